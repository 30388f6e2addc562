"""Samples of an accelerometer that is later than the gyro are moved to the gyro's clock before there is a graph.

The level of the track is computed from forces. If they are late, it is shifted along the track against the
cross-level, which is computed from rates. :mod:`trackfg.sensors.imu_filters.accelerometer_clock` estimates the delay.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from trackfg.numerics.hermite import hermite_at
from trackfg.recording.findings import Finding
from trackfg.recording.model import IMU_COLUMNS, Recording
from trackfg.sensors.imu_filters.accelerometer_clock import accelerometer_clock


def with_accelerometer_in_time(recording: Recording) -> Recording:
    """Return the recording with forces of the same time as its rates, and a finding where that moved them.

    Between samples the force is a cubic through them whose slopes are those of their neighbours (Catmull & Rom 1974):
    at a tenth of the sampling rate it keeps 0.996 of an amplitude.
    """
    clock = accelerometer_clock(recording)
    if clock is None or not clock.is_sure:
        return recording
    names, t = IMU_COLUMNS[4:], recording.imu["t_s"].to_numpy()
    force = recording.imu[list(names)].to_numpy().T
    moved = hermite_at(np.clip(t - clock.offset_s, t[0], t[-1]), t, force, np.gradient(force, t, axis=1))
    imu = recording.imu.assign(**dict(zip(names, moved, strict=True)))
    finding = Finding(
        "warning",
        "accelerometer-clock",
        f"{clock.sentence}; they were moved",
        hint="give both sensors the same filter",
    )
    return replace(recording, imu=imu, findings=(*recording.findings, finding))

"""Repeated rows of the IMU: the last sample of a slow sensor, written again at the rate of a faster table.

Tables of sensors of different rates are often brought to one rate by filling forward. Each sample of the slow ones then
stands for as long as none has come. As measurements they would be steps, known as often as they are repeated. Of a
sensor that is read so, most samples stay for about the same number of rows; where a quiet sensor of coarse steps gives
one value again by itself, it does so for any number of rows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from trackfg.numerics.arrays import Array
from trackfg.numerics.spans import median_interval
from trackfg.recording.findings import Finding
from trackfg.recording.model import IMU_COLUMNS, Recording

_REGULAR = 0.6
"""Share of the samples at least that stay for the usual number of rows, or for one more or less."""


def usual_rows(lengths: np.ndarray) -> int:
    """Return for how many rows a sample usually stays, of the ``lengths`` (n,) of runs of equal rows; 1 where they are
    not regular.
    """
    usual = int(np.median(lengths)) if len(lengths) else 1
    return usual if usual < 2 or np.mean(np.abs(lengths - usual) <= 1) >= _REGULAR else 1


def repeated_rows(channels: Sequence[Array]) -> np.ndarray:
    """Return which rows of all six channels, (n,) each, repeat a sample of a slower sensor, (n,)."""
    fresh = np.zeros(len(channels[0]), dtype=bool)
    fresh[:1] = True
    for channel in channels:
        fresh[1:] |= channel[1:] != channel[:-1]
    if fresh.all():
        return ~fresh
    starts = np.flatnonzero(fresh)
    lengths = np.diff(starts)
    usual = usual_rows(lengths)
    if usual < 2:
        return np.zeros_like(fresh)
    sample = np.cumsum(fresh) - 1
    since = np.arange(len(fresh)) - starts[sample]
    left = np.append(lengths, len(fresh) - starts[-1])[sample] - since
    is_again = (since % usual == 0) & (left >= usual - 1)  # the same value, measured again
    return np.asarray(~(fresh | is_again))


def without_repeated_rows(recording: Recording) -> Recording:
    """Return the recording with the IMU's samples at the sensor's own rate, and a finding where rows were left out."""
    imu = recording.imu
    repeated = repeated_rows([imu[name].to_numpy() for name in IMU_COLUMNS[1:]])
    if not repeated.any():
        return recording
    left = imu[~repeated].reset_index(drop=True)
    rate_hz = 1.0 / median_interval(left["t_s"].to_numpy())
    part = recording.description.imu
    message = (
        f"{np.count_nonzero(repeated)} of {len(imu)} rows repeat the row before in all six channels, and were left "
        f"out: the sensor gives {rate_hz:.3g} samples a second"
    )
    hint = "log the sensor's own rows"
    columns = ", ".join((*part.gyro, *part.accel))
    finding = Finding("warning", "rows-repeated", message, file=part.file, column=columns, hint=hint)
    return replace(recording, imu=left, findings=(*recording.findings, finding))

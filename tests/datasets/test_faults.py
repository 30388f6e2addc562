"""Faults take out what they say and nothing else."""

from dataclasses import replace

import numpy as np
import pytest

from trackfg import datasets
from trackfg.datasets.vehicle.adhesion import WheelSlip


def test_dropped_spans_are_gone():
    recording = datasets.simulate("mainline", duration_s=60.0).recording
    damaged = datasets.drop_tach(datasets.drop_imu(recording, 40.0, 45.0), 20.0, 50.0)
    assert not damaged.imu["t_s"].between(40.0, 44.999).any()
    assert not damaged.tach["t_s"].between(20.0, 49.999).any()
    assert len(damaged.imu) == len(recording.imu) - 5 * 200
    assert len(damaged.tach) == len(recording.tach) - 30 * 50
    assert damaged.tach["distance_m"].iloc[-1] == recording.tach["distance_m"].iloc[-1]
    assert len(recording.imu) == 60 * 200


def test_a_wheel_slips_by_what_is_asked_and_else_rolls_as_before():
    run = datasets.simulate("mainline", seed=2, duration_s=120.0)
    slipped = datasets.slip_wheel(run, [WheelSlip(90.0, 5.0, -1.0), WheelSlip(60.0, 10.0, 0.2)])
    before, after = run.recording.tach, slipped.recording.tach
    assert before is not None
    added = after["distance_m"] - before["distance_m"]
    quantum = np.diff(before["distance_m"]).max()
    t = before["t_s"].to_numpy()
    assert slipped.slips["kind"].tolist() == ["slip", "slide"]
    errors = slipped.slips["distance_error_m"].to_numpy() / run.wheel_scale
    assert added[t < 60.0].abs().max() == 0.0
    assert added[(t > 70.0) & (t < 90.0)].to_numpy() == pytest.approx(errors[0], abs=quantum)
    assert added[t > 95.0].to_numpy() == pytest.approx(errors.sum(), abs=quantum)
    locked = (t > 90.6) & (t < 94.4)
    assert np.ptp(after["distance_m"][locked]) <= quantum
    assert np.ptp(before["distance_m"][locked]) > 10.0
    with pytest.raises(ValueError, match="counts pulses"):
        datasets.slip_wheel(replace(run, recording=replace(run.recording, tach=None)), [])

"""Forces that are later than rates are moved before there is a graph."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from trackfg.datasets.effects.clocks import LateAccelerometer
from trackfg.datasets.scenarios import Simulation, scenario, simulate
from trackfg.evaluation.geometry_errors import geometry_errors
from trackfg.smoothing.clocks.late_accelerometer import with_accelerometer_in_time
from trackfg.smoothing.smoother import smooth


@pytest.fixture(scope="module")
def late() -> Simulation:
    return simulate(replace(scenario("mainline"), effects=(LateAccelerometer(20.0),)), seed=1, duration_s=150.0)


def test_forces_are_moved_to_the_rates(late: Simulation) -> None:
    moved, prompt = with_accelerometer_in_time(late.recording), simulate("mainline", seed=1, duration_s=150.0).recording
    (finding,) = moved.findings
    assert finding.code == "accelerometer-clock"
    assert finding.message.startswith("the accelerometer's samples are 20.")
    assert "they were moved" in finding.message
    off, was = ((of.accel - prompt.accel)[10:-10] for of in (moved, late.recording))
    assert (off.std(axis=0) < 0.3 * was.std(axis=0)).all()
    assert np.array_equal(moved.gyro, late.recording.gyro)
    assert with_accelerometer_in_time(prompt) is prompt


def test_the_level_of_a_late_accelerometer_has_its_sigmas(late: Simulation) -> None:
    result = smooth(late.recording)
    assert "accelerometer-clock" in {finding.code for finding in result.summary.findings}
    errors = geometry_errors(result.geometry, result.trajectory, late.truth, late.truth_geometry)
    for name in ("level_mm", "versine_level_mm", "versine_alignment_mm"):
        assert np.sqrt(np.nanmean((errors[name] / errors[f"{name}_sd"]) ** 2)) < 1.3

"""A record at rest throughout does not show the unit of its gyro, which is said, unless it contradicts gravity."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from trackfg.checks.contradictions.all_contradictions import diagnose
from trackfg.datasets.scenarios import simulate
from trackfg.numerics.units import STANDARD_GRAVITY
from trackfg.recording.model import IMU_COLUMNS, Recording

_BIAS = 4e-3 * np.array([1.0, -0.7, 0.4])


@pytest.fixture(scope="module")
def moving() -> Recording:
    return simulate("mainline", seed=1, duration_s=60.0).recording


def _at_rest(moving: Recording, factor: float, bias: np.ndarray = _BIAS) -> Recording:
    """Return 60 s of a sensor of phones at rest, without a tach, whose rates are multiplied by a ``factor``."""
    rng, t = np.random.default_rng(2), np.arange(0.0, 60.0, 0.01)
    gyro = factor * (bias + 6e-4 * rng.standard_normal((t.size, 3)))
    accel = [0.0, 0.0, STANDARD_GRAVITY] + 7e-3 * rng.standard_normal((t.size, 3))
    imu = pd.DataFrame(np.column_stack([t, gyro, accel]), columns=list(IMU_COLUMNS))
    description = moving.description.model_copy(update={"tach": None, "fixes": None, "balises": None})
    return replace(moving, imu=imu, tach=None, fixes=None, gnss=None, description=description)


def _found(recording: Recording) -> dict[str, tuple[str, str]]:
    return {f.code: (f.level, f"{f.message}. {f.hint}") for f in diagnose(recording)[1]}


def test_rest_throughout_says_that_the_unit_is_not_judged(moving: Recording) -> None:
    level, text = _found(_at_rest(moving, 1.0))["rest-throughout"]
    assert level == "info"
    assert "the gyro's unit is not judged: as declared (rad/s) it has a bias of 82" in text
    assert "rad/s/√Hz" in text


def test_degrees_that_tilt_while_gravity_stays_are_doubted(moving: Recording) -> None:
    level, text = _found(_at_rest(moving, 180.0 / np.pi))["gyro-unit"]
    assert level == "warning"
    assert "tilts by 0.229 rad/s, in the median, while gravity stays" in text
    assert 'set imu.gyro_unit = "deg/s"' in text


def test_degrees_whose_bias_is_small_are_as_at_no_rest(moving: Recording) -> None:
    level, text = _found(_at_rest(moving, 180.0 / np.pi, 0.0 * _BIAS))["rest-throughout"]
    assert level == "info"
    assert "as at no rest" in text


def test_a_run_is_neither(moving: Recording) -> None:
    assert not {"rest-throughout", "gyro-unit"} & _found(moving).keys()
    without_wheel = replace(moving, tach=None, fixes=None, gnss=None)
    assert not {"rest-throughout", "gyro-unit"} & _found(without_wheel).keys()

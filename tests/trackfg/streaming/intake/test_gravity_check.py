"""The first rows of a stream are judged by where they show gravity."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from trackfg.checks.limits import CheckLimits
from trackfg.errors import BadInputError
from trackfg.numerics.arrays import Array
from trackfg.recording.description import Imu
from trackfg.streaming.intake.gravity_check import GravityCheck

IMU = Imu(file="-", gyro=("wx", "wy", "wz"), accel=("fx", "fy", "fz"))
DOWN = (0.0, 0.0, -9.81)


def rows(force: tuple[float, float, float], begin_s: float, duration_s: float) -> Array:
    t = begin_s + np.arange(0.0, duration_s, 0.01)
    return np.column_stack([t, np.zeros((t.size, 3)), np.broadcast_to(force, (t.size, 3))])


@pytest.mark.parametrize(
    ("force", "says"),
    [
        (DOWN, "imu, column 'fz': gravity is on the wrong axis or sign"),
        ((0.0, 0.0, 1.0), 'set imu.accel_unit = "g"'),
        ((0.1, 0.0, 0.0), "gravity seems to have been removed"),
        ((0.0, 7.0, 7.0), "description, column 'imu.axes': gravity is 45 deg off"),
    ],
)
def test_rows_that_show_gravity_elsewhere_are_refused(force: tuple[float, float, float], says: str) -> None:
    check = GravityCheck(CheckLimits())
    check.take(rows(force, 0.0, 9.0), IMU)
    with pytest.raises(BadInputError, match="the first 10 s of the stream: ") as refused:
        check.take(rows(force, 9.0, 2.0), IMU)
    assert says in str(refused.value)


def test_a_hole_is_no_time_with_rows_and_later_rows_are_not_judged() -> None:
    check = GravityCheck(CheckLimits())
    check.take(rows(DOWN, 0.0, 4.0), IMU)
    check.take(rows((0.0, 0.0, 9.7), 60.0, 7.0), IMU)
    check.take(rows(DOWN, 67.0, 60.0), IMU)


def test_what_waits_is_kept_over_a_checkpoint(saved_and_restored: Callable[..., Any]) -> None:
    check = GravityCheck(CheckLimits())
    check.take(rows(DOWN, 0.0, 9.0), IMU)
    with pytest.raises(BadInputError):
        saved_and_restored(check).take(rows(DOWN, 9.0, 2.0), IMU)

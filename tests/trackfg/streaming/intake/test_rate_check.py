"""Angular rates that no vehicle holds are named once, wherever in the stream they come."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from trackfg.checks.limits import CheckLimits
from trackfg.numerics.arrays import Array
from trackfg.recording.description import Imu
from trackfg.results.events import DOUBT, Event
from trackfg.streaming.intake.rate_check import RateCheck

IMU = Imu(file="-", gyro=("wx", "wy", "wz"), accel=("fx", "fy", "fz"))


def events_of(
    yaw_rate: float, speed_mps: float, seconds: float, again: Callable[[Any], Any] = lambda check: check
) -> Any:
    """Return the events of a minute of straight track and a curve of some seconds, in pieces of 0.1 s."""
    t = np.arange(0.0, 80.0, 0.01)
    rows: Array = np.zeros((t.size, 7))
    rows[:, 0], rows[:, 3] = t, np.where((t > 60.0) & (t < 60.0 + seconds), yaw_rate, 0.0)
    tach = np.column_stack([t, speed_mps * t])
    check, events = RateCheck(CheckLimits()), list[Event]()
    for part, rolled in zip(np.split(rows, 800), np.split(tach, 800), strict=True):
        check = again(check)
        event = check.take(part, rolled, IMU)
        events += [] if event is None else [event]
    return events


@pytest.mark.parametrize(("degrees", "speed_mps"), [(3.0, 5.0), (1.1, 20.0)])
def test_a_curve_in_degrees_is_named_once(
    degrees: float, speed_mps: float, saved_and_restored: Callable[..., Any]
) -> None:
    """In deg/s a curve of R 100 at 5 m/s turns by 3, one of R 1000 at 20 m/s by 1.1."""
    (event,) = events_of(degrees, speed_mps, 15.0)
    assert (event.kind, event.table, event.t_s) == (DOUBT, "imu", pytest.approx(60.0, abs=0.6))
    assert event.detail.endswith('set imu.gyro_unit = "deg/s", and begin anew')
    assert events_of(degrees, speed_mps, 15.0, saved_and_restored) == [event]


def test_a_curve_and_a_blow_are_none() -> None:
    assert events_of(0.2, 10.0, 15.0) == []
    assert events_of(10.0, 10.0, 3.0) == []

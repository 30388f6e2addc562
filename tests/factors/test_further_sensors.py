"""The sense of what a further sensor's factors say, in cases that can be worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest

from trackfg.factors.further_sensors import speed_distance, tach_increment
from trackfg.factors.states import SHARED, Kind, Nav, Odo, States

FIRST = np.array([0])
SIGMA = np.full((1, 1), 0.01)


def moved(distance: float, sensor: tuple[float, float], traction: float = 0.0) -> States:
    """Two keyframes with so far between them."""
    odo = np.array([[0.0, 1.0, 0.0, 0.0], [distance, 1.0, 0.0, distance]])
    nav = Nav(np.tile(np.eye(3), (2, 1, 1)), np.zeros((2, 3)), np.zeros((2, 3)))
    mount, clock, imu, wheel = (np.zeros((1, kind.dim)) for kind in SHARED)
    wheel[0, 2] = traction
    return States(nav, np.zeros((2, Kind.BIAS.dim)), Odo(odo), mount, clock, imu, wheel, np.array([sensor]))


def test_a_radar_that_sees_more_is_positive() -> None:
    """2 % more than it shows: 10 m shown are 10.2 m, 0.2 m more than the vehicle has moved."""
    measured = {"distance": np.array([10.0]), "swing": np.zeros(1), "across": np.zeros(1)}
    family = speed_distance(FIRST, 0, measured, SIGMA, None, "speed/1")
    assert family.residual(moved(10.0, (0.02, 0.0)))[0, 0] == pytest.approx(0.2)


def test_a_radar_ahead_that_looks_inwards_sees_its_front_swing() -> None:
    """3 m ahead, in a turn to the left by 0.1 rad, its place moves 0.3 m to the left: it looks there by 1 %."""
    measured = {"distance": np.array([10.003]), "swing": np.zeros(1), "across": np.array([0.3])}
    family = speed_distance(FIRST, 0, measured, SIGMA, None, "speed/1")
    assert family.residual(moved(10.0, (0.0, 0.01)))[0, 0] == pytest.approx(0.0, abs=1e-12)


def test_a_wheel_that_turns_more_is_positive_and_a_late_clock_counts_what_came_before() -> None:
    """In a second in which it gets 1 m/s faster, a clock 0.1 s behind shows the count of 0.1 s later: 0.1 m more."""
    measured = {"counted": np.array([10.1]), "faster": np.array([1.0]), "response": np.zeros((1, 5))}
    family = tach_increment(FIRST, 0, measured, SIGMA, None, "tach/2")
    assert family.residual(moved(10.0, (0.0, 0.1)))[0, 0] == pytest.approx(0.0, abs=1e-12)
    assert family.residual(moved(10.0, (0.0, 0.0)))[0, 0] == pytest.approx(0.1)


def test_creep_in_traction_is_no_slip() -> None:
    measured = {"counted": np.array([10.1]), "faster": np.zeros(1), "response": np.array([[0.0, 0.0, 2.0, 0.0, 0.0]])}
    family = tach_increment(FIRST, 0, measured, SIGMA, None, "tach/2")
    assert family.residual(moved(10.0, (0.0, 0.0), traction=0.05))[0, 0] == pytest.approx(0.0, abs=1e-12)

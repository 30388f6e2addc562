"""GNSS positions: the lever arm's and the clock's signs, worked out by hand."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from trackfg.factors.gnss import ReceiverSpeeds, gnss_position, gnss_speed
from trackfg.factors.states import Nav, States
from trackfg.numerics.rotations import matrix_from_rpy


def moving(states: States) -> States:
    """At (100, 0, 0) m, facing e2 (yaw 90 degrees), at 20 m/s that way."""
    R = matrix_from_rpy(np.zeros(1), np.zeros(1), np.full(1, np.pi / 2.0))
    return replace(states, nav=Nav(R, np.array([[100.0, 0.0, 0.0]]), np.array([[0.0, 20.0, 0.0]])))


def test_stamps_of_a_receiver_whose_clock_is_slow_are_early(at_origin: Callable[[int], States]) -> None:
    """The antenna is 2 m ahead and 3 m up: from (100, 0, 0) it is at (100, 2, 3) m. At 20 m/s along e2 a position
    stamped 0.1 s after the keyframe, to whose stamp T = +0.05 s is to be added, was taken 3 m further on, at
    (100, 5, 3) m. Without the offset the model is 1 m short of it, and by T it grows with the velocity.
    """
    states, measured = moving(at_origin(1)), np.array([[100.0, 5.0, 3.0]])
    family = gnss_position(np.array([0]), measured, np.array([2.0, 0.0, 3.0]), np.array([0.1]), np.ones((1, 3)), None)
    slow = replace(states, clock=np.array([[0.0, 0.0, 0.05]]))
    np.testing.assert_allclose(family.residual(slow), np.zeros((1, 3)), atol=1e-12)
    np.testing.assert_allclose(family.residual(states), [[0.0, -1.0, 0.0]], atol=1e-12)
    by_clock = family.linearize(slow).jacobians[1][0]
    np.testing.assert_allclose(by_clock[:, 2], [0.0, 20.0, 0.0], atol=1e-12)
    assert by_clock[:, :2] == pytest.approx(0.0)


def test_an_antenna_may_be_elsewhere_from_the_sensor(at_origin: Callable[[int], States]) -> None:
    """Facing e2, an antenna that is 1 m further ahead and 0.5 m further left than declared is 1 m further along e2 and
    0.5 m against e1.
    """
    states = replace(moving(at_origin(1)), sensor=np.array([[0.0, 0.0], [1.0, 0.5]]))
    measured = np.array([[99.5, 3.0, 3.0]])
    family = gnss_position(np.array([0]), measured, np.array([2.0, 0.0, 3.0]), np.zeros(1), np.ones((1, 3)), None, 1)
    np.testing.assert_allclose(family.residual(states), np.zeros((1, 3)), atol=1e-12)


def speeds(speed: float, delay: float, rate: list[float], force: list[float], sd: float) -> ReceiverSpeeds:
    """One speed of a receiver."""
    return ReceiverSpeeds(np.array([speed]), np.array([delay]), np.array([rate]), np.array([force]), np.array([[sd]]))


def test_a_speed_is_that_of_the_antenna_at_its_own_time(at_origin: Callable[[int], States]) -> None:
    """The antenna is 3 m to the left; turning left at 0.1 rad/s it is 0.3 m/s slower than the IMU, which drives at 20
    m/s along e2 and gains 1 m/s^2 forwards (9.8 m/s^2 upwards is gravity's). A speed stamped 0.5 s after the keyframe,
    to whose stamp q = -0.7 s is to be added, was measured 0.2 s before it: at 20 - 0.3 - 0.2 = 19.5 m/s. By q it grows
    with the acceleration, and by its offset b, 0.1 m/s here, as it is.
    """
    states = moving(at_origin(1))
    states = replace(states, sensor=np.array([[0.0, 0.0], [0.1, -0.7]]))
    measured = speeds(19.5, 0.5, [0.0, 0.0, 0.1], [1.0, 0.0, 9.8], 1e-9)
    family = gnss_speed(np.array([0]), 1, measured, np.array([0.0, 3.0, 1.0]), np.ones((1, 1)), None)
    np.testing.assert_allclose(family.residual(states), [[0.1]], atol=1e-9)
    np.testing.assert_allclose(family.linearize(states).jacobians[1][0], [[1.0, 1.0]], atol=1e-9)


@pytest.mark.parametrize("speed", [0.3, 0.5, 2.0])
def test_a_speed_is_expected_where_its_noise_has_it_on_average(
    at_origin: Callable[[int], States], speed: float
) -> None:
    """Components that err by 0.1 m/s each make a length that is too large: by 0.015 m/s at 0.3 m/s."""
    states = at_origin(1)
    states = replace(states, nav=replace(states.nav, v=np.array([[0.0, speed, 0.2]])), sensor=np.zeros((1, 2)))
    noise = 0.1 * np.random.default_rng(1).standard_normal((1_000_000, 2))
    mean = float(np.mean(np.hypot(noise[:, 0], speed + noise[:, 1])))
    measured = speeds(mean, 0.0, [0.0] * 3, [0.0] * 3, 0.1)
    family = gnss_speed(np.array([0]), 0, measured, np.zeros(3), np.ones((1, 1)), None)
    assert abs(family.residual(states).item()) < 0.0015
    assert mean - speed > 0.002


def test_at_rest_a_speed_says_nothing(at_origin: Callable[[int], States]) -> None:
    states = replace(at_origin(1), sensor=np.zeros((1, 2)))
    measured = speeds(0.12, 0.0, [0.0] * 3, [0.0, 0.0, 9.8], 0.1)
    family = gnss_speed(np.array([0]), 0, measured, np.zeros(3), np.ones((1, 1)), None)
    np.testing.assert_allclose(family.linearize(states).jacobians[0], 0.0, atol=1e-12)

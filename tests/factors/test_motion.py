"""Motion along the track: the lever arm's and the mounting's signs, worked out by hand."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from trackfg.factors.motion import non_holonomic
from trackfg.factors.states import Nav, States

UNIT = np.zeros(1), np.zeros((1, 2)), np.ones((1, 2))
"""A sigma of 1 m/s at any speed."""

AtOrigin = Callable[[int], States]


def going(states: States, velocity: list[float]) -> States:
    """The keyframe at this velocity, m/s."""
    return replace(states, nav=Nav(states.nav.R, states.nav.p, np.array([velocity])))


def test_a_sensor_above_the_reference_point_swings_when_the_vehicle_rolls(at_origin: AtOrigin) -> None:
    """The sensor is 2 m above it. At +0.1 rad/s, left side up, it swings by w x l = (0.1, 0, 0) x (0, 0, 2), 0.2 m/s to
    the right. The vehicle itself does not move sideways.
    """
    rate, arm = np.array([[0.1, 0.0, 0.0]]), np.array([0.0, 0.0, 2.0])
    family = non_holonomic(np.array([0]), rate, arm, *UNIT, None)
    np.testing.assert_allclose(family.residual(going(at_origin(1), [10.0, -0.2, 0.0])), [[0.0, 0.0]], atol=1e-12)
    np.testing.assert_allclose(family.residual(going(at_origin(1), [10.0, 0.0, 0.0])), [[0.2, 0.0]], atol=1e-12)


@pytest.mark.parametrize(
    ("mount", "direction"),
    [([0.0, 0.1], [np.cos(0.1), np.sin(0.1), 0.0]), ([0.1, 0.0], [np.cos(0.1), 0.0, -np.sin(0.1)])],
    ids=["yaw", "pitch"],
)
def test_a_sensor_sees_the_direction_of_travel_as_it_is_mounted(
    at_origin: AtOrigin, mount: list[float], direction: list[float]
) -> None:
    """Mounting yaw of +0.1 rad: the vehicle travels 0.1 rad to the left of the sensor's forward axis. Mounting pitch of
    +0.1 rad: it travels 0.1 rad below it.
    """
    family = non_holonomic(np.array([0]), np.zeros((1, 3)), np.zeros(3), *UNIT, None)
    states = replace(at_origin(1), mount=np.array([[*mount, 0.0, 0.0, 0.0]]))
    along = [10.0 * part for part in direction]
    np.testing.assert_allclose(family.residual(going(states, along)), [[0.0, 0.0]], atol=1e-12)


def test_a_point_that_follows_the_track_is_where_nothing_swings(at_origin: AtOrigin) -> None:
    """The sensor is 10 m ahead of it and swings by w x c = (0, 0, 0.04) x (10, 0, 0), 0.4 m/s to the left in a curve
    to the left. The point is 10 m behind the reference point, which is the sensor's own.
    """
    rate = np.array([[0.0, 0.0, 0.04]])
    family = non_holonomic(np.array([0]), rate, np.zeros(3), *UNIT, None)
    behind = replace(at_origin(1), mount=np.array([[0.0, 0.0, -10.0, 0.0, 0.0]]))
    np.testing.assert_allclose(family.residual(going(behind, [20.0, 0.4, 0.0])), [[0.0, 0.0]], atol=1e-12)
    np.testing.assert_allclose(family.residual(going(at_origin(1), [20.0, 0.4, 0.0])), [[0.4, 0.0]], atol=1e-12)


@pytest.mark.parametrize("speed", [5.0, 20.0, 80.0])
def test_a_turn_against_the_path_is_as_unlikely_at_any_speed(at_origin: AtOrigin, speed: float) -> None:
    """The body is turned by 0.001 rad against its path. At the 20 m/s for which the sigma, in proportion to the speed,
    is given, it moves sideways by 0.02 m/s: so much is the residual whatever its speed is in the end.
    """
    at = np.array([20.0]), np.full((1, 2), 1.0 / 20.0), np.ones((1, 2))
    family = non_holonomic(np.array([0]), np.zeros((1, 3)), np.zeros(3), *at, None)
    turned = going(at_origin(1), [speed, 1e-3 * speed, 0.0])
    np.testing.assert_allclose(family.residual(turned), [[0.02, 0.0]], atol=1e-12)
    np.testing.assert_allclose(family.residual(going(turned, [-speed, 1e-3 * speed, 0.0])), [[0.02, 0.0]], atol=1e-12)

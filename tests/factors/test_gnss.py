"""GNSS positions: the lever arm's and the clock's signs, worked out by hand."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from trackfg.factors.gnss import gnss_position
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

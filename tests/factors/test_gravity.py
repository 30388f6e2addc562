"""Gravity tilt: the signs of the tilt and of the bias, worked out by hand."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from trackfg.factors.gravity import gravity_tilt
from trackfg.factors.states import Nav, States
from trackfg.numerics.rotations import matrix_from_rpy

GRAVITY = 9.8


def test_a_bias_is_added_to_what_is_measured_of_gravity(at_origin: Callable[[int], States]) -> None:
    """At rest and level an accelerometer with the bias (0.1, -0.2, 0.05) shows (0.1, -0.2, 9.85) m/s^2."""
    force, bias = np.array([[0.1, -0.2, GRAVITY + 0.05]]), np.array([[0.1, -0.2, 0.05, 0.0, 0.0, 0.0]])
    family = gravity_tilt(np.array([0]), force, GRAVITY, np.ones((1, 3)))
    biased = replace(at_origin(1), bias=bias)
    np.testing.assert_allclose(family.residual(biased), np.zeros((1, 3)), atol=1e-12)
    np.testing.assert_allclose(family.linearize(biased).jacobians[1][0, :, :3], np.eye(3))


def test_a_side_that_is_up_measures_gravity_towards_itself(at_origin: Callable[[int], States]) -> None:
    """Rolled by +0.1 rad, left side up, the reaction g of the ground is (0, g sin 0.1, g cos 0.1) in body axes: it
    has a part to the left. Pitched by +0.1 rad, nose down, it is (-g sin 0.1, 0, g cos 0.1).
    """
    s, c = GRAVITY * np.sin(0.1), GRAVITY * np.cos(0.1)
    R = matrix_from_rpy(np.array([0.1, 0.0]), np.array([0.0, 0.1]), np.array([0.7, -2.0]))
    states = replace(at_origin(2), nav=Nav(R, *np.zeros((2, 2, 3))))
    family = gravity_tilt(np.arange(2), np.array([[0.0, s, c], [-s, 0.0, c]]), GRAVITY, np.ones((2, 3)))
    np.testing.assert_allclose(family.residual(states), np.zeros((2, 3)), atol=1e-12)

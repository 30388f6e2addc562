"""The factor that stands for keyframes that are gone."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from trackfg.factors.checking import check_jacobians
from trackfg.factors.marginal_prior import (
    marginal_prior,
    rebased_to_interval_bias,
    retract_in_chart,
    step_from,
    with_distance_shifted,
    with_scale_walked,
)
from trackfg.factors.states import KEYFRAME_DIM, SHARED, SHARED_DIM, Kind, Nav, Odo, States, Step, offset_in_keyframe
from trackfg.numerics.rotations import matrix_from_rpy

DIM = KEYFRAME_DIM + SHARED_DIM


def one_keyframe(rng: np.random.Generator) -> States:
    R = matrix_from_rpy(*(0.3 * rng.standard_normal((3, 1))))
    nav = Nav(R, *rng.standard_normal((2, 1, 3)))
    shared = (rng.standard_normal((1, kind.dim)) for kind in SHARED)
    return States(nav, rng.standard_normal((1, Kind.BIAS.dim)), Odo(rng.standard_normal((1, Kind.ODO.dim))), *shared)


def a_step(rng: np.random.Generator, size: float) -> Step:
    tangent = size * rng.standard_normal(DIM)
    return Step(tangent[None, :KEYFRAME_DIM], tangent[KEYFRAME_DIM:])


def test_it_measures_from_where_it_was_linearised() -> None:
    rng = np.random.default_rng(0)
    origin, step, rows = one_keyframe(rng), a_step(rng, 0.3), rng.standard_normal((DIM, DIM + 1))
    states = retract_in_chart(origin, step)
    x = np.concatenate([step.keyframes[0], step.shared])
    np.testing.assert_allclose(
        marginal_prior(rows, origin).residual(states)[0], rows[:, :-1] @ x - rows[:, -1], atol=1e-9
    )
    back = step_from(origin, states)
    np.testing.assert_allclose(np.concatenate([back.keyframes[0], back.shared]), x, atol=1e-12)


def test_small_steps_are_those_of_the_graph() -> None:
    rng = np.random.default_rng(1)
    origin, step = one_keyframe(rng), a_step(rng, 1e-6)
    one, other = retract_in_chart(origin, step).nav, origin.moved(step).nav
    np.testing.assert_allclose(one.R, other.R, atol=1e-11)
    np.testing.assert_allclose(one.v, other.v, atol=1e-9)


@pytest.mark.parametrize("sensors", [0, 2])
def test_kernels_move_states_as_numpy_does(
    sensors: int, with_both: Callable[[Callable[[], Any]], tuple[Any, Any]]
) -> None:
    """By a step and back, over several keyframes, in the chart of the graph and in this one."""
    rng = np.random.default_rng(3)
    origin = replace(one_keyframe(rng).joined(one_keyframe(rng)), sensor=rng.standard_normal((sensors, 2)))
    step = Step(0.4 * rng.standard_normal((2, KEYFRAME_DIM)), 0.4 * rng.standard_normal(SHARED_DIM + 2 * sensors))

    def computed() -> list[np.ndarray]:
        one, other = origin.moved(step), retract_in_chart(origin, step)
        back = step_from(origin, other)
        return [*one.arrays, one.sensor, *other.arrays, other.sensor, back.keyframes, back.shared]

    for ours, theirs in zip(*with_both(computed), strict=True):
        np.testing.assert_allclose(ours, theirs, atol=1e-13)


def turned(states: States, angle: float) -> States:
    """With the velocity, about the vertical."""
    about = matrix_from_rpy(np.zeros(1), np.zeros(1), np.full(1, angle))
    nav = states.nav
    return replace(states, nav=Nav(about @ nav.R, nav.p, np.einsum("mij,mj->mi", about, nav.v)))


def test_a_turn_about_the_vertical_leaves_roll_and_pitch() -> None:
    origin = one_keyframe(np.random.default_rng(2))
    x = step_from(origin, turned(origin, 2.0)).of(Kind.NAV)[0, :3]
    np.testing.assert_allclose(x, 2.0 * origin.nav.R[0, 2], atol=1e-12)


def test_a_turn_about_the_vertical_leaves_the_speed_however_far_it_goes() -> None:
    origin = one_keyframe(np.random.default_rng(2))
    little, far = (step_from(origin, turned(origin, angle)).of(Kind.NAV)[0] / angle for angle in (1e-6, 2.0))
    np.testing.assert_allclose(far, little, atol=1e-9)
    tangent = (turned(origin, 1e-6).nav.v - origin.nav.v) @ origin.nav.R[0] / 1e-6
    np.testing.assert_allclose(little[6:], tangent[0], atol=1e-5)


def test_jacobians() -> None:
    rng = np.random.default_rng(3)
    origin = one_keyframe(rng)
    family = marginal_prior(rng.standard_normal((DIM, DIM + 1)), origin)
    check_jacobians(family, retract_in_chart(origin, a_step(rng, 0.2)), rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("sensors", [0, 2])
def test_the_kernel_computes_what_numpy_does(
    sensors: int, with_both: Callable[[Callable[[], Any]], tuple[Any, Any]]
) -> None:
    """On a keyframe that is not the first, and far from the linearisation point."""
    rng = np.random.default_rng(3)
    origin = replace(one_keyframe(rng), sensor=rng.standard_normal((sensors, 2)))
    dim = DIM + 2 * sensors
    step = a_step(rng, 0.2)
    step = Step(step.keyframes, np.append(step.shared, 0.2 * rng.standard_normal(2 * sensors)))
    family = marginal_prior(rng.standard_normal((dim, dim + 1)), origin).shifted(1)
    states = origin.joined(retract_in_chart(origin, step))
    ours, theirs = with_both(lambda: (family.linearize(states).rows, family.whitened(states)))
    for found, expected in zip(ours, theirs, strict=True):
        np.testing.assert_allclose(found, expected, rtol=1e-10, atol=1e-10)


def test_a_past_elsewhere_has_lost_the_distance_alone() -> None:
    rng = np.random.default_rng(3)
    origin, rows, by, sd = one_keyframe(rng), rng.standard_normal((DIM, DIM + 1)), 40.0, 25.0
    family = with_distance_shifted(marginal_prior(rows, origin), by, sd)
    A, b = family.data["A"][0], family.data["b"][0]
    at = offset_in_keyframe(Kind.ODO)
    before, after = np.linalg.inv(rows[:, :-1].T @ rows[:, :-1]), np.linalg.inv(A.T @ A)
    before[at, at] += sd**2
    np.testing.assert_allclose(after, before, rtol=1e-6, atol=1e-6 * np.abs(before).max())
    expected, found = np.linalg.solve(rows[:, :-1], rows[:, -1]), after @ A.T @ b
    np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-6)
    step = a_step(rng, 0.1)
    states = retract_in_chart(origin, step)
    x = np.concatenate([step.keyframes[0], step.shared])
    there = replace(states, odo=states.odo.moved_along(by))
    np.testing.assert_allclose(family.residual(there)[0], A @ x - b, atol=1e-9)


def test_a_scale_that_may_have_walked_makes_distance_and_speed_unsure_with_it() -> None:
    """Draws of a walk in 200 steps of the way have the covariance that the prior gets besides its own."""
    rng = np.random.default_rng(4)
    origin, way, walk = one_keyframe(rng), -400.0, 5e-3
    rows = np.eye(DIM, DIM + 1) + 0.05 * rng.standard_normal((DIM, DIM + 1))
    family = with_scale_walked(marginal_prior(rows, origin), way, walk)
    A, b = family.data["A"][0], family.data["b"][0]
    scale = np.cumsum(rng.normal(0.0, walk * np.sqrt(abs(way) / 200), (20000, 200)), axis=1)
    drawn = np.zeros((20000, DIM))
    odo, nav = offset_in_keyframe(Kind.ODO), offset_in_keyframe(Kind.NAV)
    drawn[:, odo + Odo.DISTANCE], drawn[:, odo + Odo.SCALE] = scale.mean(axis=1) * way, scale[:, -1]
    drawn[:, nav + 6 : nav + 9] = scale[:, -1:] * origin.nav.own_velocity / origin.odo.scale
    added = np.linalg.inv(A.T @ A) - np.linalg.inv(rows[:, :-1].T @ rows[:, :-1])
    expected = np.cov(drawn.T)
    size = np.sqrt(np.diagonal(expected))
    assert (np.abs(added - expected) <= 0.03 * np.outer(size, size) + 1e-6).all()
    before, after = np.linalg.solve(rows[:, :-1], rows[:, -1]), np.linalg.lstsq(A, b, rcond=None)[0]
    np.testing.assert_allclose(after, before, rtol=1e-6, atol=1e-6)


def test_yaw_is_measured_the_short_way_round() -> None:
    """From yaw 3.1 to yaw -3.1 rad a level vehicle has turned left by 2 pi - 6.2 = 0.083 rad, not right by 6.2."""
    level = one_keyframe(np.random.default_rng(4))
    before, after = (
        replace(level, nav=Nav(matrix_from_rpy(np.zeros(1), np.zeros(1), np.full(1, yaw)), *np.zeros((2, 1, 3))))
        for yaw in (3.1, -3.1)
    )
    there, back = (step_from(*ends).of(Kind.NAV)[0, :3] for ends in ((before, after), (after, before)))
    np.testing.assert_allclose(there, [0.0, 0.0, 2.0 * np.pi - 6.2], atol=1e-12)
    np.testing.assert_allclose(back, [0.0, 0.0, 6.2 - 2.0 * np.pi], atol=1e-12)


def test_bias_of_an_interval_is_the_sensors_own_and_what_the_calibration_adds() -> None:
    """With b = own + response c the factor says of (b, c) what it said of (own, c): the same residual, whatever c."""
    rng = np.random.default_rng(5)
    origin, rows, response = (
        one_keyframe(rng),
        rng.standard_normal((DIM, DIM + 1)),
        rng.standard_normal((6, Kind.IMU.dim)),
    )
    own = retract_in_chart(origin, a_step(rng, 0.2))
    interval = replace(own, bias=own.bias + own.imu @ response.T)
    family = marginal_prior(rows, origin)
    np.testing.assert_allclose(
        rebased_to_interval_bias(family, response).residual(interval), family.residual(own), atol=1e-9
    )

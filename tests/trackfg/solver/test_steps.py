"""The solver's step control and stop rule on one variable, worked out by hand."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from trackfg.config import SolverConfig
from trackfg.factors.factor_type import FactorType
from trackfg.factors.family import Family
from trackfg.factors.imu import InertialFactors
from trackfg.factors.linear import Slot
from trackfg.factors.loss import Cauchy
from trackfg.factors.odometry import absolute_fix
from trackfg.factors.prior import nav_prior, prior
from trackfg.factors.states import Kind, Nav, Odo, States
from trackfg.solver.gauss_newton import solve

TIGHT = SolverConfig(step_tolerance=1e-6, cost_tolerance=1e-14)
VAGUE = 1e6
"""Sigma of the distance before any measurement."""


def one_keyframe(distance: float, *measured: Family) -> Any:
    """A graph of one keyframe at the origin, of which only the distance is open, to be solved from ``distance``."""
    index = np.array([0])
    nav = Nav(np.eye(3)[None], *np.zeros((2, 1, 3)))
    odo = np.array([[distance, 1.0, 0.0, 0.0]])
    shared = [np.zeros((1, kind.dim)) for kind in (Kind.MOUNT, Kind.CLOCK, Kind.IMU, Kind.WHEEL)]
    others = [kind for kind in Kind if kind not in (Kind.NAV, Kind.ODO, Kind.SENSOR)]
    priors = [prior(kind, index, np.zeros((1, kind.dim)), np.ones((1, kind.dim))) for kind in others]
    return SimpleNamespace(
        t=np.zeros(1),
        initial=States(nav, np.zeros((1, Kind.BIAS.dim)), Odo(odo), *shared),
        inertial=InertialFactors(()),
        families=(
            *priors,
            nav_prior(index, nav, np.ones((1, 9)), np.zeros(3)),
            prior(Kind.ODO, index, odo, np.array([[VAGUE, 1.0, 1.0, 1.0]])),
            *measured,
        ),
    )


def of_distance(value: Callable[[np.ndarray], np.ndarray], slope: Callable[[np.ndarray], np.ndarray]) -> Family:
    """A residual that is a function of the distance, sigma 1."""

    def evaluate(odo: Odo) -> tuple[np.ndarray, tuple[np.ndarray, ...]]:
        jacobian = np.zeros((len(odo), 1, Kind.ODO.dim))
        jacobian[:, 0, 0] = slope(odo.distance)
        return value(odo.distance[:, None]), (jacobian,)

    return Family(FactorType.CUSTOM, evaluate, (Slot(Kind.ODO, np.array([0])),), {}, np.ones((1, 1)))


def test_a_step_that_raises_the_cost_is_halved() -> None:
    """The residual atan(x) at x = 1.5: the full step is -atan(1.5) (1 + 1.5^2) = -3.194, to x = -1.694, where the cost
    is 0.54 instead of 0.48; from there full steps go further and further away. Half of it leads to -0.097.
    """
    graph = one_keyframe(1.5, of_distance(np.arctan, lambda x: 1.0 / (1.0 + x**2)))
    once = solve(graph, TIGHT.model_copy(update={"max_iterations": 1}))
    assert once.states.odo.distance[0] == pytest.approx(1.5 - 0.5 * np.arctan(1.5) * (1.0 + 1.5**2), abs=1e-6)
    solution = solve(graph, TIGHT)
    assert solution.converged
    assert solution.states.odo.distance[0] == pytest.approx(0.0, abs=1e-6)


def test_a_step_that_helps_is_doubled_while_that_helps_more() -> None:
    """Fixes at 0 and 30 m, sigma 1 m, Cauchy's loss of width 1, which is on from the start at 20 m. Their weights there
    are 1 / 401 and 1 / 101, and the step leads to their mean, 30 401 / 502 = 23.964 m. Twice as long it leads closer to
    30 m, where the one fix alone has weight; four times as long beyond.
    """
    fixes = absolute_fix(np.zeros(2, dtype=np.int64), np.array([0.0, 30.0]), np.ones((2, 1)), Cauchy(1.0))
    once = solve(one_keyframe(20.0, fixes), TIGHT.model_copy(update={"max_iterations": 1}), near=True)
    assert once.states.odo.distance[0] == pytest.approx(20.0 + 2.0 * 3.964, abs=1e-3)


def test_a_step_that_is_too_short_is_doubled_where_less_is_gained_than_expected() -> None:
    """The residual x^2 at x = 1: the step is -x / 2 wherever it begins, half as long as it ought to be. Twice as long
    it ends at the minimum, four times as long at -1, where the cost is that of the start.
    """
    graph = one_keyframe(1.0, of_distance(np.square, lambda x: 2.0 * x))
    once = solve(graph, TIGHT.model_copy(update={"max_iterations": 1}))
    assert once.states.odo.distance[0] == pytest.approx(0.0, abs=1e-9)
    assert once.cost < 1e-12 < once.initial_cost


def test_a_step_is_not_doubled_where_the_cost_is_a_parabola() -> None:
    """Two fixes without a loss: the full step ends at their mean."""
    fixes = absolute_fix(np.zeros(2, dtype=np.int64), np.array([0.0, 30.0]), np.ones((2, 1)), None)
    once = solve(one_keyframe(20.0, fixes), TIGHT.model_copy(update={"max_iterations": 1}), near=True)
    assert once.states.odo.distance[0] == pytest.approx(15.0, abs=1e-6)
    assert once.trials == 1


def test_the_minimum_of_plain_squares_is_not_the_end() -> None:
    """Fixes at 0, 0 and 30 m, sigma 1 m, Cauchy's loss of width 1. Without the loss the minimum is their mean, 10 m,
    and the step from there is nothing. With it the wrong one lets go: 2 x / (1 + x^2) = (30 - x) / (1 + (30 - x)^2)
    at x = 0.0167.
    """
    fixes = absolute_fix(np.zeros(3, dtype=np.int64), np.array([0.0, 0.0, 30.0]), np.ones((3, 1)), Cauchy(1.0))
    solution = solve(one_keyframe(10.0, fixes), TIGHT)
    x = solution.states.odo.distance[0]
    assert solution.converged
    assert x == pytest.approx(0.0167, abs=1e-4)
    assert 2.0 * x / (1.0 + x**2) == pytest.approx((30.0 - x) / (1.0 + (30.0 - x) ** 2), rel=1e-3)


def test_losses_are_on_once_a_step_is_short_or_none_helps() -> None:
    """A start at the minimum of plain squares, two iterations: the second one has the losses already."""
    fixes = absolute_fix(np.zeros(3, dtype=np.int64), np.array([0.0, 0.0, 30.0]), np.ones((3, 1)), Cauchy(1.0))
    solution = solve(one_keyframe(10.0, fixes), TIGHT.model_copy(update={"max_iterations": 2}))
    assert solution.states.odo.distance[0] < 9.0

"""GTSAM's own optimiser finds the same minimum of the exported graph, and a user's factors shift it as they should."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import gtsam
import numpy as np
import pytest

from trackfg.config import SmoothConfig, SolverConfig
from trackfg.datasets import slip_wheel
from trackfg.datasets.scenarios import Simulation, scenario, simulate
from trackfg.datasets.sensors.receiver_speeds import ReceiverSpeeds
from trackfg.datasets.vehicle.adhesion import WheelSlip
from trackfg.factors.factor_type import FactorType
from trackfg.factors.landmark import landmark
from trackfg.factors.loss import Cauchy
from trackfg.factors.marginal_prior import step_from
from trackfg.factors.states import KEYFRAME_DIM, Kind, Odo, States, Step, offset_in_keyframe
from trackfg.graph import GtsamProblem, Problem, build_problem
from trackfg.solver import Solution, posterior_covariance, solve
from trackfg.solver.elimination import eliminate

TIGHT = SolverConfig(step_tolerance=1e-9, cost_tolerance=1e-13, max_iterations=100)
ROUNDING = 1e-5
"""Sigmas: comparing costs of some hundred, as GTSAM and our solver do, hides a few millionths of a sigma."""
SAME = 1e-6
"""Sigmas: what undamped steps, which compare no costs, may leave."""

Make = Callable[..., Simulation]


def with_outliers(simulated: Make) -> Problem:
    """GNSS positions, some of them beyond Huber's width."""
    return build_problem(simulated("mainline-gnss", seed=2, duration_s=60.0).recording, SmoothConfig())


def with_slip(simulated: Make) -> Problem:
    """A wheel that slips for 5 s: the chain of switches leaves it no weight there."""
    run = slip_wheel(simulated("mainline", seed=2, duration_s=60.0), [WheelSlip(40.0, 5.0, 0.3)])
    return build_problem(run.recording, SmoothConfig())


def speedless(simulated: Make) -> Problem:
    """The accelerometer alone measures the tilt."""
    recording = simulated("mainline-gnss", seed=2, duration_s=60.0).recording
    return build_problem(replace(recording, tach=None, gnss=None), SmoothConfig())


def with_landmarks(simulated: Make) -> Problem:
    """Three places of a map, one of them wrong."""
    problem = build_problem(simulated("mainline", seed=2, duration_s=60.0).recording, SmoothConfig())
    first, share = np.array([15, 22, 30]), np.array([0.2, 0.5, 0.9])
    distance = problem.initial.odo.distance
    passed = (1.0 - share) * distance[first] + share * distance[first + 1] + [0.1, 5.0, -0.1]
    return problem.with_family(landmark(first, share, passed, np.full((3, 1), 0.3), Cauchy(3.0)))


def with_radar(simulated: Make) -> Problem:
    """A further sensor, which has a shared variable of its own."""
    return build_problem(simulated("slippery-line-radar", seed=2, duration_s=60.0).recording, SmoothConfig())


def with_receiver_speeds(simulated: Make) -> Problem:
    """A receiver that measures its speed, too, which is some time old."""
    plan = replace(scenario("mainline-gnss"), further_sensors=(ReceiverSpeeds(delay_s=0.1),))
    return build_problem(simulate(plan, seed=2, duration_s=60.0).recording, SmoothConfig())


PROBLEMS = (with_outliers, with_slip, speedless, with_landmarks, with_radar, with_receiver_speeds)


@pytest.fixture(scope="module", params=PROBLEMS, ids=lambda make: make.__name__)
def solved(request: pytest.FixtureRequest, simulated: Make) -> tuple[Problem, Solution]:
    problem = request.param(simulated)
    return problem, solve(problem, TIGHT)


def sigmas(problem: Problem, solution: Solution) -> np.ndarray:
    """Of each keyframe and the shared variables, (n, KEYFRAME_DIM + SHARED_DIM)."""
    marginal = posterior_covariance(solution.root).marginal
    return np.asarray(np.sqrt(np.diagonal(marginal, axis1=1, axis2=2)))


def apart(a: States, b: States, sd: np.ndarray) -> float:
    """The largest difference of any variable, in sigmas."""
    step = step_from(a, b)
    keyframes, shared = np.abs(step.keyframes) / sd[:, :KEYFRAME_DIM], np.abs(step.shared) / sd[0, KEYFRAME_DIM:]
    return float(max(keyframes.max(), shared.max()))


def optimised(export: GtsamProblem, graph: gtsam.NonlinearFactorGraph, start: gtsam.Values) -> States:
    """By GTSAM's Levenberg-Marquardt, until a step lowers the cost by no more than one of 1e-4 sigmas does. A search
    for yet a lower cost, where there is none, takes as long as twenty steps."""
    parameters = gtsam.LevenbergMarquardtParams()
    parameters.setLinearSolverType("SEQUENTIAL_QR")
    parameters.setOrdering(export.ordering)
    parameters.setlambdaInitial(1e-9)
    parameters.setRelativeErrorTol(0.0)
    parameters.setAbsoluteErrorTol(0.0)
    optimiser = gtsam.LevenbergMarquardtOptimizer(graph, start, parameters)
    for _ in range(8):
        before = optimiser.error()
        optimiser.iterate()
        if before - optimiser.error() < 1e-8:
            break
    return export.states(optimiser.values())


def displaced(states: States, sd: np.ndarray) -> States:
    """Every variable, drawn at random with half its sigma about its value."""
    offset = 0.5 * sd * np.random.default_rng(0).standard_normal(sd.shape)
    return states.moved(Step(offset[:, :KEYFRAME_DIM], offset[0, KEYFRAME_DIM:]))


@pytest.mark.parametrize(
    "solved", [with_outliers, with_slip, with_radar], indirect=True, ids=lambda make: make.__name__
)
def test_levenberg_marquardt_reaches_the_same_minimum(solved: tuple[Problem, Solution]) -> None:
    problem, solution = solved
    sd = sigmas(problem, solution)
    start = displaced(solution.states, sd)
    export = problem.to_gtsam(solution.states)
    found = optimised(export, export.graph, start.to_gtsam())
    assert apart(start, solution.states, sd) > 1.0
    assert apart(found, solution.states, sd) < ROUNDING


def test_undamped_steps_of_both_reach_the_same_minimum(solved: tuple[Problem, Solution]) -> None:
    problem, solution = solved
    states, sd = solution.states, sigmas(problem, solution)
    for _ in range(3):
        linear = [problem.inertial.linearize(states), *(family.linearize(states) for family in problem.families)]
        states = states.moved(eliminate(linear, len(problem.t)).solution())
    export = problem.to_gtsam(solution.states)
    parameters = gtsam.GaussNewtonParams()
    parameters.setLinearSolverType("SEQUENTIAL_QR")
    parameters.setOrdering(export.ordering)
    optimiser = gtsam.GaussNewtonOptimizer(export.graph, displaced(solution.states, sd).to_gtsam(), parameters)
    off = np.inf
    for _ in range(7):
        optimiser.iterate()
        off = apart(export.states(optimiser.values()), states, sd)
        if off < SAME:
            break
    assert off < SAME


def test_gtsam_sees_no_step_to_take_from_our_minimum(solved: tuple[Problem, Solution]) -> None:
    problem, solution = solved
    export = problem.to_gtsam(solution.states)
    linear = export.graph.linearize(export.values)
    step = linear.eliminateSequential(export.ordering, gtsam.EliminateQR).optimize()
    moved = export.states(export.values.retract(step))
    assert apart(moved, solution.states, sigmas(problem, solution)) < 1e-5


def test_losses_are_at_work_in_these_problems(simulated: Make) -> None:
    """Else the two tests above would say nothing of them."""
    for make, kind in (
        (with_outliers, FactorType.GNSS_POSITION),
        (with_slip, FactorType.TACH_DISTANCE),
        (with_landmarks, FactorType.LANDMARK),
    ):
        problem = make(simulated)
        family = problem.family(kind)
        assert family is not None
        assert family.weights(solve(problem, TIGHT).states).min() < 0.9
    assert speedless(simulated).family(FactorType.GRAVITY_TILT) is not None


def test_errors_are_those_of_the_exported_factors(solved: tuple[Problem, Solution]) -> None:
    problem, solution = solved
    table, export = problem.errors(solution.states), problem.to_gtsam(solution.states)
    theirs = [export.graph.at(i).error(export.values) for i in range(export.graph.size())]
    np.testing.assert_allclose(table["error"], theirs, rtol=1e-6, atol=1e-9)
    assert set(table["factor"]) == {"inertial", *(family.name for family in problem.families)}
    for name, rows in table.groupby("factor"):
        shared = name in (f"prior on {kind.attribute}" for kind in Kind if kind.shared)
        assert rows["first_s"].isna().all() == shared
    assert (table["first_s"].dropna() <= table["last_s"].dropna()).all()


@pytest.fixture(scope="module")
def plain(simulated: Make) -> tuple[Problem, Solution]:
    problem = build_problem(simulated("mainline", seed=2, duration_s=60.0).recording, SmoothConfig())
    return problem, solve(problem, TIGHT)


def test_a_users_gps_factor_shifts_the_minimum_as_the_covariance_says(plain: tuple[Problem, Solution]) -> None:
    """``P H' (H P H' + R)^-1 r`` at the keyframe of the factor."""
    problem, solution = plain
    export = problem.to_gtsam(solution.states)
    k, sd, push = 25, 0.05, np.array([0.2, -0.1, 0.15])
    position = solution.states.nav.p[k] + push
    export.graph.push_back(gtsam.GPSFactor2(export.key(Kind.NAV, k), position, gtsam.noiseModel.Isotropic.Sigma(3, sd)))
    found = optimised(export, export.graph, export.values)
    at = slice(offset_in_keyframe(Kind.NAV) + 3, offset_in_keyframe(Kind.NAV) + 6)
    R = solution.states.nav.R[k]
    P = R @ posterior_covariance(solution.root).marginal[k][at, at] @ R.T
    expected = P @ np.linalg.solve(P + sd**2 * np.eye(3), push)
    assert np.linalg.norm(expected) > 0.1
    np.testing.assert_allclose(
        found.nav.p[k] - solution.states.nav.p[k], expected, atol=0.01 * np.linalg.norm(expected)
    )


def test_a_users_prior_holds_a_keyframe(plain: tuple[Problem, Solution]) -> None:
    problem, solution = plain
    export = problem.to_gtsam(solution.states)
    key = export.key_at(Kind.NAV, problem.t[20])
    turned = export.values.atNavState(key).retract(np.array([0.0, 0.0, 1e-3, *np.zeros(6)]))
    export.graph.push_back(gtsam.PriorFactorNavState(key, turned, gtsam.noiseModel.Isotropic.Sigma(9, 1e-7)))
    found = optimised(export, export.graph, export.values)
    yaw = (solution.states.nav.R[20].T @ found.nav.R[20])[1, 0]
    assert yaw == pytest.approx(1e-3, rel=1e-3)


def test_a_family_more_shifts_our_minimum_likewise(plain: tuple[Problem, Solution]) -> None:
    problem, solution = plain
    k, sd, push = 30, 0.4, 0.3
    D = solution.states.odo.distance
    one = landmark(np.array([k]), np.array([0.0]), D[k : k + 1] + push, np.array([[sd]]), None)
    found = solve(problem.with_family(one), TIGHT)
    variance = posterior_covariance(solution.root).of(Kind.ODO)[k, Odo.DISTANCE, Odo.DISTANCE]
    expected = variance / (variance + sd**2) * push
    assert found.states.odo.distance[k] - D[k] == pytest.approx(expected, rel=0.02)


@pytest.mark.parametrize("index", [-1, 10_000, 20.0])
def test_a_family_on_keyframes_that_are_not_there_is_refused(plain: tuple[Problem, Solution], index: float) -> None:
    problem, _ = plain
    one = landmark(np.array([index]), np.array([0.0]), np.array([5.0]), np.array([[0.1]]), None)
    with pytest.raises(
        IndexError, match=f"landmark: touches ODO .*; expected whole numbers from 0 to {len(problem.t) - 1}"
    ):
        problem.with_family(one)
    last = np.array([len(problem.t) - 1])  # a landmark lies between a keyframe and the next
    with pytest.raises(IndexError):
        problem.with_family(landmark(last, np.array([0.0]), np.array([5.0]), np.array([[0.1]]), None))


def test_a_solution_in_the_place_of_a_part_of_it_is_refused(plain: tuple[Problem, Solution]) -> None:
    problem, given = plain
    solution: Any = given
    for take in (problem.errors, problem.to_gtsam):
        with pytest.raises(TypeError, match=r"expected states, such as solution\.states, not Solution"):
            take(solution)
    with pytest.raises(TypeError, match=r"solution\.root, not Solution"):
        posterior_covariance(solution)


def test_keys_say_what_they_stand_for(plain: tuple[Problem, Solution]) -> None:
    problem, _ = plain
    export = problem.to_gtsam()
    n = len(problem.t)
    assert export.variable(export.key(Kind.NAV, -1)) == (Kind.NAV, n - 1, problem.t[-1])
    assert export.variable(export.key(Kind.WHEEL)) == (Kind.WHEEL, 0, None)
    table = export.variables
    assert len(table) == export.values.size() == 3 * n + 4
    assert set(table["key"]) == set(export.graph.keyVector())
    bias = table[table["kind"] == "BIAS"]
    np.testing.assert_array_equal(np.sort(bias["t_s"]), problem.t)
    with pytest.raises(ValueError, match="no variable"):
        export.variable(gtsam.symbol("x", 0))
    with pytest.raises(ValueError, match="no variable"):
        export.variable(gtsam.symbol("n", n))
    with pytest.raises(IndexError, match=rf"no variable NAV {n}: expected a number from 0 to {n - 1}"):
        export.key(Kind.NAV, n)
    with pytest.raises(TypeError, match=r"'NAV' is no kind of variable: expected one such as Kind\.NAV"):
        export.key("NAV", 1)  # type: ignore[arg-type]
    assert export.key_at(Kind.NAV, problem.t[-1] + 0.01) == export.key(Kind.NAV, -1)
    for t in (1e6, problem.t[0] - 1e3, np.nan):
        with pytest.raises(ValueError, match="no keyframe at"):
            export.key_at(Kind.NAV, t)

"""The solver finds the minimum that other means find, says truly why it stopped, and copes with outliers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import solve_triangular

from trackfg.config import SmoothConfig, SolverConfig
from trackfg.datasets.scenarios import Simulation
from trackfg.errors import UnsolvableError
from trackfg.factors.factor_type import FactorType
from trackfg.factors.family import Family
from trackfg.factors.prior import prior
from trackfg.factors.states import ELIMINATION_ORDER, KEYFRAME_DIM, SHARED, Kind, Nav, States, retract
from trackfg.graph.build import Problem, build_problem
from trackfg.numerics.rotations import so3_exp, so3_log
from trackfg.solver.covariance import posterior_covariance
from trackfg.solver.gauss_newton import Solution, solve

TIGHT = SolverConfig(step_tolerance=1e-4, cost_tolerance=1e-9)

Linearized = Callable[[Problem, States], tuple[np.ndarray, np.ndarray]]


def without_loss(problem: Problem) -> Problem:
    plain = tuple(Family(f.type, f.evaluate, f.slots, f.data, f.sigma) for f in problem.families)
    return replace(problem, families=plain)


@pytest.fixture(scope="module")
def problem(simulated: Callable[..., Simulation]) -> Problem:
    """A short run on a smooth straight, whose sensor's place is declared: it would hardly show."""
    recording = simulated("mainline-gnss", seed=2, duration_s=40.0).recording
    imu = recording.description.imu.model_copy(update={"lever_arm_sd_m": (0.05, 0.05, 0.05)})
    description = recording.description.model_copy(update={"imu": imu})
    return build_problem(replace(recording, description=description), SmoothConfig())


@pytest.fixture(scope="module")
def solution(problem: Problem) -> Solution:
    return solve(problem, TIGHT)


def moved(states: States, delta: np.ndarray) -> States:
    """Retract by a stacked tangent in the chain's order."""
    n = len(states)
    keyframes = delta[: n * KEYFRAME_DIM].reshape(n, KEYFRAME_DIM)
    parts, start = {}, 0
    for kind in ELIMINATION_ORDER:
        parts[kind] = retract(states.of(kind), keyframes[:, start : start + kind.dim])
        start += kind.dim
    shared, start = delta[n * KEYFRAME_DIM :], 0
    for kind in SHARED:
        parts[kind] = retract(states.of(kind), shared[None, start : start + kind.dim])
        start += kind.dim
    nav = parts[Kind.NAV]
    assert isinstance(nav, Nav)
    return States(nav, *(parts[kind] for kind in (Kind.BIAS, Kind.ODO, *SHARED)))  # type: ignore[arg-type]


def difference_in_sigmas(a: States, b: States, solution: Solution) -> float:
    """The largest difference of any variable of two solutions, in its posterior sigmas."""
    covariance = posterior_covariance(solution.root)
    turn = so3_log(np.swapaxes(a.nav.R, 1, 2) @ b.nav.R)
    p, v = (np.einsum("mji,mj->mi", a.nav.R, y - x) for x, y in ((a.nav.p, b.nav.p), (a.nav.v, b.nav.v)))
    differences = {
        Kind.NAV: np.hstack([turn, p, v]),
        Kind.BIAS: a.bias - b.bias,
        Kind.ODO: a.odo.array - b.odo.array,
        Kind.MOUNT: a.mount - b.mount,
        Kind.CLOCK: a.clock - b.clock,
        Kind.IMU: a.imu - b.imu,
        Kind.WHEEL: a.wheel - b.wheel,
    }
    return max(
        float(np.abs(x / np.sqrt(np.diagonal(covariance.of(kind), axis1=1, axis2=2))).max())
        for kind, x in differences.items()
    )


def dense_step(A: np.ndarray, b: np.ndarray) -> np.ndarray:
    """The least-squares solution of the whole system at once."""
    R = np.linalg.qr(np.column_stack([A, b]), mode="r")
    n = A.shape[1]
    return np.asarray(solve_triangular(R[:n, :n], R[:n, n]))


def cost(problem: Problem, states: States) -> float:
    return float(problem.native.error(states.to_gtsam())) + sum(family.cost(states) for family in problem.families)


def test_equals_dense_gauss_newton(problem: Problem, linearized: Linearized) -> None:
    plain = without_loss(problem)
    ours = solve(plain, TIGHT)
    states = plain.initial
    for _ in range(5):
        states = moved(states, dense_step(*linearized(plain, states)))
    assert ours.converged
    assert difference_in_sigmas(ours.states, states, ours) < 1e-3
    assert ours.cost == pytest.approx(cost(plain, states), rel=1e-9)


def test_robust_minimum_is_stationary(problem: Problem, solution: Solution, linearized: Linearized) -> None:
    """At the minimum of the robust cost, the reweighted least-squares step of the dense system is nothing."""
    A, b = linearized(problem, solution.states)
    assert np.linalg.norm(A @ dense_step(A, b)) < 1e-2


def test_no_neighbour_is_cheaper(problem: Problem, solution: Solution) -> None:
    """Moving along random directions by a tenth of a posterior sigma costs more, on both sides alike."""
    rng = np.random.default_rng(0)
    lowest = cost(problem, solution.states)
    assert solution.cost == pytest.approx(lowest, rel=1e-9)
    sd = np.sqrt(np.diagonal(posterior_covariance(solution.root).marginal, axis1=1, axis2=2))
    stacked = np.concatenate([sd[:, :KEYFRAME_DIM].ravel(), sd[0, KEYFRAME_DIM:]])
    for _ in range(20):
        delta = 0.1 * stacked * rng.normal(size=stacked.size)
        assert cost(problem, moved(solution.states, delta)) > lowest
        assert cost(problem, moved(solution.states, -delta)) > lowest


def test_reason_is_true_when_it_converges(problem: Problem) -> None:
    """Only the step's rule left: a step below the tolerance, and from there hardly anything moves."""
    first = solve(problem, SolverConfig(step_tolerance=0.03, cost_tolerance=1e-12))
    assert first.converged
    assert "below 0.03" in first.reason
    again = solve(replace(problem, initial=first.states), TIGHT)
    assert difference_in_sigmas(first.states, again.states, again) < 0.1
    assert 0 <= first.cost - again.cost < 0.01
    assert first.initial_cost > first.cost


def test_too_few_iterations_are_said(problem: Problem) -> None:
    few = solve(problem, SolverConfig(max_iterations=1))
    assert not few.converged
    assert few.reason == "stopped after 1 iterations"
    assert few.iterations == 1
    assert few.cost <= few.initial_cost


def test_poor_start_ends_where_the_good_one_does(problem: Problem, solution: Solution) -> None:
    """Attitude wrong by up to 0.5 rad, speed by 10 m/s, place by 100 m."""
    rng = np.random.default_rng(1)
    start = problem.initial
    n = len(start)
    delta = np.repeat([0.15, 30.0, 3.0], 3) * rng.normal(size=(n, 9))
    nav = retract(start.nav, delta)
    assert isinstance(nav, Nav)
    poor = solve(replace(problem, initial=replace(start, nav=nav)), TIGHT.model_copy(update={"max_iterations": 100}))
    assert poor.converged
    assert poor.initial_cost > 1e3 * solution.cost
    assert poor.cost == pytest.approx(solution.cost, rel=1e-4)
    assert difference_in_sigmas(poor.states, solution.states, solution) < 0.05


@pytest.mark.parametrize("heading_rad", [0.5, 2.0])
def test_a_path_that_points_the_wrong_way_is_turned(problem: Problem, solution: Solution, heading_rad: float) -> None:
    """Straight steps would lengthen each interval, which the tach contradicts: 0.5 rad takes ten, 2 rad never end."""
    turn, nav = so3_exp(np.array([[0.0, 0.0, heading_rad]]))[0], problem.initial.nav
    turned = Nav(turn @ nav.R, nav.p[:1] + (nav.p - nav.p[:1]) @ turn.T, nav.v @ turn.T)
    found = solve(replace(problem, initial=replace(problem.initial, nav=turned)), TIGHT)
    assert found.converged
    assert found.iterations <= (8 if heading_rad < 1.0 else 25)
    assert found.cost == pytest.approx(solution.cost, rel=1e-4)
    assert difference_in_sigmas(found.states, solution.states, solution) < 0.05


def test_degrees_of_freedom_are_rows_less_variables(
    problem: Problem, solution: Solution, linearized: Linearized
) -> None:
    A, _ = linearized(problem, solution.states)
    assert solution.degrees_of_freedom == A.shape[0] - A.shape[1]


def test_wrong_fix_is_set_aside(simulated: Callable[..., Simulation]) -> None:
    recording = simulated("shunting", seed=0, duration_s=240.0).recording
    assert recording.fixes is not None
    assert len(recording.fixes) >= 3
    good = solve(build_problem(recording, SmoothConfig()), TIGHT)
    for wrong_row in range(len(recording.fixes)):
        fixes = recording.fixes.copy()
        fixes.loc[wrong_row, "chainage_m"] += 100.0
        problem = build_problem(replace(recording, fixes=fixes), SmoothConfig())
        bad = solve(problem, TIGHT)
        assert bad.converged
        family = problem.family(FactorType.ABSOLUTE_FIX)
        assert family is not None
        assert np.argmin(family.weights(bad.states)) == wrong_row
        assert np.abs(bad.states.odo.distance - good.states.odo.distance).max() < 1.0


def test_gnss_outliers_are_set_aside(simulated: Callable[..., Simulation]) -> None:
    run = simulated("mainline-gnss", seed=3, duration_s=120.0)
    assert run.recording.gnss is not None
    gnss = run.recording.gnss.copy()
    outliers = np.arange(40, 110, 10)
    gnss.loc[outliers, ["east_m", "north_m"]] += [60.0, -40.0]
    recording = replace(run.recording, gnss=gnss)

    def worst(config: SmoothConfig) -> float:
        problem = build_problem(recording, config)
        states = solve(problem, config.solver).states
        true = run.ride.position(problem.t)
        return float(np.linalg.norm((states.nav.p - true)[:, :2], axis=1).max())

    plain = SmoothConfig().position.model_copy(update={"robust": False})
    assert worst(SmoothConfig()) < 1.0
    assert worst(SmoothConfig(position=plain)) > 2.0


def test_undetermined_graph_is_refused(problem: Problem) -> None:
    """Inertial factors, but nothing that says where the run is, nor its heading."""
    n = len(problem.t)
    shared = np.array([0])
    afloat = tuple(
        prior(kind, index, np.zeros((index.size, kind.dim)), np.ones((index.size, kind.dim)))
        for kind, index in ((Kind.ODO, np.arange(n)), *((kind, shared) for kind in SHARED))
    )
    walk = problem.family(FactorType.BIAS_WALK)
    assert walk is not None
    afloat = (*afloat, walk)
    with pytest.raises(UnsolvableError, match="do not determine the states"):
        solve(replace(problem, families=afloat), SolverConfig())


def test_progress_goes_on(problem: Problem) -> None:
    seen: list[float] = []
    solve(problem, SolverConfig(), seen.append)
    assert seen == sorted(seen)
    assert 0 < seen[0] <= seen[-1] <= 1.0


def test_whole_settings_in_place_of_their_section_are_refused(problem: Problem) -> None:
    with pytest.raises(TypeError, match=r"solve takes the section solver of settings, .* not SmoothConfig"):
        solve(problem, SmoothConfig())  # type: ignore[arg-type]

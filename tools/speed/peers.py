"""The same measurements given to other estimators: GTSAM's own optimiser and the feedback filter of python-ins.

Everything here runs in this process, one estimator after the other, and takes the shortest of ``repeats`` times: CPU
time, since wall times scatter with what else the machine does.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TypeVar

import gtsam
import numpy as np

from trackfg.baselines.attitude import motion_of
from trackfg.config import KeyframeConfig, SmoothConfig
from trackfg.datasets.catalogue import scenario
from trackfg.datasets.scenarios import Simulation, simulate
from trackfg.graph.build import Problem, build_problem
from trackfg.numerics.arrays import Array
from trackfg.peers.installed import is_installed
from trackfg.peers.python_ins import Start, feedback_filter
from trackfg.smoothing.smoother import smooth_states
from trackfg.solver.elimination import eliminate
from trackfg.solver.gauss_newton import solve

LATITUDE_DEG = 35.2
"""python-ins always models the Earth's rotation, so the Earth of the simulation has to turn."""

SETTLED_S = 60.0
"""Left out of the attitude errors, for the filter to settle."""

T = TypeVar("T")


@dataclass(frozen=True)
class OptimiserTimes:
    """One plain problem (no robust losses), trackfg's solver against GTSAM's Levenberg-Marquardt with QR.

    ``outside_s``: one iteration's linearisation, QR, step and cost over the very same GTSAM graph, but with the values
    owned by Python, so that no callback is handed a copy of them; ``callbacks_s``: its part in linearisation and cost.
    ``gtsam_qr_s``: GTSAM's sequential QR of the linear graph and its step, native code alone; ``ours_qr_s``: ours.
    """

    duration_s: float
    keyframes: int
    factors: int
    ours_s: float
    ours_iterations: int
    ours_cost: float
    gtsam_s: float
    gtsam_iterations: int
    gtsam_cost: float
    outside_s: float
    callbacks_s: float
    gtsam_qr_s: float
    ours_qr_s: float

    @property
    def ratio(self) -> float:
        return self.gtsam_s / self.ours_s

    @property
    def copies_share(self) -> float:
        """The share of GTSAM's time that is neither callbacks nor linear algebra: copies of the values."""
        return 1.0 - self.outside_s * self.gtsam_iterations / self.gtsam_s


@dataclass(frozen=True)
class CholeskyOutcome:
    """Where Levenberg-Marquardt with Cholesky, GTSAM's default, is after as many iterations as trackfg may make."""

    seconds: float
    iterations: int
    cost: float
    error: str | None


@dataclass(frozen=True)
class FilterTimes:
    """Seconds per IMU sample, and the standard deviation of the cross-level error along the run, mm."""

    smoother_s: float
    filter_s: float
    smoother_mm: float
    filter_mm: float

    @property
    def ratio(self) -> float:
        return self.filter_s / self.smoother_s


def simulated(duration_s: float) -> Simulation:
    """The start of ``mainline``, on an Earth that turns."""
    return simulate(replace(scenario("mainline"), latitude_deg=LATITUDE_DEG), duration_s=duration_s)


def plain_problem(run: Simulation, keyframes: KeyframeConfig) -> Problem:
    """The graph without robust losses, so that every optimiser minimises the same sum of squares."""
    problem = build_problem(run.recording, SmoothConfig(keyframes=keyframes))
    return replace(problem, families=tuple(replace(family, loss=None) for family in problem.families))


def compare_optimisers(problem: Problem, repeats: int) -> OptimiserTimes:
    """Both from the same initial values, each to its own stop; the costs say whether they reached the same minimum."""
    ours_s, solution = _fastest(lambda: solve(problem, SmoothConfig().solver), repeats)
    export = problem.to_gtsam()
    graph, values, ordering = export.graph, export.values, export.ordering

    def optimise() -> gtsam.LevenbergMarquardtOptimizer:
        optimiser = _levenberg_marquardt(graph, values, ordering, "SEQUENTIAL_QR")
        optimiser.optimize()
        return optimiser

    gtsam_s, optimiser = _fastest(optimise, repeats)
    linearise_s, linear = _fastest(lambda: graph.linearize(values), repeats)
    solve_s, step = _fastest(lambda: linear.eliminateSequential(ordering, gtsam.EliminateQR).optimize(), repeats)
    cost_s, _ = _fastest(lambda: graph.error(values.retract(step)), repeats)
    rows = [problem.inertial.linearize(solution.states)]
    rows += [family.linearize(solution.states) for family in problem.families]
    ours_qr_s, _ = _fastest(lambda: eliminate(rows, len(problem.t)).solution(), repeats)
    return OptimiserTimes(
        duration_s=float(problem.t[-1] - problem.t[0]),
        keyframes=len(problem.t),
        factors=graph.size(),
        ours_s=ours_s,
        ours_iterations=solution.iterations,
        ours_cost=solution.cost,
        gtsam_s=gtsam_s,
        gtsam_iterations=optimiser.iterations(),
        gtsam_cost=optimiser.error(),
        outside_s=linearise_s + solve_s + cost_s,
        callbacks_s=linearise_s + cost_s,
        gtsam_qr_s=solve_s,
        ours_qr_s=ours_qr_s,
    )


def with_cholesky(problem: Problem) -> CholeskyOutcome:
    """GTSAM's default linear solver on the same problem, with the same chain ordering."""
    export = problem.to_gtsam()
    graph, values, ordering = export.graph, export.values, export.ordering
    optimiser = _levenberg_marquardt(graph, values, ordering, "MULTIFRONTAL_CHOLESKY")
    start, error = time.process_time(), None
    try:
        optimiser.optimize()
    except RuntimeError as raised:  # "Indeterminate linear system", where damping does not hide it
        error = str(raised).strip().splitlines()[0]
    return CholeskyOutcome(time.process_time() - start, optimiser.iterations(), optimiser.error(), error)


def _levenberg_marquardt(
    graph: gtsam.NonlinearFactorGraph, values: gtsam.Values, ordering: gtsam.Ordering, linear_solver: str
) -> gtsam.LevenbergMarquardtOptimizer:
    parameters = gtsam.LevenbergMarquardtParams()
    parameters.setLinearSolverType(linear_solver)
    parameters.setOrdering(ordering)
    parameters.setMaxIterations(SmoothConfig().solver.max_iterations)
    return gtsam.LevenbergMarquardtOptimizer(graph, values, parameters)


def compare_filter(run: Simulation, repeats: int) -> FilterTimes | None:
    """The whole smoother against the whole filter on one run; None where python-ins is not installed.

    What the filter cannot estimate, it is given: the true wheel scale, and the true attitude at the start. The filter
    runs once, after a short run that has its integrator compiled.
    """
    if not is_installed("python-ins"):
        return None
    recording, samples = run.recording, len(run.recording.imu)
    smoother_s, smoothed = _fastest(lambda: smooth_states(recording, SmoothConfig()), repeats)
    _filtered_roll(run, recording.imu["t_s"].iloc[400])
    filter_s, (t, roll) = _fastest(lambda: _filtered_roll(run, np.inf), 1)
    trajectory = smoothed.trajectory
    return FilterTimes(
        smoother_s=smoother_s / samples,
        filter_s=filter_s / samples,
        smoother_mm=_cross_level_error_mm(run, trajectory["t_s"].to_numpy(), trajectory["roll_rad"].to_numpy()),
        filter_mm=_cross_level_error_mm(run, t, roll),
    )


def _filtered_roll(run: Simulation, until_s: float) -> tuple[Array, Array]:
    """Times and roll (rad) of python-ins' feedback filter with body velocities from the tach, up to ``until_s``."""
    imu, start = run.recording.imu, run.truth.iloc[0]
    recording = replace(run.recording, imu=imu[imu["t_s"] <= until_s])
    filtered = feedback_filter(
        recording,
        motion_of(recording, remove_static_bias=False),
        Start(
            geodetic=np.array([LATITUDE_DEG, 0.0, 0.0]),
            rpy=start[["roll_rad", "pitch_rad", "yaw_rad"]].to_numpy(dtype=np.float64),
            place_sd_m=1e-3,
            tilt_sd_rad=np.radians(1.0),
            yaw_sd_rad=np.radians(0.1),
        ),
        gyro_bias_sd=recording.description.imu.noise.gyro_bias_sd,
        wheel_scale=run.wheel_scale,
    )
    return filtered.t, filtered.rpy[:, 0]


def _cross_level_error_mm(run: Simulation, t: Array, roll: Array) -> float:
    """Standard deviation along the run: the constant part, which accelerometer bias makes, is not in it."""
    base_m = run.recording.description.track.cross_level_base_m
    error = np.sin(roll) - np.sin(np.interp(t, run.truth["t_s"], run.truth["roll_rad"]))
    return float(1e3 * base_m * np.std(error[t > SETTLED_S]))


def _fastest(run: Callable[[], T], repeats: int) -> tuple[float, T]:
    """The shortest time, and what the last run gave."""
    times = []
    for _ in range(repeats):
        start = time.process_time()
        result = run()
        times.append(time.process_time() - start)
    return min(times), result

"""The same measurements given to other estimators: GTSAM's own optimiser and the feedback filter of python-ins.

Everything here runs in this process, one estimator after the other, and takes the shortest of ``repeats`` times.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from importlib.util import find_spec
from typing import TypeVar

import gtsam
import numpy as np
import pandas as pd

from trackfg.config import KeyframeConfig, SmoothConfig
from trackfg.datasets.catalogue import scenario
from trackfg.datasets.scenarios import Simulation, simulate
from trackfg.frames import Array
from trackfg.graph import Problem, build_problem
from trackfg.smoother import smooth_states
from trackfg.solver import chain_ordering, solve

LATITUDE_DEG = 35.2
"""python-ins always models the Earth's rotation, so the Earth of the simulation has to turn."""

FILTER_RATE_HZ = 2.0
"""Body velocities per second: about twice as often as trackfg has keyframes. More of them cost the filter more."""

SETTLED_S = 60.0
"""Left out of the attitude errors, for the filter to settle."""

T = TypeVar("T")

_FLU_TO_FRD = np.array([1.0, -1.0, -1.0])


@dataclass(frozen=True)
class OptimiserTimes:
    """One plain problem (no robust losses), trackfg's solver against GTSAM's Levenberg-Marquardt with QR.

    ``outside_s``: one iteration's linearisation, QR, step and cost over the very same GTSAM graph, but with the values
    owned by Python, so that no callback is handed a copy of them; ``callbacks_s``: its part in linearisation and cost.
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


def gtsam_graph(problem: Problem) -> gtsam.NonlinearFactorGraph:
    """All factors as GTSAM sees them: its own, and a ``CustomFactor`` for each of ours."""
    graph = gtsam.NonlinearFactorGraph(problem.native)
    for family in problem.families:
        for factor in family.custom_factors():
            graph.push_back(factor)
    return graph


def compare_optimisers(problem: Problem, repeats: int) -> OptimiserTimes:
    """Both from the same initial values, each to its own stop; the costs say whether they reached the same minimum."""
    ours_s, solution = _fastest(lambda: solve(problem, SmoothConfig().solver), repeats)
    graph, values, ordering = gtsam_graph(problem), problem.initial.to_gtsam(), chain_ordering(len(problem.t))

    def optimise() -> gtsam.LevenbergMarquardtOptimizer:
        optimiser = _levenberg_marquardt(graph, values, ordering, "SEQUENTIAL_QR")
        optimiser.optimize()
        return optimiser

    gtsam_s, optimiser = _fastest(optimise, repeats)
    linearise_s, linear = _fastest(lambda: graph.linearize(values), repeats)
    solve_s, step = _fastest(lambda: linear.eliminateSequential(ordering, gtsam.EliminateQR).optimize(), repeats)
    cost_s, _ = _fastest(lambda: graph.error(values.retract(step)), repeats)
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
    )


def with_cholesky(problem: Problem) -> CholeskyOutcome:
    """GTSAM's default linear solver on the same problem, with the same chain ordering."""
    graph, values, ordering = gtsam_graph(problem), problem.initial.to_gtsam(), chain_ordering(len(problem.t))
    optimiser = _levenberg_marquardt(graph, values, ordering, "MULTIFRONTAL_CHOLESKY")
    start, error = time.perf_counter(), None
    try:
        optimiser.optimize()
    except RuntimeError as raised:  # "Indeterminate linear system", where damping does not hide it
        error = str(raised).strip().splitlines()[0]
    return CholeskyOutcome(time.perf_counter() - start, optimiser.iterations(), optimiser.error(), error)


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
    if find_spec("pyins") is None:
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
    from pyins import filters, inertial_sensor, measurements, strapdown

    recording, noise = run.recording, run.recording.description.imu.noise
    used = recording.imu["t_s"].to_numpy() <= until_s
    t = recording.imu["t_s"].to_numpy()[used]
    imu = pd.DataFrame(
        np.hstack([recording.gyro[used] * _FLU_TO_FRD, recording.accel[used] * _FLU_TO_FRD]),
        index=t,
        columns=[f"{sensor}_{axis}" for sensor in ("gyro", "accel") for axis in "xyz"],
    )
    start = run.truth.iloc[0]
    attitude = np.degrees([start["roll_rad"], -start["pitch_rad"], 0.5 * np.pi - start["yaw_rad"]])
    initial = pd.Series(
        [LATITUDE_DEG, 0.0, 0.0, 0.0, 0.0, 0.0, *attitude],
        index=["lat", "lon", "alt", "VN", "VE", "VD", "roll", "pitch", "heading"],
        name=t[0],
    )
    tach = recording.tach
    assert tach is not None
    clock = np.arange(np.ceil(t[0] + 0.25), t[-1] - 0.25, 1.0 / FILTER_RATE_HZ)
    rolled = [np.interp(clock + shift, tach["t_s"], tach["distance_m"]) for shift in (-0.25, 0.25)]
    speed = run.wheel_scale * (rolled[1] - rolled[0]) / 0.5
    velocity = pd.DataFrame({"VX": speed, "VY": 0.0, "VZ": 0.0}, index=clock)
    result = filters.run_feedback_filter(
        initial,
        position_sd=1e-3,
        velocity_sd=1e-2,
        level_sd=1.0,
        azimuth_sd=0.1,
        increments=strapdown.compute_increments_from_imu(imu, "rate"),
        gyro_model=inertial_sensor.EstimationModel(noise.gyro_bias_sd, noise.gyro_white, noise.gyro_bias_walk),
        accel_model=inertial_sensor.EstimationModel(noise.accel_bias_sd, noise.accel_white, noise.accel_bias_walk),
        measurements=[measurements.BodyVelocity(velocity, 0.03)],
    )
    return result.trajectory.index.to_numpy(), np.radians(result.trajectory["roll"].to_numpy())


def _cross_level_error_mm(run: Simulation, t: Array, roll: Array) -> float:
    """Standard deviation along the run: the constant part, which accelerometer bias makes, is not in it."""
    base_m = run.recording.description.track.cross_level_base_m
    error = np.sin(roll) - np.sin(np.interp(t, run.truth["t_s"], run.truth["roll_rad"]))
    return float(1e3 * base_m * np.std(error[t > SETTLED_S]))


def _fastest(run: Callable[[], T], repeats: int) -> tuple[float, T]:
    """The shortest time, and what the last run gave."""
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        result = run()
        times.append(time.perf_counter() - start)
    return min(times), result

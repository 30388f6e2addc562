"""Noise levels from the residuals: right where the declared ones are right, found where they are not."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from trackfg.config import SmoothConfig
from trackfg.datasets.scenarios import Simulation
from trackfg.factors.gnss import gnss_position
from trackfg.factors.states import (
    KEYFRAME_DIM,
    SHARED,
    SHARED_DIM,
    Kind,
    Nav,
    Odo,
    States,
    offset_in_keyframe,
)
from trackfg.graph.build import build_problem
from trackfg.smoothing.noise_levels import noise_findings
from trackfg.smoothing.smoother import smooth, smooth_states
from trackfg.solver.covariance import Covariance, posterior_covariance
from trackfg.solver.gauss_newton import solve
from trackfg.solver.variance_components import group_residuals, ratios_of

DURATION_S = 300.0


def test_true_densities_give_ratios_near_one(simulated: Callable[..., Simulation]) -> None:
    """The simulated vehicle follows its track exactly: the sway that the motion factors allow for is not there, and a
    little of the accelerometer's noise goes into it."""
    recording = simulated("mainline-gnss", seed=3, duration_s=DURATION_S).recording
    ratios = smooth_states(recording, SmoothConfig()).noise_ratios
    assert ratios["gyro"] == pytest.approx(1.0, abs=0.15)
    assert 0.7 < ratios["accel"] < 1.15
    assert ratios["gnss"] == pytest.approx(1.0, abs=0.15)
    assert ratios["motion"] < 0.5
    assert noise_findings(ratios) == ()


def test_sigmas_declared_too_small_are_found(simulated: Callable[..., Simulation]) -> None:
    recording = simulated("mainline-gnss", seed=3, duration_s=DURATION_S).recording
    assert recording.gnss is not None
    gnss = recording.gnss.copy()
    gnss[["east_sd_m", "north_sd_m", "up_sd_m"]] /= 4.0
    optimist = replace(recording, gnss=gnss)
    problem = build_problem(optimist, SmoothConfig())
    solution = solve(problem, SmoothConfig().solver)
    ratios = ratios_of(
        group_residuals(problem, solution.states, posterior_covariance(solution.root), problem.run.bridged)
    )
    assert 3.0 < ratios["gnss"] < 4.0  # positions far off have lost some of their weight
    assert ["'gnss'" in finding.message for finding in noise_findings(ratios)] == [True]
    warned = smooth(optimist, SmoothConfig()).summary
    assert [finding.code for finding in warned.findings] == ["gnss-level"]
    assert warned.noise_ratios["gnss"] == pytest.approx(1.0, abs=0.15)
    assert warned.noise_ratios["gyro"] == pytest.approx(1.0, rel=0.15)


def test_a_ratio_is_of_the_squares_to_the_redundancy() -> None:
    """Each of 30 keyframes has two GNSS positions, 0.6 sigma to either side of its state, and nothing else: it is known
    to sigma / sqrt(2) along each axis. Each residual then has the leverage 1/2. The squares are 0.36 each, the
    redundancy is half the number, and the ratio is sqrt(0.36 / 0.5) = 0.849.
    """
    n, sigma = 30, 2.0
    index = np.repeat(np.arange(n), 2)
    aside = 0.6 * sigma * np.tile([[1.0, 1.0, 1.0], [-1.0, -1.0, -1.0]], (n, 1))
    gnss = gnss_position(index, aside, np.zeros(3), np.zeros(2 * n), np.full((2 * n, 3), sigma), None)
    nav = Nav(np.tile(np.eye(3), (n, 1, 1)), *np.zeros((2, n, 3)))
    shared = (np.zeros((1, kind.dim)) for kind in SHARED)
    states = States(nav, np.zeros((n, 6)), Odo(np.zeros((n, 4))), *shared)
    dim, size, at = KEYFRAME_DIM, KEYFRAME_DIM + SHARED_DIM, offset_in_keyframe(Kind.NAV) + 3
    marginal = np.zeros((n, size, size))
    marginal[:, [at, at + 1, at + 2], [at, at + 1, at + 2]] = 0.5 * sigma**2
    covariance = Covariance(marginal[:, :dim], marginal[0, dim:, dim:], np.zeros((n - 1, dim, dim)))
    bridged = np.ones(n - 1, dtype=bool)
    graph: Any = SimpleNamespace(families=(gnss,))
    assert ratios_of(group_residuals(graph, states, covariance, bridged)) == pytest.approx(
        {"gnss": np.sqrt(0.36 / 0.5)}
    )


def test_the_kernel_spreads_as_numpy_does(
    simulated: Callable[..., Simulation], with_both: Callable[[Callable[[], Any]], tuple[Any, Any]]
) -> None:
    """Of the accelerometer what is left after cancelling is 1e-4 either way, by a sum in long double."""
    problem = build_problem(simulated("mainline-gnss", seed=3, duration_s=60.0).recording, SmoothConfig())
    solution = solve(problem, SmoothConfig().solver)
    covariance = posterior_covariance(solution.root)
    ours, theirs = with_both(lambda: group_residuals(problem, solution.states, covariance, problem.run.bridged))
    assert set(ours) == set(theirs) >= {"gyro", "accel", "motion", "path", "tach", "gnss"}
    for name, residuals in theirs.items():
        np.testing.assert_array_equal(ours[name].keyframe, residuals.keyframe)
        np.testing.assert_allclose(ours[name].redundancy, residuals.redundancy, atol=3e-4 if name == "accel" else 1e-6)


def test_the_kernel_refuses_factors_that_do_not_belong_together() -> None:
    compiled = pytest.importorskip("trackfg.numerics.compiled")
    first, columns, later = np.zeros(2, dtype=np.int64), np.zeros(3, dtype=np.int64), np.zeros(3, dtype=bool)
    with pytest.raises(ValueError, match="do not belong together: factors"):
        compiled.spread(
            *(np.zeros((1, 1, 4)), first, first, columns, later),
            *(np.zeros((2, 19, 61)), np.zeros((42, 42)), np.zeros((1, 19, 19)), np.zeros((1, 1))),
        )

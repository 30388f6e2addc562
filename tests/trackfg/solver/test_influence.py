"""Shares and misfits of groups of residuals, against the dense system."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from trackfg.config import SmoothConfig
from trackfg.datasets.scenarios import Simulation
from trackfg.factors.imu import linearize_imu_factors
from trackfg.factors.states import KEYFRAME_DIM
from trackfg.graph.build import build_problem
from trackfg.numerics.arrays import Array
from trackfg.sensors.displacement import rail_views
from trackfg.smoothing.rail_ties import with_rail_factors
from trackfg.solver.covariance import Functions
from trackfg.solver.elimination import eliminate
from trackfg.solver.gauss_newton import solve
from trackfg.solver.influence import Misfit, all_rows, gains, misfits

Linearized = Callable[..., tuple[Array, Array]]
LENGTH = 7
"""Keyframes in a block."""


def of_first_state(keyframe: np.ndarray, shared: int) -> Functions:
    """Return the first state of some keyframes (m,) as functions."""
    by_first = np.zeros((len(keyframe), KEYFRAME_DIM))
    by_first[:, 0] = 1.0
    return Functions(keyframe, by_first, np.zeros_like(by_first), np.zeros((len(keyframe), shared)))


class Dense:
    """A run of 40 s, its dense system, and what is found of the chainage at two keyframes."""

    def __init__(self, run: Simulation, linearized: Linearized) -> None:
        config = SmoothConfig()
        problem = build_problem(run.recording, config)
        solution = solve(problem, config.solver)
        linear = [linearize_imu_factors(problem.native, solution.values)]
        linear += [family.linearize(solution.states) for family in problem.families]
        n = len(problem.t)
        solution = replace(solution, root=eliminate(linear, n))
        self.A, self.r = linearized(problem, solution.states)
        self.P = np.linalg.inv(self.A.T @ self.A)
        self.gyro = (9 * np.arange(n - 1)[:, None] + np.arange(3)).ravel()
        functions = of_first_state(np.array([n // 2, n - 2]), solution.root.size - KEYFRAME_DIM)
        columns = np.zeros((n, KEYFRAME_DIM, 2))
        functions.add_to(columns, 0)
        stacked = np.concatenate([columns.reshape(-1, 2), functions.by_shared.T])
        gain = self.P @ stacked
        self.w = self.A @ gain / np.sqrt(np.sum(stacked * gain, axis=0))
        block = np.arange(n) // LENGTH
        rows = all_rows(problem, solution, np.random.default_rng(0))
        (found,) = misfits(rows, gains(solution.root, functions, [n], 1), [np.arange(n), block])
        self.found = {one.group: one for one in found}

    def in_blocks(self, rows: Array, per_factor: int, keyframes: int) -> np.ndarray:
        """Return which block of some keyframes each of a group's rows is in."""
        return np.arange(len(rows)) // per_factor // keyframes


@pytest.fixture(scope="module")
def dense(simulated: Callable[..., Simulation], linearized: Linearized) -> Dense:
    return Dense(simulated("mainline", seed=2, duration_s=40.0), linearized)


def seen(dense: Dense, rows: Array, block: np.ndarray) -> float:
    """Return the sum over blocks of squared sums of w r."""
    product = dense.w[rows] * dense.r[rows, None]
    return float(sum(np.sum(product[block == b].sum(axis=0) ** 2) for b in np.unique(block)))


def test_shares_are_those_of_the_dense_system(dense: Dense) -> None:
    assert np.sum(dense.w**2, axis=0) == pytest.approx(np.ones(2), rel=1e-4)
    assert dense.found["gyro"].share == pytest.approx(np.sum(dense.w[dense.gyro] ** 2) / 2.0, rel=1e-3)


@pytest.mark.parametrize(("of_blocks", "keyframes"), [(0, 1), (1, LENGTH)])
def test_residuals_are_summed_over_blocks(dense: Dense, of_blocks: int, keyframes: int) -> None:
    gyro = seen(dense, dense.gyro, dense.in_blocks(dense.gyro, 3, keyframes))
    assert dense.found["gyro"].seen[of_blocks] == pytest.approx(gyro, rel=1e-2)


def test_drawn_errors_have_the_mean_that_the_model_expects(dense: Dense) -> None:
    """``sum_b w_b' (I - A P A')_bb w_b`` over the blocks, for both functions."""
    A, rows = dense.A[dense.gyro], dense.gyro
    redundancy = np.eye(len(rows)) - A @ dense.P @ A.T
    block = dense.in_blocks(rows, 3, LENGTH)
    same = block[:, None] == block
    expected = np.einsum("im,ij,jm->", dense.w[rows], redundancy * same, dense.w[rows])
    drawn = dense.found["gyro"].drawn[1]
    assert abs(drawn.mean() - expected) < 4.0 * drawn.std() / np.sqrt(len(drawn))


@pytest.mark.usefixtures("kernels")
@pytest.mark.parametrize("scenario", ["mainline", "measuring-car"])
def test_parts_of_a_run_give_the_misfits_of_the_whole(scenario: str, simulated: Callable[..., Simulation]) -> None:
    """With lasers, conditionals reach over some parts."""
    recording, config = simulated(scenario, seed=2, duration_s=60.0).recording, SmoothConfig()
    problem = build_problem(recording, config)
    if views := rail_views(recording):
        problem = with_rail_factors(problem, problem.initial, views, config.laser)
    solution, n = solve(problem, config.solver), len(problem.t)
    functions = of_first_state(np.array([n // 4, n // 2, n - 2]), solution.root.size - KEYFRAME_DIM)
    functions.by_second[0, 3] = functions.by_shared[1, 2] = -1.0
    rows, block = all_rows(problem, solution, np.random.default_rng(0)), np.arange(n) // 5
    assert solution.root.ahead.any() == (scenario == "measuring-car")
    (whole,), (parts,) = (
        misfits(rows, gains(solution.root, functions, ends, 1), [np.arange(n), block])
        for ends in ([n], [*range(5, n, 5), n])
    )
    for one, other in zip(whole, parts, strict=True):
        assert one.group == other.group
        assert one.share == pytest.approx(other.share, rel=1e-7)
        np.testing.assert_allclose(one.seen, other.seen, rtol=1e-7)
        np.testing.assert_allclose(one.drawn, other.drawn, rtol=1e-7)


def test_ratio_and_degrees_of_freedom() -> None:
    """Draws of mean 4 and variance 8: a chi-square of 4 degrees of freedom."""
    drawn = 4.0 + np.sqrt(8.0) * np.array([[-1.0, 1.0]])
    misfit = Misfit("tach", 0.5, np.array([12.0]), drawn)
    assert misfit.ratio == pytest.approx([3.0])
    assert misfit.degrees == pytest.approx([4.0])

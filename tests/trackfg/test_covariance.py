"""The backward recursion against the dense inverse of the whole information matrix."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import gtsam
import numpy as np
import pytest
from scipy.linalg import solve_triangular

from trackfg.config import SmoothConfig
from trackfg.covariance import Covariance, posterior_covariance, square_root
from trackfg.datasets.scenarios import Simulation
from trackfg.factors.states import KEYFRAME_DIM, SHARED, SHARED_DIM, Kind, States, offset_in_keyframe
from trackfg.graph import Problem, build_problem
from trackfg.solver import chain_ordering


class Solved(NamedTuple):
    keyframes: int
    dense: np.ndarray
    """The whole covariance, keyframe by keyframe, shared variables last."""
    ours: Covariance


@pytest.fixture(scope="module", params=["trolley", "mainline-gnss"])
def solved(
    request: pytest.FixtureRequest,
    simulated: Callable[..., Simulation],
    linearized: Callable[[Problem, States], gtsam.GaussianFactorGraph],
) -> Solved:
    problem = build_problem(
        simulated(request.param, seed=2, duration_s=65.0 if request.param == "trolley" else 45.0).recording,
        SmoothConfig(),
    )
    n = len(problem.t)
    ordering = chain_ordering(n)
    linear = linearized(problem, problem.initial)
    A, _ = linear.jacobian(ordering)
    R = np.linalg.qr(A, mode="r")
    root = solve_triangular(R, np.eye(len(R)))
    ours = posterior_covariance(square_root(linear.eliminateSequential(ordering, gtsam.EliminateQR), n))
    return Solved(n, root @ root.T, ours)


def block(solved: Solved, i: int, j: int) -> np.ndarray:
    """The dense covariance of (x_i, s) with (x_j, s)."""

    def rows(k: int) -> np.ndarray:
        shared = solved.keyframes * KEYFRAME_DIM + np.arange(SHARED_DIM)
        return np.concatenate([k * KEYFRAME_DIM + np.arange(KEYFRAME_DIM), shared])

    return solved.dense[np.ix_(rows(i), rows(j))]


def assert_same(ours: np.ndarray, dense: np.ndarray, scale_i: np.ndarray, scale_j: np.ndarray) -> None:
    """Equal as correlations: the variables' own sigmas span ten powers of ten."""
    scale = np.sqrt(np.outer(np.diag(scale_i), np.diag(scale_j)))
    np.testing.assert_allclose(ours / scale, dense / scale, atol=2e-5)


def test_marginals_equal_the_dense_inverse(solved: Solved) -> None:
    for k in range(solved.keyframes):
        dense = block(solved, k, k)
        assert_same(solved.ours.marginal[k], dense, dense, dense)


def test_cross_covariances_of_any_two_keyframes(solved: Solved) -> None:
    last = solved.keyframes - 1
    for i, j in [(0, 1), (0, last), (3, 3), (5, 17), (last - 1, last), (last // 2, last)]:
        assert_same(solved.ours.between(i, j), block(solved, i, j), block(solved, i, i), block(solved, j, j))


@pytest.mark.parametrize("kind", Kind)
def test_marginals_of_one_kind(solved: Solved, kind: Kind) -> None:
    ours = solved.ours.of(kind)
    if kind.shared:
        start = solved.keyframes * KEYFRAME_DIM + sum(k.dim for k in SHARED[: SHARED.index(kind)])
        starts = np.array([start])
    else:
        starts = KEYFRAME_DIM * np.arange(solved.keyframes) + offset_in_keyframe(kind)
    assert ours.shape == (len(starts), kind.dim, kind.dim)
    for one, start in zip(ours, starts, strict=True):
        dense = solved.dense[start : start + kind.dim, start : start + kind.dim]
        assert_same(one, dense, dense, dense)


def test_marginals_are_covariances(solved: Solved) -> None:
    marginal = solved.ours.marginal
    np.testing.assert_array_equal(marginal, np.swapaxes(marginal, 1, 2))
    sd = np.sqrt(np.diagonal(marginal, axis1=1, axis2=2))
    assert (sd > 0).all()
    correlation = marginal / sd[:, :, None] / sd[:, None, :]
    assert np.linalg.eigvalsh(correlation).min() > -1e-9


def test_shared_variables_are_the_same_in_every_marginal(solved: Solved) -> None:
    shared = solved.ours.marginal[:, KEYFRAME_DIM:, KEYFRAME_DIM:]
    sd = np.sqrt(np.diagonal(shared[0]))
    np.testing.assert_allclose(
        shared / np.outer(sd, sd), np.broadcast_to(shared[0] / np.outer(sd, sd), shared.shape), atol=1e-9
    )

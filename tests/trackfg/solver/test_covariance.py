"""The backward recursion against the dense inverse of the whole information matrix."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import pytest
from scipy.linalg import solve_triangular

from trackfg.config import SmoothConfig
from trackfg.datasets.scenarios import Simulation
from trackfg.errors import UnsolvableError
from trackfg.factors.imu import linearize_imu_factors
from trackfg.factors.linear import LinearFactors, Slot, last_keyframe
from trackfg.factors.marginal_prior import marginal_prior
from trackfg.factors.states import ELIMINATION_ORDER, KEYFRAME_DIM, SHARED, SHARED_DIM, Kind, States, offset_in_keyframe
from trackfg.graph.build import Problem, build_problem
from trackfg.recording.model import Recording
from trackfg.sensors.displacement import rail_views
from trackfg.smoothing.rail_ties import with_rail_factors
from trackfg.solver.covariance import (
    Covariance,
    Functions,
    covariance_given_next,
    joint_covariance,
    posterior_covariance,
    posterior_samples,
    times_covariance,
)
from trackfg.solver.elimination import compressed, eliminate, eliminate_pair, eliminate_with_marginals
from trackfg.solver.placed_factors import stacked_pair
from trackfg.solver.square_root import SquareRoot


class Solved(NamedTuple):
    keyframes: int
    A: np.ndarray
    """The whole system ``A d = b`` as GTSAM has it."""
    b: np.ndarray
    dense: np.ndarray
    """The whole covariance, keyframe by keyframe, shared variables last."""
    information: np.ndarray
    """Its inverse's square root, upper triangular."""
    factors: list[LinearFactors]
    root: SquareRoot
    ours: Covariance


WithBoth = Callable[[Callable[[], Any]], tuple[Any, Any]]
Linearized = Callable[[Problem, States], tuple[np.ndarray, np.ndarray]]


def problem_of(recording: Recording) -> Problem:
    """With the factors of its lasers, if it has any."""
    problem, config = build_problem(recording, SmoothConfig()), SmoothConfig()
    views = rail_views(recording)
    return with_rail_factors(problem, problem.initial, views, config.laser) if views else problem


def solved_of(recording: Recording, linearized: Linearized) -> Solved:
    problem = problem_of(recording)
    n, states = len(problem.t), problem.initial
    A, b = linearized(problem, states)
    R = np.linalg.qr(A, mode="r")
    inverse = solve_triangular(R, np.eye(len(R)))
    inertial = linearize_imu_factors(problem.native, states.to_gtsam())
    factors = [inertial, *(family.linearize(states) for family in problem.families)]
    root = eliminate(factors, n)
    return Solved(n, A, b, inverse @ inverse.T, R, factors, root, posterior_covariance(root))


def test_keyframes_left_behind_say_what_they_said(simulated: Callable[..., Simulation]) -> None:
    """Once some are eliminated and stand as one factor, the rest is known as before."""
    problem = problem_of(simulated("mainline-gnss", seed=2, duration_s=45.0).recording)
    n, gone, states = len(problem.t), 7, problem.initial
    inertial = linearize_imu_factors(problem.native, states.to_gtsam())
    factors = [inertial, *(family.linearize(states) for family in problem.families)]
    late = [from_keyframe(one, gone) for one in factors]
    whole, left = eliminate_with_marginals(factors, n, {gone})
    rest = eliminate(
        [
            marginal_prior(left[gone], states.take(slice(gone, gone + 1))).linearize(states.take(slice(gone, None))),
            *late,
        ],
        n - gone,
    )
    np.testing.assert_allclose(rest.solution().keyframes, whole.solution().keyframes[gone:], rtol=1e-5, atol=1e-9)
    marginal = posterior_covariance(rest).marginal
    np.testing.assert_allclose(marginal, posterior_covariance(whole).marginal[gone:], rtol=1e-4, atol=1e-14)


def test_what_is_known_of_later_keyframes_is_gone_on_from(
    simulated: Callable[..., Simulation], with_both: WithBoth
) -> None:
    problem = problem_of(simulated("mainline-gnss", seed=2, duration_s=45.0).recording)
    n, earlier = len(problem.t), 7
    inertial = linearize_imu_factors(problem.native, problem.initial.to_gtsam())
    root = eliminate([inertial, *(family.linearize(problem.initial) for family in problem.families)], n)

    def pieced() -> tuple[Covariance, Covariance]:
        return posterior_covariance(root), posterior_covariance(
            root.first(earlier), posterior_covariance(root.last(n - earlier))
        )

    for whole, joined in with_both(pieced):
        for part in ("of_keyframes", "of_shared", "cross"):
            np.testing.assert_array_equal(getattr(joined, part), getattr(whole, part))


def test_a_pair_is_eliminated_as_a_chain_of_two(simulated: Callable[..., Simulation]) -> None:
    problem = problem_of(simulated("mainline-gnss", seed=2, duration_s=45.0).recording)
    states = problem.initial
    inertial = linearize_imu_factors(problem.native, states.to_gtsam())
    every = [inertial, *(family.linearize(states) for family in problem.families)]
    factors = [one.take(last_keyframe(one.slots, len(one.rows)) <= 1) for one in every]
    chain = eliminate(factors, 2)
    rows = stacked_pair(factors)
    pair, left = eliminate_pair(compressed(rows[:40]), rows[40:])
    for name in ("R", "S", "d", "R_shared", "d_shared"):
        theirs = getattr(chain, name)
        np.testing.assert_allclose(getattr(pair, name), theirs, rtol=1e-6, atol=1e-9 * max(1.0, np.abs(theirs).max()))
    rest = np.zeros((len(left), left.shape[1]))
    rest[:19, :19], rest[:19, 19:-1], rest[:19, -1] = chain.R[1], chain.S[1, :, 19:], chain.d[1]
    rest[19:, 19:-1], rest[19:, -1] = chain.R_shared, chain.d_shared
    ours, theirs = left.T @ left, rest.T @ rest
    scale = np.maximum(np.sqrt(np.diag(theirs)), 1.0)
    np.testing.assert_allclose(ours / np.outer(scale, scale), theirs / np.outer(scale, scale), atol=1e-9)
    with pytest.raises(UnsolvableError, match="do not determine"):
        eliminate_pair(compressed(rows[:30]), rows[:0])


def from_keyframe(factors: LinearFactors, keyframe: int) -> LinearFactors:
    """Those that touch none before, by numbers of their own."""
    own = [slot.index for slot in factors.slots if not slot.kind.shared]
    late = np.min(own, axis=0) >= keyframe if own else np.zeros(len(factors.b), dtype=bool)
    slots = tuple(Slot(s.kind, s.index[late] - (0 if s.kind.shared else keyframe)) for s in factors.slots)
    return LinearFactors(slots, factors.rows[late])


@pytest.fixture(scope="module")
def far_reaching(simulated_in_full: Callable[..., Simulation], linearized: Linearized) -> Solved:
    """A car that gathers speed: its two units of lasers tie keyframes that are up to several apart."""
    return solved_of(simulated_in_full("measuring-car", seed=2, duration_s=42.0).recording, linearized)


@pytest.fixture(scope="module", params=["trolley", "mainline-gnss", "measuring-car"])
def solved(request: pytest.FixtureRequest, simulated: Callable[..., Simulation], linearized: Linearized) -> Solved:
    if request.param == "measuring-car":
        far: Solved = request.getfixturevalue("far_reaching")
        return far
    duration_s = 65.0 if request.param == "trolley" else 45.0
    return solved_of(simulated(request.param, seed=2, duration_s=duration_s).recording, linearized)


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


def test_elimination_solves_the_least_squares_problem(solved: Solved) -> None:
    """What is left of the system after the step is square to every column; what is not is the step's length."""
    step = solved.root.solution()
    stacked = np.concatenate([step.keyframes.ravel(), step.shared])
    left = solved.b - solved.A @ stacked
    assert np.abs(solved.A.T @ left / np.linalg.norm(solved.A, axis=0)).max() < 1e-7 * np.linalg.norm(solved.b)
    assert solved.root.length == pytest.approx(np.linalg.norm(solved.A @ stacked), rel=1e-9)


def test_square_root_is_that_of_the_dense_system(solved: Solved) -> None:
    """Row by row, of the first keyframes; a row's sign is free, and ours has a positive diagonal."""
    n, dim = solved.keyframes, KEYFRAME_DIM
    R = solved.information * np.copysign(1.0, np.diag(solved.information))[:, None]
    for k in range(8):
        rows = slice(k * dim, (k + 1) * dim)
        np.testing.assert_allclose(solved.root.R[k], R[rows, rows], rtol=1e-6, atol=1e-7 * np.abs(R[rows]).max())
        ours = solved.root.S[k, :, : dim + SHARED_DIM]
        theirs = np.hstack([R[rows, (k + 1) * dim : (k + 2) * dim], R[rows, n * dim :]])
        np.testing.assert_allclose(ours, theirs, rtol=1e-6, atol=1e-7 * np.abs(R[rows]).max())
    assert (np.diagonal(solved.root.R, axis1=1, axis2=2) > 0).all()
    assert (np.diagonal(solved.root.R_shared) > 0).all()


def assert_same_root(compiled: SquareRoot, lapack: SquareRoot) -> None:
    """Rows of the root are held against their length; the whitened step, in posterior sigmas, against its own."""
    for name in ("R", "S", "R_shared"):
        ours, theirs = getattr(compiled, name), getattr(lapack, name)
        scale = np.linalg.norm(lapack.R if name == "S" else theirs, axis=-1, keepdims=True)
        np.testing.assert_allclose(ours / scale, theirs / scale, atol=1e-8)
    for name in ("d", "d_shared"):
        ours, theirs = getattr(compiled, name), getattr(lapack, name)
        np.testing.assert_allclose(ours, theirs, atol=1e-8 * max(1.0, lapack.length))


def test_kernels_eliminate_as_lapack_does(solved: Solved, with_both: WithBoth) -> None:
    compiled, lapack = with_both(lambda: eliminate(solved.factors, solved.keyframes))
    assert_same_root(compiled, lapack)
    assert (compiled.ahead == lapack.ahead).all()


def test_kernels_leave_the_same_marginals(simulated: Callable[..., Simulation], with_both: WithBoth) -> None:
    problem = problem_of(simulated("mainline-gnss", seed=2, duration_s=45.0).recording)
    inertial = linearize_imu_factors(problem.native, problem.initial.to_gtsam())
    factors = [inertial, *(family.linearize(problem.initial) for family in problem.families)]
    compiled, lapack = with_both(lambda: eliminate_with_marginals(factors, len(problem.t), {1, 7})[1])
    assert compiled.keys() == lapack.keys() == {1, 7}
    for count in (1, 7):
        ours, theirs = (rows[count].T @ rows[count] for rows in (compiled, lapack))
        scale = np.maximum(np.sqrt(np.diag(theirs)), 1.0)
        np.testing.assert_allclose(ours / np.outer(scale, scale), theirs / np.outer(scale, scale), atol=1e-9)


def test_kernels_eliminate_a_pair_as_lapack_does(simulated: Callable[..., Simulation], with_both: WithBoth) -> None:
    problem = problem_of(simulated("mainline-gnss", seed=2, duration_s=45.0).recording)
    inertial = linearize_imu_factors(problem.native, problem.initial.to_gtsam())
    every = [inertial, *(family.linearize(problem.initial) for family in problem.families)]
    rows = stacked_pair([one.take(last_keyframe(one.slots, len(one.rows)) <= 1) for one in every])
    (ours, our_marginal), (theirs, their_marginal) = with_both(lambda: eliminate_pair(compressed(rows[:-9]), rows[-9:]))
    assert_same_root(ours, theirs)
    scale = np.linalg.norm(their_marginal, axis=1, keepdims=True)
    np.testing.assert_allclose(our_marginal / scale, their_marginal / scale, atol=1e-8)


def test_kernels_recur_as_numpy_does(solved: Solved, with_both: WithBoth) -> None:
    """Covariances, samples and products with the covariance, in posterior sigmas."""
    n, dim = solved.keyframes, KEYFRAME_DIM
    scale = np.sqrt(np.diag(solved.dense))
    columns = np.random.default_rng(0).standard_normal((len(scale), 3)) / scale[:, None]

    def recursions() -> tuple[Covariance, list[np.ndarray]]:
        samples = posterior_samples(solved.root, 4, np.random.default_rng(1))
        products = times_covariance(solved.root, columns[: n * dim].reshape(n, dim, 3).copy(), columns[n * dim :])
        return posterior_covariance(solved.root), [*samples, *products]

    (ours, drawn), (theirs, also_drawn) = with_both(recursions)
    sd = np.sqrt(np.diagonal(theirs.marginal, axis1=1, axis2=2))
    of_both = sd[:, :dim, None] * sd[:, None, :]
    np.testing.assert_allclose(ours.of_keyframes / of_both, theirs.of_keyframes / of_both, atol=1e-8)
    shared = np.outer(sd[0, dim:], sd[0, dim:])
    np.testing.assert_allclose(ours.of_shared / shared, theirs.of_shared / shared, atol=1e-8)
    of_neighbours = sd[:-1, :dim, None] * sd[1:, None, :dim]
    np.testing.assert_allclose(ours.cross / of_neighbours, theirs.cross / of_neighbours, atol=1e-8)
    for one, other, sigma in zip(drawn, also_drawn, 2 * (sd[:, :dim], sd[0, dim:]), strict=True):
        np.testing.assert_allclose(one / sigma[..., None], other / sigma[..., None], atol=1e-8)


def test_covariance_times_columns_is_that_of_the_dense_system(solved: Solved) -> None:
    rng, n, dim = np.random.default_rng(0), solved.keyframes, KEYFRAME_DIM
    scale = np.sqrt(np.diag(solved.dense))
    columns = rng.standard_normal((len(scale), 3)) / scale[:, None]
    keyframes, shared = times_covariance(solved.root, columns[: n * dim].reshape(n, dim, 3).copy(), columns[n * dim :])
    ours = np.concatenate([keyframes.reshape(-1, 3), shared])
    np.testing.assert_allclose(ours / scale[:, None], (solved.dense @ columns) / scale[:, None], atol=1e-3)


def test_only_navigation_states_reach_past_the_next_keyframe() -> None:
    first = np.array([0])
    factors = LinearFactors((Slot(Kind.BIAS, first), Slot(Kind.BIAS, first + 2)), np.ones((1, 1, 13)))
    with pytest.raises(ValueError, match="BIAS is touched from 2 keyframes before"):
        eliminate([factors], 4)


def test_marginals_equal_the_dense_inverse(solved: Solved) -> None:
    for k in range(solved.keyframes):
        dense = block(solved, k, k)
        assert_same(solved.ours.marginal[k], dense, dense, dense)


def test_cross_covariances_of_any_two_keyframes(solved: Solved) -> None:
    """Along a chain; where factors tie keyframes further apart those of neighbours."""
    last = solved.keyframes - 1
    pairs = [(0, 1), (0, last), (3, 3), (5, 17), (last - 1, last), (last // 2, last)]
    if solved.root.ahead.any():
        pairs = [(k, k + 1) for k in range(last)]
    for i, j in pairs:
        assert_same(solved.ours.between(i, j), block(solved, i, j), block(solved, i, i), block(solved, j, j))


def test_lasers_tie_keyframes_that_are_no_neighbours(far_reaching: Solved) -> None:
    """As far ahead as the car takes to run the 5 m between its units; fewer as it gathers speed; none at the end."""
    ahead = far_reaching.root.ahead
    assert 3 <= ahead.max() <= SmoothConfig().laser.max_keyframes
    assert ahead.argmax() < ahead.size // 2
    assert ahead[-1] == 0
    # A window is carried until its last keyframe is reached.
    assert (np.diff(ahead) >= -1).all()


def test_samples_have_the_posterior_covariance(solved: Solved) -> None:
    """All keyframes and the shared variables together: R times a sample is white, whatever the condition of R."""
    count, n = 600, solved.keyframes
    keyframes, shared = posterior_samples(solved.root, count, np.random.default_rng(0))
    assert keyframes.shape == (n, KEYFRAME_DIM, count)
    assert shared.shape == (SHARED_DIM, count)
    stacked = np.concatenate([keyframes.reshape(-1, count), shared])
    white = solved.information @ stacked
    variance = white.var(axis=1)
    assert variance.mean() == pytest.approx(1.0, abs=4 * np.sqrt(2.0 / white.size) + 1e-3)
    assert np.abs(variance - 1.0).max() < 6 * np.sqrt(2.0 / count)
    correlation = np.corrcoef(white) - np.eye(len(white))
    assert np.abs(correlation).max() < 6.5 / np.sqrt(count)
    samples = np.concatenate([keyframes, np.broadcast_to(shared, (n, *shared.shape))], axis=1)
    marginal = samples.std(axis=2) / np.sqrt(np.diagonal(solved.ours.marginal, axis1=1, axis2=2))
    assert np.abs(marginal - 1.0).max() < 6 / np.sqrt(2 * count)


def test_samples_repeat_with_their_generator(far_reaching: Solved) -> None:
    one, again = (posterior_samples(far_reaching.root, 5, np.random.default_rng(7)) for _ in range(2))
    np.testing.assert_array_equal(one[0], again[0])
    np.testing.assert_array_equal(one[1], again[1])


@pytest.mark.parametrize("kind", [*ELIMINATION_ORDER, *SHARED])
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


def test_functions_far_apart_covary_as_in_the_dense_inverse(solved: Solved) -> None:
    rng = np.random.default_rng(5)
    keyframe = np.sort(rng.integers(0, solved.keyframes - 1, 40))
    first, second = rng.standard_normal((2, 40, KEYFRAME_DIM)) / np.sqrt(np.diag(solved.dense)[:KEYFRAME_DIM])
    shared = rng.standard_normal((40, SHARED_DIM))
    rows = np.zeros((40, len(solved.dense)))
    for row, k, one, two, three in zip(rows, keyframe, first, second, shared, strict=True):
        row[k * KEYFRAME_DIM : (k + 2) * KEYFRAME_DIM] = np.concatenate([one, two])
        row[-SHARED_DIM:] = three
    expected = rows @ solved.dense @ rows.T
    ours = joint_covariance(solved.root, Functions(keyframe, first, second, shared), solved.ours).matrix
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    assert np.abs((ours - expected) / scale).max() < 1e-6


def test_functions_given_the_next_keyframe_covary_as_without_it(
    simulated: Callable[..., Simulation], linearized: Linearized
) -> None:
    """Functions ``G' z + e`` of the keyframes before the last one, z = (x_n, s): ``G' P G + Cov(e)`` is the covariance
    that they have in the whole chain.
    """
    solved = solved_of(simulated("mainline-gnss", seed=2, duration_s=45.0).recording, linearized)
    root, rng = solved.root, np.random.default_rng(6)
    keyframe = np.sort(rng.integers(0, solved.keyframes - 1, 40))
    first, second = rng.standard_normal((2, 40, KEYFRAME_DIM)) / np.sqrt(np.diag(solved.dense)[:KEYFRAME_DIM])
    functions = Functions(keyframe, first, second, rng.standard_normal((40, SHARED_DIM)))
    before = replace(root, R=root.R[:-1], S=root.S[:-1], d=root.d[:-1], ahead=root.ahead[:-1])
    between, G = covariance_given_next(before, functions)
    expected = joint_covariance(root, functions, solved.ours).matrix
    ours = between + G.T @ solved.ours.marginal[-1] @ G
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    assert np.abs((ours - expected) / scale).max() < 1e-6


def test_functions_of_late_keyframes_alone(solved: Solved) -> None:
    """A long rest puts many keyframes before the first place of a profile: none of them touches a function."""
    k, odo = solved.keyframes - 2, offset_in_keyframe(Kind.ODO)
    by_first = np.zeros((1, KEYFRAME_DIM))
    by_first[0, odo] = 1.0
    functions = Functions(np.array([k]), by_first, np.zeros((1, KEYFRAME_DIM)), np.zeros((1, SHARED_DIM)))
    distance = k * KEYFRAME_DIM + odo
    np.testing.assert_allclose(
        joint_covariance(solved.root, functions, solved.ours).matrix, solved.dense[distance, distance], rtol=1e-4
    )

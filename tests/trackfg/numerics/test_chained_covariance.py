"""The covariance by blocks against the matrix of a process whose covariance is known in closed form."""

from __future__ import annotations

import numpy as np
import pytest

from trackfg.numerics.chained_covariance import Block, ChainedCovariance

STATE, BLOCKS, EACH = 3, 12, 4
GAIN = np.array([[1.0, 0.2, 0.0], [0.0, 0.9, 0.1], [0.0, 0.0, 1.0]])


def process(seed: int = 0) -> tuple[ChainedCovariance, np.ndarray]:
    """Return functions ``f_a = D_a y_a + v`` of ``y_a = G y_{a-1} + w``, by blocks and as a matrix."""
    rng = np.random.default_rng(seed)
    variance, by_state = [np.eye(STATE)], rng.standard_normal((BLOCKS, EACH, STATE))
    for _ in range(BLOCKS):
        variance.append(GAIN @ variance[-1] @ GAIN.T + np.diag([0.1, 0.2, 0.0]))
    blocks, matrix = [], np.diag(np.full(BLOCKS * EACH, 0.5))
    for a, D in enumerate(by_state):
        before, after = variance[a], variance[a + 1]
        rows = EACH * a + np.arange(EACH)
        own = D @ after @ D.T + 0.5 * np.eye(EACH)
        start_by_end = before @ GAIN.T @ np.linalg.inv(after)
        blocks.append(Block(rows, own, D, start_by_end, before @ GAIN.T @ D.T))
        for b, D_b in enumerate(by_state[a:], a):
            across = D @ after @ np.linalg.matrix_power(GAIN, b - a).T @ D_b.T
            at = slice(EACH * b, EACH * (b + 1))
            matrix[rows, at] = across + (0.5 * np.eye(EACH) if a == b else 0.0)
            matrix[at, rows] = matrix[rows, at].T
    return ChainedCovariance(tuple(blocks)), matrix


def test_the_whole_and_any_part_are_those_of_the_matrix() -> None:
    chained, matrix = process()
    np.testing.assert_allclose(chained.matrix, matrix, atol=1e-12)
    rows = np.random.default_rng(1).permutation(len(matrix))[:17]
    np.testing.assert_allclose(chained.part(rows), matrix[np.ix_(rows, rows)], atol=1e-12)
    assert chained.part(rows[:0]).shape == (0, 0)


def test_scaled_and_renumbered_it_is_the_matrix_scaled_and_renumbered() -> None:
    chained, matrix = process()
    rng = np.random.default_rng(2)
    factor, number = 1.0 + rng.random(len(matrix)), rng.permutation(len(matrix))
    np.testing.assert_allclose(chained.scaled(factor).matrix, np.outer(factor, factor) * matrix, atol=1e-12)
    np.testing.assert_allclose(chained.renumbered(number).matrix[np.ix_(number, number)], matrix, atol=1e-12)


def test_memory_is_in_proportion_to_the_number_of_functions() -> None:
    chained, matrix = process()
    numbers = sum(part.size for block in chained.blocks for part in block)
    assert numbers == BLOCKS * (EACH + EACH**2 + 2 * STATE * EACH + STATE**2)
    assert ChainedCovariance.of(matrix).part(np.array([3, 1])).tolist() == matrix[np.ix_([3, 1], [3, 1])].tolist()


def test_blocks_that_do_not_fit_are_refused() -> None:
    blocks = process()[0].blocks
    with pytest.raises(ValueError, match="do not fit"):
        ChainedCovariance((blocks[0], ChainedCovariance.of(np.eye(2)).blocks[0]))
    with pytest.raises(ValueError, match="do not fit"):
        ChainedCovariance((blocks[0]._replace(by_end=blocks[0].by_end[1:]), *blocks[1:]))
    with pytest.raises(ValueError, match="each function once"):
        ChainedCovariance((blocks[0], blocks[0]))

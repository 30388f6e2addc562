"""Two states in a row: against the loop over intervals, and what makes an error an outlier."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from trackfg.factors.switching import (
    OUTLIER_SIGMAS,
    Chain,
    _matrices,
    chain_after,
    chain_cost,
    chain_weights,
    first_state_probability,
)

WIDTH = 3.5
CHAIN = Chain(WIDTH)


def errors(n: int, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return rng.normal(size=n) * np.where(rng.random(n) < 0.2, 30.0, 1.0)


def by_loops(z: np.ndarray) -> tuple[float, np.ndarray]:
    """Minus log likelihood and probabilities by the usual forward and backward recursions, scaled at each step."""
    matrices, scale = _matrices(z, CHAIN)
    forward, log_likelihood, before = np.array([1.0, 0.0]), scale.sum(), []
    for k in range(len(z)):
        forward = forward @ matrices[:, :, k]
        log_likelihood += np.log(forward.sum())
        forward = forward / forward.sum()
        before.append(forward)
    after = [np.ones(2)]
    for k in range(len(z) - 1, 0, -1):
        backward = matrices[:, :, k] @ after[0]
        after.insert(0, backward / backward.sum())
    both = np.array(before) * np.array(after)
    return -log_likelihood, both[:, 0] / both.sum(axis=1)


@pytest.mark.parametrize("n", [1, 2, 3, 64, 1000])
def test_doubling_equals_the_recursions(n: int) -> None:
    z = errors(n)
    cost, probability = by_loops(z)
    at_zero, _ = by_loops(np.zeros(n))
    assert chain_cost(z, CHAIN) == pytest.approx(cost - at_zero, abs=1e-8)
    np.testing.assert_allclose(first_state_probability(z, CHAIN), probability, atol=1e-12)


@pytest.mark.parametrize("n", [1, 2, 64, 1000])
@pytest.mark.parametrize("before", [1.0, 0.3, 0.0])
def test_the_kernel_finds_what_numpy_does(
    n: int, before: float, with_both: Callable[[Callable[[], Any]], tuple[Any, Any]]
) -> None:
    chain, z = Chain(WIDTH, 0.5, before), errors(n)
    ours, theirs = with_both(lambda: (chain_weights(z, chain), chain_after(z, chain).inlier_before))
    for found, expected in zip(ours, theirs, strict=True):
        np.testing.assert_allclose(found, expected, rtol=1e-11, atol=1e-15)


def test_weight_is_the_slope_of_the_cost_over_the_error() -> None:
    z, step = errors(60, 3), 1e-5
    for k in range(0, 60, 7):
        moved = np.zeros(60)
        moved[k] = step
        slope = (chain_cost(z + moved, CHAIN) - chain_cost(z - moved, CHAIN)) / (2.0 * step)
        assert slope == pytest.approx(chain_weights(z, CHAIN)[k] * z[k], rel=1e-4, abs=1e-6)


def test_a_lone_error_at_the_width_is_as_likely_an_outlier() -> None:
    def weight(size: float) -> float:
        z = np.zeros(101)
        z[50] = size
        return float(chain_weights(z, CHAIN)[50])

    assert weight(2.0) > 0.9
    assert 0.3 < weight(WIDTH) < 0.7
    assert weight(5.0) < 0.01
    assert weight(1e6) == pytest.approx(OUTLIER_SIGMAS**-2, rel=1e-3)


def test_errors_that_last_need_not_be_large_and_make_neighbours_doubtful() -> None:
    z = np.zeros(101)
    z[40:60] = 2.5
    weight = chain_weights(z, CHAIN)
    assert weight[50] < 0.05
    assert weight[20] > 0.99
    z[40:60] = 1.0
    assert chain_weights(z, CHAIN)[50] > 0.95
    beside = np.zeros(101)
    beside[[40, 41, 43, 44]] = 50.0
    assert chain_weights(beside, CHAIN)[42] < chain_weights(beside, CHAIN)[60] - 0.2


def test_noise_is_not_doubted() -> None:
    assert chain_weights(np.random.default_rng(1).normal(size=20_000), CHAIN).mean() > 0.98


@pytest.mark.parametrize("cut", [1, 20, 59])
def test_a_row_goes_on_where_another_ended(cut: int) -> None:
    z = errors(60, 3)
    rest = chain_after(z[:cut], CHAIN)
    assert 0.0 <= rest.inlier_before <= 1.0
    np.testing.assert_allclose(
        chain_after(z[cut:], rest).inlier_before, first_state_probability(z, CHAIN)[-1], rtol=1e-9, atol=1e-12
    )
    assert chain_after(z[:0], CHAIN) == CHAIN


def test_errors_that_last_are_doubted_alike_however_long_the_intervals() -> None:
    """The same creep in half as long intervals makes errors that are smaller by the square root of two."""
    for size in (1.5, 2.0, 2.5, 3.0):
        whole, halves = np.zeros(80), np.zeros(160)
        whole[40:50], halves[80:100] = size, size / np.sqrt(2.0)
        by_whole = chain_weights(whole, CHAIN)[40:50].mean()
        by_halves = chain_weights(halves, Chain(WIDTH, interval_s=0.5))[80:100].mean()
        assert by_halves == pytest.approx(by_whole, abs=0.25)

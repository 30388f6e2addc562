"""Two states in a row: against the loop over intervals, and what makes an error an outlier."""

from __future__ import annotations

import numpy as np
import pytest

from trackfg.factors.switching import OUTLIER_SIGMAS, _matrices, first_state_probability, row_cost, row_weights

WIDTH = 3.5


def errors(n: int, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return rng.normal(size=n) * np.where(rng.random(n) < 0.2, 30.0, 1.0)


def by_loops(z: np.ndarray) -> tuple[float, np.ndarray]:
    """Minus log likelihood and probabilities by the usual forward and backward recursions, scaled at each step."""
    matrices, scale = _matrices(z, WIDTH)
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
    assert row_cost(z, WIDTH) == pytest.approx(cost - at_zero, abs=1e-8)
    np.testing.assert_allclose(first_state_probability(z, WIDTH), probability, atol=1e-12)


def test_weight_is_the_slope_of_the_cost_over_the_error() -> None:
    z, step = errors(60, 3), 1e-5
    for k in range(0, 60, 7):
        moved = np.zeros(60)
        moved[k] = step
        slope = (row_cost(z + moved, WIDTH) - row_cost(z - moved, WIDTH)) / (2.0 * step)
        assert slope == pytest.approx(row_weights(z, WIDTH)[k] * z[k], rel=1e-4, abs=1e-6)


def test_a_lone_error_at_the_width_is_as_likely_an_outlier() -> None:
    def weight(size: float) -> float:
        z = np.zeros(101)
        z[50] = size
        return float(row_weights(z, WIDTH)[50])

    assert weight(2.0) > 0.9
    assert 0.3 < weight(WIDTH) < 0.7
    assert weight(5.0) < 0.01
    assert weight(1e6) == pytest.approx(OUTLIER_SIGMAS**-2, rel=1e-3)


def test_errors_that_last_need_not_be_large_and_make_neighbours_doubtful() -> None:
    z = np.zeros(101)
    z[40:60] = 2.5
    weight = row_weights(z, WIDTH)
    assert weight[50] < 0.05
    assert weight[20] > 0.99
    z[40:60] = 1.0
    assert row_weights(z, WIDTH)[50] > 0.95
    beside = np.zeros(101)
    beside[[40, 41, 43, 44]] = 50.0
    assert row_weights(beside, WIDTH)[42] < row_weights(beside, WIDTH)[60] - 0.2


def test_noise_is_not_doubted() -> None:
    assert row_weights(np.random.default_rng(1).normal(size=20_000), WIDTH).mean() > 0.98

from __future__ import annotations

import numpy as np
import pytest

from trackfg.mapping.trends.drift import drift, reached

RNG = np.random.default_rng(7)
PLACES, SD = 4000, 0.5


def noise(n: int) -> np.ndarray:
    return SD * RNG.standard_normal((n, PLACES))


@pytest.mark.parametrize("scale", [0.5, 1.0, 2.0])
def test_rates_are_within_two_sigmas_as_often_as_they_should_whatever_sigmas_are_stated(scale: float) -> None:
    t, rate = np.sort(RNG.uniform(0.0, 6.0, 7)), RNG.uniform(-2.0, 2.0, PLACES)
    y = 3.0 + t[:, None] * rate + noise(7)
    d = drift(t, y, np.full(y.shape, scale * SD), threshold=6.0)
    assert d.scale == pytest.approx(1.0 / scale, rel=0.04)
    assert 0.94 < np.mean(np.abs(d.rate - rate) < 2.0 * d.rate_sd) < 0.97
    truth = 3.0 + t[-1] * rate
    assert 0.94 < np.mean(np.abs(d.value - truth) < 2.0 * d.value_sd) < 0.97


def test_a_place_that_does_not_drift_straight_is_less_certain_and_no_other_is() -> None:
    t = np.arange(12.0)
    y = noise(12)
    y[:, 0] += 10.0 * np.sin(t)
    d = drift(t, y, np.full(y.shape, SD), threshold=1000.0)
    assert d.rate_sd[0] > 10.0 * np.median(d.rate_sd)
    assert d.value_sd[0] > 10.0 * np.median(d.value_sd)
    assert np.mean(d.rate_sd > 1.01 * np.median(d.rate_sd)) < 0.003


def test_tamping_is_a_step_and_the_rate_goes_on() -> None:
    t, rate = np.arange(12.0), RNG.choice([-1.5, 1.5], PLACES)
    y = t[:, None] * rate + noise(12)
    y[7:] -= 7.0 * rate
    d = drift(t, y, np.full(y.shape, SD), threshold=6.0)
    assert np.mean(d.steps[7] != 0.0) > 0.99
    assert np.count_nonzero(np.delete(d.steps, 7, axis=0)) < 0.01 * PLACES
    assert 0.93 < np.mean(np.abs(d.rate - rate) < 2.0 * d.rate_sd) < 0.98
    error = np.abs(d.steps[7] + 7.0 * rate)
    assert 0.93 < np.mean(error < 2.0 * d.step_sd[7]) < 0.98


def test_a_step_is_found_by_the_first_run_after_it() -> None:
    t = np.arange(8.0)
    y = 2.0 * t[:, None] + noise(8)
    y[7] -= 14.0
    d = drift(t, y, np.full(y.shape, SD), threshold=6.0)
    assert np.mean(d.steps[7] < -10.0) > 0.99


def test_an_outlier_is_no_step_and_moves_no_rate() -> None:
    t, rate = np.arange(10.0), RNG.uniform(-1.0, 1.0, PLACES)
    y = t[:, None] * rate + noise(10)
    y[4] += 12.0
    d = drift(t, y, np.full(y.shape, SD), threshold=6.0)
    assert d.outliers[4].mean() > 0.99
    assert np.any(d.steps != 0.0, axis=0).mean() < 0.01
    assert 0.93 < np.mean(np.abs(d.rate - rate) < 2.0 * d.rate_sd) < 0.98


def test_the_sum_of_squares_is_that_of_least_squares() -> None:
    t, y = np.array([0.0, 1.0, 2.5, 4.0]), np.array([[1.0], [2.0], [2.5], [5.0]])
    sd = np.array([[1.0], [0.5], [1.0], [2.0]])
    d = drift(t, y, sd, threshold=1e6)
    slope, value = np.polyfit(t - 4.0, y[:, 0], 1, w=1.0 / sd[:, 0])
    assert (d.rate[0], d.value[0]) == pytest.approx((slope, value))


def test_too_few_runs_and_holes_give_nothing() -> None:
    t, y = np.array([0.0, 1.0, 1.0, 2.0]), np.ones((4, 3))
    y[3, 0] = y[0, 2] = y[1, 2] = np.nan
    d = drift(t, y, np.full(y.shape, 0.1), threshold=6.0)
    assert np.isnan(d.rate).tolist() == [True, False, True]
    with pytest.raises(ValueError, match="ascending"):
        drift(t[::-1], y, y, threshold=6.0)


@pytest.mark.parametrize("n", [5, 12])
def test_the_date_of_a_limit_is_in_its_interval_as_often_as_it_should(n: int) -> None:
    t, rate = np.sort(RNG.uniform(0.0, n, n)), RNG.choice([-1.0, 1.0], PLACES) * RNG.uniform(0.5, 2.0, PLACES)
    start = RNG.standard_normal(PLACES)
    y = start + t[:, None] * rate + noise(n)
    d = drift(t, y, np.full(y.shape, SD), threshold=6.0)
    truth = (25.0 * np.sign(rate) - start) / rate
    on, earliest, latest = reached(d, 25.0)
    assert 0.93 < np.mean((earliest <= truth) & (truth <= latest)) < 0.98
    assert np.all((earliest <= on) & (on <= latest))


def test_what_stands_still_has_an_open_interval_and_what_is_beyond_is_there_now() -> None:
    t = np.arange(6.0)
    d = drift(t, 1.0 + noise(6), np.full((6, PLACES), SD), threshold=6.0)
    assert np.mean(np.isinf(reached(d, 25.0)[2])) > 0.9
    over = drift(t, 30.0 + noise(6), np.full((6, PLACES), SD), threshold=6.0)
    assert np.all(reached(over, 25.0)[0] == 5.0)


def test_a_sigma_that_is_nearly_zero_leaves_numbers() -> None:
    t, sd = np.array([0.0, 1.0, 2.0]), np.array([[1e-14], [0.1], [0.1]])
    d = drift(t, np.array([[1.0], [1.5], [2.1]]), sd, threshold=6.0)
    assert np.isfinite([d.rate, d.rate_sd, d.value, d.value_sd]).all()

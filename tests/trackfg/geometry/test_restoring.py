"""Restoring a shape from its versines: what the chord sees comes back, what it does not stays with the prior."""

from __future__ import annotations

import numpy as np
import pytest

from trackfg.errors import BadInputError
from trackfg.geometry.bands import D1, band_pass
from trackfg.geometry.restoring import ShapePrior, restore, restoring_response
from trackfg.geometry.versines import versine

STEP = 0.25
X = np.arange(2400) * STEP


def amplitude(y: np.ndarray, wavelength: float) -> float:
    """Of the sine of that wavelength in the middle of ``y``, a parabola taken off: versines do not say how it lies."""
    inner = slice(400, 2000)
    x = X[inner] - 300.0
    w = 2.0 * np.pi / wavelength
    parts = np.stack([np.sin(w * X[inner]), np.cos(w * X[inner]), np.ones_like(x), x, x**2], axis=1)
    return float(np.linalg.lstsq(parts, y[inner], rcond=None)[0][0])


@pytest.mark.parametrize("wavelength", [8.0, 10.0, 15.0, 25.0, 40.0, 70.0])
@pytest.mark.parametrize("chord", [(5.0, 5.0), (2.5, 7.5)])
def test_waves_from_eight_metres_come_back_within_one_percent(wavelength: float, chord: tuple[float, float]) -> None:
    wave = 1e-3 * np.sin(2.0 * np.pi * X / wavelength)
    restored = restore(versine(wave, STEP, *chord), STEP, *chord, noise_sd_m=1e-5)
    assert amplitude(restored.shape_m, wavelength) == pytest.approx(1e-3, rel=0.01)


@pytest.mark.parametrize("wavelength", [2.5, 5.0, 5.1, 6.0, 10.0, 50.0])
def test_a_wave_comes_out_with_the_response(wavelength: float) -> None:
    prior = ShapePrior(d1_sd_m=1e-3, longest_m=60.0)
    wave = np.sin(2.0 * np.pi * X / wavelength)
    restored = restore(versine(wave, STEP), STEP, noise_sd_m=1e-3, prior=prior)
    expected = float(restoring_response(wavelength, STEP, noise_sd_m=1e-3, prior=prior))
    assert amplitude(restored.shape_m, wavelength) == pytest.approx(expected, abs=1e-3)


def test_what_the_chord_does_not_see_stays_with_the_prior() -> None:
    response = restoring_response([2.5, 5.0, 1e7], STEP, noise_sd_m=1e-4)
    np.testing.assert_allclose(response, 0.0, atol=1e-6)
    noise = np.random.default_rng(0).normal(0.0, 1e-4, len(X))
    restored = restore(noise, STEP, noise_sd_m=1e-4)
    a, variance = ShapePrior().innovation(STEP)
    prior_sd = np.sqrt(variance * (1.0 + a * a) / (1.0 - a * a) ** 3)
    assert restored.sd_m.max() < prior_sd
    assert np.abs(restored.shape_m).max() < prior_sd


def test_the_prior_has_the_d1_standard_deviation_and_the_density_that_it_says() -> None:
    signal = pytest.importorskip("scipy.signal")
    prior = ShapePrior(d1_sd_m=2e-3, longest_m=100.0)
    a, variance = prior.innovation(STEP)
    white = np.random.default_rng(1).normal(0.0, np.sqrt(variance), (20, 40_000))
    shape = signal.lfilter([1.0], [1.0, -2.0 * a, a * a], white)
    assert np.nanstd(band_pass(shape, STEP, D1)[:, 2000:]) == pytest.approx(2e-3, rel=0.02)
    # One-sided, rad/m: the recursion's density below the Nyquist wave number.
    w = 2.0 * np.pi / np.array([5.0, 20.0, 100.0])
    sampled = variance * STEP / np.pi / np.abs(1.0 - a * np.exp(-1j * w * STEP)) ** 4
    np.testing.assert_allclose(prior.density(w), sampled, rtol=0.02)


def test_the_sigma_covers() -> None:
    signal = pytest.importorskip("scipy.signal")
    prior = ShapePrior(d1_sd_m=1e-3, longest_m=60.0)
    a, variance = prior.innovation(STEP)
    rng = np.random.default_rng(2)
    white = rng.normal(0.0, np.sqrt(variance), (60, 4000))
    shape = signal.lfilter([1.0], [1.0, -2.0 * a, a * a], white)[:, 2500:]  # stationary by then
    measured = versine(shape, STEP) + rng.normal(0.0, 2e-4, shape.shape)
    measured[:, 700:760] = np.nan
    restored = restore(measured, STEP, noise_sd_m=2e-4, prior=prior)
    z = (restored.shape_m - shape) / restored.sd_m
    assert np.abs(z).max() < 6.0
    assert (z**2).mean() == pytest.approx(1.0, abs=0.1)
    assert (z[:, 720:740] ** 2).mean() == pytest.approx(1.0, abs=0.3)
    assert (z[:, :10] ** 2).mean() == pytest.approx(1.0, abs=0.3)
    assert restored.sd_m[730] > 1.2 * restored.sd_m[400]


def test_it_is_the_least_squares_solution() -> None:
    """Against dense matrices, with a hole, an eccentric chord and a length that is no whole number of blocks."""
    n, p, q, noise = 75, 4, 7, 3e-4
    prior = ShapePrior(d1_sd_m=1e-3, longest_m=40.0)
    v = np.random.default_rng(3).normal(0.0, 1e-3, n)
    v[30:33] = np.nan
    chord = np.zeros((n, n))
    for i in range(p, n - q):
        if not 30 <= i < 33:
            chord[i, [i - p, i, i + q]] = -q / (p + q), 1.0, -p / (p + q)
    a, variance = prior.innovation(0.5)
    lags = np.abs(np.subtract.outer(np.arange(n), np.arange(n)))
    level = variance * (1.0 + a * a) / (1.0 - a * a) ** 3
    covariance = level * a**lags * (1.0 + lags * (1.0 - a * a) / (1.0 + a * a))
    posterior = np.linalg.inv(np.linalg.inv(covariance) + chord.T @ chord / noise**2)
    mean = posterior @ chord.T @ np.nan_to_num(v) / noise**2
    restored = restore(np.stack([v, 2.0 * v]), 0.5, 0.5 * p, 0.5 * q, noise_sd_m=noise, prior=prior)
    np.testing.assert_allclose(restored.shape_m[0], mean, atol=1e-6 * np.abs(mean).max())
    np.testing.assert_allclose(restored.shape_m[1], 2.0 * restored.shape_m[0])
    np.testing.assert_allclose(restored.sd_m, np.sqrt(np.diagonal(posterior)), rtol=1e-6)


def test_what_cannot_be_restored_is_refused() -> None:
    with pytest.raises(BadInputError, match="more than the chord's 40 steps"):
        restore(np.zeros(40), STEP, noise_sd_m=1e-4)
    with pytest.raises(BadInputError, match="noise_sd_m"):
        restore(np.zeros(100), STEP, noise_sd_m=0.0)
    with pytest.raises(BadInputError, match="expected both above 0"):
        ShapePrior(d1_sd_m=0.0)

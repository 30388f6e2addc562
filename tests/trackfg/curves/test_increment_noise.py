"""Whitening against a covariance by quadrature, and parameters found again in noise drawn with them."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import fft

from trackfg.curves.increment_noise import IncrementNoise, fitted_noise

NOISE = IncrementNoise(level=2.0, walk=0.02, cutoff=0.4, theta=0.2)
COUNT = 40


def spectrum(noise: IncrementNoise, u: np.ndarray) -> np.ndarray:
    """Of the increments, the walk's in it: the formula of the module's docstring."""
    passed = 1.0 / (1.0 + (np.tan(0.5 * noise.cutoff) / np.tan(0.5 * u)) ** 8)
    moving = np.abs(1.0 + noise.theta * np.exp(-1j * u)) ** 2
    return np.asarray(noise.level * moving * passed * np.abs(1.0 - np.exp(-1j * u)) ** 2 + noise.walk)


def drawn(noise: IncrementNoise, count: int, rng: np.random.Generator) -> np.ndarray:
    u = 2.0 * np.pi * np.arange(1, count // 2 + 1) / count
    amplitude = np.concatenate([[np.sqrt(noise.walk)], np.sqrt(spectrum(noise, u))])
    return np.asarray(fft.irfft(fft.rfft(rng.standard_normal(count)) * amplitude, count))


def test_autocovariance_is_that_of_the_spectrum() -> None:
    u = (np.arange(20_000) + 0.5) * np.pi / 20_000
    expected = [np.mean(spectrum(NOISE, u) * np.cos(lag * u)) for lag in range(COUNT)]
    np.testing.assert_allclose(NOISE.autocovariance(COUNT), expected, atol=1e-6)
    np.testing.assert_allclose(NOISE.autocovariance(1500)[:COUNT], expected, atol=1e-6)


def test_whitened_noise_is_white() -> None:
    rng = np.random.default_rng(0)
    known, disturbed = rng.uniform(0.0, 0.3, COUNT), rng.uniform(0.0, 0.3, COUNT + 1)
    # A disturbance of a cell's mean is in the increment before it and, with the other sign, in the one after.
    of_cells = np.diff(np.eye(COUNT + 1), axis=0)
    lags = np.abs(np.subtract.outer(np.arange(COUNT), np.arange(COUNT)))
    covariance = NOISE.autocovariance(COUNT)[lags] + np.diag(known) + of_cells @ np.diag(disturbed) @ of_cells.T
    white = NOISE.whitener(known, disturbed)
    np.testing.assert_allclose(white @ covariance @ white.T, np.eye(COUNT), atol=1e-9)


def test_increments_not_measured_do_not_matter() -> None:
    known, disturbed = np.zeros(COUNT), np.zeros(COUNT + 1)
    known[10:20], disturbed[30] = 1e7, 1e7
    increments = np.random.default_rng(1).standard_normal(COUNT)
    other = increments.copy()
    other[10:20] += 5.0
    other[29:31] += [5.0, -5.0]
    whitener = NOISE.whitener(known, disturbed)
    assert np.sum((whitener @ increments) ** 2) == pytest.approx(np.sum((whitener @ other) ** 2), rel=1e-4)


def test_parameters_are_found_again() -> None:
    noise = drawn(NOISE, 6000, np.random.default_rng(2))
    noise[3000:3020] = np.nan
    found = fitted_noise([(noise[:2000], np.zeros(2000)), (noise[2000:], np.zeros(4000))], floor=1e-6)
    assert found.level == pytest.approx(NOISE.level, rel=0.1)
    assert found.walk == pytest.approx(NOISE.walk, rel=0.3)
    assert found.cutoff == pytest.approx(NOISE.cutoff, rel=0.05)
    assert found.theta == pytest.approx(NOISE.theta, abs=0.05)


def test_perfect_data_have_the_floor() -> None:
    assert fitted_noise([(np.zeros(50), np.zeros(50))], floor=1e-3).level == pytest.approx(1e-6)

"""Whitening against the covariance written out in full, and parameters found again in noise drawn with them."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import toeplitz
from scipy.signal import lfilter

from trackfg.curves.increment_noise import IncrementNoise, fitted_noise

NOISE = IncrementNoise(level=2.0, walk=0.05, phi=0.7, theta=0.2)
COUNT = 40


def impulse(noise: IncrementNoise, length: int) -> np.ndarray:
    moving = np.convolve([1.0, -3.0, 3.0, -1.0], [1.0, noise.theta])
    return np.asarray(lfilter(moving, np.convolve([1.0, -noise.phi], [1.0, -noise.phi]), np.eye(1, length)[0]))


def full_covariance(noise: IncrementNoise, known: np.ndarray) -> np.ndarray:
    """Stationary noise of the impulse response, and the walk's independent steps."""
    psi = impulse(noise, 1000)
    lags = np.array([psi[: 1000 - lag] @ psi[lag:] for lag in range(len(known))])
    return np.asarray(noise.level * toeplitz(lags) + np.diag(known + noise.walk))


def test_whitened_noise_has_the_full_covariance_inside_out() -> None:
    known = np.random.default_rng(0).uniform(0.0, 0.3, COUNT)
    whitener = NOISE.whitener(known)
    covariance = full_covariance(NOISE, known)
    white = whitener(np.eye(COUNT))
    np.testing.assert_allclose(white @ covariance @ white.T, np.eye(COUNT), atol=1e-9)
    assert whitener.log_determinant == pytest.approx(np.linalg.slogdet(covariance)[1], rel=1e-12)


def test_increments_not_measured_do_not_matter() -> None:
    known = np.zeros(COUNT)
    known[10:20] = 1e7
    increments = np.random.default_rng(1).standard_normal(COUNT)
    other = increments.copy()
    other[10:20] += 5.0
    whitener = NOISE.whitener(known)
    assert np.sum(whitener(increments) ** 2) == pytest.approx(np.sum(whitener(other) ** 2), rel=1e-4)


def test_parameters_are_found_again() -> None:
    rng = np.random.default_rng(2)
    n = 6000
    e = rng.standard_normal(n + 500) * np.sqrt(NOISE.level)
    drawn = np.convolve(e, impulse(NOISE, 500))[500 : 500 + n] + rng.standard_normal(n) * np.sqrt(NOISE.walk)
    found = fitted_noise([(drawn[:2000], np.zeros(2000)), (drawn[2000:], np.zeros(4000))], floor=1e-6)
    assert found.level == pytest.approx(NOISE.level, rel=0.1)
    assert found.walk == pytest.approx(NOISE.walk, rel=0.5)
    assert found.phi == pytest.approx(NOISE.phi, abs=0.05)
    assert found.theta == pytest.approx(NOISE.theta, abs=0.1)


def test_perfect_data_have_the_floor() -> None:
    assert fitted_noise([(np.zeros(50), np.zeros(50))], floor=1e-3).level == pytest.approx(1e-6)

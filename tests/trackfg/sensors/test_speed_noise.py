"""The noise of a speed signal, by the accelerometer."""

from __future__ import annotations

import numpy as np
import pytest

from trackfg.numerics.arrays import Array
from trackfg.sensors.imu_intervals import Intervals
from trackfg.sensors.speed_noise import speed_noise
from trackfg.sensors.tach import Wheel

RATE_HZ, DURATION_S = 20.0, 400.0


def speed(t: Array) -> Array:
    """Between 9 and 15 m/s, with accelerations up to 0.3 m/s^2."""
    return 12.0 + 3.0 * np.sin(0.1 * t)


def wheel(noise: float) -> Wheel:
    t = np.arange(0.0, DURATION_S, 1.0 / RATE_HZ)
    shown = speed(t) + noise * np.random.default_rng(0).standard_normal(len(t))
    distance = np.concatenate([[0.0], np.cumsum(0.5 * (shown[1:] + shown[:-1]) / RATE_HZ)])
    return Wheel(t, distance, 1e-4, 0.0, True, np.zeros((0, 2)))


def inertial(noise: float, gradient: float = 0.02) -> Intervals:
    """Forward force on a gradient that changes to its opposite half way, at 100 Hz."""
    edges = 0.01 * np.arange(round(100 * DURATION_S) + 1)
    n = len(edges) - 1
    accel = np.zeros((n, 3))
    accel[:, 0] = np.diff(speed(edges)) / 0.01 + 9.8 * gradient * np.where(np.arange(n) < n // 2, 1.0, -1.0)
    accel[:, 0] += noise * np.random.default_rng(1).standard_normal(n)
    return Intervals(edges, np.zeros((n, 3)), accel, np.zeros(n, dtype=bool))


@pytest.mark.parametrize("noise", [0.1, 0.5])
def test_white_noise_of_rows_is_found(noise: float) -> None:
    """Rows 0.05 s apart with the noise s are s sqrt(0.05) m/s in 1 s: 0.5 m/s are 0.112."""
    assert speed_noise(wheel(noise), inertial(0.01)) == pytest.approx(noise / np.sqrt(RATE_HZ), rel=0.15)


def test_the_accelerometers_own_noise_is_not_the_tachs() -> None:
    """A white 2 m/s^2 at 100 Hz makes 0.2 m in third differences of 1 s, as much as 0.08 m/s in 1 s of the speed: that
    is taken off, but for what 400 of them leave open.
    """
    found = speed_noise(wheel(0.02), inertial(2.0))
    assert found is not None
    assert found < 0.04


def test_a_short_run_shows_no_noise() -> None:
    short = wheel(0.1)
    kept = short.t < 20.0
    assert (
        speed_noise(Wheel(short.t[kept], short.distance[kept], 1e-4, 0.0, True, np.zeros((0, 2))), inertial(0.01))
        is None
    )

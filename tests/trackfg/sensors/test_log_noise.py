"""Noise that numpy makes of known densities comes back from a log, in the units that it was made in."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from numpy.typing import NDArray

from trackfg.recording.description import Imu, RecordingDescription
from trackfg.recording.model import IMU_COLUMNS, Recording
from trackfg.sensors.allan import averaging_factors, degrees_of_freedom, overlapping_allan
from trackfg.sensors.log_noise import log_noise
from trackfg.sensors.noise_fit import fit_noise, pooled
from trackfg.sensors.rest_log import longest_rest

Array = NDArray[np.float64]
RATE_HZ = 20.0
TWO_HOURS_S = 7200.0


def white(rng: np.random.Generator, count: int, density: float) -> Array:
    """Samples of a continuous white noise, averaged over their interval."""
    return density * np.sqrt(RATE_HZ) * rng.standard_normal((count, 3))


def walk(rng: np.random.Generator, count: int, density: float) -> Array:
    return np.cumsum(density / np.sqrt(RATE_HZ) * rng.standard_normal((count, 3)), axis=0)


def flicker(rng: np.random.Generator, count: int, coefficient: float) -> Array:
    """Samples with the two-sided density B^2 / (2 pi f), cut from a period eight times as long."""
    f = np.fft.rfftfreq(8 * count, 1.0 / RATE_HZ)[1:]
    amplitude = np.sqrt(coefficient**2 / (2.0 * np.pi * f) * 8 * count * RATE_HZ / 2.0)
    parts = rng.standard_normal((2, 3, len(f)))
    spectrum = np.pad(amplitude * (parts[0] + 1j * parts[1]), ((0, 0), (1, 0)))
    return np.fft.irfft(spectrum, 8 * count)[:, :count].T


def recording(gyro: Array, accel: Array) -> Recording:
    t = np.arange(len(gyro)) / RATE_HZ
    table = pd.DataFrame(np.column_stack([t, gyro, accel]), columns=list(IMU_COLUMNS))
    imu = Imu(file="imu.csv", gyro=("wx", "wy", "wz"), accel=("fx", "fy", "fz"))
    return Recording.of_tables(RecordingDescription(id="rest", imu=imu), {"imu": table})


def parked(seed: int, *, seconds: float = TWO_HOURS_S) -> tuple[Array, Array]:
    rng, count = np.random.default_rng(seed), round(seconds * RATE_HZ)
    gyro = white(rng, count, 1e-4) + walk(rng, count, 1e-5) + [1e-3, -2e-3, 5e-4]
    accel = white(rng, count, 2e-3) + walk(rng, count, 2e-4) + [0.1, -0.2, 9.8]
    return gyro, accel


@pytest.mark.parametrize("seed", range(3))
def test_two_hours_give_white_noise_and_walk_within_a_tenth(seed: int) -> None:
    noise = log_noise(recording(*parked(seed)))
    truth = {"gyro_white": 1e-4, "gyro_bias_walk": 1e-5, "accel_white": 2e-3, "accel_bias_walk": 2e-4}
    assert noise.declared == pytest.approx(truth, rel=0.1)
    assert noise.toml().splitlines()[0] == "[imu.noise]"
    assert noise.rest.is_whole
    axes = noise.axes[noise.axes["axis"] != "all"]
    assert np.all(np.abs(axes["white"] / ([1e-4] * 3 + [2e-3] * 3) - 1.0) < 0.1)
    off = (axes["bias_walk"] - ([1e-5] * 3 + [2e-4] * 3)) / axes["bias_walk_sd"]
    assert np.abs(off).max() < 4.0
    curve = noise.allan.query("sensor == 'gyro' and axis == 'x'")
    near = curve["degrees_of_freedom"] > 30
    assert np.all(np.abs(curve["deviation"] - curve["model"])[near] < 4.0 * curve["deviation_sd"][near])


def test_bias_instability_is_distinguished_from_a_walk() -> None:
    coefficients = []
    for seed in range(3):
        rng, count = np.random.default_rng(seed), round(TWO_HOURS_S * RATE_HZ)
        fit = pooled(fit_noise(white(rng, count, 1e-4) + flicker(rng, count, 3e-5), 1.0 / RATE_HZ))
        coefficients.append(fit.coefficients)
    N, B, K = np.mean(coefficients, axis=0)
    assert pytest.approx(1e-4, rel=0.02) == N
    assert pytest.approx(3e-5, rel=0.1) == B
    assert K * np.sqrt(1000.0 / 3.0) < 0.2 * 3e-5  # its deviation at 1000 s


def test_temperature_is_distinguished_from_the_walk() -> None:
    gyro, accel = parked(1)
    heat = 20.0 + 8.0 * np.sin(2.0 * np.pi * np.arange(len(gyro)) / RATE_HZ / 900.0)
    noise = log_noise(recording(gyro + 1e-4 * (heat - 20.0)[:, None], accel), ("temp_c", heat))
    axes = noise.axes.query("sensor == 'gyro' and axis != 'all'")
    assert np.all(np.abs(axes["per_kelvin"] - 1e-4) < 4.0 * axes["per_kelvin_sd"])
    assert axes["per_kelvin_sd"].max() < 3e-5
    assert noise.declared["gyro_bias_walk"] == pytest.approx(1e-5, rel=0.1)


def test_the_deviation_is_that_of_its_definition() -> None:
    y, dt = np.random.default_rng(0).standard_normal(300), 0.25
    x = np.append(0.0, np.cumsum(y)) * dt
    for m in (1, 7, 100, 150):
        terms = [(x[i + 2 * m] - 2.0 * x[i + m] + x[i]) ** 2 for i in range(len(x) - 2 * m)]
        expected = np.sqrt(np.mean(terms) / 2.0) / (m * dt)
        assert overlapping_allan(y, dt, np.array([m]))[0] == pytest.approx(expected)
    assert averaging_factors(300)[[0, -1]].tolist() == [1, 150]


@pytest.mark.parametrize("kind", ["white", "walk"])
def test_sigmas_of_the_deviation_are_its_spread(kind: str) -> None:
    rng, count, factors = np.random.default_rng(0), 2000, np.array([1, 10, 100, 400])
    samples = rng.standard_normal((400, count))
    if kind == "walk":
        samples = np.cumsum(samples, axis=1)
    variances = np.array([overlapping_allan(y, 1.0, factors) ** 2 for y in samples])
    freedom = 2.0 * variances.mean(axis=0) ** 2 / variances.var(axis=0)
    np.testing.assert_allclose(degrees_of_freedom(count, factors, np.array([kind] * 4)), freedom, rtol=0.25)


def test_the_longest_rest_is_used() -> None:
    gyro, accel = parked(2, seconds=900.0)
    moved = slice(round(300 * RATE_HZ), round(310 * RATE_HZ))
    gyro[moved, 2] += 0.05
    accel[moved, 0] += np.sin(np.arange(round(10 * RATE_HZ)))
    noise = log_noise(recording(gyro, accel))
    assert not noise.rest.is_whole
    assert (noise.rest.begin_s, noise.rest.end_s) == pytest.approx((311.0, 900.0), abs=2.0)
    with pytest.raises(ValueError, match="the longest rest lasts 49 s; expected 60 s or more"):
        log_noise(recording(gyro[: round(50 * RATE_HZ)], accel[: round(50 * RATE_HZ)]))


def test_a_drift_is_no_motion_and_a_drive_is_no_rest() -> None:
    gyro, accel = parked(3, seconds=600.0)
    drift = np.linspace(0.0, 1.0, len(gyro))[:, None]
    rest = longest_rest(recording(gyro + 0.02 * drift, accel + drift))
    assert rest is not None
    assert rest.is_whole
    t = np.arange(len(gyro)) / RATE_HZ
    swaying = accel + 0.5 * np.sin(2.0 * np.pi * t / 7.0)[:, None]
    rest = longest_rest(recording(gyro, swaying))
    assert rest is None or rest.end_s - rest.begin_s < 10.0


def test_readings_that_change_by_single_steps_are_at_rest_and_get_the_noise_of_rounding() -> None:
    rng, count, step = np.random.default_rng(0), round(600.0 * RATE_HZ), 0.04
    accel = step * (np.round(white(rng, count, 1.5e-3) / step) + np.array([0.0, 0.0, 245.0]))
    noise = log_noise(recording(white(rng, count, 1e-4), accel))
    assert noise.rest.is_whole
    assert noise.declared["accel_white"] == pytest.approx(step / np.sqrt(12.0 * RATE_HZ), rel=1e-3)
    assert "rounding to steps of 0.04 m/s^2" in noise.remarks["accel_white"]
    assert noise.declared["gyro_white"] == pytest.approx(1e-4, rel=0.1)
    assert "gyro_white" not in noise.remarks


def test_a_channel_that_holds_one_value_is_refused_by_name() -> None:
    gyro, accel = parked(0, seconds=600.0)
    accel[:, 2] = 9.8
    with pytest.raises(ValueError, match=r"^accel z: holds 9\.8 m/s\^2 throughout the rest; expected noise\. Hint: "):
        log_noise(recording(gyro, accel))

"""The gyro's bias before there is a graph, against what was put in."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from scipy.signal import lfilter

from trackfg.recording.description import ImuNoise
from trackfg.sensors.starting_bias import GridMotion, rest_bias, starting_bias, tilt_error_sd_by_gyro

G = 9.80665
STEP_S = 0.1
BIAS = np.array([0.02, -0.01, 0.015])
NO_RESTS = np.zeros((0, 2))


def ride(yaw_rate: np.ndarray, speed: float = 15.0, roll: float = 0.03) -> tuple[GridMotion, np.ndarray]:
    """A ride at constant speed over a swaying track, the gyro with BIAS; and its heading."""
    t = STEP_S * np.arange(len(yaw_rate))
    rolled, pitched = roll * np.sin(0.2 * t), 0.01 * np.sin(0.05 * t)
    sin_r, cos_r = np.sin(rolled), np.cos(rolled)
    roll_rate, pitch_rate = np.gradient(rolled, t), np.gradient(pitched, t)
    across = yaw_rate * np.cos(pitched)
    w = np.stack(
        [
            roll_rate - yaw_rate * np.sin(pitched),
            pitch_rate * cos_r + across * sin_r,
            across * cos_r - pitch_rate * sin_r,
        ],
        axis=1,
    )
    up = np.stack([-np.sin(pitched), np.cos(pitched) * sin_r, np.cos(pitched) * cos_r], axis=1)
    force = G * up + np.stack([np.zeros(len(t)), speed * w[:, 2], -speed * w[:, 1]], axis=1)
    motion = GridMotion(t, w + BIAS, force, np.full(len(t), speed), np.zeros(len(t)))
    return motion, np.cumsum(yaw_rate) * STEP_S


def curves(n: int) -> np.ndarray:
    """Straight, a curve to the left, straight, a curve to the right, in turn."""
    phase = (np.arange(n) // 150) % 4
    return np.choose(phase, [0.0, 0.05, 0.0, -0.03])


def test_without_rests_tilt_and_straights_show_the_bias() -> None:
    motion, _ = ride(curves(2400))
    start = starting_bias(motion, NO_RESTS, np.zeros(3), ImuNoise(), None)
    np.testing.assert_allclose(start.gyro[0], BIAS, atol=5e-4)
    assert start.gyro_level == pytest.approx(0.02, rel=0.05)
    assert start.vertical_sd is not None
    assert abs(start.gyro[0, 2] - BIAS[2]) < 3.0 * start.vertical_sd


def test_curves_separate_the_accelerometers_bias_from_a_tilt() -> None:
    motion, _ = ride(curves(2400))
    bias = np.array([0.4, -0.6, 0.3])
    start = starting_bias(replace(motion, accel=motion.accel + bias), NO_RESTS, np.zeros(3), ImuNoise(), None)
    np.testing.assert_allclose(start.accel[:2], bias[:2], atol=0.05)
    assert start.accel_level == pytest.approx(0.6, abs=0.05)
    np.testing.assert_allclose(start.gyro[0, :2], BIAS[:2], atol=1e-3)


def test_what_lasts_for_minutes_is_no_bias_of_the_accelerometer() -> None:
    """A tilt of 20 mrad that changes over minutes, as a heading does in a town, is no bias in most drives."""
    step, lasts_s, rng = STEP_S, 300.0, np.random.default_rng(3)
    streets = np.repeat(rng.choice([0.0, 0.0, 0.15, -0.15], 360), 100)
    motion, _ = ride(streets)
    within = np.exp(-step / lasts_s)
    levels = []
    for _ in range(7):
        drawn = rng.normal(0.0, 0.02 * np.sqrt(1.0 - within**2), (len(motion.t), 2))
        tilt = lfilter([1.0], [1.0, -within], drawn, axis=0)
        accel = motion.accel + G * np.column_stack([tilt[:, 1], -tilt[:, 0], np.zeros(len(tilt))])
        levels.append(starting_bias(replace(motion, accel=accel), NO_RESTS, np.zeros(3), ImuNoise(), None).accel_level)
    assert np.median(levels) < 0.05


def test_what_the_gyro_integrates_is_no_bias_of_the_accelerometer() -> None:
    """A slow ride turns once in ten minutes: the rates' errors, drawn and integrated, scatter the error of the tilt."""
    t, step, rng = np.arange(600.0), 1.0, np.random.default_rng(2)
    heading = 0.8 * np.clip((t - 200.0) / 150.0, 0.0, 1.0)
    terms = np.stack([np.ones(600), t, heading], axis=1)
    force = np.stack([0.0 * t, np.where((t > 200.0) & (t < 350.0), 1.2, 0.0), np.full(600, G)], axis=1)
    declared = dict.fromkeys(("gyro_white", "gyro_bias_walk", "g_sensitivity_sd"), 1e-12)
    earth = tilt_error_sd_by_gyro(terms, force, ImuNoise(**declared))
    white, walk, response = 1e-3, 1e-5, 1e-4
    towards = rng.uniform(0.0, 2.0 * np.pi, (1000, 1))
    drawn = {
        "gyro_white": (white, white / np.sqrt(step) * rng.standard_normal((1000, 600))),
        "gyro_bias_walk": (walk, np.cumsum(walk * np.sqrt(step) * rng.standard_normal((1000, 600)), axis=1)),
        "g_sensitivity_sd": (response, response * rng.standard_normal((1000, 3)) @ force.T),
    }
    for name, (sd, rates) in drawn.items():
        errors = np.linalg.lstsq(terms, np.cumsum(rates, axis=1).T * step, rcond=None)[0][2]
        stated = tilt_error_sd_by_gyro(terms, force, ImuNoise(**{**declared, name: sd}))
        assert np.sqrt(stated**2 - earth**2) == pytest.approx(errors.std(), rel=0.1), name
    turning = np.cumsum(7.292e-5 * np.cos(towards + heading), axis=1).T * step
    assert earth == pytest.approx(np.linalg.lstsq(terms, turning, rcond=None)[0][2].std(), rel=0.1)


@pytest.mark.parametrize("rate", [0.2, -0.2])
def test_a_run_in_one_curve_does_not_pass_for_a_bias(rate: float) -> None:
    """A sensor whose other axes are off by 0.02 rad/s is not off by 0.2 in the third."""
    motion, _ = ride(np.full(1200, rate), speed=8.0)
    start = starting_bias(motion, NO_RESTS, np.zeros(3), ImuNoise(), None)
    np.testing.assert_allclose(start.gyro[0, :2], BIAS[:2], atol=6e-3)
    assert start.vertical_sd is not None
    assert abs(start.gyro[0, 2] - BIAS[2]) < 3.0 * start.vertical_sd < 0.1


def test_positions_show_the_vertical_bias_in_a_curve() -> None:
    rate = np.full(1200, 0.04)
    motion, heading = ride(rate)
    place = np.cumsum(15.0 * STEP_S * np.stack([np.cos(heading), np.sin(heading)], axis=1), axis=0)
    noisy = place + np.random.default_rng(0).normal(0.0, 1.0, place.shape)
    gnss = pd.DataFrame({"t_s": motion.t, "east_m": noisy[:, 0], "north_m": noisy[:, 1]})
    gnss = gnss.assign(east_sd_m=1.0, north_sd_m=1.0).iloc[::10]
    start = starting_bias(motion, NO_RESTS, np.zeros(3), ImuNoise(), gnss)
    assert start.vertical_sd is None
    assert start.gyro[0, 2] == pytest.approx(BIAS[2], abs=2e-3)


def test_the_earths_vertical_rate_is_no_bias() -> None:
    motion, _ = ride(curves(2400))
    earth = np.array([0.0, 5e-5, 4e-5])
    with_earth, without = (starting_bias(motion, NO_RESTS, rate, ImuNoise(), None) for rate in (earth, np.zeros(3)))
    assert without.gyro[0, 2] - with_earth.gyro[0, 2] == pytest.approx(4e-5, rel=0.1)


def test_the_accelerometers_bias_shows_in_the_length_of_the_force() -> None:
    motion, _ = ride(curves(1200))
    motion = GridMotion(
        motion.t, motion.gyro, motion.accel + np.array([0.0, 0.0, 0.3]), motion.speed, motion.acceleration
    )
    start = starting_bias(motion, NO_RESTS, np.zeros(3), ImuNoise(), None)
    assert start.accel_level == pytest.approx(0.3, abs=0.02)


def test_short_rests_weigh_less_than_long_ones() -> None:
    """A bias that does not walk is the mean of all rests, weighted by their durations."""
    t = STEP_S * np.arange(1000)
    gyro = np.random.default_rng(1).normal(0.0, 1e-3, (1000, 3)) + BIAS
    rests = np.array([[0.0, 40.0], [50.0, 51.0], [90.0, 99.0]])
    steady = rest_bias(t, gyro, rests, np.zeros(3), walk=1e-9)
    resting = (t <= 40.0) | ((t >= 50.0) & (t <= 51.0)) | (t >= 90.0) & (t <= 99.0)
    np.testing.assert_allclose(steady[[0, 500, -1]], np.tile(gyro[resting].mean(axis=0), (3, 1)), atol=2e-6)
    each = rest_bias(t, gyro, rests, np.zeros(3))
    np.testing.assert_allclose(each[505], gyro[(t >= 50.0) & (t <= 51.0)].mean(axis=0), atol=1e-6)

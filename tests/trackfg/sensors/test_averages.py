"""Means of the samples over intervals, and the band that correlations are made in."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from trackfg.recording.model import IMU_COLUMNS
from trackfg.sensors.averages import averaged, band_passed


def test_means_are_over_the_interval_in_the_samples_own_units() -> None:
    """A rate that grows by 0.2 rad/s^2, a wheel at 3 m/s: the mean over half a second is the rate in its middle, the
    speed 3 m/s.
    """
    t = np.arange(1001) / 100.0
    names = ("wx_radps", "wy_radps", "wz_radps", "fx_mps2", "fy_mps2", "fz_mps2")
    imu = pd.DataFrame({"t_s": t} | dict.fromkeys(names, 0.0 * t)).assign(wz_radps=0.2 * t, fz_mps2=9.8)
    motion = averaged(imu, pd.DataFrame({"t_s": t, "distance_m": 3.0 * t}), 0.5)
    assert motion is not None
    assert np.diff(motion.t_s) == pytest.approx(0.5)
    np.testing.assert_allclose(motion.gyro[:, 2], 0.2 * motion.t_s, atol=1e-12)
    np.testing.assert_allclose(motion.accel[:, 2], 9.8)
    np.testing.assert_allclose(motion.speed, 3.0)
    assert motion.valid.all()


def test_a_band_has_no_part_in_what_is_constant_and_keeps_what_is_between() -> None:
    """Gaussians of 0.5 and 20 s pass exp(-(w s)^2 / 2) each: of a sine of 10 s period 0.952 - 0.000, and nothing of a
    constant.
    """
    t = np.arange(4000) * 0.1
    valid = np.ones(t.size, dtype=bool)
    period, middle = 10.0, slice(1500, 2500)
    wave = np.sin(2.0 * np.pi * t / period)
    kept = band_passed(7.0 + wave, valid, 0.1, 0.5, 20.0)[middle]
    gain = np.exp(-0.5 * (2.0 * np.pi / period * 0.5) ** 2)
    np.testing.assert_allclose(kept, gain * wave[middle], atol=0.01)


def test_what_rests_has_nothing_in_a_band() -> None:
    """An acceleration of 0 marks a tach at rest: rounding would be one."""
    acceleration = np.zeros(4000)
    acceleration[1000:1100] = 0.7
    kept = band_passed(acceleration, np.ones(4000, dtype=bool), 0.05, 0.4, 3.0)
    reach = round(4.0 * 3.0 / 0.05)
    assert not kept[: 1000 - reach].any()
    assert not kept[1100 + reach :].any()
    assert (kept[1000:1100] != 0.0).all()


def test_a_jump_of_the_clock_takes_no_memory() -> None:
    """Fifty years at two intervals a second are 3e9 intervals, for a thousand samples."""
    t = np.arange(1000) / 100.0 + np.where(np.arange(1000) < 500, 0.0, 1.6e9)
    imu = pd.DataFrame({"t_s": t} | dict.fromkeys(IMU_COLUMNS[1:], 0.0 * t))
    assert averaged(imu, None, 0.5) is None

"""Vibration between the white noise of the sensor and the motion of the track: lines of known size."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import butter, sosfilt

from trackfg.datasets.scenarios import simulate
from trackfg.sensors.imu_intervals import Intervals, intervals
from trackfg.sensors.short_vibration import Blocks

HZ, AMPLITUDE = 20.0, 1e-4
"""A roll of 0.1 mrad at 20 Hz."""


@pytest.fixture(scope="module")
def quiet() -> Intervals:
    """Samples of 40 s that show nothing but white noise and gravity."""
    data = intervals(simulate("trolley", seed=0, duration_s=40.0).recording)
    rng = np.random.default_rng(0)
    white = rng.standard_normal((2, len(data), 3))
    return replace(data, gyro=1e-4 * white[0], accel=1e-2 * white[1] + [0.0, 0.0, 9.8])


def with_roll(data: Intervals) -> Intervals:
    rate = 2.0 * np.pi * HZ * AMPLITUDE * np.cos(2.0 * np.pi * HZ * data.edges[:-1])
    return replace(data, gyro=data.gyro + rate[:, None] * [1.0, 0.0, 0.0])


def test_at_rest_a_line_is_seen_in_full(quiet: Intervals) -> None:
    t = quiet.edges[[0, -1]]
    resting, moving = Blocks.of(with_roll(quiet), t, np.zeros(2)).shaking()
    assert resting.roll == pytest.approx(AMPLITUDE / np.sqrt(2.0), rel=0.05)
    assert np.isnan(moving.roll)
    assert Blocks.of(quiet, t, np.zeros(2)).shaking()[0].roll < 0.1 * AMPLITUDE


@pytest.mark.parametrize(("speed", "is_seen"), [(8.0, True), (20.0, False)])
def test_in_motion_a_line_is_seen_where_no_track_has_its_wave(quiet: Intervals, speed: float, is_seen: bool) -> None:
    """20 Hz are 0.4 m at 8 m/s and 1 m at 20 m/s."""
    moving = Blocks.of(with_roll(quiet), quiet.edges[[0, -1]], np.full(2, speed)).shaking()[1]
    assert (moving.roll > 0.9 * AMPLITUDE / np.sqrt(2.0)) == is_seen


def shaken(data: Intervals, seed: int) -> tuple[Intervals, float]:
    """Return samples with angular acceleration of even density from 5 Hz to 60 Hz, and the rms of the roll of that."""
    step = float(np.median(data.durations))
    f = np.fft.rfftfreq(len(data), step)
    band = (f > 5.0) & (f < 60.0)
    drawn = np.random.default_rng(seed).standard_normal((2, len(f)))
    rate = np.where(band, drawn[0] + 1j * drawn[1], 0.0) / np.maximum(2.0 * np.pi * f, 1.0)
    roll = np.fft.irfft(rate / np.maximum(2.0 * np.pi * f, 1.0), len(data))
    size = AMPLITUDE / np.std(roll)
    return replace(data, gyro=data.gyro + size * np.fft.irfft(rate, len(data))[:, None] * [1.0, 0.0, 0.0]), AMPLITUDE


def test_roll_on_the_waves_of_a_twist_is_distinguished_from_that_on_shorter_ones(quiet: Intervals) -> None:
    """At 15 m/s 0.7 m are 21 Hz: of the angle above 5 Hz a tenth is seen, and the rest follows from its density."""
    data, roll = shaken(quiet, 3)
    ends, speed = data.edges[[0, -1]], np.full(2, 15.0)
    assert Blocks.of(data, ends, speed).shaking()[1].roll == pytest.approx((5.0 / 21.4) ** 1.5 * roll, rel=0.15)
    assert Blocks.of(data, ends, speed).shaking(6.0)[1].roll == pytest.approx(roll, rel=0.15)


def test_kinks_of_cant_ramps_are_no_vibration(quiet: Intervals) -> None:
    """A ramp of 3 mrad/s between two kinks, as at 20 m/s in a transition of 60 m."""
    t = quiet.edges[:-1] - quiet.edges[0]
    ramp = np.where((t > 10.0) & (t < 13.0), 3e-3, 0.0)
    data = replace(quiet, gyro=quiet.gyro + ramp[:, None] * [1.0, 0.0, 0.0])
    assert Blocks.of(data, data.edges[[0, -1]], np.full(2, 20.0)).shaking(6.0)[1].roll == 0.0


def test_a_sway_across_is_integrated_twice(quiet: Intervals) -> None:
    size = 1e-4
    sway = -size * (2.0 * np.pi * HZ) ** 2 * np.cos(2.0 * np.pi * HZ * quiet.edges[:-1])
    swaying = replace(quiet, accel=quiet.accel + sway[:, None] * [0.0, 1.0, 0.0])
    resting = Blocks.of(swaying, quiet.edges[[0, -1]], np.zeros(2)).shaking()[0]
    assert resting.across == pytest.approx(size / np.sqrt(2.0), rel=0.1)
    assert resting.up < 0.3 * size


def test_a_short_record_says_nothing(quiet: Intervals) -> None:
    few = replace(quiet, edges=quiet.edges[:200], gyro=quiet.gyro[:199], accel=quiet.accel[:199])
    assert np.isnan([Blocks.of(few, few.edges[[0, -1]], np.zeros(2)).shaking()[k].roll for k in (0, 1)]).all()


def test_a_filter_is_no_vibration(quiet: Intervals) -> None:
    """Above the bandwidth the noise falls below the floor that it has further down."""
    low_pass = butter(2, 40.0, fs=1.0 / np.median(quiet.durations), output="sos")
    filtered = replace(quiet, gyro=sosfilt(low_pass, quiet.gyro, axis=0))
    ends, still = quiet.edges[[0, -1]], np.zeros(2)
    white, taken_for_white, known = (
        Blocks.of(data, ends, still, hz).shaking()[0].roll
        for data, hz in ((quiet, None), (filtered, None), (filtered, 40.0))
    )
    assert max(white, known) < 0.3 * taken_for_white
    assert Blocks.of(with_roll(filtered), ends, still, 40.0).shaking()[0].roll > 0.6 * AMPLITUDE

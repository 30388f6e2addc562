"""The bandwidth of a sensor, from what its samples hold at rest."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import butter, sosfilt

from trackfg.numerics.arrays import Array
from trackfg.sensors.imu_filters.bandwidth import Bandwidths, RestSpectra
from trackfg.sensors.imu_intervals import Intervals

RATE = 200.0
RESTS = np.array([[0.0, 20.0], [100.0, 115.0]])


def samples(seed: int = 0, rate_hz: float = RATE, duration_s: float = 120.0) -> Intervals:
    """White noise, and motion between 20 and 100 s, which is red."""
    rng = np.random.default_rng(seed)
    n = round(duration_s * rate_hz)
    edges = np.arange(n + 1) / rate_hz
    white, red = rng.standard_normal((2, n, 6))
    moving = ((edges[:-1] > 20.0) & (edges[:-1] < 100.0))[:, None]
    both = white + np.where(moving, np.cumsum(red, axis=0), 0.0)
    return Intervals(edges, 1e-4 * both[:, :3], 1e-2 * both[:, 3:] + [0.0, 0.0, 9.8], np.zeros(n, dtype=bool))


def low_passed(data: Intervals, hz: float, order: int = 2) -> Intervals:
    low_pass = butter(order, hz, fs=1.0 / np.diff(data.edges[:2])[0], output="sos")
    return replace(data, gyro=sosfilt(low_pass, data.gyro, axis=0), accel=sosfilt(low_pass, data.accel - 9.8, axis=0))


def mean_over(data: Intervals, count: int) -> Intervals:
    def mean(values: Array) -> Array:
        return np.column_stack([np.convolve(column, np.ones(count) / count, mode="same") for column in values.T])

    return replace(data, gyro=mean(data.gyro), accel=mean(data.accel - 9.8))


@pytest.mark.parametrize("seed", range(20))
@pytest.mark.parametrize("rate_hz", [20.0, 100.0, 500.0])
def test_white_samples_have_all_of_it(seed: int, rate_hz: float) -> None:
    assert RestSpectra.of(samples(seed, rate_hz), RESTS).bandwidths == Bandwidths(None, None)


@pytest.mark.parametrize(
    ("hz", "order"), [*((hz, order) for hz in (3.0, 10.0, 30.0) for order in (1, 2, 4)), (40.0, 2), (40.0, 4)]
)
def test_a_filter_is_found(hz: float, order: int) -> None:
    found = RestSpectra.of(low_passed(samples(), hz, order), RESTS).bandwidths
    assert found.gyro_hz == pytest.approx(hz, rel=0.35)
    assert found.accel_hz == pytest.approx(hz, rel=0.35)


def test_means_over_some_samples_are_found() -> None:
    found = RestSpectra.of(mean_over(samples(), 20), RESTS).bandwidths
    assert found.gyro_hz == pytest.approx(0.443 * RATE / 20, rel=0.35)


def test_samples_between_slower_ones_are_found() -> None:
    slow = samples(rate_hz=20.0)
    fine = np.arange(0.05, 119.9, 1.0 / RATE)
    middle = 0.5 * (slow.edges[1:] + slow.edges[:-1])

    def between(values: Array) -> Array:
        return np.column_stack([np.interp(fine[:-1], middle, column) for column in values.T])

    data = Intervals(fine, between(slow.gyro), between(slow.accel), np.zeros(len(fine) - 1, dtype=bool))
    found = RestSpectra.of(data, RESTS).bandwidths
    assert found.gyro_hz is not None
    assert 4.0 < found.gyro_hz < 10.0


@pytest.mark.parametrize("where", [(5.0, 20.0), (12.0, 20.0), (30.0, 40.0)])
def test_an_engine_at_rest_is_no_filter(where: tuple[float, float]) -> None:
    rng, data = np.random.default_rng(1), samples()
    t = data.edges[:-1, None]
    lines = rng.uniform(*where, 12)
    shaking = np.sin(2.0 * np.pi * lines * t + rng.uniform(0.0, 6.0, 12)).sum(axis=1)[:, None]
    shaken = replace(data, gyro=data.gyro + 1e-3 * shaking, accel=data.accel + 0.1 * shaking)
    assert RestSpectra.of(shaken, RESTS).bandwidths == Bandwidths(None, None)


def test_only_what_is_whole_and_at_rest_counts() -> None:
    data = low_passed(samples(), 10.0)
    assert RestSpectra.of(data, np.zeros((0, 2))).bandwidths == Bandwidths(None, None)
    assert RestSpectra.of(data, np.array([[0.0, 2.5]])).bandwidths == Bandwidths(None, None)
    assert RestSpectra.of(data.take(slice(0, 100)), RESTS).bandwidths == Bandwidths(None, None)
    bridged = replace(data, bridged=np.ones(len(data), dtype=bool))
    assert RestSpectra.of(bridged, RESTS).bandwidths == Bandwidths(None, None)


def test_rests_add_up_and_held_samples_show_nothing() -> None:
    data = low_passed(samples(), 10.0)
    both = RestSpectra.of(data, RESTS[:1]) + RestSpectra.of(data, RESTS[1:])
    whole = RestSpectra.of(data, RESTS)
    np.testing.assert_allclose(both.logs, whole.logs)
    assert both.bandwidths.gyro_hz == pytest.approx(whole.bandwidths.gyro_hz)
    held = replace(data, gyro=np.zeros_like(data.gyro))
    assert RestSpectra.of(held, RESTS).bandwidths.gyro_hz is None


@pytest.mark.parametrize("unit", [1e3, 1e-3, 1e-6])
def test_stamps_in_another_unit_leave_no_bandwidth(unit: float) -> None:
    """Milliseconds that are taken for seconds, and the other way: blocks would have hundreds of millions of samples."""
    data = samples(duration_s=10.0)
    other = replace(data, edges=unit * data.edges)
    assert RestSpectra.of(other, unit * np.array([[0.0, 10.0]])).bandwidths == Bandwidths(None, None)

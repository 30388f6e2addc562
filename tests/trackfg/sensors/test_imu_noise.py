"""White noise as samples show it: noise and aliased vibration count, motion and lines do not."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import astuple
from typing import Any

import numpy as np
import pytest

from trackfg.sensors.imu_intervals import Intervals
from trackfg.sensors.imu_noise.noise_at_rest import NoiseAtRest
from trackfg.sensors.imu_noise.noise_floor import NoiseFloor, noise_seen
from trackfg.sensors.imu_noise.white_noise import WhiteNoise

RATE_HZ = 100.0
GYRO, ACCEL = 1e-4, 1e-3
SECONDS = np.arange(0.0, 61.0)


def noise_of(gyro: np.ndarray, accel: np.ndarray) -> WhiteNoise:
    edges = np.arange(len(gyro) + 1) / RATE_HZ
    data = Intervals(edges, gyro, accel, np.zeros(len(gyro), dtype=bool))
    return NoiseFloor.of(data).between(SECONDS, GYRO, ACCEL)


def white(density: float, seed: int = 0) -> np.ndarray:
    """60 s of samples on three axes whose noise has this density."""
    return density * np.sqrt(RATE_HZ) * np.random.default_rng(seed).standard_normal((6000, 3))


def test_noise_as_declared_or_below_is_as_declared() -> None:
    noise = noise_of(white(GYRO), white(0.1 * ACCEL, 1))
    assert noise.gyro == pytest.approx(GYRO, rel=1e-9)
    assert noise.accel == pytest.approx(ACCEL, rel=1e-9)


def test_vibration_without_a_filter_counts_where_and_along_the_axis_that_it_is_on() -> None:
    """2 m/s^2 rms at 100 Hz are a density of 2 sqrt(0.01) = 0.2."""
    accel = white(ACCEL, 1)
    accel[3000:, 1] += 2.0 * np.random.default_rng(2).standard_normal(3000)
    noise = noise_of(white(GYRO), accel)
    assert np.median(noise.accel[34:, 1]) == pytest.approx(0.2, rel=0.1)
    assert noise.accel[34:, 1] == pytest.approx(0.2, rel=0.3)
    assert noise.accel[:27, 1] == pytest.approx(ACCEL, rel=1e-9)
    assert noise.accel[:, [0, 2]] == pytest.approx(ACCEL, rel=1e-9)


def test_motion_lines_and_a_shock_that_swings_back_do_not_count() -> None:
    t = np.arange(6000)[:, None] / RATE_HZ
    swaying = 3.0 * np.sin(2.0 * np.pi * 1.3 * t) + 0.5 * np.sin(2.0 * np.pi * 31.0 * t + np.arange(3))
    accel = white(ACCEL, 1) + swaying
    accel[2000] += 30.0
    accel[2002] -= 30.0
    seen = noise_of(white(GYRO), accel).accel / ACCEL
    assert np.median(seen) == pytest.approx(1.0)
    assert np.quantile(seen, 0.9) == pytest.approx(1.0)
    assert ACCEL * seen.max() < 0.05 * 0.3  # a swing of 0.3 m/s, next to a line


def test_a_shock_that_moves_the_vehicle_ahead_is_an_error_on_every_axis() -> None:
    """30 m/s^2 for 0.02 s would be 0.6 m/s; across and upwards alone it may be the track."""
    accel = np.tile([0.0, 0.0, 9.8], (6000, 1)) + white(ACCEL, 1)
    accel[2050:2052] += [30.0, 20.0, 0.0]
    accel[4050:4052, 1] += 20.0
    seen = noise_of(white(GYRO), accel).accel
    assert seen[20] == pytest.approx([0.6, 0.4, ACCEL], rel=0.02)
    assert seen[40, [0, 2]] == pytest.approx(ACCEL, rel=1e-9)
    accel[2050:2052, 0] = accel[4050:4052, 0]
    assert noise_of(white(GYRO), accel).accel == pytest.approx(ACCEL, rel=1e-9)


def test_a_shock_at_the_end_of_an_interval_counts_in_both_by_its_parts() -> None:
    accel = np.tile([0.0, 0.0, 9.8], (6000, 1)) + white(ACCEL, 1)
    accel[1997:2001, 0] += 10.0
    seen = noise_of(white(GYRO), accel).accel[:, 0]
    assert seen[19:21] == pytest.approx([0.3, 0.1], rel=0.03)


def test_a_value_that_stays_hides_what_is_between_two_steps() -> None:
    """Steps q = 0.1: samples that change each time have q^2/12 dt; a block of 128 that never changes q^2/12 1.28 s."""
    accel = np.zeros((6000, 3))
    accel[:, 0] = 0.1 * np.round(white(0.02, 1)[:, 0] / 0.1)
    accel[0] = 0.1
    noise = noise_of(white(GYRO), accel)
    assert noise.accel[30, 0] == pytest.approx(np.hypot(0.02, 0.1 / np.sqrt(12.0 * RATE_HZ)), rel=0.15)
    assert noise.accel[30, 1] == pytest.approx(0.1 * np.sqrt(1.28 / 12.0))


def test_a_missing_sample_may_hide_as_much_as_the_largest_one_nearby() -> None:
    accel = np.tile([0.0, 0.0, 9.8], (6000, 1)) + white(ACCEL, 1)
    accel[3050:3052, 0] = [5.0, -5.0]
    edges = np.arange(6001) / RATE_HZ
    edges[3046:] += 0.01  # one sample is missing there
    data = Intervals(edges, white(GYRO), accel, np.zeros(6000, dtype=bool))
    noise = NoiseFloor.of(data).between(SECONDS, GYRO, ACCEL)
    assert noise.accel[30, 0] == pytest.approx(5.0 * 0.01, rel=0.02)
    assert noise.accel[29, 0] == noise.accel[31, 0] == pytest.approx(ACCEL)


def test_samples_at_the_end_of_the_range_hide_as_much_again() -> None:
    accel = white(0.01, 1)
    accel[3000:3100:25, 2] = 40.0
    noise = noise_of(white(GYRO), accel)
    assert noise.accel[30, 2] == pytest.approx(4 * 40.0 * 0.01, rel=0.02)


def test_a_record_shorter_than_a_block_is_as_declared() -> None:
    data = Intervals(np.arange(21) / RATE_HZ, np.ones((20, 3)), np.ones((20, 3)), np.zeros(20, dtype=bool))
    noise = NoiseFloor.of(data).between(np.array([0.0, 0.2]), GYRO, ACCEL)
    assert noise.gyro == pytest.approx(GYRO, rel=1e-9)


def test_a_line_folded_to_near_zero_counts_where_the_vehicle_rests() -> None:
    """A line of 100 Hz that wanders by 1 Hz, sampled at 100 Hz, looks like slow motion; at rest it can be none."""
    t = np.arange(6000)[:, None] / RATE_HZ
    wander = np.cumsum(np.random.default_rng(3).standard_normal((6000, 1)), axis=0) * 2.0 * np.pi * 0.05
    accel = white(ACCEL, 1) + 0.5 * np.sin(2.0 * np.pi * 0.2 * t + wander) * [1.0, 0.5, 0.0]
    data = Intervals(np.arange(6001) / RATE_HZ, white(GYRO), accel, np.zeros(6000, dtype=bool))
    floor, rests = NoiseFloor.of(data), np.array([[0.0, 5.0], [20.0, 25.0]])
    before, after = (one.between(SECONDS, GYRO, ACCEL) for one in (floor, floor.with_rests(data, rests)))
    means = accel[: 600 * 10].reshape(-1, 50, 3).mean(axis=1)
    true = means.std(axis=0) * np.sqrt(0.5)
    assert (np.median(before.accel, axis=0)[:2] < 0.2 * true[:2]).all()
    assert np.median(after.accel, axis=0)[:2] == pytest.approx(true[:2], rel=0.3)
    assert np.median(after.accel, axis=0)[2] == pytest.approx(ACCEL, rel=1e-9)
    assert np.median(after.gyro, axis=0) == pytest.approx(GYRO, rel=1e-9)
    none = floor.with_rests(data, np.zeros((0, 2))).between(SECONDS, GYRO, ACCEL)
    np.testing.assert_array_equal(none.accel, before.accel)


@pytest.mark.parametrize("rest_s", [20.0, 300.0])
def test_a_sensor_better_than_declared_has_the_noise_that_its_rests_show(rest_s: float) -> None:
    """A limit of 2 sigma: of 240 sensors' axes 6 are below the true noise by chance, and half are far from the limit.

    The bias drifts as a sensor's does that warms up.
    """
    count, rests = round(rest_s * RATE_HZ), np.array([[0.0, rest_s]])
    ratio = np.empty((40, 6))
    for seed in range(len(ratio)):
        noise = np.random.default_rng(seed).standard_normal((count, 6)) * np.sqrt(RATE_HZ)
        drifting = (3e-7 * np.arange(count) / RATE_HZ)[:, None]
        gyro, accel = 0.1 * GYRO * noise[:, :3] + drifting, 0.1 * ACCEL * noise[:, 3:] + drifting
        data = Intervals(np.arange(count + 1) / RATE_HZ, gyro, accel, np.zeros(count, dtype=bool))
        white = NoiseFloor.of(data).with_rests(data, rests).between(data.edges[[0, -1]], GYRO, ACCEL)
        ratio[seed] = np.sqrt(white.variance[0]) / (0.1 * np.repeat([GYRO, ACCEL], 3))
    assert np.mean(ratio < 1.0) < 0.06
    assert np.median(ratio) < (1.2 if rest_s > 100.0 else 2.1)


def test_samples_too_slow_for_a_spectrum_are_as_declared() -> None:
    """Nothing would show what motion adds to the noise."""
    data = Intervals(np.arange(3001) / 10.0, 0.1 * white(GYRO)[:3000], white(ACCEL)[:3000], np.zeros(3000, dtype=bool))
    noise = NoiseFloor.of(data).with_rests(data, np.array([[0.0, 300.0]])).between(SECONDS, GYRO, ACCEL)
    assert noise.gyro == pytest.approx(GYRO, rel=1e-9)


def test_two_seconds_of_rest_show_too_little_to_lower_the_declared_noise_by_much() -> None:
    data = Intervals(np.arange(201) / RATE_HZ, 0.1 * white(GYRO)[:200], white(ACCEL)[:200], np.zeros(200, dtype=bool))
    noise = NoiseFloor.of(data).with_rests(data, np.array([[0.0, 2.0]])).between(data.edges[[0, -1]], GYRO, ACCEL)
    assert (noise.gyro > 0.5 * GYRO).all()


def test_a_density_is_lowered_to_a_tenth_and_not_at_all_where_samples_are_held() -> None:
    gyro, accel = 1e-3 * white(GYRO), 0.03 * white(ACCEL, 1)
    data = Intervals(np.arange(6001) / RATE_HZ, gyro, accel, np.zeros(6000, dtype=bool))
    noise = NoiseFloor.of(data).with_rests(data, np.array([[0.0, 60.0]])).between(SECONDS, GYRO, ACCEL)
    assert noise.gyro == pytest.approx(GYRO, rel=1e-9)
    assert noise.accel == pytest.approx(0.1 * ACCEL, rel=1e-9)


@pytest.mark.parametrize("count", [33, 100, 520, 6000])
@pytest.mark.parametrize("faulty", [False, True])
def test_the_kernel_finds_what_numpy_does(
    count: int, faulty: bool, with_both: Callable[[Callable[[], Any]], tuple[Any, Any]]
) -> None:
    """Of clean samples, and of rounded ones with shocks, ends of the range, bridged ones, and some missing."""
    random, edges = np.random.default_rng(count), np.arange(count + 1) / RATE_HZ
    gyro, accel = GYRO * random.standard_normal((count, 3)), [0.0, 0.0, 9.8] + 0.05 * random.standard_normal((count, 3))
    bridged = np.zeros(count, dtype=bool)
    if faulty:
        gyro, accel = np.cumsum(gyro, axis=0), np.round(accel, 2)
        gyro[:, 1] = 0.0
        accel[count // 3 : count // 3 + 3] += [30.0, 50.0, -20.0]
        accel[count // 4 : count // 4 + 5, 1] = 25.0
        accel = np.clip(accel, -25.0, 25.0)
        edges[count // 2 :] += 0.6 / RATE_HZ
        bridged[count // 5 : count // 5 + 4] = True
    data = Intervals(edges, gyro, accel, bridged)
    ours, theirs = with_both(lambda: NoiseFloor.of(data))
    most = np.array([0.01 * GYRO**2, *np.full(4, np.inf), 0.1 * ACCEL**2])
    edges, at_rest = edges[[0, count // 3, count]], NoiseAtRest(np.array([0.0, GYRO**2, 0.0, 0.0, 0.0, 1e-4]), most)
    seen, theirs_seen = with_both(lambda: noise_seen(data, edges, GYRO, ACCEL, at_rest).variance)
    np.testing.assert_allclose(seen, theirs_seen, rtol=1e-11)
    assert (ours.lost_t.size > 0, ours.shock_t.size > 0) == (faulty, faulty)
    for found, expected in zip(astuple(ours)[:-1], astuple(theirs)[:-1], strict=True):
        np.testing.assert_allclose(found, expected, rtol=1e-11, atol=0.0)


def test_the_kernel_adds_up_the_noise_as_numpy_does(with_both: Callable[[Callable[[], Any]], tuple[Any, Any]]) -> None:
    """Of intervals within a block, over several, and beyond the record, with what is lost at the edges of some."""
    random, knots = np.random.default_rng(5), np.array([0.0, 1.0, 2.5, 3.0, 6.0])
    at, other = np.array([0.5, 1.5, 1.5, 5.0]), np.array([-1.0, 0.2, 2.9, 7.0])
    floor = NoiseFloor(knots, random.uniform(0.0, 4.0, (4, 6)), at, random.normal(size=(4, 6)), other, np.ones((4, 6)))
    t = np.array([-0.5, 0.5, 0.7, 1.5, 5.0, 6.5])
    ours, theirs = with_both(lambda: floor.between(t, 1.0, 0.5).variance)
    np.testing.assert_allclose(ours, theirs, rtol=1e-12)

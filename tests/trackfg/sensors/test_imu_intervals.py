"""The inertial record without holes, and its compression against brute-force integration."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import astuple, replace
from typing import Any

import numpy as np
import pytest

from trackfg.datasets.faults import drop_imu
from trackfg.datasets.scenarios import Simulation
from trackfg.numerics.rotations import so3_exp, so3_log
from trackfg.recording.model import Recording
from trackfg.sensors.imu_intervals import (
    Increments,
    Intervals,
    compress,
    interpolate_columns,
    intervals,
    laid_out,
    means_around,
    turning,
)

RATE_HZ = 200.0
BIAS = np.array([3e-3, -2e-3, 1e-3])
WithBoth = Callable[[Callable[[], Any]], tuple[Any, Any]]


@pytest.fixture(scope="module")
def recording(simulated: Callable[..., Simulation]) -> Recording:
    return simulated("trolley", seed=0, duration_s=30.0).recording


def tumbling(n: int = 400) -> Intervals:
    """A body that nods, rolls and turns at once, up to about 1 rad/s, with vibration in its specific force."""
    t = (np.arange(n) + 0.5) / RATE_HZ
    gyro = np.stack([np.sin(3 * t), 0.7 * np.cos(5 * t), 0.5 + 0.4 * np.sin(11 * t)], axis=1)
    accel = np.stack([np.cos(4 * t), 2 * np.sin(9 * t), 9.8 + np.sin(50 * t)], axis=1)
    return Intervals(np.arange(n + 1) / RATE_HZ, gyro, accel, np.zeros(n, dtype=bool))


def brute_force(data: Intervals, steps: int = 50) -> tuple[np.ndarray, np.ndarray]:
    """Rotation and velocity change over all samples, each cut into many short midpoint steps."""
    R, v = np.eye(3), np.zeros(3)
    for w, f, dt in zip(data.gyro, data.accel, data.durations, strict=True):
        half, whole = so3_exp(0.5 * w * dt / steps), so3_exp(w * dt / steps)
        for _ in range(steps):
            v = v + R @ half @ f * dt / steps
            R = R @ whole
    return R, v


def chained(increments: Increments) -> tuple[np.ndarray, np.ndarray]:
    R, v = np.eye(3), np.zeros(3)
    for turn, change in zip(increments.rotation, increments.velocity, strict=True):
        v = v + R @ change
        R = R @ so3_exp(turn)
    return R, v


@pytest.mark.parametrize("group", [1, 4, 10, 400])
def test_compression_loses_nothing_of_a_tumbling_body(group: int) -> None:
    data = tumbling()
    R, v = chained(compress(data, np.arange(0, len(data) + 1, group)))
    truth_R, truth_v = brute_force(data)
    np.testing.assert_allclose(R, truth_R, atol=1e-12)
    # Sculling within a sample is kept to first order in its turn, 6 mrad at most: the rest is a sixth of its square.
    assert np.linalg.norm(v - truth_v) < 0.006**2 / 6 * np.linalg.norm(truth_v)


def test_compression_keeps_coning_and_sculling_that_sums_lose() -> None:
    data = tumbling()
    starts = np.arange(0, len(data) + 1, 10)
    truth_R, truth_v = brute_force(data)
    summed = Increments(
        np.diff(data.edges[starts]),
        np.add.reduceat(data.gyro / RATE_HZ, starts[:-1]),
        np.add.reduceat(data.accel / RATE_HZ, starts[:-1]),
    )
    naive_R, naive_v = chained(summed)
    R, v = chained(compress(data, starts))
    assert np.linalg.norm(so3_log(truth_R.T @ R)) < 1e-6 * np.linalg.norm(so3_log(truth_R.T @ naive_R))
    assert np.linalg.norm(v - truth_v) < 1e-3 * np.linalg.norm(naive_v - truth_v)


def test_groups_may_differ_in_length_and_need_not_start_at_the_beginning() -> None:
    data = tumbling(60)
    starts = np.array([5, 6, 19, 20, 57])
    together = compress(data, starts)
    np.testing.assert_allclose(together.duration, np.diff(starts) / RATE_HZ, rtol=1e-12)
    for g in range(4):
        alone = compress(data, starts[g : g + 2])
        np.testing.assert_allclose(together.rotation[g], alone.rotation[0], atol=1e-15)
        np.testing.assert_allclose(together.velocity[g], alone.velocity[0], atol=1e-15)


def test_sound_record_is_laid_edge_to_edge(recording: Recording) -> None:
    data = intervals(recording)
    assert len(data) == len(recording.imu)
    assert not data.bridged.any()
    assert data.gaps().shape == (0, 2)
    np.testing.assert_allclose(data.edges, np.arange(len(data) + 1) / RATE_HZ, atol=1e-9)
    np.testing.assert_array_equal(data.gyro, recording.gyro)
    np.testing.assert_array_equal(data.accel, recording.accel)


def test_record_from_0_starts_at_0_exactly(recording: Recording) -> None:
    data = intervals(recording)
    assert data.edges[0] == 0.0
    assert data.edges[-1] == 30.0


def test_single_sample_is_an_interval_of_no_length(recording: Recording) -> None:
    data = intervals(replace(recording, imu=recording.imu.iloc[:1]))
    assert len(data) == 1
    assert data.durations.sum() == 0.0


def test_hole_is_bridged_with_lines_and_marked(recording: Recording) -> None:
    data = intervals(drop_imu(recording, 10.0, 15.0))
    assert len(data) == len(recording.imu)
    np.testing.assert_allclose(data.durations, 1 / RATE_HZ, atol=1e-9)
    np.testing.assert_allclose(data.gaps(), [[10.0, 15.0]], atol=1e-9)
    assert data.bridged.sum() == 1000
    t = 0.5 * (data.edges[1:] + data.edges[:-1])
    before, after = recording.gyro[1999], recording.gyro[3000]
    share = ((t - t[1999]) / (t[3000] - t[1999]))[2000:3000, None]
    np.testing.assert_allclose(data.gyro[data.bridged], before + share * (after - before), atol=1e-12)
    np.testing.assert_array_equal(data.accel[~data.bridged], np.delete(recording.accel, np.s_[2000:3000], axis=0))


def test_several_holes_are_several_gaps(recording: Recording) -> None:
    holed = recording
    spans = [(3.0, 3.1), (8.0, 12.0), (20.0, 20.25)]
    for span in spans:
        holed = drop_imu(holed, *span)
    data = intervals(holed)
    np.testing.assert_allclose(data.gaps(), spans, atol=1e-6)
    assert (data.durations > 0).all()
    assert data.edges[-1] == pytest.approx(intervals(recording).edges[-1])


@pytest.mark.parametrize("lost", [1, 2])
def test_dropped_samples_are_no_holes(recording: Recording, lost: int) -> None:
    kept = np.ones(len(recording.imu), dtype=bool)
    for start in range(40, len(kept) - 40, 97):
        kept[start : start + lost] = False
    data = intervals(replace(recording, imu=recording.imu[kept].reset_index(drop=True)))
    assert len(data) == kept.sum()
    assert not data.bridged.any()
    assert data.durations.min() > 0.99 / RATE_HZ
    assert data.durations.max() < (1.01 + lost / 2) / RATE_HZ
    assert data.durations.sum() == pytest.approx(len(kept) / RATE_HZ)


@pytest.mark.parametrize(
    ("rate_hz", "silent_s", "hole"),
    [(200.0, 0.045, False), (200.0, 0.055, True), (20.0, 0.15, False), (20.0, 0.2, True)],
)
def test_a_hole_is_longer_than_50_ms_and_than_three_samples(rate_hz: float, silent_s: float, hole: bool) -> None:
    """At 200 Hz 50 ms count, ten samples; at 20 Hz three and a half samples, 0.175 s."""
    before = np.arange(100) / rate_hz
    t = np.concatenate([before, before[-1] + silent_s + np.arange(100) / rate_hz])
    data = laid_out(t, *np.zeros((2, len(t), 3)), 1.0 / rate_hz)
    assert data.bridged.any() == hole
    assert len(data.gaps()) == hole


def test_hole_turns_the_body_no_more_than_its_neighbours_say(recording: Recording) -> None:
    """A trolley does not turn much in 5 s: the bridged record ends with nearly the attitude of the whole one."""
    turns = [
        compress(data, np.array([0, len(data)])).rotation[0]
        for data in (intervals(recording), intervals(drop_imu(recording, 10.0, 15.0)))
    ]
    assert np.linalg.norm(turns[0] - turns[1]) < 0.02


def assert_alike(both: tuple[Any, Any]) -> None:
    """What the kernel finds is what numpy does, up to rounding."""
    for ours, theirs in zip(*map(astuple, both), strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=1e-11, atol=1e-13)


@pytest.mark.parametrize("starts", [np.arange(3, 390), np.arange(0, 401, 4), np.array([0, 1, 5, 6, 100, 400])])
def test_the_kernel_compresses_as_numpy_does(starts: np.ndarray, with_both: WithBoth) -> None:
    assert_alike(with_both(lambda: compress(tumbling(), starts, BIAS)))


@pytest.mark.parametrize("speed", [20.0, 0.0, -3.0])
def test_the_kernel_follows_attitudes_as_numpy_does(speed: float, with_both: WithBoth) -> None:
    data, keyframes = tumbling(), np.array([2, 100, 101, 240, 399])
    distance = np.cumsum(speed * (1.0 + 0.5 * np.sin(data.edges))) / RATE_HZ
    assert_alike(with_both(lambda: turning(data, keyframes, BIAS, distance)))


def test_the_kernel_averages_as_numpy_does(with_both: WithBoth) -> None:
    """Around times within the record, at its ends, and beyond one by less than half the width."""
    data, t = tumbling(), np.array([0.0, 0.001, 0.5, 0.502, 1.37, 2.0, 2.015])
    ours, theirs = with_both(lambda: means_around(t, 0.04, data.edges, data.accel))
    np.testing.assert_allclose(ours, theirs, rtol=1e-10)


@pytest.mark.parametrize("rows", [1, 2, 5])
def test_the_kernel_interpolates_as_numpy_does(rows: int, with_both: WithBoth) -> None:
    """Before the first and after the last time, at each of them, and in between."""
    t, values = np.arange(rows) ** 1.5, np.random.default_rng(rows).normal(size=(rows, 3))
    at = np.concatenate([[-1.0, 100.0], t, t + 0.1])
    ours, theirs = with_both(lambda: interpolate_columns(at, t, values))
    np.testing.assert_allclose(ours, theirs, atol=1e-14)

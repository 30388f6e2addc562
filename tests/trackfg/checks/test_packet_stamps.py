"""Samples that a logger stamps by the packet are spread evenly."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from trackfg.checks.inertial.packet_stamps import spread_evenly
from trackfg.datasets.scenarios import Simulation, simulate
from trackfg.io.check import check_recording
from trackfg.io.reader import read_recording, write_recording
from trackfg.numerics.arrays import Array
from trackfg.recording.model import Recording
from trackfg.smoothing.smoother import smooth

RATE_HZ = 200.0
TRUE = np.arange(20_000) / RATE_HZ


def channels(t: Array) -> list[Array]:
    return list(np.random.default_rng(7).standard_normal((6, len(t))))


def stamped(t: Array, sizes: np.ndarray, spread_s: float = 0.0, delay_s: float = 0.0) -> Array:
    """Return the times of packets of so many samples that arrive with their last one, or some time later."""
    packet = np.repeat(np.arange(len(sizes)), sizes)[: len(t)]
    last = np.append(np.flatnonzero(np.diff(packet)), len(packet) - 1)
    arrival = t[last] + (np.random.default_rng(3).exponential(delay_s, len(last)) if delay_s else 0.0)
    arrival = np.maximum.accumulate(arrival)
    return arrival[packet] + spread_s * (np.arange(len(t)) - np.searchsorted(packet, packet))


@pytest.mark.parametrize(("count", "spread_s"), [(2, 3e-6), (10, 3e-6), (10, 4e-4), (64, 1e-6)])
def test_times_of_arrival_are_those_of_the_last_sample(count: int, spread_s: float) -> None:
    even = spread_evenly(stamped(TRUE, np.full(20_000, count), spread_s), channels(TRUE))
    assert even is not None
    assert (even.rows, even.equal) == (count, False)
    assert even.t == pytest.approx(TRUE, abs=1e-6)


@pytest.mark.parametrize("count", [2, 3, 10])
def test_equal_stamps_are_those_of_the_middle(count: int) -> None:
    """Of packets as of a clock that ticks as seldom: neither is off by more than half of a packet."""
    for times in (stamped(TRUE, np.full(20_000, count)), np.floor(np.arange(20_000) / count) * count / RATE_HZ):
        even = spread_evenly(times, channels(TRUE))
        assert even is not None
        assert even.equal
        assert np.diff(even.t) == pytest.approx(1.0 / RATE_HZ, rel=1e-6)
        assert np.abs(even.t - TRUE).max() <= 0.5 * count / RATE_HZ


def test_delays_scatter_about_a_line() -> None:
    even = spread_evenly(stamped(TRUE, np.full(20_000, 10), 3e-6, 0.003), channels(TRUE))
    assert even is not None
    off = even.t - TRUE
    assert off.mean() == pytest.approx(0.0025, abs=0.001)  # later outliers do not count
    assert off.std() < 0.0005
    assert np.diff(even.t).min() > 0.5 / RATE_HZ


def test_sizes_and_rates_of_packets_vary() -> None:
    sizes = np.random.default_rng(1).integers(8, 13, 20_000)
    even = spread_evenly(stamped(TRUE, sizes, 3e-6), channels(TRUE))
    assert even is not None
    assert even.t == pytest.approx(TRUE, abs=1e-6)
    slower = np.concatenate([TRUE, TRUE[-1] + 4.0 * TRUE[1:5000]])
    even = spread_evenly(stamped(slower, np.full(20_000, 10), 3e-6), channels(slower))
    assert even is not None
    off = np.abs(even.t - slower)
    assert np.count_nonzero(off > 1e-5) <= 20
    assert off.max() < 0.05


def test_packets_that_are_lost_stay_holes() -> None:
    times, packet = stamped(TRUE, np.full(20_000, 10), 3e-6, 0.002), np.arange(20_000) // 10
    kept = ~np.isin(packet, [100, 300, 301, *range(1000, 1100)])
    even = spread_evenly(times[kept], channels(TRUE[kept]))
    assert even is not None
    assert (even.t - TRUE[kept]).std() < 0.0005
    holes = np.sort(np.diff(even.t))[-3:]
    assert holes == pytest.approx([0.055, 0.105, 5.005], abs=0.003)


def test_other_stamps_are_left_alone() -> None:
    rng = np.random.default_rng(0)
    for times in (
        TRUE,
        np.sort(TRUE + rng.normal(0.0, 0.002, len(TRUE))),
        np.maximum.accumulate(TRUE + rng.exponential(0.005, len(TRUE))),
        TRUE[rng.random(len(TRUE)) > 0.3],
        np.concatenate([np.arange(20_000) / 1000.0, 20.0 + np.arange(20_000) / 4.0]),
        TRUE + 9.0 * np.floor(TRUE),  # a second of every ten
        TRUE[::-1],
        np.zeros(100),
        TRUE[:15],
        TRUE[:0],
    ):
        assert spread_evenly(times, channels(times)) is None


def test_rows_that_are_written_twice_are_no_packets() -> None:
    twice = [np.repeat(channel, 2) for channel in channels(TRUE)]
    assert spread_evenly(np.repeat(TRUE, 2), twice) is None


def in_packets(recording: Recording, spread_s: float) -> Recording:
    times = recording.imu["t_s"].to_numpy()
    return replace(recording, imu=recording.imu.assign(t_s=stamped(times, np.full(len(times), 10), spread_s, 0.002)))


@pytest.fixture(scope="module")
def run() -> Simulation:
    return simulate("mainline-gnss", seed=0, duration_s=100.0)


@pytest.mark.parametrize("spread_s", [0.0, 3e-6])
def test_a_run_is_smoothed_as_of_even_samples(run: Simulation, spread_s: float, tmp_path: Path) -> None:
    fine, result = smooth(run.recording), smooth(in_packets(run.recording, spread_s))
    for name in ("roll_rad_sd", "speed_mps_sd", "chainage_m_sd"):
        assert (result.trajectory[name] / fine.trajectory[name]).median() == pytest.approx(1.0, abs=0.15)
    (finding,) = [finding for finding in result.summary.findings if finding.code == "packet-stamps"]
    assert "packets of 10 samples have one time each" in finding.message
    clock = result.summary.gnss_clock_offset_s
    assert clock is not None
    assert clock.sd is not None
    late = 0.0225 if spread_s == 0.0 else 0.0  # the middle of a packet is stamped with its last sample
    assert abs(clock.value - late) < 4.0 * clock.sd
    write_recording(in_packets(run.recording, spread_s), tmp_path / "run")
    read = read_recording(tmp_path / "run")
    assert smooth(read).trajectory.equals(result.trajectory)
    report = check_recording(tmp_path / "run")
    assert report.usable
    assert [finding.code for finding in report.findings if finding.level == "warning"] == ["packet-stamps"]

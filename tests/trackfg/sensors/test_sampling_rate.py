"""The sampling interval is that of each part of a record."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from trackfg.checks.contradictions.all_contradictions import diagnose
from trackfg.datasets.scenarios import Simulation, simulate
from trackfg.io.formats.imu import ImuFormat
from trackfg.numerics.arrays import Array
from trackfg.recording.model import Recording
from trackfg.sensors.imu_intervals import intervals
from trackfg.sensors.imu_noise.noise_floor import NoiseFloor
from trackfg.sensors.sampling_rate import RateFollower, local_intervals, rate_stretches
from trackfg.smoothing.smoother import smooth

FAST_S, SLOW_S = 0.005, 0.1


def followed(steps: Array, batch: int, usual_s: float = FAST_S) -> Array:
    """Return the interval that a stream takes for usual of each step, in batches of so many."""
    follower, usual = RateFollower(usual_s), []
    for first in range(0, len(steps), batch):
        for count, interval_s in follower.pieces(steps[first : first + batch]):
            usual += [interval_s] * count
    return np.array(usual)


@pytest.mark.parametrize("later_s", [SLOW_S, 0.01, 0.002])
@pytest.mark.parametrize("at", [1000, 1003, 1015])
def test_a_change_is_found_to_the_row(later_s: float, at: int) -> None:
    steps = np.concatenate([np.full(at, FAST_S), np.full(1500, later_s), np.full(900, FAST_S)])
    assert rate_stretches(steps) == [(0, at), (at, at + 1500), (at + 1500, len(steps))]
    assert local_intervals(steps, FAST_S)[[0, at - 1, at, -1]] == pytest.approx([FAST_S, FAST_S, later_s, FAST_S])


def test_other_irregularities_are_no_rate() -> None:
    rng, steps = np.random.default_rng(0), np.full(40_000, FAST_S)
    lost = np.diff(np.arange(0.0, 200.0, FAST_S)[rng.random(40_000) > 0.1])
    jitter = np.diff(np.arange(40_000) * FAST_S + rng.normal(0.0, 0.0005, 40_000))
    delays = np.diff(np.maximum.accumulate(np.arange(40_000) * FAST_S + rng.exponential(0.005, 40_000)))
    holes = np.where(np.arange(40_000) % 900 == 0, 1.0, steps)
    busy = steps.copy()
    busy[5000:5150] *= 2.0  # every second row for a moment
    packets = np.where(np.arange(40_000) % 10 == 0, 10.0 * FAST_S, 0.0)
    drifting = FAST_S * np.linspace(1.0, 1.3, 40_000)
    for each in (steps, lost, jitter, delays, holes, busy, packets, drifting, steps[:20], steps[:0]):
        assert len(rate_stretches(each)) == 1
        assert set(followed(each, 1000)) <= {FAST_S}


@pytest.mark.parametrize("batch", [1, 7, 16, 50, 4000])
def test_a_stream_follows_in_whatever_batches(batch: int) -> None:
    steps = np.concatenate([np.full(1003, FAST_S), np.full(100, SLOW_S), np.full(1000, FAST_S)])
    usual = followed(steps, batch)
    assert np.array_equal(usual, followed(steps, 1))
    slow = np.flatnonzero(usual == SLOW_S)
    assert 1003 + 20 <= slow[0] <= 1003 + 48  # after 2 s of whole blocks
    assert 1103 <= slow[-1] <= 1103 + 432


def test_stamps_are_moved_by_half_an_interval_of_their_rate() -> None:
    steps = np.concatenate([np.full(1000, FAST_S), np.full(100, SLOW_S)])
    t = np.append(0.0, np.cumsum(steps))
    imu = simulate("mainline", seed=0, duration_s=5.0).recording.description.imu
    moved = ImuFormat().on_common_clock(imu.model_copy(update={"stamp": "end"}), t) - t
    assert moved[[0, -1]] == pytest.approx([-0.5 * FAST_S, -0.5 * SLOW_S])


def slower(recording: Recording, count: int, first: int, end: int) -> Recording:
    """Return a recording in whose rows from ``first`` to ``end`` so many samples are averaged to one."""
    imu = recording.imu
    part = imu.iloc[first : first + (end - first) // count * count]
    means = pd.DataFrame(part.to_numpy().reshape(-1, count, part.shape[1]).mean(axis=1), columns=imu.columns)
    return replace(recording, imu=pd.concat([imu.iloc[:first], means, imu.iloc[end:]], ignore_index=True))


@pytest.fixture(scope="module")
def run() -> Simulation:
    """Four minutes, at rest for the first half a minute."""
    return simulate("mainline", seed=0, duration_s=200.0)


def test_each_part_has_the_noise_of_its_rate(run: Simulation) -> None:
    """The density is the same at either rate."""
    data = intervals(slower(run.recording, 20, 20_000, 40_000))
    assert not data.bridged.any()
    floor = NoiseFloor.of(data)
    noise = run.recording.description.imu.noise
    white = floor.between(np.arange(0.5, 199.0, 0.5), noise.gyro_white, noise.accel_white)
    for densities, declared in ((white.gyro, noise.gyro_white), (white.accel, noise.accel_white)):
        assert np.quantile(densities, 0.98, axis=0) == pytest.approx(declared, rel=0.2)
        assert densities.max() < 6.0 * declared  # where one interval meets the other


@pytest.mark.parametrize(("count", "first", "end"), [(4, 20_000, 40_000), (20, 20_000, 40_000), (20, 0, 20_000)])
def test_a_change_of_the_rate_widens_no_sigma(run: Simulation, count: int, first: int, end: int) -> None:
    result, fine = smooth(slower(run.recording, count, first, end)), smooth(run.recording)
    for name in ("roll_rad_sd", "speed_mps_sd", "chainage_m_sd"):
        ratio = result.trajectory[name] / fine.trajectory[name]
        assert ratio.median() == pytest.approx(1.0, abs=0.2)
        assert ratio.quantile(0.98) < 2.0


def test_the_noise_at_rest_is_that_of_the_rate_there(run: Simulation) -> None:
    estimates, findings = diagnose(slower(run.recording, 4, 0, 20_000))
    (finding,) = findings
    assert (finding.code, finding.level, finding.row) == ("rate-changes", "info", 5001)
    assert "from 50 to 200 samples a second" in finding.message
    assert estimates.noise_density is not None
    assert estimates.noise_density.gyro_ratio == pytest.approx(1.0, abs=0.15)
    assert estimates.noise_density.accel_ratio == pytest.approx(1.0, abs=0.15)

"""Samples of a slow sensor in a table of a higher rate."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from trackfg.checks.contradictions.all_contradictions import diagnose
from trackfg.checks.inertial.repeated_rows import repeated_rows, without_repeated_rows
from trackfg.datasets.scenarios import Simulation
from trackfg.recording.model import IMU_COLUMNS, Recording
from trackfg.smoothing.smoother import smooth

SAMPLES = np.random.default_rng(0).standard_normal((200, 6))


@pytest.mark.parametrize("count", [2, 5, 20])
def test_samples_that_stay_are_repeated(count: int) -> None:
    repeated = repeated_rows(np.repeat(SAMPLES, count, axis=0).T)
    assert np.array_equal(~repeated, np.arange(200 * count) % count == 0)


def test_rates_need_not_divide_each_other() -> None:
    fine, slow = np.arange(0.0, 10.0, 0.01), np.arange(0.0, 10.0, 1.0 / 13.7)
    row = np.searchsorted(slow, fine, side="right") - 1
    repeated = repeated_rows(SAMPLES[row].T)
    assert np.count_nonzero(~repeated) == pytest.approx(len(slow), abs=3)


def test_measurements_pass() -> None:
    assert not repeated_rows(SAMPLES.T).any()
    assert not repeated_rows(SAMPLES[:1].T).any()
    assert not repeated_rows(SAMPLES[:0].T).any()
    one_channel = SAMPLES.copy()
    one_channel[:, 3] = 9.8
    assert not repeated_rows(one_channel.T).any()


def test_a_quiet_sensor_of_coarse_steps_is_no_slow_one() -> None:
    """At rest its six values change together only now and then."""
    steps = np.repeat(SAMPLES[:100], np.random.default_rng(1).geometric(0.2, 100), axis=0)
    assert not repeated_rows(steps.T).any()


def test_a_rest_of_a_slow_sensor_keeps_its_rate() -> None:
    held = np.repeat(np.concatenate([SAMPLES, np.tile(SAMPLES[-1], (30, 1)), SAMPLES]), 5, axis=0)
    repeated = repeated_rows(held.T)
    assert np.array_equal(~repeated, np.arange(len(held)) % 5 == 0)


def held(recording: Recording, count: int) -> Recording:
    row = np.arange(len(recording.imu)) // count * count
    values = recording.imu.iloc[row].reset_index(drop=True).assign(t_s=recording.imu["t_s"])
    return replace(recording, imu=values)


def test_a_run_is_smoothed_as_at_the_rate_of_the_sensor(simulated: Callable[..., Simulation]) -> None:
    recording = simulated("slippery-line", seed=0, duration_s=90.0).recording
    slow = replace(recording, imu=recording.imu[::20].reset_index(drop=True))
    left = without_repeated_rows(held(recording, 20))
    assert left.imu.equals(slow.imu)
    assert without_repeated_rows(recording) is recording
    result = smooth(held(recording, 20))
    assert result.trajectory.equals(smooth(slow).trajectory)
    (finding,) = [finding for finding in result.summary.findings if finding.code == "rows-repeated"]
    assert "the sensor gives 5 samples a second" in finding.message
    (named,) = [finding for finding in diagnose(held(recording, 20))[1] if finding.code == "rows-repeated"]
    assert "samples of a slower one" in str(named.hint)
    assert list(left.imu.columns) == list(IMU_COLUMNS)

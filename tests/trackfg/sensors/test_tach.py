"""The tach as a function of time: kinds, rounding, gaps, the sense of an unsigned one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from trackfg.datasets import tables
from trackfg.datasets.faults import drop_tach
from trackfg.datasets.scenarios import Simulation
from trackfg.recording.description import Tach
from trackfg.recording.model import Recording
from trackfg.sensors.tach import read_wheel

MAX_GAP_S = 0.3
PULSE_M = 0.03


@pytest.fixture(scope="module")
def shunting(simulated: Callable[..., Simulation]) -> Simulation:
    return simulated("shunting-unsigned", seed=4, duration_s=240.0)


def with_tach(recording: Recording, t: np.ndarray, distance: np.ndarray, **description: object) -> Recording:
    tach = Tach.model_validate({"file": "tach.csv", "column": "x", "kind": "distance", "unit": "m", **description})
    return replace(
        recording,
        tach=pd.DataFrame({"t_s": t, "distance_m": distance}),
        description=recording.description.model_copy(update={"tach": tach}),
    )


def driven(t: np.ndarray) -> np.ndarray:
    """Distance of a vehicle whose speed swings between 4 and 8 m/s."""
    return 6.0 * t - 10.0 * np.cos(t / 5.0)


def test_no_tach_is_no_wheel(shunting: Simulation) -> None:
    assert read_wheel(replace(shunting.recording, tach=None), MAX_GAP_S) is None


def test_sampled_count_rounds_uniformly_within_a_pulse(shunting: Simulation) -> None:
    t = np.arange(0.0, 100.0, 0.02)
    count = np.floor(driven(t) / PULSE_M) * PULSE_M
    wheel = read_wheel(with_tach(shunting.recording, t, count, signed=True), MAX_GAP_S)
    assert wheel is not None
    assert wheel.quantum == pytest.approx(PULSE_M)
    assert wheel.rounding_sd == pytest.approx(np.std(driven(t) - count), rel=0.05)
    assert not wheel.integrates_speed


def test_rows_at_the_pulses_own_times_hardly_round(shunting: Simulation) -> None:
    fine = np.arange(0.0, 100.0, 1e-3)
    pulse = np.arange(driven(fine[0]), driven(fine[-1]), PULSE_M)
    t = np.interp(pulse, driven(fine), fine)
    wheel = read_wheel(with_tach(shunting.recording, t, pulse, signed=True), MAX_GAP_S)
    assert wheel is not None
    at = np.linspace(1.0, 99.0, 500)
    error = np.std(wheel.at(at) - driven(at))
    assert error < wheel.rounding_sd < PULSE_M / np.sqrt(12.0) / 2


def test_distance_that_is_not_counted_has_a_rounding_of_a_tenth_of_a_millimetre(shunting: Simulation) -> None:
    t = np.arange(0.0, 100.0, 0.1)
    wheel = read_wheel(with_tach(shunting.recording, t, driven(t), signed=True), MAX_GAP_S)
    assert wheel is not None
    assert wheel.quantum == 0.0
    assert wheel.rounding_sd == pytest.approx(1e-4)


def test_integrated_speed_is_smooth_between_rows(shunting: Simulation) -> None:
    t = np.arange(0.0, 100.0, 0.5)
    speed = 6.0 + 2.0 * np.sin(t / 5.0)
    distance = tables.integrated_speed(t, speed)
    for description in ({"kind": "speed", "unit": "m/s"}, {"integrated": True}):
        wheel = read_wheel(with_tach(shunting.recording, t, distance, signed=True, **description), MAX_GAP_S)
        assert wheel is not None
        assert wheel.integrates_speed
        assert wheel.quantum == 0.0
        between = t[1:-2] + 0.25
        true = 6.0 * between + 10.0 * (1.0 - np.cos(between / 5.0))
        np.testing.assert_allclose(wheel.at(between), true, atol=0.05)
        # Linear between rows would swing by a v' dt / 8 within each of them.
        np.testing.assert_allclose(wheel.rate(between, 0.1), 6.0 + 2.0 * np.sin(between / 5.0), atol=0.03)


def test_rate_is_the_mean_speed_of_the_window(shunting: Simulation) -> None:
    t = np.arange(0.0, 100.0, 0.01)
    wheel = read_wheel(with_tach(shunting.recording, t, driven(t), signed=True), MAX_GAP_S)
    assert wheel is not None
    at = np.array([10.0, 33.3, 80.0])
    np.testing.assert_allclose(wheel.rate(at), 6.0 + 2.0 * np.sin(at / 5.0), atol=1e-3)
    np.testing.assert_allclose(wheel.rate(at, 2.0), (driven(at + 2.0) - driven(at - 2.0)) / 4.0, atol=1e-4)


def test_outside_its_record_the_wheel_is_constant_and_covers_nothing(shunting: Simulation) -> None:
    t = np.arange(10.0, 50.0, 0.1)
    wheel = read_wheel(with_tach(shunting.recording, t, driven(t), signed=True), MAX_GAP_S)
    assert wheel is not None
    np.testing.assert_allclose(wheel.at(np.array([0.0, 9.0, 60.0])), driven(np.array([10.0, 10.0, t[-1]])))
    covers = wheel.covers(np.array([9.99, 10.0, 30.0, t[-1], 50.1]))
    assert covers.tolist() == [False, True, True, True, False]


def test_silence_in_motion_is_a_gap_and_silence_at_rest_is_none(simulated: Callable[..., Simulation]) -> None:
    run = simulated("mainline", seed=3, duration_s=120.0)
    wheel = read_wheel(drop_tach(run.recording, 5.0, 25.0), MAX_GAP_S)
    assert wheel is not None
    assert wheel.gaps.shape == (0, 2)
    wheel = read_wheel(drop_tach(run.recording, 60.0, 90.0), MAX_GAP_S)
    assert wheel is not None
    np.testing.assert_allclose(wheel.gaps, [[60.0, 90.0]], atol=0.021)
    assert wheel.covers(np.array([59.9, 61.0, 89.0, 90.1])).tolist() == [True, False, False, True]
    wheel = read_wheel(drop_tach(run.recording, 60.0, 61.0), MAX_GAP_S)
    assert wheel is not None
    assert wheel.covers(np.array([59.9, 60.5, 61.1])).tolist() == [True, False, True]
    wheel = read_wheel(drop_tach(run.recording, 60.0, 60.25), MAX_GAP_S)
    assert wheel is not None
    assert len(wheel.gaps) == 0


def test_rows_that_are_seldom_are_no_gaps(simulated: Callable[..., Simulation]) -> None:
    recording = simulated("mainline", seed=3, duration_s=120.0).recording
    assert recording.tach is not None
    seldom = replace(recording, tach=recording.tach[::50].reset_index(drop=True))
    wheel = read_wheel(seldom, MAX_GAP_S)
    assert wheel is not None
    assert len(wheel.gaps) == 0
    wheel = read_wheel(drop_tach(seldom, 60.0, 66.0), MAX_GAP_S)
    assert wheel is not None
    assert len(wheel.gaps) == 1


def test_pulses_only_on_change_are_no_gap_at_rest(simulated: Callable[..., Simulation]) -> None:
    """A tach that writes a row per pulse is silent at rest: one pulse over 30 s is no gap."""
    recording = simulated("mainline", seed=3, duration_s=120.0).recording
    assert recording.tach is not None
    step = recording.tach["distance_m"].diff().fillna(1.0)
    wheel = read_wheel(replace(recording, tach=recording.tach[step > 0].reset_index(drop=True)), MAX_GAP_S)
    assert wheel is not None
    assert len(wheel.gaps) == 0


@pytest.mark.parametrize("seed", [0, 2, 4])
def test_sense_of_an_unsigned_tach_is_found(simulated: Callable[..., Simulation], seed: int) -> None:
    run = simulated("shunting-unsigned", seed=seed, duration_s=240.0)
    assert (run.truth["speed_mps"] < -1.0).any()
    wheel = read_wheel(run.recording, MAX_GAP_S)
    assert wheel is not None
    t = run.truth["t_s"].to_numpy()[:-10]
    true = run.truth["chainage_m"].to_numpy()[:-10] - run.truth["chainage_m"].iloc[0]
    rolled = run.recording.tach["distance_m"].iloc[-1]  # type: ignore[index]
    np.testing.assert_allclose(wheel.at(t) * run.wheel_scale, true, atol=0.1 + 1e-3 * rolled)


@pytest.mark.parametrize("name", ["shuttle", "no-stop"])
def test_ten_seconds_at_constant_speed_are_not_taken_for_backwards(
    simulated: Callable[..., Simulation], name: str
) -> None:
    recording = simulated(name, seed=1, duration_s=150.0).recording
    assert recording.tach is not None
    for begin in np.arange(60.0, 140.0, 4.0):
        imu, tach = (table[table["t_s"].between(begin, begin + 10.0)] for table in (recording.imu, recording.tach))
        wheel = read_wheel(replace(recording, imu=imu, tach=tach), MAX_GAP_S)
        assert wheel is not None
        assert wheel.distance[-1] > wheel.distance[0], begin


def test_signed_tach_is_taken_as_it_is(simulated: Callable[..., Simulation]) -> None:
    recording = simulated("shunting", seed=4, duration_s=240.0).recording
    wheel = read_wheel(recording, MAX_GAP_S)
    assert wheel is not None
    assert recording.tach is not None
    np.testing.assert_array_equal(wheel.distance, recording.tach["distance_m"])


def test_run_that_never_reverses_keeps_its_count(simulated: Callable[..., Simulation]) -> None:
    for name in ("mainline", "trolley", "no-stop", "parked"):
        recording = simulated(name, seed=5, duration_s=150.0).recording
        wheel = read_wheel(recording, MAX_GAP_S)
        assert wheel is not None
        assert recording.tach is not None
        np.testing.assert_array_equal(wheel.distance, recording.tach["distance_m"])


def test_the_noise_of_a_speed_at_rest_rolls_nowhere(shunting: Simulation) -> None:
    t = np.arange(0.0, 60.0, 0.05)
    speed = np.where((t > 10.0) & (t < 30.0), 5.0, np.abs(np.random.default_rng(0).normal(0.0, 0.05, len(t))))
    noisy = with_tach(shunting.recording, t, np.cumsum(speed) * 0.05, kind="speed", unit="m/s", signed=True)
    wheel = read_wheel(noisy, MAX_GAP_S)
    assert wheel is not None
    still = wheel.standing(np.array([[0.0, 9.5], [31.0, 60.0]]))
    assert np.ptp(still.at(np.linspace(0.2, 9.3, 50))) < 1e-9
    assert np.ptp(still.at(np.linspace(31.2, 60.0, 50))) < 1e-9
    between = np.array([11.0, 29.0])
    np.testing.assert_allclose(np.diff(still.at(between)), np.diff(wheel.at(between)))
    counted = with_tach(shunting.recording, t, np.cumsum(speed) * 0.05, signed=True)
    of_counts = read_wheel(counted, MAX_GAP_S)
    assert of_counts is not None
    assert of_counts.standing(np.array([[0.0, 9.5]])) is of_counts

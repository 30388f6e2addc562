"""Standstills against the truth of simulated runs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from trackfg.datasets.faults import drop_tach
from trackfg.datasets.scenarios import Simulation
from trackfg.sensors.standstills import find_standstills

MIN_REST_S = 3.0


def true_rests(run: Simulation, duration_s: float) -> np.ndarray:
    """Spans without speed, at least as long as is asked for with a margin at both ends."""
    t = np.arange(0.0, duration_s, 0.01)
    resting = np.abs(run.ride.motion.speed(t)) < 1e-9
    spans = t[np.flatnonzero(np.diff(np.concatenate([[False], resting, [False]]).astype(int))).clip(max=t.size - 1)]
    spans = spans.reshape(-1, 2)
    return spans[spans[:, 1] - spans[:, 0] > MIN_REST_S + 4.0]


@pytest.mark.parametrize(
    ("name", "duration_s"),
    [
        ("mainline", 400.0),
        ("trolley", 100.0),
        ("shunting", 200.0),
        ("shunting-unsigned", 200.0),
        ("mainline-gnss", 400.0),
    ],
)
@pytest.mark.parametrize("seed", range(2))
def test_every_stop_is_found_within_2_s(
    simulated: Callable[..., Simulation], name: str, duration_s: float, seed: int
) -> None:
    run = simulated(name, seed=seed, duration_s=duration_s)
    found, truth = find_standstills(run.recording, MIN_REST_S), true_rests(run, duration_s)
    assert len(truth) >= 1
    for start, end in truth:
        best = found[np.argmin(np.abs(found - [start, end]).max(axis=1))]
        np.testing.assert_allclose(best, [start, end], atol=2.0)


@pytest.mark.parametrize("name", ["mainline", "trolley", "shunting", "shunting-unsigned"])
def test_nothing_that_moves_is_called_at_rest(simulated: Callable[..., Simulation], name: str) -> None:
    run = simulated(name, seed=1, duration_s=200.0)
    for start, end in find_standstills(run.recording, MIN_REST_S):
        moved = np.ptp(run.ride.motion.path(np.linspace(start, end, 200)))
        assert moved < 1e-3


def test_run_without_a_stop_has_none(simulated: Callable[..., Simulation]) -> None:
    assert find_standstills(simulated("no-stop", seed=0, duration_s=200.0).recording, MIN_REST_S).shape == (0, 2)


def test_parked_run_is_one_standstill(simulated: Callable[..., Simulation]) -> None:
    recording = simulated("parked", seed=0, duration_s=100.0).recording
    for one in (recording, replace(recording, tach=None)):
        np.testing.assert_allclose(find_standstills(one, MIN_REST_S), [[0.0, 100.0]], atol=2.0)


@pytest.mark.parametrize("seed", range(2))
def test_silent_tach_on_a_moving_vehicle_is_no_standstill(simulated: Callable[..., Simulation], seed: int) -> None:
    """A broken cable: the count stays where it is while the train runs on through curves."""
    run = simulated("mainline", seed=seed, duration_s=200.0)
    assert run.recording.tach is not None
    tach = run.recording.tach.copy()
    dead = tach["t_s"] > 70.0
    tach.loc[dead, "distance_m"] = tach.loc[~dead, "distance_m"].iloc[-1]
    for start, end in find_standstills(replace(run.recording, tach=tach), MIN_REST_S):
        assert np.ptp(run.ride.motion.path(np.linspace(start, end, 200))) < 0.1


@pytest.mark.parametrize("known", [(0.0, 60.0), (80.0, 120.0)])
def test_where_a_tach_has_no_rows_nobody_knows(
    simulated: Callable[..., Simulation], known: tuple[float, float]
) -> None:
    """At walking pace on smooth track, which is as quiet as a rest."""
    run = simulated("trolley", seed=0, duration_s=120.0)
    assert run.recording.tach is not None
    tach = run.recording.tach[run.recording.tach["t_s"].between(*known)].reset_index(drop=True)
    for start, end in find_standstills(replace(run.recording, tach=tach), MIN_REST_S):
        assert np.ptp(run.ride.motion.path(np.linspace(start, end, 200))) < 1e-3


@pytest.mark.parametrize("seed", range(4))
def test_without_a_tach_gnss_must_have_seen_the_rest(simulated: Callable[..., Simulation], seed: int) -> None:
    """On a smooth straight at constant speed the inertial sensor is as quiet as at rest."""
    run = simulated("mainline-gnss", seed=seed, duration_s=200.0)
    found = find_standstills(replace(run.recording, tach=None), MIN_REST_S)
    np.testing.assert_allclose(found, true_rests(run, 200.0), atol=2.0)


@pytest.mark.parametrize(("sd_m", "found"), [(2.0, False), (0.02, True)])
def test_without_a_tach_positions_must_distinguish_a_crawl_from_a_rest(
    simulated: Callable[..., Simulation], sd_m: float, found: bool
) -> None:
    """Four positions of 2 m do not show whether a vehicle stood for 3.5 s or went on at walking pace."""
    recording = simulated("mainline-gnss", seed=0, duration_s=30.0).recording
    assert recording.gnss is not None
    imu, seen = (table[table["t_s"] <= 4.0] for table in (recording.imu, recording.gnss))
    seen = seen.assign(east_m=0.0, north_m=0.0, east_sd_m=sd_m, north_sd_m=sd_m)
    rests = find_standstills(replace(recording, imu=imu, gnss=seen, tach=None), MIN_REST_S)
    assert (len(rests) == 1) == found


def test_missing_rows_at_rest_do_not_hide_a_standstill(simulated: Callable[..., Simulation]) -> None:
    run = simulated("mainline", seed=2, duration_s=100.0)
    found = find_standstills(drop_tach(run.recording, 3.0, 20.0), MIN_REST_S)
    np.testing.assert_allclose(found[0], true_rests(run, 100.0)[0], atol=2.0)


def test_shorter_rests_than_asked_for_are_left_out(simulated: Callable[..., Simulation]) -> None:
    recording = simulated("shunting", seed=1, duration_s=200.0).recording
    all_of_them = find_standstills(recording, 3.0)
    length = all_of_them[:, 1] - all_of_them[:, 0]
    limit = float(np.median(length))
    np.testing.assert_array_equal(find_standstills(recording, limit), all_of_them[length >= limit])

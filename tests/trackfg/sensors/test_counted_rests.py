"""Rests through which a tach goes on counting."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from trackfg.datasets.scenarios import Simulation
from trackfg.numerics.arrays import Array
from trackfg.recording.model import Recording
from trackfg.sensors.counted_rests import Pieces, counted_rests
from trackfg.sensors.standstills import counted_standstills, find_standstills
from trackfg.sensors.tach import read_wheel
from trackfg.smoothing.smoother import smooth

CLOCK_SD_S = 0.1


def counting_at_rest(run: Simulation, speed_mps: float) -> Recording:
    """The recording of a tach that counts on, as if the vehicle rolled at ``speed_mps``, where it rests."""
    tach = run.recording.tach
    assert tach is not None
    t = tach["t_s"].to_numpy()
    rests = np.abs(run.ride.motion.speed(t)) < 1e-9
    quantum = np.pi * 0.86 / 90
    counted = np.floor(np.cumsum(rests * speed_mps * np.gradient(t)) / quantum) * quantum
    return replace(run.recording, tach=tach.assign(distance_m=tach["distance_m"] + counted))


@pytest.mark.parametrize("name", ["mainline", "slippery-line", "trolley", "no-stop"])
def test_a_sound_tach_has_none(simulated: Callable[..., Simulation], name: str) -> None:
    recording = simulated(name, seed=0, duration_s=200.0).recording
    for spans in counted_standstills(recording, find_standstills(recording), CLOCK_SD_S):
        assert len(spans) == 0


def test_a_run_without_a_tach_has_none(simulated: Callable[..., Simulation]) -> None:
    recording = simulated("mainline-gnss", seed=0, duration_s=60.0).recording
    assert [len(of) for of in counted_standstills(replace(recording, tach=None), np.zeros((0, 2)), CLOCK_SD_S)] == [
        0,
        0,
    ]


@pytest.mark.parametrize("speed_mps", [0.5, 5.0])
def test_the_vehicle_rests_though_its_tach_counts(simulated: Callable[..., Simulation], speed_mps: float) -> None:
    run = simulated("slippery-line", seed=1, duration_s=300.0)
    known = find_standstills(run.recording)
    recording = counting_at_rest(run, speed_mps)
    lost = find_standstills(recording)
    found, _ = counted_standstills(recording, lost, CLOCK_SD_S)
    assert len(lost) < len(known)
    for span in found:
        assert np.ptp(run.ride.motion.path(np.linspace(*span, 100))) < 1e-3
    assert np.diff(found, axis=1).sum() > 0.7 * np.diff(known, axis=1).sum()


def test_speed_and_chainage_hold_though_the_tach_counts_at_rest(simulated: Callable[..., Simulation]) -> None:
    run = simulated("slippery-line", seed=1, duration_s=300.0)
    rows = smooth(counting_at_rest(run, 0.5)).trajectory
    error = rows["speed_mps"] - run.ride.motion.speed(rows["t_s"].to_numpy())
    assert (np.abs(error) > 4.0 * rows["speed_mps_sd"]).mean() < 0.02


def ride(speed_mps: float, shown_mps: float, *, rough_m: float = 2e-3) -> tuple[Pieces, Array]:
    """A vehicle that brakes to ``speed_mps``, and stays as fast for 20 s, while its tach shows ``shown_mps`` more then;
    and that span. The track rises and cants by ``rough_m`` on waves of 20 m.
    """
    rng, step = np.random.default_rng(1), 0.1
    t = np.arange(0.0, 200.0, step)
    speed = np.interp(t, [0.0, 150.0, 170.0, 190.0, 200.0], [15.0, 15.0, speed_mps, speed_mps, 6.0 + speed_mps])
    place, span = np.cumsum(speed) * step, np.array([172.0, 188.0])
    angle = 2.0 * np.pi * rough_m / 20.0 * np.sin(2.0 * np.pi * place / 20.0)
    rate, force = rng.normal(0.0, 3e-4, (len(t), 3)), rng.normal(0.0, 6e-3, (len(t), 3))
    rate[:, :2] += np.gradient(angle, step)[:, None]
    force += np.column_stack([np.gradient(speed, step) - 9.8 * angle, 9.8 * angle, np.full_like(t, 9.8)])
    counts = (t > 170.0) & (t < 190.0)
    rolled = np.append(0.0, np.cumsum(speed + shown_mps * counts) * step)
    return Pieces(np.append(t, 200.0), rate, force, rolled), span[None, :]


@pytest.mark.parametrize(
    ("speed_mps", "shown_mps", "rests", "doubtful"),
    [(0.0, 1.0, True, False), (1.0, 0.0, False, False), (0.0, 0.01, False, True), (0.01, 0.0, False, True)],
)
def test_what_the_accelerometer_shows_decides(
    speed_mps: float, shown_mps: float, *, rests: bool, doubtful: bool
) -> None:
    counted = counted_rests(*ride(speed_mps, shown_mps), CLOCK_SD_S)
    assert (counted.rests.tolist(), counted.doubtful.tolist()) == ([rests], [doubtful])


def test_a_doubtful_distance_may_be_wrong_by_all_of_itself(simulated: Callable[..., Simulation]) -> None:
    recording = simulated("mainline", seed=0, duration_s=60.0).recording
    wheel = read_wheel(recording, 0.3)
    assert wheel is not None
    span = np.array([40.0, 50.0])
    rolled = float(np.diff(wheel.at(span))[0])
    gained = wheel.with_doubtful(span[None, :]).variance_gained(np.arange(35.0, 56.0), 0.0)
    assert rolled > 1.0
    np.testing.assert_allclose(gained.sum(), rolled**2)
    np.testing.assert_allclose(gained[[0, 6]], [0.0, rolled**2 / 10.0])

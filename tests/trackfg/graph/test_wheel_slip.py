"""Where the wheel rolls, before there is a graph: slips of any length and size, and none where there are none."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from trackfg.config import SmoothConfig
from trackfg.datasets import slip_wheel
from trackfg.datasets.catalogue import scenario
from trackfg.datasets.effects.inertial import LowCost
from trackfg.datasets.effects.mounting import Tilt
from trackfg.datasets.effects.vibration import Vibration
from trackfg.datasets.line.built_in_lines import YARD
from trackfg.datasets.scenarios import Simulation, simulate
from trackfg.datasets.vehicle.adhesion import WheelSlip
from trackfg.graph.wheel_slip import Rolling, rolling
from trackfg.numerics.units import STANDARD_GRAVITY
from trackfg.recording.model import Recording
from trackfg.sensors.dead_reckoning import initial_path
from trackfg.sensors.imu_intervals import intervals
from trackfg.sensors.imu_noise.noise_floor import NoiseFloor
from trackfg.sensors.standstills import find_standstills
from trackfg.sensors.tach import Wheel, read_wheel

MAX_GAP_S = 5.0


def found_in(recording: Recording) -> tuple[Rolling, Wheel]:
    data, wheel, rests = intervals(recording), read_wheel(recording, MAX_GAP_S), find_standstills(recording)
    assert wheel is not None
    path = initial_path(recording, data, wheel, rests, np.zeros(3), 0.0)
    return rolling(wheel, data, NoiseFloor.of(data), path, rests, STANDARD_GRAVITY, SmoothConfig()), wheel


@pytest.mark.parametrize("name", ["mainline", "trolley", "shunting-unsigned", "measuring-car", "no-stop"])
def test_a_wheel_that_rolls_is_left_alone(simulated_in_full: Callable[..., Simulation], name: str) -> None:
    run = simulated_in_full(name, seed=1, duration_s=150.0)
    found, wheel = found_in(run.recording)
    assert found.rolls.all()
    np.testing.assert_array_equal(found.wheel.distance, wheel.distance)


@pytest.mark.parametrize(
    ("start", "duration", "creep"),
    [(70.0, 5.0, -1.0), (70.0, 20.0, -1.0), (60.0, 30.0, 0.6), (40.0, 20.0, 0.3), (75.0, 3.0, 0.1), (80.0, 10.0, -0.1)],
)
def test_slips_are_found_and_the_speed_goes_on(
    simulated_in_full: Callable[..., Simulation], start: float, duration: float, creep: float
) -> None:
    run = slip_wheel(simulated_in_full("mainline", seed=2, duration_s=150.0), [WheelSlip(start, duration, creep)])
    found, _ = found_in(run.recording)
    middle = 0.5 * (found.t[1:] + found.t[:-1])
    within = (middle > start + 0.5) & (middle < start + duration - 0.5)
    beside = (middle < start - 0.5) | (middle > start + duration + 0.5)
    assert not found.rolls[within].any()
    assert found.rolls[beside].mean() > 0.95
    true = np.interp(found.t, run.truth["t_s"], run.truth["speed_mps"])
    assert np.abs(found.speed - true).max() < max(0.5, 0.03 * duration)
    # The mended wheel has rolled as far as the vehicle went, to its scale.
    gone = np.interp([140.0, 35.0], run.truth["t_s"], run.truth["chainage_m"])
    rolled = found.wheel.at(np.array([140.0, 35.0]))
    assert rolled[0] - rolled[1] == pytest.approx(gone[0] - gone[1], rel=0.015)


def test_intervals_that_touch_a_slip() -> None:
    t = np.arange(0.0, 5.0, 0.5)
    rolls = np.ones(9, dtype=bool)
    rolls[4] = False  # from 2.0 to 2.5 s
    wheel = Wheel(t, t, 1e-4, 0.0, False, np.zeros((0, 2)))
    found = Rolling(t, np.ones(10), rolls, wheel)
    assert found.slips_within(np.array([0.0, 1.0, 1.9, 2.2, 2.4, 2.6, 4.0])).tolist() == [
        False,
        False,
        True,
        True,
        True,
        False,
    ]


def test_a_mended_wheel_goes_by_the_speed_where_it_did_not_roll() -> None:
    t = np.arange(0.0, 10.01, 0.1)
    wheel = Wheel(t, 2.0 * t, 1e-3, 1e-3, False, np.zeros((0, 2)))
    grid = np.arange(0.0, 10.01, 0.5)
    middle = 0.5 * (grid[1:] + grid[:-1])
    rolls = (middle < 4.0) | (middle > 6.0)
    mended = wheel.with_speed(grid, np.full(grid.size, 1.0), rolls)
    expected = np.interp(t, [0.0, 4.0, 6.0, 10.0], [0.0, 8.0, 10.0, 18.0])
    np.testing.assert_allclose(mended.at(t), expected, atol=1e-9)


@pytest.mark.parametrize("seed", [1, 2])
def test_a_sensor_of_a_few_euros_in_sharp_curves_shows_no_slip(seed: int) -> None:
    line = replace(YARD, radius_m=(40.0, 120.0), straight_m=(20.0, 100.0), max_turn_rad=2.0, transition_min_m=10.0)
    run = simulate(
        replace(scenario("mainline"), line=line, balises=None, effects=(LowCost(0.5), Tilt(3.0), Vibration(0.5))),
        seed=seed,
        duration_s=150.0,
    )
    found, wheel = found_in(run.recording)
    assert found.rolls.mean() > 0.95
    assert found.wheel.distance[-1] == pytest.approx(wheel.distance[-1], rel=0.01)


def test_a_force_that_is_measured_wrongly_throughout_is_no_slip(simulated_in_full: Callable[..., Simulation]) -> None:
    recording = simulated_in_full("mainline", seed=2, duration_s=150.0).recording
    t = recording.imu["t_s"].to_numpy()
    shown = recording.imu.assign(fx_mps2=recording.imu["fx_mps2"] + 2.0 * np.sin(2.0 * np.pi * t / 40.0))
    found, wheel = found_in(replace(recording, imu=shown))
    assert found.rolls.all()
    np.testing.assert_array_equal(found.wheel.distance, wheel.distance)
    np.testing.assert_array_equal(found.speed, wheel.rate(found.t))

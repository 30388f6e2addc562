"""The offset of an accelerometer's clock against the gyro's, from what both show of a rigid vehicle."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from trackfg.datasets.effects.clocks import LateAccelerometer
from trackfg.datasets.scenarios import Simulation, scenario, simulate
from trackfg.recording.model import IMU_COLUMNS, Recording
from trackfg.sensors.imu_filters.accelerometer_clock import accelerometer_clock

from ....datasets.conftest import at_50_hz


def ride(
    template: Recording, late_s: float, *, seed: int = 0, ahead_m: float = 0.0, turns: float = 1.0, heaves: float = 0.0
) -> Recording:
    """A ride over waves, with noise; the sensor is ``ahead_m`` ahead, its force stamped ``late_s`` late.

    Written without trackfg: the speed is 15 + 8 sin(t / 25), a level of waves of 6 to 40 m gives the pitch. A body that
    ``heaves`` has as much force of its own, m/s^2, besides; ``turns`` times the gyro's rate is measured.
    """
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, 240.0, 0.01)

    def speed_at(t: np.ndarray) -> np.ndarray:
        return 15.0 + 8.0 * np.sin(t / 25.0)

    def place(t: np.ndarray) -> np.ndarray:
        return 15.0 * t - 200.0 * np.cos(t / 25.0)

    lengths, phases = np.linspace(6.0, 40.0, 30), rng.uniform(0.0, 2.0 * np.pi, 30)

    def pitch_rate(t: np.ndarray) -> np.ndarray:
        k = 2.0 * np.pi / lengths
        waves = 2e-3 * k**2 * np.sin(k * place(t)[:, None] + phases)
        return np.asarray(waves.sum(axis=1) * speed_at(t))

    def force(t: np.ndarray) -> np.ndarray:
        change = (pitch_rate(t + 1e-4) - pitch_rate(t - 1e-4)) / 2e-4
        swaying = heaves * np.sin(2.0 * np.pi * 1.1 * t)
        return np.asarray(9.8 - speed_at(t) * pitch_rate(t) - ahead_m * change + swaying)

    imu = pd.DataFrame(0.0, index=range(len(t)), columns=list(IMU_COLUMNS)).assign(
        t_s=t,
        wx_radps=2e-4 * rng.standard_normal(len(t)),
        wy_radps=turns * pitch_rate(t) + 2e-4 * rng.standard_normal(len(t)),
        fz_mps2=force(t - late_s) + 0.02 * rng.standard_normal(len(t)),
    )
    return replace(template, imu=imu, tach=pd.DataFrame({"t_s": t, "distance_m": place(t) - place(t[:1])}))


@pytest.fixture(scope="module")
def template() -> Recording:
    return simulate(at_50_hz(scenario("mainline")), duration_s=5.0).recording


@pytest.mark.parametrize("late_s", [0.0, 0.002, 0.02, 0.1, -0.05])
@pytest.mark.parametrize("ahead_m", [0.0, 1.5])
def test_the_offset_is_found_with_its_sigma_wherever_the_sensor_is(
    late_s: float, ahead_m: float, template: Recording
) -> None:
    found = [accelerometer_clock(ride(template, late_s, seed=seed, ahead_m=ahead_m)) for seed in range(10)]
    clocks = [clock for clock in found if clock is not None]
    assert len(clocks) == len(found)
    errors, sds = np.array([(clock.offset_s + late_s, clock.sd_s) for clock in clocks]).T
    assert sds.max() < 5e-4
    assert np.abs(errors).max() < 5e-4
    assert ahead_m or np.sqrt(np.mean(np.square(errors / sds))) < 1.6
    assert all(clock.is_sure == (late_s != 0.0) for clock in clocks)


@pytest.mark.parametrize("turns", [0.5, -1.0])
def test_it_does_not_depend_on_scales(turns: float, template: Recording) -> None:
    found = accelerometer_clock(ride(template, 0.02, turns=turns))
    assert found is not None
    assert found.offset_s == pytest.approx(-0.02, abs=1e-3)


def test_a_body_on_springs_has_no_offset(template: Recording) -> None:
    assert accelerometer_clock(ride(template, 0.02, heaves=3.0)) is None


def test_without_motion_or_tach_there_is_none(template: Recording) -> None:
    recording = ride(template, 0.02)
    assert recording.tach is not None
    assert accelerometer_clock(replace(recording, tach=None)) is None
    assert accelerometer_clock(replace(recording, tach=recording.tach.assign(distance_m=0.0))) is None
    assert accelerometer_clock(replace(recording, imu=recording.imu[:300])) is None


@pytest.mark.parametrize("name", ["mainline", "shunting-unsigned", "no-stop", "measuring-car", "slippery-line"])
def test_scenarios_have_clocks_of_one_time(name: str, simulated_in_full: Callable[..., Simulation]) -> None:
    found = accelerometer_clock(simulated_in_full(name, seed=1, duration_s=300.0).recording)
    assert (found is None) == (name in ("measuring-car", "slippery-line"))
    assert found is None or not found.is_sure


def test_a_unit_that_counts_both_ways_is_understood() -> None:
    plan = replace(scenario("shunting-unsigned"), effects=(LateAccelerometer(20.0),))
    found = accelerometer_clock(simulate(plan, seed=1, duration_s=300.0).recording)
    assert found is not None
    assert found.offset_s == pytest.approx(-0.02, abs=1e-3)
    assert "20." in found.sentence or "19." in found.sentence

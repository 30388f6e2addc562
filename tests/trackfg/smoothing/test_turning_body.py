"""How much of what a body on springs moves sideways is its turning against its path."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from trackfg.config import SmoothConfig
from trackfg.datasets.effects.mounting import RoughTrack
from trackfg.datasets.scenarios import Simulation, scenario, simulate
from trackfg.factors.factor_type import FactorType
from trackfg.numerics.arrays import Array
from trackfg.recording.model import Recording
from trackfg.smoothing.smoother import smooth_states


def growth_kept(recording: Recording) -> Array:
    """Return which share of the declared growth with speed sideways and vertical sigmas have in the end, (2,)."""
    smoothed = smooth_states(recording, SmoothConfig())
    growths = [graph.family(FactorType.NON_HOLONOMIC) for graph in (smoothed.problem, smoothed.declared)]
    found, declared = (family.data["growth"] for family in growths if family is not None)
    kept = found / declared
    assert np.ptp(kept, axis=0) == pytest.approx([0.0, 0.0], abs=1e-9)
    return kept[0]


@pytest.fixture(scope="module")
def coach() -> Simulation:
    """A coach on rough track, at 50 Hz, without positions."""
    plan = scenario("mainline")
    plan = replace(plan, imu=replace(plan.imu, rate_hz=50.0), balises=None, effects=(RoughTrack(6.0),))
    return simulate(plan, seed=3, duration_s=300.0)


def test_a_coach_on_rough_track_turns(coach: Simulation) -> None:
    assert (growth_kept(coach.recording) > 0.7).all()


def test_a_body_that_bounces_does_not_turn(coach: Simulation) -> None:
    """It bounces by 0.15 m/s in irregular bursts, at 1.1 to 1.5 Hz."""
    imu = coach.recording.imu
    t, moves = imu["t_s"].to_numpy(), coach.truth["speed_mps"].to_numpy() > 2.0
    envelope = np.interp(t, coach.truth["t_s"], moves.astype(float))
    phase = 2.0 * np.pi * np.cumsum(np.interp(t, np.arange(0.0, 301.0, 7.0), np.tile([1.1, 1.5], 22)[:43])) * 0.02
    bounce = np.gradient(0.2 * envelope * np.sin(phase), t)
    recording = replace(coach.recording, imu=imu.assign(fz_mps2=imu["fz_mps2"] + bounce))
    sideways, upwards = growth_kept(recording)
    assert upwards < 0.4
    assert sideways > 0.7


def test_a_sensor_that_follows_the_track_has_what_is_declared() -> None:
    recording = simulate("mainline", seed=3, duration_s=60.0).recording
    np.testing.assert_array_equal(growth_kept(recording), 1.0)

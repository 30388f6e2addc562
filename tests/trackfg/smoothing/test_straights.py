"""Roll on straights: a tilted sensor shows there, and roll and cross-level say that they do not know it from cant."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from trackfg.config import SmoothConfig
from trackfg.datasets.scenarios import Simulation
from trackfg.numerics.rotations import matrix_from_rpy
from trackfg.recording.model import Recording
from trackfg.smoothing.passage import STEP_M, Passage
from trackfg.smoothing.smoother import SmoothedStates, smooth_states
from trackfg.smoothing.straights import (
    UNSEEN,
    MeanRoll,
    roll_at_no_curvature,
    roll_of_mounting_sd,
    straight,
    straightest,
    unexplained_roll,
)

TOTAL_S = 150.0


def tilted(recording: Recording, roll_deg: float, pitch_deg: float = 0.0) -> Recording:
    """Return what the sensor would record if it were tilted to the left and forwards by so much, undeclared."""
    R_vs = matrix_from_rpy(np.radians(roll_deg), np.radians(pitch_deg), np.array(0.0))
    imu = recording.imu.copy()
    for triad in (imu.columns[1:4], imu.columns[4:7]):
        imu[triad] = imu[triad].to_numpy() @ R_vs
    return replace(recording, imu=imu)


def test_a_straight_ends_a_base_before_the_curve() -> None:
    """1000 m, a curve of R 500 from 400 to 600 m: the chord of 50 m sees it from 380 to 620 m, and another base of 50 m
    is left on each side, and at both ends of the run the chord and the base.
    """
    s = np.arange(0.0, 1000.0, 10.0)
    found = s[straight(np.clip(s - 400.0, 0.0, 200.0) / 500.0, straightest(np.array(20.0)))]
    assert found.min() == 70.0
    assert found[found < 500.0].max() == pytest.approx(330.0, abs=10.0)
    assert found[found > 500.0].min() == pytest.approx(670.0, abs=10.0)
    assert found.max() == 920.0


def test_a_wide_curve_is_straight_for_a_slow_line_alone() -> None:
    """R 8000 needs no cant at 40 m/s, and 130 mm at 83 m/s."""
    heading = np.arange(0.0, 1000.0, 10.0) / 8000.0
    assert straight(heading, straightest(np.array(40.0))).any()
    assert not straight(heading, straightest(np.array(83.0))).any()


@pytest.mark.parametrize("roll_deg", [2.0, -1.0])
def test_a_tilt_is_in_the_sigma_of_roll_and_is_said(simulated: Callable[..., Simulation], roll_deg: float) -> None:
    run = simulated("mainline", seed=0, duration_s=TOTAL_S)
    result = smooth_states(tilted(run.recording, roll_deg), SmoothConfig())
    error = result.trajectory["roll_rad"] - run.ride.rpy(result.trajectory["t_s"].to_numpy())[:, 0]
    assert np.sqrt(np.mean((error / result.trajectory["roll_rad_sd"]) ** 2)) == pytest.approx(1.0, abs=0.1)
    cross_level_sd = 1e-3 * result.geometry["cross_level_mm_sd"] / result.problem.run.conventions.cross_level_base_m
    assert cross_level_sd.median() == pytest.approx(np.radians(abs(roll_deg)), rel=0.1)
    assert result.geometry["twist_mm_sd"].median() < 0.1
    (finding,) = (one for one in result.findings if one.code == "roll-on-straights")
    assert f"the {'left' if roll_deg > 0 else 'right'} side is" in finding.message
    assert f"add {roll_deg:.0f}." in str(finding) or f"add {np.trunc(0.95 * roll_deg):.0f}." in str(finding)


def test_an_upright_sensor_keeps_its_sigma(
    simulated: Callable[..., Simulation], smoothed: Callable[..., SmoothedStates]
) -> None:
    result = smoothed("mainline", seed=0, duration_s=TOTAL_S)
    assert result.trajectory["roll_rad_sd"].median() < 1e-3
    assert not [one for one in result.findings if one.code == "roll-on-straights"]


def test_a_tilt_shows_in_curves_of_both_ways(simulated: Callable[..., Simulation]) -> None:
    """A yard has no long straight."""
    result = smooth_states(tilted(simulated("shunting", seed=0, duration_s=240.0).recording, 2.0), SmoothConfig())
    assert result.problem.run.mount_roll_sd == pytest.approx(np.radians(2.0), rel=0.1)


def two_left_curves(tilt: float, cant: float) -> Passage:
    """Two curves of R 300 to the left, 200 m and 240 m long, between straights of 60 m, with ramps of 50 m."""
    way = np.arange(0.0, 620.0, STEP_M)
    ramp = np.interp(way, [60, 110, 210, 260, 320, 370, 510, 560], [0, 1, 1, 0, 0, 1, 1, 0])
    heading = np.cumsum(ramp) * STEP_M / 300.0
    return Passage(heading, tilt + cant * ramp, np.full(len(way), 0.002**2), np.full(len(way), 10.0))


@pytest.mark.parametrize("tilt", [0.08, -0.08])
def test_a_tilt_shows_in_curves_of_one_way(tilt: float) -> None:
    seen = roll_at_no_curvature(two_left_curves(tilt, cant=0.0))
    assert seen.roll == pytest.approx(tilt, abs=0.005)
    assert unexplained_roll(seen.roll, seen.own + seen.besides) == pytest.approx(0.08, rel=0.1)


def test_cant_of_an_upright_vehicle_is_no_tilt_in_curves_of_one_way() -> None:
    seen = roll_at_no_curvature(two_left_curves(0.0, cant=-0.04))
    assert unexplained_roll(seen.roll, seen.own + seen.besides) == 0.0


def test_no_tilt_shows_within_one_curve() -> None:
    """Its curvature is the same all the way: roll and cant cannot be separated."""
    way = np.arange(0.0, 400.0, STEP_M)
    within = Passage(way / 300.0, np.full(len(way), 0.08), np.full(len(way), 0.002**2), np.full(len(way), 10.0))
    assert roll_at_no_curvature(within) == UNSEEN


def test_pitch_and_yaw_of_the_mounting_count_where_the_way_shows_nothing_of_its_roll() -> None:
    """On straights the mean roll is the tilt, whatever else is tilted; of 10 mrad the sigma of roll explains 6."""
    for tilt in (0.0, 0.05):
        assert roll_of_mounting_sd(MeanRoll(0.010, 0.006**2, 0.0), tilt) == pytest.approx(0.008)
        assert roll_of_mounting_sd(UNSEEN, tilt) == pytest.approx(tilt)
        assert roll_of_mounting_sd(MeanRoll(0.0, 0.006**2, 1e6), tilt) == pytest.approx(tilt, rel=1e-3)


def test_of_many_tilted_mountings_the_sigma_of_roll_covers_the_errors() -> None:
    """The reported roll errs by its own error and by the tilt; the mean shows both, and cant besides. The larger of two
    prior variances is wide by a third on average.
    """
    rng = np.random.default_rng(3)
    tilt, own, cant = rng.standard_normal((3, 4000)) * np.array([[0.03], [0.01], [0.02]])
    seen = [MeanRoll(roll, 0.01**2, 0.02**2) for roll in tilt + own + cant]
    added = [roll_of_mounting_sd(one, 0.03) for one in seen]
    variance = np.mean(np.square(added)) + 0.01**2
    assert 0.7 < np.mean((tilt + own) ** 2) / variance < 1.0


def test_a_sensor_that_nobody_levelled_may_be_tilted_sideways_too(simulated: Callable[..., Simulation]) -> None:
    """Of a way of 100 m nothing is averaged: pitch and yaw of the mounting show in it, and roll does not."""
    run = simulated("shunting", seed=0, duration_s=60.0)
    result = smooth_states(tilted(run.recording, 3.0, pitch_deg=3.0), SmoothConfig())
    error = result.trajectory["roll_rad"] - run.ride.rpy(result.trajectory["t_s"].to_numpy())[:, 0]
    assert np.sqrt(np.mean((error / result.trajectory["roll_rad_sd"]) ** 2)) < 2.0
    (finding,) = (one for one in result.findings if one.code == "mount-roll-unknown")
    assert "pitch and yaw of the sensor's mounting are off by 2." in finding.message

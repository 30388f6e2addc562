"""A receiver's speeds in the graph: which rows are used, exactly as they should be, and consistent."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from trackfg.config import SmoothConfig, SolverConfig
from trackfg.datasets.scenarios import Simulation, scenario, simulate
from trackfg.datasets.sensors.receiver_speeds import ReceiverSpeeds
from trackfg.datasets.vehicle.vehicle import Rigid
from trackfg.factors.factor_type import FactorType
from trackfg.factors.states import Kind
from trackfg.graph.build import build_problem
from trackfg.numerics.spans import within
from trackfg.recording.model import GNSS_SPEED_TABLE, IMU_COLUMNS, Recording
from trackfg.results.result import Result
from trackfg.smoothing.smoother import smooth, smooth_states

ANTENNA_M = (2.0, 0.5, 3.0)


@cache
def simulated(duration_s: float, *, delay_s: float = 0.0) -> Simulation:
    """A run with GNSS whose receiver measures its speed, too."""
    plan = scenario("mainline-gnss")
    assert plan.gnss is not None
    speeds = ReceiverSpeeds(antenna_m=ANTENNA_M, delay_s=delay_s)
    plan = replace(plan, gnss=replace(plan.gnss, antenna_m=ANTENNA_M), further_sensors=(speeds,))
    return simulate(plan, seed=2, duration_s=duration_s)


def without_tach(recording: Recording) -> Recording:
    return replace(recording, tach=None, description=recording.description.model_copy(update={"tach": None}))


def test_without_noise_the_factors_hold_at_the_truth() -> None:
    """But for what noise would add on average, s^2 / 2u."""
    plan = scenario("mainline-gnss")
    speeds = ReceiverSpeeds(antenna_m=ANTENNA_M)
    assert plan.gnss is not None
    receiver = replace(plan.gnss, antenna_m=ANTENNA_M)
    plan = replace(plan, irregularities=None, vehicle=Rigid(), gnss=receiver, further_sensors=(speeds,))
    run = simulate(plan, seed=2, duration_s=120.0, noise=False)
    problem = build_problem(run.recording, SmoothConfig())
    family = problem.family(FactorType.GNSS_SPEED)
    assert family is not None
    family = family.with_data(declared=np.full_like(family.data["declared"], 1e-9))
    R = run.ride.rotation(problem.t)
    swing = np.cross(run.ride.body_rate(problem.t), problem.run.lever_arm)
    nav = replace(problem.initial.nav, R=R, v=run.ride.velocity(problem.t) + np.einsum("nij,nj->ni", R, swing))
    assert len(family) > 50
    assert np.abs(family.residual(replace(problem.initial, nav=nav))).max() < 2e-3


def test_rows_at_rest_and_slow_ones_are_left_out() -> None:
    run = simulated(120.0)
    table = run.recording.others[GNSS_SPEED_TABLE]
    held = table.assign(speed_mps=table["speed_mps"].where(~table["t_s"].between(60.0, 70.5), 0.0))
    problem = build_problem(replace(run.recording, others={GNSS_SPEED_TABLE: held}), SmoothConfig())
    family = problem.family(FactorType.GNSS_SPEED)
    assert family is not None
    stamps = problem.t[family.slots[0].index] + family.data["delay"][:, 0]
    assert len(problem.rests)
    assert not within(stamps, problem.rests).any()
    assert not ((stamps > 59.9) & (stamps < 70.6)).any()
    moving = held[~within(held["t_s"].to_numpy(), problem.rests)]
    assert len(family) == np.count_nonzero(moving["speed_mps"] > 0.5)
    assert family.data["speed"].min() > 0.5


def test_a_receiver_that_is_quieter_near_rest_than_it_declares_has_no_offset() -> None:
    """Creeping at 0.2 m/s for two minutes, it errs by 0.02 m/s where it declares 0.1."""
    run = simulated(300.0)
    table = run.recording.others[GNSS_SPEED_TABLE]
    truth = np.interp(table["t_s"], run.truth["t_s"], run.truth["speed_mps"])
    quiet = np.abs(truth + 0.02 * np.random.default_rng(1).standard_normal(len(table)))
    slow = table.assign(speed_mps=np.where(truth < 0.5, quiet, table["speed_mps"]))
    smoothed = smooth_states(replace(run.recording, others={GNSS_SPEED_TABLE: slow}), SmoothConfig())
    assert abs(smoothed.solution.states.sensor[0, 0]) < 0.006


def test_the_age_of_the_speeds_is_found_beside_that_of_the_positions() -> None:
    run = simulated(180.0, delay_s=0.2)
    for recording in (run.recording, without_tach(run.recording)):
        smoothed = smooth_states(recording, SmoothConfig())
        states, covariance = smoothed.solution.states, smoothed.covariance
        off, sd = states.sensor[0], np.sqrt(np.diag(covariance.of(Kind.SENSOR)[0]))
        assert abs(off[1] + 0.2) < 3.0 * sd[1] < 0.1
        assert abs(off[0]) < 3.0 * sd[0]
        assert abs(states.clock[0, 2]) < 3.0 * np.sqrt(covariance.of(Kind.CLOCK)[0, 2, 2])
        speed = np.interp(smoothed.trajectory["t_s"], run.truth["t_s"], run.truth["speed_mps"])
        error = (smoothed.trajectory["speed_mps"] - speed) / smoothed.trajectory["speed_mps_sd"]
        assert np.sqrt(np.mean(error**2)) < 1.5


def test_the_summary_has_the_offset_and_the_age_of_the_speeds(tmp_path: Path) -> None:
    run = simulated(180.0, delay_s=0.2)
    table = run.recording.others[GNSS_SPEED_TABLE]
    late = replace(run.recording, others={GNSS_SPEED_TABLE: table.assign(t_s=table["t_s"] + 0.6)})
    result = smooth(late)
    page = Result.read(result.write(tmp_path / "out")).summary
    assert page.gnss_speed_offset_mps is not None
    assert page.gnss_speed_clock_offset_s is not None
    assert page.gnss_speed_offset_mps.sd is not None
    assert abs(page.gnss_speed_offset_mps.value) < 3.0 * page.gnss_speed_offset_mps.sd
    assert page.gnss_speed_clock_offset_s.value == pytest.approx(-0.8, abs=0.05)  # stamps that were moved included
    assert not page.further_scales  # an offset is no scale
    assert smooth(replace(late, others={})).summary.gnss_speed_offset_mps is None


def test_speeds_hold_a_run_together_where_positions_end() -> None:
    """Without a wheel nothing else does: over 200 s the accelerometer's bias alone makes hundreds of metres."""
    run = simulated(300.0)
    recording = without_tach(run.recording)
    assert recording.gnss is not None
    recording = replace(recording, gnss=recording.gnss[recording.gnss["t_s"] < 100.0])
    end = smooth_states(recording, SmoothConfig()).trajectory.iloc[-1]
    truth = run.truth.iloc[(run.truth["t_s"] - end["t_s"]).abs().argmin()]
    error = np.hypot(end["east_m"] - truth["east_m"], end["north_m"] - truth["north_m"])
    assert error < 3.0 * np.hypot(end["east_m_sd"], end["north_m_sd"])
    assert error < 15.0


def test_speeds_that_are_worse_than_declared_get_less_weight() -> None:
    run = simulated(300.0)
    table, rng = run.recording.others[GNSS_SPEED_TABLE], np.random.default_rng(1)
    noise = np.where(table["t_s"].between(100.0, 200.0), 1.0, 0.0) * rng.standard_normal(len(table))
    worse = table.assign(speed_mps=np.abs(table["speed_mps"] + noise))
    smoothed = smooth_states(replace(run.recording, others={GNSS_SPEED_TABLE: worse}), SmoothConfig())
    family = smoothed.problem.family(FactorType.GNSS_SPEED)
    assert family is not None
    t = smoothed.problem.t[family.slots[0].index]
    widened = family.sigma[:, 0] / family.data["declared"][:, 0]
    inside = (t > 110.0) & (t < 190.0)
    assert np.median(widened[inside]) > 5.0
    assert np.median(widened[(t < 80.0) | (t > 220.0)]) < 2.0
    (finding,) = (one for one in smoothed.findings if one.code == "gnss-speed-level")
    assert "speeds err by" in finding.message
    error = smoothed.trajectory["speed_mps"] - np.interp(
        smoothed.trajectory["t_s"], run.truth["t_s"], run.truth["speed_mps"]
    )
    assert np.sqrt(np.mean(np.square(error / smoothed.trajectory["speed_mps_sd"]))) < 1.5


@pytest.mark.parametrize(("offset", "code"), [(-0.28, "far-from-prior-sensor")])
def test_speeds_cut_off_to_whole_numbers_are_said_to_be_too_low(offset: float, code: str) -> None:
    run = simulated(300.0)
    table = run.recording.others[GNSS_SPEED_TABLE]
    low = table.assign(speed_mps=np.maximum(table["speed_mps"] + offset, 0.0))
    findings = smooth_states(replace(run.recording, others={GNSS_SPEED_TABLE: low}), SmoothConfig()).findings
    (finding,) = (one for one in findings if one.code == code)
    assert "the receiver's speeds are -0.2" in finding.message


def test_speeds_that_a_phone_has_filtered_leave_the_noise_of_its_sensors_to_be_found() -> None:
    """Both are far from what is declared, and three rounds must do for both: sensors err anew each half second."""
    run, rng = simulated(300.0), np.random.default_rng(1)
    imu = run.recording.imu.copy()
    t = imu["t_s"].to_numpy()
    half = (2.0 * t).astype(int)
    for columns, sd in ((IMU_COLUMNS[1:4], 0.02), (IMU_COLUMNS[4:7], 0.1)):
        imu[list(columns)] += sd * rng.standard_normal((half.max() + 1, 3))[half] * (t > 30.0)[:, None]
    table = run.recording.others[GNSS_SPEED_TABLE]
    filtered = table.assign(speed_mps=table["speed_mps"].ewm(alpha=0.15).mean())
    recording = replace(without_tach(run.recording), imu=imu, others={GNSS_SPEED_TABLE: filtered})
    # The first rounds, whose sigmas are wrong, need not end at the minimum: after 50 steps it is found as well.
    config = SmoothConfig(solver=SolverConfig(max_iterations=20))
    ratios = smooth_states(recording, config).noise_ratios
    assert ratios["gyro"] < 1.3
    assert ratios["accel"] < 1.3

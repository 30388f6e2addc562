"""IMM odometry: distance, speed and events where wheels slip and slide."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from trackfg.baselines import odometry_imm
from trackfg.baselines.odometry_imm import MODES, OdometryParameters
from trackfg.datasets import simulate
from trackfg.datasets.catalogue import scenario
from trackfg.errors import BadInputError


@pytest.fixture(scope="module")
def slippery():
    run = simulate("slippery-line", seed=2)
    return run, odometry_imm.run(run.recording)


def at_true_scale(run, result):
    """Distance, its error, and the speed's error, with the wheel's true scale."""
    t = result.trajectory["t_s"]
    true = np.interp(t, run.truth["t_s"], run.truth["chainage_m"])
    distance = run.wheel_scale * result.trajectory["chainage_m"]
    speed = run.wheel_scale * result.trajectory["speed_mps"] - np.interp(t, run.truth["t_s"], run.truth["speed_mps"])
    return true - true[0], distance - (true - true[0]), speed


def test_distance_and_speed(slippery):
    true, error, speed_error = at_true_scale(*slippery)
    assert true[-1] > 10_000.0
    assert error.abs().max() < 2e-3 * true[-1]
    assert np.sqrt((speed_error**2).mean()) < 0.15


def test_every_slip_is_found_and_the_large_ones_named(slippery):
    run, result = slippery
    found = result.events[result.events["kind"].isin(["slip", "slide"])]
    assert len(run.slips) >= 4
    for slip in run.slips.itertuples():
        near = found[(found["start_s"] < slip.end_s + 0.5) & (found["end_s"] > slip.start_s - 0.5)]
        assert len(near)
        # A small one may end as its opposite: the filter has followed the wheel.
        if abs(slip.distance_error_m) > 2.0:
            assert slip.kind in set(near["kind"])
    for event in found.itertuples():
        assert ((run.slips["start_s"] < event.end_s + 1.0) & (run.slips["end_s"] > event.start_s - 1.0)).any()


def test_distance_removed(slippery):
    run, result = slippery
    large = run.slips[run.slips["distance_error_m"].abs() > 3.0]
    assert len(large)
    for slip in large.itertuples():
        near = result.events[(result.events["start_s"] < slip.end_s) & (result.events["end_s"] > slip.start_s)]
        removed = near.loc[near["kind"] != "standstill", "distance_removed_m"].sum()
        assert removed == pytest.approx(slip.distance_error_m / run.wheel_scale, rel=0.35)


def test_stops_are_standstills(slippery):
    run, result = slippery
    still = np.abs(np.interp(result.trajectory["t_s"], run.truth["t_s"], run.truth["speed_mps"])) < 1e-6
    rests = result.events[result.events["kind"] == "standstill"]
    t = result.trajectory["t_s"].to_numpy()
    seen = np.zeros(len(t), dtype=bool)
    for event in rests.itertuples():
        seen |= (t >= event.start_s) & (t <= event.end_s)
    assert seen[still].mean() > 0.8
    assert seen[~still].mean() < 0.02


def test_parked():
    run = simulate("parked", seed=1, duration_s=60.0)
    result = odometry_imm.run(run.recording)
    assert result.trajectory["chainage_m"].abs().max() < 0.1
    assert set(result.events["kind"]) == {"standstill"}


def test_direction_of_the_track():
    plan = replace(scenario("shuttle"), irregularities=None)
    there, back = (odometry_imm.run(simulate(plan, seed=1, run=run, duration_s=120.0).recording) for run in (0, 1))
    assert there.trajectory["chainage_m"].iloc[-1] > 100.0
    assert back.trajectory["chainage_m"].iloc[-1] < -100.0
    assert back.trajectory["speed_mps"].max() > 1.0


def test_holes_in_the_tach_are_bridged(slippery):
    run, whole = slippery
    imu, tach = (table[table["t_s"] < 500.0] for table in (run.recording.imu, run.recording.tach))
    holed = replace(run.recording, imu=imu, tach=tach[~tach["t_s"].between(300.0, 304.0)].reset_index(drop=True))
    result = odometry_imm.run(holed)
    off = result.trajectory["chainage_m"] - whole.trajectory["chainage_m"].iloc[: len(result.trajectory)]
    assert off.abs().max() < 20.0
    assert abs(off.iloc[-1]) < 5.0


def test_no_tachometer():
    run = simulate("parked", seed=1, duration_s=10.0)
    description = run.recording.description.model_copy(update={"tach": None})
    with pytest.raises(BadInputError, match="no tachometer"):
        odometry_imm.run(replace(run.recording, tach=None, description=description))


def test_parameters_are_in_the_result(slippery):
    assert slippery[1].parameters["creep_mps"] == OdometryParameters().creep_mps
    assert len(MODES) == 4

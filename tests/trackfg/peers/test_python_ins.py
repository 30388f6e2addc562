from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from trackfg.baselines.result import BaselineResult
from trackfg.datasets.catalogue import scenario
from trackfg.datasets.scenarios import Simulation, simulate
from trackfg.errors import BadInputError
from trackfg.numerics.arrays import Array
from trackfg.numerics.geodesy import geodetic_to_enu
from trackfg.peers import python_ins
from trackfg.recording.model import Recording

ErrorOf = Callable[[BaselineResult, Simulation, str], Array]

pytest.importorskip("pyins")

LATITUDE_DEG = 35.2
DURATION_S = 32.0


@pytest.fixture(scope="module")
def on_earth() -> Simulation:
    """Perfect sensors from rest on an Earth that turns, IMU above the reference point."""
    plan = scenario("mainline")
    plan = replace(
        plan,
        imu=replace(plan.imu, rate_hz=50.0, lever_arm_m=(1.0, 0.5, 1.2)),
        driver=replace(plan.driver, start_rest_s=12.0),
        latitude_deg=LATITUDE_DEG,
        irregularities=None,
    )
    return simulate(plan, seed=1, duration_s=DURATION_S, noise=False)


@pytest.fixture(scope="module")
def result(on_earth: Simulation) -> BaselineResult:
    return python_ins.run(on_earth.recording)


def test_attitude_comes_back_with_its_signs(on_earth: Simulation, result: BaselineResult, error_of: ErrorOf) -> None:
    for column, most in (("roll_rad", 2e-4), ("pitch_rad", 1e-3)):
        assert np.abs(error_of(result, on_earth, column)).max() < most
    yaw = error_of(result, on_earth, "yaw_rad")
    assert np.abs(np.angle(np.exp(1j * yaw))).max() < 1e-3


def test_position_is_that_of_the_reference_point(
    on_earth: Simulation, result: BaselineResult, error_of: ErrorOf
) -> None:
    assert np.hypot(on_earth.truth["east_m"].iloc[-1], on_earth.truth["north_m"].iloc[-1]) > 100.0
    for column in ("east_m", "north_m", "up_m"):
        assert np.abs(error_of(result, on_earth, column)).max() < 0.1


def test_takes_the_latitude_of_the_recording(result: BaselineResult) -> None:
    assert result.parameters["latitude_deg"] == pytest.approx(LATITUDE_DEG, abs=1e-4)


def test_sigmas_come_with_what_is_known(result: BaselineResult) -> None:
    for name in ("roll_rad", "pitch_rad", "yaw_rad", "east_m", "north_m", "up_m"):
        assert (result.trajectory[f"{name}_sd"] > 0.0).all()
    known = result.geometry["cross_level_mm"].notna()
    assert known.any()
    assert (result.geometry.loc[known, "cross_level_mm_sd"] > 0.0).all()


def test_without_a_latitude_it_takes_the_default_and_counts_yaw_from_the_start(error_of: ErrorOf) -> None:
    run = simulate("trolley", seed=1, duration_s=20.0, noise=False)
    found = python_ins.run(_thinned(run.recording))
    assert found.parameters["latitude_deg"] == python_ins.DEFAULT_LATITUDE_DEG
    assert np.abs(error_of(found, run, "roll_rad")).max() < 2e-4
    assert np.abs(error_of(found, run, "yaw_rad")).max() < 2e-3


def test_gnss_gives_place_and_heading(error_of: ErrorOf) -> None:
    plan = scenario("mainline-gnss")
    plan = replace(plan, imu=replace(plan.imu, rate_hz=50.0), irregularities=None)
    run = simulate(plan, seed=1, duration_s=35.0, noise=False)
    description = run.recording.description
    no_heading = description.model_copy(update={"track": description.track.model_copy(update={"heading_deg": None})})
    found = python_ins.run(replace(run.recording, description=no_heading))
    settled = found.trajectory["t_s"] > 17.5
    for column in ("east_m", "north_m", "up_m"):
        assert np.abs(error_of(found, run, column)[settled]).max() < 1.0
    yaw = error_of(found, run, "yaw_rad")[settled]
    assert np.abs(np.angle(np.exp(1j * yaw))).max() < 0.01


def test_geodetic_of_is_the_inverse() -> None:
    origin = np.array([35.2, 137.0, 40.0])
    enu = np.array([[0.0, 0.0, 0.0], [3e4, -5e4, 200.0], [-200.0, 70.0, -5.0]])
    np.testing.assert_allclose(geodetic_to_enu(python_ins.geodetic_of(enu, origin), origin), enu, atol=1e-4)


def test_needs_a_tachometer(on_earth: Simulation) -> None:
    with pytest.raises(BadInputError, match="no tachometer"):
        python_ins.run(replace(on_earth.recording, tach=None))


def _thinned(recording: Recording) -> Recording:
    """Every fourth sample: a quicker filter."""
    return replace(recording, imu=recording.imu.iloc[::4].reset_index(drop=True))

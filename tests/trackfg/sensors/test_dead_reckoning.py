"""The cheap pass is near enough to the truth for Gauss-Newton."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from trackfg.datasets.scenarios import Simulation
from trackfg.numerics.geodesy import earth_rate_enu
from trackfg.numerics.rotations import matrix_from_rpy
from trackfg.sensors.dead_reckoning import InitialPath, initial_path
from trackfg.sensors.imu_intervals import intervals
from trackfg.sensors.standstills import find_standstills
from trackfg.sensors.starting_bias import rest_bias
from trackfg.sensors.tach import Wheel, read_wheel


def path_of(
    run: Simulation, *, wheel: bool = True, earth_rate: np.ndarray | None = None, yaw: float = 0.0
) -> InitialPath:
    recording = run.recording
    rolled: Wheel | None = read_wheel(recording, 5.0) if wheel else None
    earth = np.zeros(3) if earth_rate is None else earth_rate
    return initial_path(recording, intervals(recording), rolled, find_standstills(recording), earth, yaw)


def tilt_error(run: Simulation, path: InitialPath) -> np.ndarray:
    return path.rpy[:, :2] - run.ride.rpy(path.t)[:, :2]


def yaw_error(run: Simulation, path: InitialPath) -> np.ndarray:
    error = path.rpy[:, 2] - run.ride.rpy(path.t)[:, 2]
    return (error + np.pi) % (2 * np.pi) - np.pi


@pytest.mark.parametrize("seed", range(2))
def test_attitude_is_within_5_mrad(simulated: Callable[..., Simulation], seed: int) -> None:
    """The accelerometer's bias of 0.02 m/s^2 (1 sigma) is 2 mrad in each of both, if curves do not show it."""
    run = simulated("mainline", seed=seed, duration_s=400.0)
    path = path_of(run)
    error = tilt_error(run, path)
    assert np.sqrt(np.mean(error**2, axis=0)).max() < 2e-3
    assert np.quantile(np.abs(error), 0.99) < 5e-3
    assert np.abs(error).max() < 8e-3


def test_kinematic_correction_matters_in_curves(simulated: Callable[..., Simulation]) -> None:
    run = simulated("mainline", seed=1, duration_s=400.0, noise=False)
    good, blind = (np.abs(tilt_error(run, path_of(run, wheel=wheel))).max(axis=0) for wheel in (True, False))
    assert (good < 5e-3).all()
    assert (blind > 5 * good).all()


def test_heading_follows_the_gyro_less_its_bias(simulated: Callable[..., Simulation]) -> None:
    run = simulated("mainline", seed=2, duration_s=400.0)
    error = yaw_error(run, path_of(run))
    assert abs(error[0]) < 1e-3
    assert np.abs(error).max() < np.radians(1.0)


@pytest.mark.parametrize("seed", range(2))
def test_heading_is_turned_onto_gnss(simulated: Callable[..., Simulation], seed: int) -> None:
    run = simulated("mainline-gnss", seed=seed, duration_s=200.0)
    path = path_of(run, earth_rate=earth_rate_enu(35.2), yaw=1.0)
    moving = path.speed > 1.0
    assert np.abs(yaw_error(run, path)[moving]).max() < np.radians(1.0)
    distance = run.ride.motion.distance(path.t[-1]) - run.ride.motion.distance(path.t[0])
    assert np.linalg.norm((path.p - run.ride.position(path.t))[:, :2], axis=1).max() < 5.0 + 0.01 * distance


def test_speed_comes_from_gnss_where_there_is_no_tach(simulated: Callable[..., Simulation]) -> None:
    run = simulated("mainline-gnss", seed=0, duration_s=200.0)
    path = path_of(run, wheel=False, earth_rate=earth_rate_enu(35.2))
    moving = (run.ride.motion.speed(path.t) > 3.0) & (path.t < 195.0)
    assert np.sqrt(np.mean((path.speed - run.ride.motion.speed(path.t))[moving] ** 2)) < 1.0


def test_dead_reckoning_is_near_the_line(simulated: Callable[..., Simulation]) -> None:
    run = simulated("mainline", seed=0, duration_s=200.0, noise=False)
    path = path_of(run)
    length = run.ride.motion.path(200.0)
    assert np.linalg.norm(path.p - run.ride.position(path.t), axis=1).max() < 2e-3 * length
    np.testing.assert_allclose(path.speed, run.ride.motion.speed(path.t), atol=0.3)


def test_reversing_goes_backwards(simulated: Callable[..., Simulation]) -> None:
    run = simulated("shunting-unsigned", seed=4, duration_s=240.0)
    path = path_of(run)
    np.testing.assert_allclose(path.speed, run.ride.motion.speed(path.t), atol=0.3)
    assert np.abs(tilt_error(run, path)).max() < 8e-3


def test_interpolation_is_consistent(simulated: Callable[..., Simulation]) -> None:
    path = path_of(simulated("trolley", seed=0, duration_s=90.0))
    k = [5, 300, 800]
    np.testing.assert_allclose(path.position(path.t[k]), path.p[k])
    np.testing.assert_allclose(path.velocity(path.t[k]), path.v[k])
    np.testing.assert_allclose(path.attitude(path.t[k]), matrix_from_rpy(*path.rpy[k].T))


def test_rest_bias_interpolates_between_rests() -> None:
    t = np.arange(0.0, 100.0, 0.1)
    gyro = np.tile([1e-3, 2e-3, 3e-3], (t.size, 1))
    gyro[t > 50] += 1e-3
    earth = np.array([0.0, 5e-5, 4e-5])
    bias = rest_bias(t, gyro, np.array([[10.0, 20.0], [80.0, 90.0]]), earth)
    np.testing.assert_allclose(bias[[0, 150]], np.tile([1e-3, 2e-3, 3e-3 - 4e-5], (2, 1)), atol=1e-12)
    np.testing.assert_allclose(bias[500], [1.5e-3, 2.5e-3, 3.5e-3 - 4e-5], atol=2e-6)
    np.testing.assert_allclose(bias[-1], [2e-3, 3e-3, 4e-3 - 4e-5], atol=1e-12)
    assert not rest_bias(t, gyro, np.zeros((0, 2)), earth).any()


def test_run_without_tach_and_gnss_still_has_a_tilt(simulated: Callable[..., Simulation]) -> None:
    run = simulated("parked", seed=0, duration_s=60.0)
    path = path_of(replace(run, recording=replace(run.recording, tach=None)), wheel=False)
    assert not path.speed.any()
    assert np.abs(tilt_error(run, path)).max() < 0.01

"""The IMU: its noise-free samples give the motion back."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import PPoly

from trackfg.datasets import tables
from trackfg.datasets.line.irregularities import IrregularityModel, draw_irregularities
from trackfg.datasets.line.track import SimulatedTrack
from trackfg.datasets.sensors.inertial_sensor import gravity, ideal_samples
from trackfg.datasets.vehicle.body_motion import through
from trackfg.datasets.vehicle.motion import Limits, change, motion, rest
from trackfg.datasets.vehicle.ride import Ride
from trackfg.datasets.vehicle.vehicle import CarBody, Rigid
from trackfg.numerics import geodesy, rotations

LATITUDES = [None, 48.0]
VEHICLES = [Rigid(), Rigid(1.2), CarBody()]


@pytest.fixture
def rough_ride(winding_ride):
    """Makes the winding ride with a vehicle on rough track, sampled at given edges."""
    line, drive = winding_ride.line, winding_ride.motion
    track = SimulatedTrack(
        line, draw_irregularities(IrregularityModel(), line.length_m, np.random.default_rng(5)), 1.067
    )
    return lambda vehicle, edges: Ride(line, drive, body=vehicle.body_motion(track, drive, edges))


def _earth(latitude_deg):
    return np.zeros(3) if latitude_deg is None else geodesy.earth_rate_enu(latitude_deg)


def _frame_rate(ride, edges, latitude_deg):
    """How the level frame turns in each interval: with the Earth and over its curvature, at the true velocity."""
    middle = 0.5 * (edges[1:] + edges[:-1])
    velocity = ride.velocity(middle)
    east_rate, north_rate = -velocity[:, 1] / 6.371e6, velocity[:, 0] / 6.371e6
    return _earth(latitude_deg) + np.column_stack([east_rate, north_rate, 0 * east_rate])


def _composed(ride, gyro, edges, latitude_deg):
    """Attitudes at the edges from the first one and the gyro alone."""
    dt = edges[1] - edges[0]
    turns = rotations.so3_exp(gyro * dt)
    backs = rotations.so3_exp(-_frame_rate(ride, edges, latitude_deg) * dt)
    R = np.empty((len(edges), 3, 3))
    R[0] = ride.rotation(edges[:1])[0]
    for k, (back, turn) in enumerate(zip(backs, turns, strict=True)):
        R[k + 1] = back @ R[k] @ turn
    return R


@pytest.mark.parametrize("latitude_deg", LATITUDES)
def test_composing_the_gyro_gives_the_attitude(winding_ride, latitude_deg):
    edges = tables.clock(120.0, 200.0)
    gyro, _ = ideal_samples(winding_ride, edges, latitude_deg)
    error = np.swapaxes(winding_ride.rotation(edges), 1, 2) @ _composed(winding_ride, gyro, edges, latitude_deg)
    assert np.abs(rotations.so3_log(error)).max() < 1e-9


@pytest.mark.parametrize("vehicle", VEHICLES)
@pytest.mark.parametrize("latitude_deg", LATITUDES)
def test_composing_the_gyro_gives_the_attitude_on_rough_track(rough_ride, vehicle, latitude_deg):
    edges = tables.clock(15.0, 200.0)
    ride = rough_ride(vehicle, edges)
    gyro, _ = ideal_samples(ride, edges, latitude_deg)
    error = np.swapaxes(ride.rotation(edges), 1, 2) @ _composed(ride, gyro, edges, latitude_deg)
    assert np.abs(rotations.so3_log(error)).max() < 1e-9


@pytest.mark.parametrize("latitude_deg", LATITUDES)
@pytest.mark.parametrize("lever_arm", [(0.0, 0.0, 0.0), (2.0, -0.5, 1.0)])
def test_integrating_the_specific_force_gives_velocity_and_position(winding_ride, latitude_deg, lever_arm):
    edges = tables.clock(25.0, 1000.0)
    off_velocity, off_position = _integrated(winding_ride, edges, latitude_deg, lever_arm)
    # With a lever arm the velocity jumps at kinks of the line, and the jump's direction is known to half a sample only.
    assert off_velocity < (1e-4 if any(lever_arm) else 1e-5)
    assert off_position < (5e-3 if any(lever_arm) else 5e-4)


@pytest.mark.parametrize("vehicle", [Rigid(1.2), CarBody()])
@pytest.mark.parametrize("lever_arm", [(0.0, 0.0, 0.0), (2.0, -0.5, 1.0)])
def test_integrating_the_specific_force_on_rough_track(rough_ride, vehicle, lever_arm):
    edges = tables.clock(15.0, 1000.0)
    off_velocity, off_position = _integrated(rough_ride(vehicle, edges), edges, 48.0, lever_arm)
    assert off_velocity < (1e-4 if any(lever_arm) else 1e-5)
    assert off_position < (5e-3 if any(lever_arm) else 5e-4)


def test_a_body_beside_a_line_whose_curvature_jumps_is_knocked(make_line):
    line = make_line([0, 100, 100.0 + 1e-9, 300, 300.0 + 1e-9, 2000], [0, 0, 1 / 200, 1 / 200, 0, 0])
    edges = tables.clock(30.0, 1000.0)
    body = through(edges, np.tile([0.2, 0, 0, 0, 0.1], (len(edges), 1)))
    gone = motion(
        [*rest(15.0), *change(15.0, 0.0, Limits(2.0, 10.0)), *change(0.0, -15.0, Limits(2.0, 10.0))], 50.03, 15.0
    )
    for drive in (motion(rest(30.0), 50.03, 15.0), gone):
        off_velocity, off_position = _integrated(Ride(_sudden(line), drive, body=body), edges, None, (0.0, 0.0, 0.0))
        assert off_velocity < 1e-4
        assert off_position < 1e-3


def _sudden(line):
    """A line with jumps of curvature in place of its very short transitions."""
    kept = np.flatnonzero(np.diff(line.curvature.x) > 1e-6)
    curvature = PPoly(line.curvature.c[:, kept], np.append(line.curvature.x[kept], line.length_m))
    return replace(line, curvature=curvature)


def _integrated(ride, edges, latitude_deg, lever_arm):
    """Greatest errors of velocity and position, integrated from the samples."""
    gyro, accel = ideal_samples(ride, edges, latitude_deg, lever_arm)
    arm, w, dt = np.array(lever_arm), _earth(latitude_deg), edges[1] - edges[0]
    R = ride.rotation(edges)
    velocity = ride.velocity(edges) + np.einsum("nij,nj->ni", R, np.cross(ride.body_rate(edges), arm))
    position = ride.position(edges) + R @ arm

    turning = _frame_rate(ride, edges, latitude_deg)
    middle = rotations.so3_exp(-turning * dt / 2) @ _composed(ride, gyro, edges, latitude_deg)[:-1]
    middle = middle @ rotations.so3_exp(gyro * dt / 2)
    steps = np.einsum("nij,nj->ni", middle, accel) * dt - np.array([0, 0, gravity(latitude_deg) * dt])
    integrated = np.empty_like(velocity)
    integrated[0] = velocity[0]
    for k, (step, turn) in enumerate(zip(steps, rotations.skew(w + turning) * dt, strict=True)):
        integrated[k + 1] = integrated[k] + step - turn @ (integrated[k] + 0.5 * step)
    travelled = position[0] + np.cumsum(0.5 * dt * (integrated[1:] + integrated[:-1]), axis=0)
    return np.abs(integrated - velocity).max(), np.abs(travelled - position[1:]).max()


def test_at_rest_it_measures_gravity_and_the_earth(make_line):
    latitude = 48.0
    ride = Ride(make_line([0, 100], [0, 0], grade=[0.02, 0.02]), motion(rest(10.0), 50.0))
    gyro, accel = ideal_samples(ride, tables.clock(10.0, 100.0), latitude)
    up = np.array([np.sin(0.02), 0.0, np.cos(0.02)])
    np.testing.assert_allclose(accel, np.broadcast_to(gravity(latitude) * up, accel.shape), atol=1e-12)
    # The x axis points east: the Earth's rate is to the left and up.
    rate = geodesy.EARTH_RATE * np.array([0.0, np.cos(np.radians(latitude)), np.sin(np.radians(latitude))])
    body = rate @ ride.rotation(np.zeros(1))[0]
    np.testing.assert_allclose(gyro, np.broadcast_to(body, gyro.shape), atol=1e-13)


def test_steady_curve_has_centripetal_and_coriolis_acceleration(make_line):
    radius, v, latitude = 400.0, 20.0, 60.0
    ride = Ride(make_line([0, 2000], [1 / radius, 1 / radius]), motion(rest(10.0), 0.0, v))
    edges = tables.clock(5.0, 100.0)
    _, still = ideal_samples(ride, edges, None)
    np.testing.assert_allclose(still[:, 1], v**2 / radius, rtol=1e-9)
    _, turning = ideal_samples(ride, edges, latitude)
    coriolis = 2 * geodesy.EARTH_RATE * np.sin(np.radians(latitude)) * v
    np.testing.assert_allclose(turning[:, 1] - still[:, 1], coriolis, rtol=1e-6)


def test_lever_arm_adds_the_rotation(make_line):
    radius, v = 400.0, 20.0
    ride = Ride(make_line([0, 2000], [1 / radius, 1 / radius]), motion(rest(10.0), 0.0, v))
    _, accel = ideal_samples(ride, tables.clock(5.0, 100.0), None, (0.0, 1.0, 0.0))
    np.testing.assert_allclose(accel[:, 1], v**2 / radius * (1 - 1 / radius), rtol=1e-9)


def test_chunks_do_not_show(winding_ride, monkeypatch):
    edges = tables.clock(20.0, 100.0)
    whole = ideal_samples(winding_ride, edges, 48.0, (1.0, 0.0, 0.5))
    monkeypatch.setattr("trackfg.datasets.sensors.inertial_sensor._CHUNK", 333)
    parts = ideal_samples(winding_ride, edges, 48.0, (1.0, 0.0, 0.5))
    for one, other in zip(whole, parts, strict=True):
        np.testing.assert_allclose(one, other, atol=1e-12)

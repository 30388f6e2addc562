"""Kinematics of the ride."""

from dataclasses import replace

import numpy as np
import pytest

from trackfg.datasets.vehicle.body_motion import through
from trackfg.numerics import rotations


@pytest.fixture
def swaying_ride(winding_ride):
    """The winding ride with a body that sways by some centimetres and degrees, at random."""
    edges = np.linspace(0.0, 120.0, 241)
    sizes = np.array([0.05, 0.03, 0.03, 0.02, 0.02])
    return replace(winding_ride, body=through(edges, sizes * np.random.default_rng(8).standard_normal((241, 5))))


def test_x_axis_is_the_tangent(winding_ride):
    t = np.linspace(1, 119, 300)
    step = 1e-4
    velocity = (winding_ride.position(t + step) - winding_ride.position(t - step)) / (2 * step)
    body = np.squeeze(np.swapaxes(winding_ride.rotation(t), 1, 2) @ velocity[..., None], -1)
    np.testing.assert_allclose(body[:, 0], winding_ride.motion.speed(t), atol=1e-5)
    np.testing.assert_allclose(body[:, 1:], 0.0, atol=1e-5)


def test_body_rate_is_the_derivative_of_the_attitude(winding_ride):
    kinks = winding_ride.kinks_s()
    t = 0.5 * (kinks[1:] + kinks[:-1])
    step = 1e-4
    turn = np.swapaxes(winding_ride.rotation(t - step), 1, 2) @ winding_ride.rotation(t + step)
    np.testing.assert_allclose(winding_ride.body_rate(t), rotations.so3_log(turn) / (2 * step), atol=1e-8)


def test_signs_on_a_canted_left_curve_uphill(make_line):
    from trackfg.datasets.vehicle.motion import motion, rest
    from trackfg.datasets.vehicle.ride import Ride

    curve = make_line([0, 2000], [1 / 500, 1 / 500], cant=[-0.05, -0.05], grade=[0.02, 0.02])
    ride = Ride(curve, motion(rest(20.0), 0.0, 10.0), chainage_origin_m=5000.0, direction=-1)
    t = np.array([0.0, 10.0])
    roll, pitch, yaw = ride.rpy(t)[1]
    assert roll < 0  # the right rail is the higher one
    assert pitch == pytest.approx(-0.02)  # nose up
    assert yaw == pytest.approx(100 / 500)  # to the left
    assert ride.position(t)[1, 2] == pytest.approx(100 * np.sin(0.02))
    assert ride.position(t)[0].tolist() == [0, 0, 0]
    assert ride.chainage(ride.motion.distance(t)).tolist() == [5000.0, 4900.0]
    assert ride.body_rate(t)[1, 2] == pytest.approx(10 / 500, rel=0.01)


def test_velocity_and_acceleration_are_derivatives_of_the_position(swaying_ride):
    kinks = swaying_ride.kinks_s()
    t = (0.5 * (kinks[1:] + kinks[:-1]))[(np.diff(kinks) > 0.01) & (kinks[1:] <= 120.0)]
    step = 1e-3
    before, here, after = (swaying_ride.position(t + d) for d in (-step, 0.0, step))
    np.testing.assert_allclose(swaying_ride.velocity(t), (after - before) / (2 * step), atol=2e-5)
    np.testing.assert_allclose(swaying_ride.acceleration(t), (after - 2 * here + before) / step**2, atol=2e-4)
    change = (swaying_ride.velocity(t + step) - swaying_ride.velocity(t - step)) / (2 * step)
    np.testing.assert_allclose(swaying_ride.acceleration(t), change, atol=2e-5)


def test_body_rate_of_a_swaying_body(swaying_ride):
    kinks = swaying_ride.kinks_s()
    t = (0.5 * (kinks[1:] + kinks[:-1]))[(np.diff(kinks) > 0.01) & (kinks[1:] <= 120.0)]
    step = 1e-4
    turn = np.swapaxes(swaying_ride.rotation(t - step), 1, 2) @ swaying_ride.rotation(t + step)
    np.testing.assert_allclose(swaying_ride.body_rate(t), rotations.so3_log(turn) / (2 * step), atol=1e-7)


def test_deviations_are_left_up_and_added_to_the_angles(winding_ride):
    off = np.array([0.3, 0.2, 0.01, -0.02, 0.03])
    edges = np.linspace(0.0, 120.0, 121)
    moved = replace(winding_ride, body=through(edges, np.tile(off, (121, 1))))
    t = np.linspace(0.0, 110.0, 50)
    np.testing.assert_allclose(moved.rpy(t) - winding_ride.rpy(t), np.tile(off[2:], (50, 1)), atol=1e-12)
    apart = moved.position(t) + moved.origin - winding_ride.position(t) - winding_ride.origin
    yaw = winding_ride.rpy(t)[:, 2]
    np.testing.assert_allclose(
        apart, np.column_stack([-0.3 * np.sin(yaw), 0.3 * np.cos(yaw), 0 * yaw + 0.2]), atol=1e-9
    )
    assert moved.position(np.zeros(1))[0].tolist() == [0, 0, 0]


def test_speed_along_the_body(winding_ride, swaying_ride):
    t = np.linspace(0.0, 119.0, 200).reshape(20, 10)
    np.testing.assert_allclose(winding_ride.speed_along_body(t), winding_ride.motion.speed(t), atol=1e-12)
    forward = swaying_ride.rotation(t)[..., :, 0]
    along = np.sum(forward * swaying_ride.velocity(t), axis=-1)
    np.testing.assert_allclose(swaying_ride.speed_along_body(t), along, atol=1e-12)

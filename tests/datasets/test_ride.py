"""Kinematics of the ride."""

import numpy as np
import pytest

from trackfg import frames


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
    np.testing.assert_allclose(winding_ride.body_rate(t), frames.so3_log(turn) / (2 * step), atol=1e-8)


def test_signs_on_a_canted_left_curve_uphill(make_line):
    from trackfg.datasets.motion import motion, rest
    from trackfg.datasets.ride import Ride

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

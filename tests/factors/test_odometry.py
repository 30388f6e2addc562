"""Distance and wheel: residuals and their signs, each case worked out by hand."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from trackfg.factors.landmark import landmark
from trackfg.factors.odometry import arc_length, distance_chain, tach_distance, tach_reading, wheel_response
from trackfg.factors.states import Nav, Odo, States

AtOrigin = Callable[[int], States]


def test_a_tach_whose_stamps_are_early_is_read_too_far_ahead(at_origin: AtOrigin) -> None:
    """The wheel rolls 10 m/s and W = 50 m. The tach's stamps are 0.2 s early, so T = +0.2 s is to be added to them.

    What bears the keyframe's stamp was counted 0.2 s after it: c = 50 + 10 x 0.2 = 52 m, and the residual
    W - (c - r T) = 50 - (52 - 2) is zero. With T = -0.2 s it is 50 - (52 + 2) = -4 m. By T it grows with r = 10 m/s.
    """
    one = replace(at_origin(1), odo=Odo(np.array([[0.0, 1.0, 50.0, 0.0]])))
    count, rate, since = np.array([52.0]), np.array([10.0]), np.array([0.0])
    family = tach_reading(np.array([0]), count, rate, since, np.ones((1, 1)))
    early, late = (replace(one, clock=np.array([[offset, 0.0, 0.0]])) for offset in (0.2, -0.2))
    assert family.residual(early).item() == pytest.approx(0.0, abs=1e-12)
    assert family.residual(late).item() == pytest.approx(-4.0)
    by_odo, by_clock = family.linearize(early).jacobians
    np.testing.assert_allclose(by_odo[0], [[0.0, 0.0, 1.0, 0.0]])
    np.testing.assert_allclose(by_clock[0], [[10.0, 0.0, 0.0]])


def test_a_tach_clock_that_drifts_is_right_in_the_middle_of_the_run(at_origin: AtOrigin) -> None:
    """Drift 1e-3, no offset: 30 s before the middle T = -0.03 s, in the middle 0, 30 s after it +0.03 s.

    At r = 10 m/s the residual W - c + r T of readings W = c = 50 m is -0.3, 0 and +0.3 m.
    """
    states = replace(at_origin(3), odo=Odo(np.tile([0.0, 1.0, 50.0, 0.0], (3, 1))), clock=np.array([[0.0, 1e-3, 0.0]]))
    since = np.array([-30.0, 0.0, 30.0])
    family = tach_reading(np.arange(3), np.full(3, 50.0), np.full(3, 10.0), since, np.ones((3, 1)))
    np.testing.assert_allclose(family.residual(states)[:, 0], [-0.3, 0.0, 0.3], atol=1e-12)
    np.testing.assert_allclose(family.linearize(states).jacobians[1][:, 0, 1], [-300.0, 0.0, 300.0])


def test_a_wheel_that_turns_more_than_the_vehicle_moves_slips(at_origin: AtOrigin) -> None:
    """Scale 1.01, 100 m rolled as counted, 90 m moved: 1.01 x 100 - 90 = +11 m."""
    odo = Odo(np.array([[0.0, 1.01, 0.0, 0.0], [90.0, 1.01, 100.0, 90.0]]))
    family = tach_distance(np.array([0]), np.zeros((1, 5)), np.ones((1, 1)), None)
    assert family.residual(replace(at_origin(2), odo=odo)).item() == pytest.approx(11.0)


def test_a_wheel_to_the_left_rolls_less_in_a_curve_to_the_left(at_origin: AtOrigin) -> None:
    """90 m, turning left by 0.3 rad under 0.02 g of traction.

    0.5 m to the left of the centre line a wheel rolls 0.5 x 0.3 = 0.15 m less, 0.1 m to the outside 0.03 m more, and
    with a creep of 0.05 per g 90 x 0.05 x 0.02 = 0.09 m more; creep in braking has no part. So of 89.97 m rolled,
    S dW - a - h w = 89.97 - 90 - (-0.15 + 0.03 + 0.09) = 0.
    """
    response = wheel_response(np.array([90.0]), np.array([0.3]), np.array([0.02]))
    wheel = np.array([[0.5, 0.1, 0.05, 7.0, 7.0]])
    odo = Odo(np.array([[0.0, 1.0, 0.0, 0.0], [90.0, 1.0, 89.97, 90.0]]))
    family = tach_distance(np.array([0]), response, np.ones((1, 1)), None)
    assert family.residual(replace(at_origin(2), odo=odo, wheel=wheel)).item() == pytest.approx(0.0, abs=1e-12)


def test_a_force_against_the_motion_is_braking() -> None:
    """Forwards under -0.1 g and backwards under +0.1 g: braking by 0.1 g over 50 m, response |d| f = -5 m on creep.

    Backwards all signs of the distance turn: 50 m less of it is 50 m more rolled the other way.
    """
    forwards, backwards = wheel_response(np.array([50.0, -50.0]), np.zeros(2), np.array([-0.1, 0.1]))
    np.testing.assert_allclose(forwards, [0.0, 0.0, 0.0, -5.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(backwards, [0.0, 0.0, 0.0, 5.0, 0.0], atol=1e-12)


def test_a_speed_that_is_cut_off_is_short_by_as_much_in_every_second_of_motion(at_origin: AtOrigin) -> None:
    """20 m in 2 s: whole km/h, cut off, are half a km/h low on average, -0.5 / 3.6 m/s, so 2 x 0.1389 = 0.2778 m are
    missing of the integral. Backwards the missing part has the other sign. S dW - a - h w = 19.7222 - 20 + 0.2778 = 0.
    """
    forwards, backwards = wheel_response(np.array([20.0, -20.0]), np.zeros(2), np.zeros(2), np.array([2.0, 2.0]))
    np.testing.assert_allclose([forwards[4], backwards[4]], [2.0, -2.0])
    odo = Odo(np.array([[0.0, 1.0, 0.0, 0.0], [20.0, 1.0, 20.0 - 2.0 * 0.5 / 3.6, 20.0]]))
    family = tach_distance(np.array([0]), forwards[None], np.ones((1, 1)), None)
    wheel = np.array([[0.0, 0.0, 0.0, 0.0, -0.5 / 3.6]])
    assert family.residual(replace(at_origin(2), odo=odo, wheel=wheel)).item() == pytest.approx(0.0, abs=1e-12)


def test_an_askew_sensor_measures_the_whole_way(at_origin: AtOrigin) -> None:
    """A vehicle travels 10 m along its own axis, which is 0.2 rad to the left of the sensor's: the arc is 10 m long,
    and not 10 cos 0.2. In a quarter turn to the left about a point 100 m away the sensor, 10 m to the left of the point
    that follows the track, moves along an arc of 90 pi/2, and that point along one of 100 pi/2.
    """
    family = arc_length(np.array([0]), np.zeros(3), np.ones((1, 1)))
    straight, turning = at_origin(2), at_origin(2)
    along = Nav(straight.nav.R, np.array([[0.0, 0.0, 0.0], [10 * np.cos(0.2), 10 * np.sin(0.2), 0.0]]), straight.nav.v)
    odo = Odo(np.array([[0.0, 1.0, 0.0, 0.0], [0.0, 1.0, 0.0, 10.0]]))
    askew = replace(straight, nav=along, odo=odo, mount=np.array([[0.0, 0.2, 0.0, 0.0, 0.0]]))
    assert family.residual(askew).item() == pytest.approx(0.0, abs=1e-12)
    R = np.stack([np.eye(3), [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]])
    curve = Nav(R, np.array([[0.0, 0.0, 0.0], [90.0, 90.0, 0.0]]), turning.nav.v)
    odo = Odo(np.array([[0.0, 1.0, 0.0, 0.0], [0.0, 1.0, 0.0, 100 * np.pi / 2]]))
    aside = replace(turning, nav=curve, odo=odo, mount=np.array([[0.0, 0.0, 0.0, -10.0, 0.0]]))
    assert family.residual(aside).item() == pytest.approx(0.0, abs=1e-9)


def test_distance_adds_up(at_origin: AtOrigin) -> None:
    """D from 5 to 12 m over a way of 6 m: +1 m. Scale from 1.01 to 1.03: +0.02."""
    odo = Odo(np.array([[5.0, 1.01, 0.0, 0.0], [12.0, 1.03, 0.0, 6.0]]))
    family = distance_chain(np.array([0]), np.ones((1, 2)))
    np.testing.assert_allclose(family.residual(replace(at_origin(2), odo=odo)), [[1.0, 0.02]])


def test_a_landmark_is_passed_at_its_share_of_the_way(at_origin: AtOrigin) -> None:
    """From D = 100 to 120 m, a quarter of the time gone: 105 m. With a landmark at 103 m the residual is +2 m. The
    first keyframe has three quarters of it.
    """
    states = replace(at_origin(2), odo=Odo.of(np.array([100.0, 120.0]), np.ones(2), np.zeros(2), np.zeros(2)))
    family = landmark(np.array([0]), np.array([0.25]), np.array([103.0]), np.ones((1, 1)), None)
    assert family.residual(states).item() == pytest.approx(2.0)
    by_first, by_second = family.linearize(states).jacobians
    np.testing.assert_allclose([by_first[0, 0, 0], by_second[0, 0, 0]], [0.75, 0.25])

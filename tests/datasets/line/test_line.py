"""The line against closed forms."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import fresnel

from trackfg.numerics.rotations import matrix_from_rpy


def test_circle_closes_and_has_its_radius(make_line):
    radius = 250.0
    circumference = 2 * np.pi * radius
    circle = make_line([0, circumference], [1 / radius, 1 / radius])
    s = np.linspace(0, circumference, 1001)
    position = circle.position(s)
    exact = np.column_stack([radius * np.sin(s / radius), radius * (1 - np.cos(s / radius)), 0 * s])
    np.testing.assert_allclose(position, exact, atol=1e-9)
    np.testing.assert_allclose(circle.rpy(s)[:, 2], s / radius, atol=1e-12)


def test_clothoid_turns_by_half_of_length_over_radius_and_is_fresnel(make_line):
    length, radius = 80.0, 300.0
    clothoid = make_line([0, length], [0, 1 / radius])
    assert clothoid.yaw(np.array(length)) == pytest.approx(length / (2 * radius), abs=1e-14)
    s = np.linspace(0, length, 33)
    scale = np.sqrt(np.pi * radius * length)
    sine, cosine = fresnel(s / scale)
    np.testing.assert_allclose(clothoid.position(s)[:, :2], scale * np.column_stack([cosine, sine]), atol=1e-10)


def test_vertical_curve_is_a_circle(make_line):
    radius, angle = 3000.0, 0.03
    curve = make_line([0, radius * angle], [0, 0], grade=[0, angle])
    s = np.linspace(0, radius * angle, 17)
    exact = np.column_stack([radius * np.sin(s / radius), 0 * s, radius * (1 - np.cos(s / radius))])
    np.testing.assert_allclose(curve.position(s), exact, atol=1e-10)
    np.testing.assert_allclose(curve.rpy(s)[:, 1], -s / radius, atol=1e-14)


def test_cant_ramp_is_linear_in_height_and_left_rail_up_is_positive_roll(make_line):
    ramp = make_line([0, 50, 100], [0, 1 / 400, 1 / 400], cant=[0, -0.1, -0.1])
    s = np.linspace(0, 49, 50)
    roll = ramp.rpy(s)[:, 0]
    np.testing.assert_allclose(ramp.cross_level_base_m * np.sin(roll), -0.1 * s / 50, atol=1e-15)
    assert roll[-1] < 0  # the right rail, the outer one of a curve to the left, is higher


def test_slopes_are_the_derivatives_of_the_attitude(winding_ride):
    line = winding_ride.line
    s = np.array([50.0, 130.0, 200.0, 330.0, 540.0, 730.0])
    step = 1e-3
    numeric = (line.rpy(s + step) - line.rpy(s - step)) / (2 * step)
    np.testing.assert_allclose(line.rpy_slopes(s), numeric, rtol=1e-6, atol=1e-10)


def test_position_stays_exact_over_seventy_kilometres(make_line):
    # Arcs of one radian, left and right in turn, so that every piece has a closed form.
    length, radius, waves = 350.0, 350.0, 200
    eps = 1e-7
    places, curvature = [0.0], [1 / radius]
    for wave in range(waves):
        side = 1 if wave % 2 == 0 else -1
        end = (wave + 1) * length
        places += [end - eps, end]
        curvature += [side / radius, -side / radius]
    line = make_line(places, curvature)
    chord = radius * np.array([np.sin(1.0), 1 - np.cos(1.0)])
    expected = np.zeros(2)
    heading = 0.0
    for wave in range(waves):
        side = 1 if wave % 2 == 0 else -1
        local = chord * np.array([1, side])
        turn = np.array([[np.cos(heading), -np.sin(heading)], [np.sin(heading), np.cos(heading)]])
        expected += turn @ local
        heading += side * 1.0
    np.testing.assert_allclose(line.position(np.array(waves * length))[:2], expected, atol=1e-4)


def test_position_agrees_with_a_much_finer_integral(winding_ride):
    line = winding_ride.line
    s = np.linspace(0, 2000, 40_001)
    middle = 0.5 * (s[1:] + s[:-1])
    offset = np.diff(s)[:, None] / np.sqrt(12) * np.array([-1, 1])
    at = middle[:, None] + offset
    gamma, yaw = line.grade(at), line.yaw(at)
    tangent = np.stack([np.cos(gamma) * np.cos(yaw), np.cos(gamma) * np.sin(yaw), np.sin(gamma)], axis=-1)
    total = np.sum(np.diff(s)[:, None, None] * tangent / 2, axis=(0, 1))
    np.testing.assert_allclose(line.position(np.array(2000.0)), total, atol=1e-9)


def test_reversed_line_passes_the_same_places_the_other_way(winding_ride):
    line = winding_ride.line
    back = line.reversed()
    # Off the kinks, where a derivative has two sides.
    s = np.linspace(0, line.length_m, 2003)[1:-1] + 1e-3
    mirrored = line.length_m - s
    ends = np.array([0.0, line.length_m])
    places = line.position(s) - line.position(ends[1])
    np.testing.assert_allclose(back.position(mirrored), places, atol=1e-8)
    np.testing.assert_allclose(back.position(ends[1]), -line.position(ends[1]), atol=1e-8)
    there, turned = (matrix_from_rpy(*at.T) for at in (line.rpy(s), back.rpy(mirrored)))
    np.testing.assert_allclose(turned, there @ np.diag([-1.0, -1.0, 1.0]), atol=1e-12)
    np.testing.assert_allclose(back.curvature(mirrored), -line.curvature(s), atol=1e-15)
    np.testing.assert_allclose(back.rpy_slopes(mirrored) * [1, 1, -1], line.rpy_slopes(s), atol=1e-15)


def test_reversed_line_mirrors_limits_and_stations_and_reversing_twice_gives_it_back(make_line):
    line = replace(
        make_line([0, 100, 150, 500], [0, 0, 0.002, 0.002], cant=[0, 0, -0.05, -0.05], stations=[120.0, 400.0]),
        limit_from_m=np.array([0.0, 100.0, 300.0]),
        limit_mps=np.array([20.0, 15.0, 25.0]),
    )
    back = line.reversed()
    np.testing.assert_allclose(back.stations_m, [100.0, 380.0])
    np.testing.assert_allclose(back.limit_from_m, [0.0, 200.0, 400.0])
    np.testing.assert_allclose(back.limit_mps, [25.0, 15.0, 20.0])
    again = back.reversed()
    s = np.linspace(0, 500, 77)
    np.testing.assert_allclose(again.position(s), line.position(s), atol=1e-10)
    np.testing.assert_allclose(again.rpy(s)[:, :2], line.rpy(s)[:, :2], atol=1e-15)
    np.testing.assert_allclose(again.limit_from_m, line.limit_from_m)
    np.testing.assert_allclose(again.stations_m, line.stations_m)

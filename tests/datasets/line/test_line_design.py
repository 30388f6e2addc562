"""Random lines keep to their design."""

from dataclasses import replace

import numpy as np
import pytest

from trackfg.datasets.line.built_in_lines import MAIN_LINE
from trackfg.datasets.line.line_design import curve_cant, curve_speed, random_line
from trackfg.numerics import units


@pytest.fixture(scope="module")
def line():
    return random_line(MAIN_LINE, 50_000.0, np.random.default_rng(4))


def test_line_is_long_enough_and_within_its_ranges(line):
    assert line.length_m >= 50_000.0
    curvature = np.abs(line.curvature(line.curvature.x))
    radii = 1 / curvature[curvature > 0]
    assert radii.min() >= MAIN_LINE.radius_m[0] * (1 - 1e-9)
    assert radii.max() <= MAIN_LINE.radius_m[1] * (1 + 1e-9)
    s = np.arange(0, line.length_m, 1.0)
    assert np.abs(line.cant(s)).max() <= MAIN_LINE.cant_max_m
    assert np.abs(np.sin(line.grade(s))).max() <= MAIN_LINE.max_gradient + 1e-4


def test_functions_are_continuous(line):
    for function in (line.curvature, line.cant, line.grade):
        inner = function.x[1:-1]
        np.testing.assert_allclose(function(inner - 1e-9), function(inner + 1e-9), atol=1e-9)


def test_outer_rail_is_the_higher_one(line):
    s = np.arange(0, line.length_m, 5.0)
    assert np.all(line.curvature(s) * line.cant(s) <= 0)


def test_cant_and_deficiency_stay_within_limits_at_the_speed_limit():
    for radius in np.linspace(300, 1200, 50):
        speed = curve_speed(MAIN_LINE, radius)
        cant = curve_cant(MAIN_LINE, radius, speed)
        equilibrium = MAIN_LINE.cross_level_base_m * speed**2 / (units.STANDARD_GRAVITY * radius)
        assert 0 <= cant <= MAIN_LINE.cant_max_m
        assert equilibrium - cant <= MAIN_LINE.deficiency_max_m + 0.0026


def test_transitions_are_400_times_the_cant(line):
    ramps = np.diff(line.cant.x), np.abs(np.diff(line.cant(line.cant.x)))
    steep = ramps[1] > 0
    assert np.all(ramps[0][steep] >= 400 * ramps[1][steep] - 1e-6)


def test_stations_are_level_enough_straight_and_apart(line):
    assert len(line.stations_m) >= 5
    assert np.all(np.diff(line.stations_m) >= MAIN_LINE.station_spacing_m)
    assert np.all(line.curvature(line.stations_m) == 0)
    assert np.all(np.abs(np.sin(line.grade(line.stations_m))) <= MAIN_LINE.station_gradient + 1e-4)


def test_vertical_curves_have_their_radius(line):
    slopes = np.diff(line.grade(line.grade.x)) / np.diff(line.grade.x)
    radii = 1 / np.abs(slopes[np.abs(slopes) > 1e-9])
    assert radii.min() >= MAIN_LINE.vertical_radius_m[0] * (1 - 1e-6)


def test_a_longer_line_begins_like_a_shorter_one(line):
    longer = random_line(MAIN_LINE, 60_000.0, np.random.default_rng(4))
    s = np.linspace(0, 49_000, 1000)
    np.testing.assert_allclose(longer.position(s), line.position(s), atol=1e-9)


def test_seeds_differ_and_a_seed_repeats(line):
    again = random_line(MAIN_LINE, 50_000.0, np.random.default_rng(4))
    other = random_line(MAIN_LINE, 50_000.0, np.random.default_rng(5))
    assert np.array_equal(again.knots, line.knots)
    assert not np.array_equal(other.knots[:10], line.knots[:10])


def test_wider_ranges_are_followed():
    sharp = replace(MAIN_LINE, radius_m=(160.0, 200.0))
    line = random_line(sharp, 5000.0, np.random.default_rng(0))
    assert np.abs(line.curvature(line.curvature.x)).max() >= 1 / 200

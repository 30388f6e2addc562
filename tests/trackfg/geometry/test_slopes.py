"""Twist, gradient and curvature over a base, cross-level and its conventions."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from trackfg.errors import BadInputError
from trackfg.geometry.cross_level import cross_level, in_convention
from trackfg.geometry.curvature import (
    curvature,
    curvature_response,
    heading_noise,
    heading_of_lateral,
    heading_of_lateral_response,
    heading_walk,
)
from trackfg.geometry.gradient import gradient, gradient_response
from trackfg.geometry.twist import twist, twist_response

OPERATORS = {
    "twist": (lambda y: twist(y, 0.25, 5.0), lambda w: twist_response(w, 5.0)),
    "twist ahead": (lambda y: twist(y, 0.25, 3.0, "ahead"), lambda w: twist_response(w, 3.0, "ahead")),
    "centred twist": (lambda y: twist(y, 0.25, 3.0, "centre"), lambda w: twist_response(w, 3.0, "centre")),
    "gradient": (lambda y: gradient(y, 0.25, 25.0), lambda w: gradient_response(w, 25.0)),
    "curvature": (lambda y: curvature(y, 0.25, 10.0), lambda w: curvature_response(w, 10.0)),
    "heading": (lambda y: heading_of_lateral(y, 0.25), lambda w: heading_of_lateral_response(w, 0.25)),
    "short": (lambda y: heading_of_lateral(y, 0.25, 0.5), lambda w: heading_of_lateral_response(w, 0.25, 0.5)),
}


@given(st.sampled_from(sorted(OPERATORS)), st.floats(0.6, 300.0))
@settings(deadline=None, max_examples=100, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_a_wave_comes_out_with_the_response(
    measured_response: Callable[..., np.ndarray], name: str, wavelength: float
) -> None:
    operator, response = OPERATORS[name]
    np.testing.assert_allclose(measured_response(operator, wavelength, length_m=60.0), response(wavelength), atol=1e-10)


def test_twist_is_blind_to_its_base_and_doubles_twice_it() -> None:
    np.testing.assert_allclose(np.abs(twist_response([5.0, 2.5, 10.0], 5.0)), [0.0, 0.0, 2.0], atol=1e-12)
    ramp = 1e-3 / 0.4 * np.arange(400) * 0.25  # 1 mm in 400 mm
    np.testing.assert_allclose(twist(ramp, 0.25, 2.5)[10:], 2.5e-3 / 0.4)
    with pytest.raises(BadInputError, match=r"base_m is 2\.6 m"):
        twist(ramp, 0.25, 2.6)
    with pytest.raises(BadInputError, match=r"half of base_m is 1\.125 m"):
        twist(ramp, 0.25, 2.25, "centre")


def test_twist_anchored_elsewhere_is_the_same_twist_shifted() -> None:
    level = np.random.default_rng(5).standard_normal(200)
    behind = twist(level, 0.25, 3.0)
    np.testing.assert_array_equal(twist(level, 0.25, 3.0, "ahead")[:-12], behind[12:])
    np.testing.assert_array_equal(twist(level, 0.25, 3.0, "centre")[6:-6], behind[12:])


def test_a_slope_and_a_circle_are_read_exactly() -> None:
    x = np.arange(800) * 0.25
    assert np.nanmax(np.abs(gradient(12e-3 * x + 40.0, 0.25) - 12e-3)) < 1e-12
    assert np.nanmax(np.abs(curvature(x / 300.0 + 2.0, 0.25) - 1.0 / 300.0)) < 1e-12
    assert np.nanmax(np.abs(curvature(heading_of_lateral(0.5 * x**2 / 300.0, 0.25), 0.25) - 1.0 / 300.0)) < 1e-9


def test_the_heading_of_a_lateral_position_is_its_slope_down_to_4_m() -> None:
    wavelengths = np.geomspace(4.0, 500.0, 50)
    slope = heading_of_lateral_response(wavelengths, 0.25)
    np.testing.assert_allclose(slope, 2j * np.pi / wavelengths, rtol=0.02)


def test_noise_of_the_heading() -> None:
    noise = np.random.default_rng(0).standard_normal(100_000)
    heading = heading_of_lateral(noise, 0.25)
    assert np.nanstd(heading) == pytest.approx(heading_noise(0.25), rel=0.02)
    assert heading_noise(0.25) < 0.5 * np.sqrt(0.5) / 0.25
    walk = np.cumsum(np.sqrt(0.25) * noise)
    assert np.nanstd(heading_of_lateral(walk, 0.25)) == pytest.approx(heading_walk(0.25), rel=0.02)
    with pytest.raises(BadInputError, match="two steps"):
        heading_of_lateral(noise, 0.25, 0.25)


def test_cross_level_is_the_height_along_the_sleeper() -> None:
    roll = np.arcsin(105.0 / 1067.0)
    assert cross_level(roll, 1.067) == pytest.approx(0.105)


def test_signs_of_cross_level() -> None:
    value = np.array([0.003, 0.080, -0.080])
    np.testing.assert_array_equal(in_convention(value, "left-high"), value)
    np.testing.assert_array_equal(in_convention(value, "right-high"), -value)
    # straight, right-hand curve (left rail outer) with 5 mm too much, left-hand curve with 5 mm too much
    by_inner = in_convention(value, "inner-rail", cant_m=[0.0, 0.075, -0.075], curvature_1pm=[0.0, -1e-3, 1e-3])
    np.testing.assert_allclose(by_inner, [-0.003, 0.005, 0.005])


def test_the_design_is_wanted_where_it_matters_and_only_there() -> None:
    with pytest.raises(BadInputError, match="expected cant_m and curvature_1pm"):
        in_convention(0.0, "inner-rail", cant_m=0.0)
    with pytest.raises(BadInputError, match="expected neither"):
        in_convention(0.0, "left-high", cant_m=0.0)
    with pytest.raises(BadInputError, match="expected left-high, right-high or inner-rail"):
        in_convention(0.0, "up")  # type: ignore[arg-type]

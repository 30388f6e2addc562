"""The laws against their closed forms."""

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq

from trackfg.datasets.line.alignment import Element, piecewise, ramp_law
from trackfg.datasets.line.line import Line

LENGTH, RADIUS = 80.0, 400.0
SHAPES = {
    "linear": lambda u: u,
    "half-sine": lambda u: (1 - np.cos(np.pi * u)) / 2,
    "sine": lambda u: u - np.sin(2 * np.pi * u) / (2 * np.pi),
    "bloss": lambda u: 3 * u**2 - 2 * u**3,
    "helmert": lambda u: np.where(u < 0.5, 2 * u**2, 1 - 2 * (1 - u) ** 2),
}
ENDS = [(0.0, 1 / 400), (1 / 400, 0.0), (0.0, -1 / 300), (-1 / 600, -1 / 250), (1 / 300, -1 / 500)]


def line_of(elements):
    length = sum(element.length_m for element in elements)
    flat = piecewise([Element("constant", length, 0.0, 0.0)])
    return Line(piecewise(elements), flat, flat, length, 1.5, np.zeros(1), np.ones(1), np.zeros(0))


def far_along(element):
    """The element 100 km along a line, and its function of arc length from there."""
    function = piecewise([Element("constant", 1e5, element.start, element.start), element])
    return lambda s: function(1e5 + s)


@pytest.mark.parametrize("law", SHAPES)
@pytest.mark.parametrize(("start", "end"), ENDS)
def test_curvature_follows_the_law_between_any_two_values(law, start, end):
    s = np.linspace(0, LENGTH, 401)[1:-1]
    exact = start + (end - start) * SHAPES[law](s / LENGTH)
    np.testing.assert_allclose(piecewise([Element(law, LENGTH, start, end)])(s), exact, atol=1e-15)
    np.testing.assert_allclose(far_along(Element(law, LENGTH, start, end))(s), exact, atol=1e-13)


@pytest.mark.parametrize("law", SHAPES)
@pytest.mark.parametrize(("start", "end"), ENDS)
def test_every_law_turns_by_the_mean_of_its_ends(law, start, end):
    turn = line_of([Element(law, LENGTH, start, end)]).yaw(np.array(LENGTH))
    assert turn == pytest.approx(LENGTH * (start + end) / 2, abs=1e-14)


def shift(law, radius):
    """How far the circle is moved inwards: its lowest point over the tangent."""
    line = line_of([Element(law, LENGTH, 0.0, 1 / radius)])
    end = np.array(LENGTH)
    return line.position(end)[1] - radius * (1 - np.cos(line.yaw(end)))


@pytest.mark.parametrize(("law", "factor"), [("linear", 1 / 24), ("half-sine", 0.5 * (0.25 - 2 / np.pi**2))])
def test_shift_of_the_circle(law, factor):
    # The formulas are the leading terms in L/R: at a large radius nothing else is left.
    radius = 1e5
    assert shift(law, radius) == pytest.approx(factor * LENGTH**2 / radius, rel=1e-6)
    assert shift(law, RADIUS) == pytest.approx(factor * LENGTH**2 / RADIUS, rel=2e-3)


def test_the_half_sine_shift_is_length_squared_over_42_2_radius():
    assert shift("half-sine", 1e5) == pytest.approx(LENGTH**2 / (42.2 * 1e5), rel=1e-3)


def test_steepest_slope_of_the_half_sine():
    curvature = piecewise([Element("half-sine", LENGTH, 0.0, 1 / RADIUS)])
    slopes = curvature(np.linspace(0, LENGTH, 1001), 1)
    assert slopes.max() == pytest.approx(np.pi / 2 / (RADIUS * LENGTH), rel=1e-10)
    assert slopes.argmax() == 500


def test_joints_are_smooth_where_the_law_is():
    for law in ("half-sine", "sine", "bloss", "helmert"):
        slope = piecewise([Element(law, LENGTH, 0.0, 1 / RADIUS)]).derivative()
        assert np.abs(slope(np.array([0.0, LENGTH - 1e-9]))).max() < 1e-13


def cubic_parabola(length, start, end):
    """The rate c of y'' = c x, and the abscissas of both ends, by adaptive quadrature."""

    def arc(c, x):
        return quad(lambda t: np.hypot(1, c * t * t / 2), start / c, x, epsabs=1e-12, epsrel=1e-13)[0]

    gentle = (end - start) / length
    c = brentq(lambda rate: arc(rate, end / rate) - length, gentle, 1.3 * gentle, xtol=1e-18, rtol=1e-14)
    return c, start / c, end / c, arc


@pytest.mark.parametrize(("start", "end"), [*ENDS, (0.0, 1 / 160), (1 / 170, -1 / 165)])
def test_cubic_parabola_lies_on_its_cubic(start, end):
    c, x_start, x_end, arc = cubic_parabola(LENGTH, start, end)
    x = np.linspace(x_start, x_end, 9)
    s = np.array([arc(c, at) for at in x])
    line = line_of([Element("cubic-parabola", LENGTH, start, end)])
    np.testing.assert_allclose(line.curvature(s[1:-1]), (c * x / np.hypot(1, c * x**2 / 2) ** 3)[1:-1], atol=1e-13)
    heading = np.arctan(c * x_start**2 / 2)
    turn = np.array([[np.cos(heading), -np.sin(heading)], [np.sin(heading), np.cos(heading)]])
    on_cubic = np.column_stack([x - x_start, c * (x**3 - x_start**3) / 6])
    np.testing.assert_allclose(line.position(s)[:, :2] @ turn.T, on_cubic, atol=1e-9)


def test_cubic_parabola_from_a_straight_is_the_textbook_one():
    line = line_of([Element("cubic-parabola", LENGTH, 0.0, 1 / RADIUS)])
    end_x, end_y, _ = line.position(np.array(LENGTH))
    assert end_y == pytest.approx(end_x**2 / (6 * RADIUS), abs=1e-11)
    slope = end_x / (2 * RADIUS)
    assert line.yaw(np.array(LENGTH)) == pytest.approx(np.arctan(slope), abs=1e-13)
    assert line.curvature(LENGTH - 1e-9) == pytest.approx(1 / RADIUS / (1 + slope**2) ** 1.5, abs=1e-12)


def test_reversed_elements_mirror():
    for law in (*SHAPES, "cubic-parabola"):
        there = piecewise([Element(law, LENGTH, 1 / 900, 1 / 300)])
        back = piecewise([Element(law, LENGTH, 1 / 300, 1 / 900)])
        s = np.linspace(0.1, LENGTH - 0.1, 57)
        np.testing.assert_allclose(there(s), back(LENGTH - s), atol=1e-15)


def test_a_cubic_parabola_up_to_24_degrees_exists_and_a_steeper_one_does_not():
    slope = 1 / np.sqrt(5)
    c = 1 / 200**2 / (2 * slope)
    longest = quad(lambda x: np.hypot(1, c * x * x / 2), 0, 1 / 200 / c)[0]
    Element("cubic-parabola", longest * 0.999, 0.0, 1 / 200)
    with pytest.raises(ValueError, match=r"steeper than 24\.1 degrees: expected it shorter"):
        Element("cubic-parabola", longest * 1.001, 0.0, 1 / 200)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("linear", 0.0, 0.0, 1.0), "length is 0 m"),
        (("linear", -5.0, 0.0, 1.0), "length is -5 m"),
        (("linear", np.nan, 0.0, 1.0), "length is nan m"),
        (("linear", 10.0, 0.0, np.inf), "finite"),
        (("constant", 10.0, 0.0, 1.0), "expected one value"),
        (("spline", 10.0, 0.0, 1.0), "expected one of constant, linear"),
    ],
)
def test_impossible_elements_are_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        Element(*arguments)


def test_cant_over_a_cubic_parabola_is_linear():
    assert ramp_law("cubic-parabola") == "linear"
    assert ramp_law("bloss") == "bloss"


def test_position_is_exact_with_every_law_in_sharp_curves():
    laws = [*SHAPES, "cubic-parabola"]
    elements = []
    for law in laws:
        elements += [Element(law, 30.0, 0.0, 1 / 60), Element("constant", 40.0, 1 / 60, 1 / 60)]
        elements += [Element(law, 35.0, 1 / 60, -1 / 60), Element(law, 30.0, -1 / 60, 0.0)]
    line = line_of(elements)
    nodes, weights = np.polynomial.legendre.leggauss(8)
    edges = np.unique(np.concatenate([np.arange(0, line.length_m, 0.5), line.knots]))
    half = 0.5 * np.diff(edges)[:, None]
    yaw = line.yaw(edges[:-1, None] + half * (1 + nodes))
    places = np.cumsum(np.sum(half * weights * np.exp(1j * yaw), axis=1))
    np.testing.assert_allclose(line.position(edges[1:])[:, :2] @ [1, 1j], places, atol=1e-9)

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline, CubicSpline

from trackfg.numerics.hermite import hermite_at, hermite_rates, hermite_weights, spline_velocities

T = 1.7


def test_a_cubic_is_its_end_values_and_slopes() -> None:
    cubic = np.polynomial.Polynomial([2.0, -1.0, 0.7, 0.3])
    ends = np.array([cubic(0.0), cubic(T), cubic.deriv()(0.0), cubic.deriv()(T)])
    f = np.linspace(0.0, 1.0, 11)
    np.testing.assert_allclose(ends @ np.array(hermite_weights(f, np.full(11, T))), cubic(f * T), atol=1e-12)
    np.testing.assert_allclose(ends @ np.array(hermite_rates(f, np.full(11, T))), cubic.deriv()(f * T), atol=1e-12)


@pytest.mark.usefixtures("kernels")
def test_cubics_between_many_places_are_those_of_scipy() -> None:
    rng = np.random.default_rng(2)
    times = np.cumsum(rng.uniform(0.1, 2.0, 50))
    places, velocities = rng.standard_normal((2, 50))
    t = np.sort(np.append(rng.uniform(times[0], times[-1], 200), times))
    expected = CubicHermiteSpline(times, places, velocities)(t)
    np.testing.assert_allclose(hermite_at(t, times, places, velocities), expected, atol=1e-12)


@pytest.mark.usefixtures("kernels")
def test_cubics_go_on_beyond_both_ends_whatever_the_order_of_the_times() -> None:
    times, t = np.array([0.0, 1.0, 3.0]), np.array([4.0, 0.5, 3.0, -1.0, 2.0, 1.0, np.nan])
    places, velocities = np.array([[0.0, 1.0, 27.0], [5.0, 5.0, 5.0]]), np.array([[0.0, 3.0, 27.0], [0.0, 0.0, 0.0]])
    np.testing.assert_allclose(hermite_at(t, times, places, velocities), [t**3, 5.0 + 0.0 * t], atol=1e-12)


@pytest.mark.usefixtures("kernels")
@pytest.mark.parametrize("count", [4, 5, 60])
def test_splines_are_those_of_scipy(count: int) -> None:
    rng = np.random.default_rng(count)
    times = np.cumsum(rng.uniform(0.5, 2.0, count))
    places = 1e4 + rng.standard_normal((3, 2, count))
    t = np.linspace(times[0], times[-1], 300)
    expected = CubicSpline(times, places, axis=-1)(t)
    np.testing.assert_allclose(hermite_at(t, times, places, spline_velocities(times, places)), expected, atol=1e-10)

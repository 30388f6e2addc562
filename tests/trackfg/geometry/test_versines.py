"""Versines of any chord: responses, the published table, circles, uniformity."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from trackfg.errors import BadInputError
from trackfg.geometry.versines import uniformity_deviation, uniformity_deviation_response, versine, versine_response

FOOT = 0.3048
TABLE_M = (5, 6, 8, 10, 15, 20, 25, 30, 40, 50, 70, 100, 150, 200)


@given(st.floats(0.6, 300.0), st.integers(1, 60), st.integers(1, 60))
@settings(deadline=None, max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_a_wave_comes_out_with_the_response(
    measured_response: Callable[..., np.ndarray], wavelength: float, p: int, q: int
) -> None:
    behind, ahead = p * 0.25, q * 0.25
    measured = measured_response(lambda y: versine(y, 0.25, behind, ahead), wavelength, length_m=60.0)
    np.testing.assert_allclose(measured, versine_response(wavelength, behind, ahead), atol=1e-10)


@pytest.mark.parametrize(
    ("chord_m", "gains"),
    [
        (10.0, (0, 0.50, 1.71, 2.0, 1.5, 1.0, 0.69, 0.50, 0.29, 0.19, 0.099, 0.049, 0.022, 0.012)),
        (40.0, (0, 1.5, 2.0, 0, 1.5, 0, 0.69, 1.5, 2.0, 1.81, 1.22, 0.69, 0.33, 0.19)),
        (31 * FOOT, (0.06, 0.77, 1.84, 1.99, 1.40, 0.91, 0.63, 0.45, 0.26, 0.17, 0.089, 0.044, 0.020, 0.011)),
        (62 * FOOT, (0.23, 1.89, 0.58, 0.06, 1.69, 1.99, 1.72, 1.40, 0.91, 0.63, 0.34, 0.17, 0.077, 0.044)),
    ],
)
def test_symmetrical_chords_have_the_gains_of_the_table(chord_m: float, gains: tuple[float, ...]) -> None:
    response = versine_response(TABLE_M, chord_m / 2.0, chord_m / 2.0)
    np.testing.assert_allclose(response.imag, 0.0, atol=1e-12)
    np.testing.assert_allclose(response.real, gains, atol=0.0051)  # as the table is rounded


def test_the_eccentric_chord_of_the_literature() -> None:
    """|H| from A and B of the eccentric offset formula."""
    p, q, wavelength = 2.5, 7.5, 13.0
    w = 2.0 * np.pi / wavelength
    a = 1.0 - (p * np.cos(w * q) + q * np.cos(w * p)) / (p + q)
    b = (q * np.sin(w * p) - p * np.sin(w * q)) / (p + q)
    assert abs(versine_response(wavelength, p, q)) == pytest.approx(np.hypot(a, b))


def test_a_left_hand_circle_reads_12500_over_radius_negative() -> None:
    radius = 800.0
    x = np.arange(0.0, 100.0, 0.25)
    circle = radius - np.sqrt(radius**2 - (x - 50.0) ** 2)  # to the left, positive
    measured = versine(circle, 0.25)[200]
    assert measured == pytest.approx(-12.5 / radius, rel=1e-4)


def test_the_chord_must_fit_the_profile_and_the_step() -> None:
    v = versine(np.zeros((2, 50)), 0.25, 2.5, 5.0)
    assert np.isnan(v[:, :10]).all()
    assert np.isnan(v[:, 30:]).all()
    assert (v[:, 10:30] == 0.0).all()
    with pytest.raises(BadInputError, match=r"behind_m is 4\.7244 m"):
        versine(np.zeros(100), 0.25, 31 * FOOT / 2, 31 * FOOT / 2)


@pytest.mark.parametrize("wavelength", [6.0, 10.0, 23.0, 60.0])
def test_uniformity_is_the_mean_of_nine(measured_response: Callable[..., np.ndarray], wavelength: float) -> None:
    measured = measured_response(lambda v: uniformity_deviation(v, 0.25, 20.0), wavelength)
    np.testing.assert_allclose(measured, uniformity_deviation_response(wavelength, 20.0), atol=1e-12)
    assert uniformity_deviation_response(np.inf, 20.0) == pytest.approx(0.0)

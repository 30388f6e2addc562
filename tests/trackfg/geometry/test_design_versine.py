"""The design's versine, from its curvature and from the versines alone."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from trackfg.geometry.design_versine import design_versine, design_versine_response, running_design_versine
from trackfg.geometry.versines import versine

STEP = 0.25


@pytest.fixture(scope="module")
def curve() -> np.ndarray:
    """Straight, clothoid of 60 m, circle of 400 m to the left, clothoid, straight."""
    x = np.arange(0.0, 800.0, STEP)
    return np.interp(x, [200.0, 260.0, 500.0, 560.0], [0.0, 1 / 400, 1 / 400, 0.0])


@pytest.mark.parametrize(("behind", "ahead"), [(5.0, 5.0), (2.5, 7.5)])
def test_the_design_explains_the_versines_of_its_own_line(curve: np.ndarray, behind: float, ahead: float) -> None:
    # The double integral of a curvature that is straight between the steps, exactly.
    slope = np.concatenate([[0.0], np.cumsum(0.5 * STEP * (curve[1:] + curve[:-1]))])
    steps_of_y = STEP * slope[:-1] + STEP**2 * (2.0 * curve[:-1] + curve[1:]) / 6.0
    y = np.concatenate([[0.0], np.cumsum(steps_of_y)])
    rest = versine(y, STEP, behind, ahead) - design_versine(curve, STEP, behind, ahead)
    assert np.nanmax(np.abs(rest)) < 1e-11
    assert design_versine(curve, STEP, behind, ahead)[1500] == pytest.approx(-0.5 * behind * ahead / 400, rel=1e-9)


@pytest.mark.parametrize("wavelength", [8.0, 13.0, 50.0, 300.0])
def test_a_wave_of_curvature_comes_out_with_the_response(
    measured_response: Callable[..., np.ndarray], wavelength: float
) -> None:
    measured = measured_response(lambda k: design_versine(k, STEP, 2.5, 7.5), wavelength)
    expected = design_versine_response(wavelength, 2.5, 7.5)
    np.testing.assert_allclose(measured, expected, atol=2e-3 * abs(design_versine_response(np.inf, 2.5, 7.5)))
    assert design_versine_response(np.inf) == -12.5


def test_holes_and_short_designs() -> None:
    k = np.zeros((2, 200))
    k[1, 100] = np.nan
    out = design_versine(k, STEP)
    assert np.isfinite(out[0, 21:-21]).all()
    assert np.flatnonzero(np.isnan(out[1, 21:-21])).tolist() == list(range(58, 101))
    assert np.isnan(design_versine(k[:, :42], STEP)).all()


def test_the_running_estimate_follows_the_curve_and_leaves_the_fault(curve: np.ndarray) -> None:
    designed = design_versine(curve, STEP)
    x = np.arange(len(curve)) * STEP
    fault = 10e-3 * np.exp(-0.5 * ((x - 380.0) / 2.0) ** 2)
    measured = designed + fault + 1e-3 * np.sin(2.0 * np.pi * x / 12.0)
    estimate = running_design_versine(np.stack([measured, measured]), STEP)
    known = np.isfinite(estimate[0])
    assert known[200:-200].all()
    assert not known[:150].any()
    error = np.abs(estimate[0] - designed)[known]
    assert error.max() < 6e-3  # of 31 mm, where the transitions begin and end
    assert np.abs(estimate[0] - designed)[1450:1600].max() < 1e-3  # at the fault of 10 mm
    np.testing.assert_array_equal(estimate[0], estimate[1])


def test_a_hole_in_the_versines_is_a_hole_in_the_estimate() -> None:
    v = np.zeros(1000)
    v[500] = np.nan
    out = running_design_versine(v, STEP, 20.0, 10.0)
    assert np.isnan(out[440:561]).all()
    assert np.isfinite(out[60:440]).all()

"""Moving-average baselines and their responses, sampled and continuous."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from trackfg.errors import BadInputError
from trackfg.geometry.moving_average import (
    ALIGNMENT_WINDOWS_M,
    baseline_removed_response,
    moving_average,
    moving_average_response,
    remove_baseline,
)

WAVELENGTHS_M = (10, 20, 25, 40, 50, 70, 100)


@given(st.floats(0.6, 300.0))
@settings(deadline=None, max_examples=40, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_a_wave_comes_out_with_the_sampled_response(
    measured_response: Callable[..., np.ndarray], wavelength: float
) -> None:
    single = measured_response(lambda y: moving_average(y, 0.25, 24.0), wavelength, length_m=80.0)
    np.testing.assert_allclose(single, moving_average_response(wavelength, 24.0, 0.25), atol=1e-11)
    double = measured_response(lambda y: remove_baseline(y, 0.25, ALIGNMENT_WINDOWS_M), wavelength, length_m=80.0)
    np.testing.assert_allclose(double, baseline_removed_response(wavelength, ALIGNMENT_WINDOWS_M, 0.25), atol=1e-11)


def test_the_gains_of_the_baselines_in_use() -> None:
    np.testing.assert_allclose(
        baseline_removed_response(WAVELENGTHS_M), (0.87, 1.16, 0.96, 0.50, 0.34, 0.18, 0.09), atol=0.0056
    )
    np.testing.assert_allclose(
        baseline_removed_response(WAVELENGTHS_M, ALIGNMENT_WINDOWS_M),
        (1.01, 1.02, 0.99, 0.65, 0.47, 0.27, 0.14),
        atol=0.0056,
    )


def test_at_a_quarter_metre_sampled_and_continuous_agree() -> None:
    wavelengths = np.array([*np.geomspace(8.0, 500.0, 200), np.inf])
    np.testing.assert_allclose(
        moving_average_response(wavelengths, 24.0, 0.25), moving_average_response(wavelengths, 24.0), atol=1e-3
    )
    assert moving_average_response(np.inf, 24.0, 0.25) == 1.0


def test_a_line_is_its_own_baseline_far_from_zero() -> None:
    y = 1e5 + 3e-3 * np.arange(400_000) * 0.25
    out = remove_baseline(y, 0.25, ALIGNMENT_WINDOWS_M)
    assert np.nanmax(np.abs(out)) < 1e-9
    assert np.isnan(out[: 12 * 4 + 9 * 4]).all()
    assert np.isfinite(out[12 * 4 + 9 * 4 : -84]).all()


def test_a_hole_spreads_by_half_a_window_and_no_further() -> None:
    y = np.zeros((2, 400))
    y[1, 200] = np.nan
    out = moving_average(y, 0.25, 5.0)
    assert np.isfinite(out[0, 10:-10]).all()
    assert np.flatnonzero(np.isnan(out[1, 10:-10])).tolist() == list(range(180, 201))


def test_too_short_a_profile_has_no_baseline_and_odd_windows_are_refused() -> None:
    assert np.isnan(moving_average(np.zeros(40), 0.25, 24.0)).all()
    with pytest.raises(BadInputError, match="half of window_m"):
        moving_average(np.zeros(400), 0.25, 24.3)

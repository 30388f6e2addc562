"""Resampling: waves kept, noise not folded back, holes and ends unknown, any order of samples."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from trackfg.errors import BadInputError
from trackfg.geometry.resampling import resample, resample_computed, resampling_response


def places(length_m: float, spacing_m: float, seed: int = 0) -> np.ndarray:
    """About ``spacing_m`` apart, irregularly, and not quite in order where they are dense."""
    x = np.arange(0.0, length_m, spacing_m)
    return x + np.random.default_rng(seed).normal(0.0, max(0.2 * spacing_m, 1e-3), len(x))


@pytest.mark.parametrize(
    ("spacing", "wavelength"),
    [*itertools.product((0.002, 0.01, 0.03, 0.05, 0.1), (1.0, 1.7, 5.0, 25.0, 100.0)), (0.2, 2.0), (0.2, 5.0)],
)
def test_waves_from_one_metre_keep_amplitude_and_phase(spacing: float, wavelength: float) -> None:
    x = places(60.0, spacing)
    grid, out = resample(x, np.sin(2.0 * np.pi * x / wavelength + 0.4))
    np.testing.assert_array_equal(grid, np.round(grid / 0.25) * 0.25)
    known = np.isfinite(out)
    assert known.sum() > 150
    assert np.abs(out - np.sin(2.0 * np.pi * grid / wavelength + 0.4))[known].max() < 0.01


@pytest.mark.parametrize("spacing", [0.002, 0.03, 0.2])
def test_a_kernel_resamples_as_arrays_do(
    spacing: float, with_both: Callable[[Callable[[], Any]], tuple[np.ndarray, np.ndarray]]
) -> None:
    x = places(1200.0, spacing)
    rows = 1e3 + np.stack([np.sin(x), 1e-4 * x**2, np.random.default_rng(1).normal(size=len(x))]).reshape(3, 1, -1)
    compiled, arrays = with_both(lambda: resample(x, rows)[1])
    np.testing.assert_allclose(compiled, arrays, rtol=0.0, atol=1e-10)


@pytest.mark.usefixtures("kernels")
@pytest.mark.parametrize("noise", [0.0, 1.0])
def test_values_that_are_computed_as_needed_are_resampled_as_those_in_memory(noise: float) -> None:
    """In order of the places, and out of order."""
    x = noise * places(1200.0, 0.03) + (1.0 - noise) * np.arange(0.0, 1200.0, 0.03)
    rows = np.stack([np.sin(x), x])
    grid, out = resample_computed(x, lambda samples: rows[:, samples], 2, 0.25)
    expected_grid, expected = resample(x, rows)
    np.testing.assert_array_equal(grid, expected_grid)
    np.testing.assert_array_equal(out, expected)


@pytest.mark.parametrize("wavelength", [0.5, 0.6, 0.7, 0.8])
def test_shorter_waves_come_out_with_the_response(wavelength: float) -> None:
    x = places(60.0, 0.02)
    grid, out = resample(x, np.sin(2.0 * np.pi * x / wavelength + 0.4))
    expected = resampling_response(wavelength) * np.sin(2.0 * np.pi * grid / wavelength + 0.4)
    assert np.nanmax(np.abs(out - expected)) < 0.007


def test_the_response_passes_and_stops() -> None:
    np.testing.assert_allclose(resampling_response(np.geomspace(0.8, 1e4, 300)), 1.0, atol=1.3e-3)
    np.testing.assert_allclose(resampling_response(np.geomspace(0.0625, 0.5, 300)), 0.0, atol=1.3e-3)
    assert resampling_response(1.6, 0.5) == pytest.approx(resampling_response(0.8, 0.25))


@pytest.mark.parametrize(("wavelength", "left"), [(0.45, 2e-3), (0.3, 2e-3), (0.15, 0.03), (0.08, 0.03), (0.032, 0.04)])
def test_what_the_grid_cannot_show_does_not_fold_back(wavelength: float, left: float) -> None:
    x = np.arange(0.0, 60.0, 0.004)
    _, out = resample(x, np.sin(2.0 * np.pi * x / wavelength))
    assert np.nanmax(np.abs(out)) < left


def test_white_noise_is_averaged_over_the_samples() -> None:
    x = np.arange(0.0, 200.0, 0.004)
    noise = np.random.default_rng(3).normal(size=len(x))
    _, out = resample(x, noise)
    bandwidth = 2.0 / 0.62 * 0.004  # two-sided, half gain at 0.62 m
    assert np.nanstd(out) == pytest.approx(np.sqrt(bandwidth), rel=0.1)


def test_a_long_halt_does_no_harm() -> None:
    rng = np.random.default_rng(4)
    moving = np.arange(0.0, 40.0, 0.05)
    x = np.concatenate([moving[:400], np.full(5000, moving[400]) + rng.normal(0.0, 1e-4, 5000), moving[400:]])
    y = np.sin(2.0 * np.pi * x / 5.0) + rng.normal(0.0, 1e-3, len(x))
    grid, out = resample(x, y)
    assert np.nanmax(np.abs(out - np.sin(2.0 * np.pi * grid / 5.0))) < 6e-3


def test_rows_are_alike_and_large_values_stay_exact() -> None:
    x = places(100.0, 0.05)
    y = np.stack([3.0 + 0.0 * x, 5e4 + 1e-3 * x, 1e4 + x**2 / 600.0])
    grid, out = resample(x, y)
    known = np.isfinite(out[0])
    np.testing.assert_allclose(out[0, known], 3.0, rtol=1e-13)
    np.testing.assert_allclose(out[1, known], 5e4 + 1e-3 * grid[known], rtol=0, atol=1e-8)
    np.testing.assert_allclose(out[2, known], 1e4 + grid[known] ** 2 / 600.0, rtol=0, atol=1e-5)


def test_holes_and_ends_are_unknown_as_far_as_the_filter_reaches() -> None:
    x = np.concatenate([np.arange(0.0, 30.0, 0.1), np.arange(32.0, 60.0, 0.1)])
    grid, out = resample(x, np.ones_like(x))
    reach = 2.4375  # half of the low-pass, 78 cells of 1/32 m
    inside = (grid >= reach) & (grid <= x[-1] - reach)
    hole = (grid > 29.9 - reach) & (grid < 32.0 + reach)
    np.testing.assert_array_equal(np.isfinite(out), inside & ~hole)
    np.testing.assert_allclose(out[inside & ~hole], 1.0)
    _, bridged = resample(x, np.ones_like(x), max_hole_m=3.0)
    np.testing.assert_array_equal(np.isfinite(bridged), inside)


def test_samples_without_a_value_are_left_out() -> None:
    x = np.arange(0.0, 30.0, 0.1)
    y = np.stack([x, 2.0 * x])
    y[1, 150] = np.nan
    grid, out = resample(x, y)
    known = np.isfinite(out).all(axis=0)
    assert known.sum() > 90
    np.testing.assert_allclose(out[:, known], [grid[known], 2.0 * grid[known]], atol=1e-9)


def test_what_cannot_be_resampled_is_refused() -> None:
    with pytest.raises(BadInputError, match="at least 4"):
        resample([0.0, 1.0, 1.0], [0.0, 1.0, 1.0])
    with pytest.raises(BadInputError, match="sample 2 is not finite"):
        resample([0.0, np.nan], [0.0, 1.0])
    with pytest.raises(BadInputError, match="one column of values per place"):
        resample([0.0, 1.0], [0.0])
    with pytest.raises(BadInputError, match="step_m"):
        resample([0.0, 1.0], [0.0, 1.0], 0.0)
    grid, out = resample(np.arange(5) * 0.04 + 0.01, np.zeros(5))  # no whole multiple of the step among them
    assert len(grid) == len(out) == 0

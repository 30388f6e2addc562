"""Bands D0 to D3: ideal and realised gains, ends, holes, curves kilometres long."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from trackfg.errors import BadInputError
from trackfg.geometry.bands import BANDS, D1, D2, Band, band_pass, band_response, end_margin_m, realised_band_response

STEP = 0.25


@pytest.mark.parametrize("name", BANDS)
def test_the_gain_is_that_of_a_butterworth_band_pass_both_ways(name: str) -> None:
    signal = pytest.importorskip("scipy.signal")
    band = BANDS[name]
    edges = [2.0 * np.pi / band.longest_m, 2.0 * np.pi / band.shortest_m]
    b, a = signal.butter(4, edges, "bandpass", analog=True)
    wavelengths = np.geomspace(band.shortest_m / 3.0, band.longest_m * 3.0, 200)
    _, h = signal.freqs(b, a, 2.0 * np.pi / wavelengths)
    np.testing.assert_allclose(band_response(wavelengths, band), np.abs(h) ** 2, atol=1e-6)
    np.testing.assert_allclose(band_response([band.shortest_m, band.longest_m], band), 0.5)
    assert band_response(np.inf, band) == 0.0
    assert band_response(np.sqrt(band.shortest_m * band.longest_m), band) == pytest.approx(1.0)


@pytest.mark.parametrize("name", BANDS)
def test_the_realised_response_is_the_ideal_one(name: str) -> None:
    band = BANDS[name]
    wavelengths = np.array([*np.geomspace(2.0 * STEP, 30.0 * band.longest_m, 300), np.inf])
    realised = realised_band_response(wavelengths, STEP, band)
    np.testing.assert_allclose(realised, band_response(wavelengths, band), atol=1e-4)


@pytest.mark.parametrize("wavelength", [2.0, 3.0, 7.3, 10.0, 25.0, 40.0, 200.0])
def test_a_wave_comes_out_with_the_gain_and_in_phase(
    measured_response: Callable[..., np.ndarray], wavelength: float
) -> None:
    measured = measured_response(lambda y: band_pass(y, STEP, D1), wavelength, length_m=700.0)
    inner = measured[len(measured) // 2 - 200 : len(measured) // 2 + 200]
    np.testing.assert_allclose(inner, band_response(wavelength, D1), atol=1e-4)
    # The continuation beyond the ends costs at most what is promised.
    np.testing.assert_allclose(measured, band_response(wavelength, D1), atol=0.03)


def test_a_circle_kilometres_long_has_no_part_in_a_band() -> None:
    x = np.arange(80_000) * STEP
    wave = 1e-3 * np.sin(2.0 * np.pi * x / 10.0)
    out = band_pass(1e4 + 0.5 * x**2 / 300.0 + wave, STEP, D1)
    margin = round(end_margin_m(STEP, D1) / STEP)
    assert np.isnan(out[:margin]).all()
    assert np.isnan(out[-margin:]).all()
    np.testing.assert_allclose(out[margin:-margin], wave[margin:-margin], atol=2e-5)  # 2 % at the ends
    np.testing.assert_allclose(out[2000:-2000], wave[2000:-2000], atol=1e-7)


def test_a_hole_is_an_end_and_counts_for_every_row() -> None:
    y = np.random.default_rng(0).normal(size=(2, 3, 3000)).cumsum(axis=-1)
    whole = band_pass(y, STEP, D1)
    holed = y.copy()
    holed[0, 1, 1500] = np.nan
    out = band_pass(holed, STEP, D1)
    margin = round(end_margin_m(STEP, D1) / STEP)
    assert np.isnan(out[..., 1500 - margin : 1501 + margin]).all()
    assert np.isfinite(out[..., margin : 1500 - margin]).all()
    near = out[..., margin : 1500 - margin] - whole[..., margin : 1500 - margin]
    assert near.std() < 0.02 * np.nanstd(whole)


def test_runs_too_short_have_no_values() -> None:
    assert np.isnan(band_pass(np.zeros((2, 400)), STEP, D1)).all()
    assert end_margin_m(STEP, D1) < 55.0
    assert end_margin_m(STEP, D2) < 170.0


def test_bands_may_be_any_but_must_be_longer_than_two_steps() -> None:
    band = Band(2.0, 30.0)
    wavelengths = np.geomspace(1.0, 100.0, 50)
    np.testing.assert_allclose(
        realised_band_response(wavelengths, 0.5, band), band_response(wavelengths, band), atol=1e-4
    )
    with pytest.raises(BadInputError, match="0 < shortest < longest"):
        Band(25.0, 3.0)
    with pytest.raises(BadInputError, match="step_m"):
        band_pass(np.zeros(100), 2.0, D1)

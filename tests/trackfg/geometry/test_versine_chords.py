"""Versines over another chord come from a band and a versine: every wave from the shortest of the band on."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from trackfg.errors import BadInputError
from trackfg.geometry.bands import D1, D2, Band, band_pass
from trackfg.geometry.versine_chords import versine_over, with_further_chords
from trackfg.geometry.versines import versine

STEP = 0.25
X = STEP * np.arange(4800)
FEET_31, FEET_124 = 9.4488, 37.7952


def over(profile: np.ndarray, chord_m: float) -> np.ndarray:
    """Return the versines over a chord of a profile, estimated from its part in D1 and its versines over 10 m."""
    return versine_over(band_pass(profile, STEP, D1), versine(profile, STEP), STEP, D1, (10.0, chord_m))


@pytest.mark.parametrize("chord_m", [FEET_31, 2 * FEET_31, FEET_124, 20.0])
@pytest.mark.parametrize("wavelength_m", [5.0, 7.3, 10.0, 18.0, 31.0, 70.0, 400.0])
def test_a_wave_has_the_versine_of_its_chord(chord_m: float, wavelength_m: float) -> None:
    phase = 2.0 * np.pi * X / wavelength_m
    expected = (1.0 - np.cos(np.pi * chord_m / wavelength_m)) * np.sin(phase)
    error = over(np.sin(phase), chord_m) - expected
    assert np.isfinite(error).sum() > 3000
    assert np.nanmax(np.abs(error)) < 0.015


def test_a_circle_has_the_versine_of_its_chord() -> None:
    offset = over(0.5 * X**2 / 500.0, FEET_124)
    assert np.nanmean(offset) == pytest.approx(-(FEET_124**2) / 8.0 / 500.0, rel=1e-3)
    assert np.nanstd(offset) < 1e-8


def test_waves_shorter_than_the_band_are_left_out() -> None:
    assert np.nanmax(np.abs(over(np.sin(2.0 * np.pi * X / 1.5), FEET_31))) < 0.05


def test_a_hole_stays_one() -> None:
    profile = np.sin(X / 3.0)
    profile[2000] = np.nan
    assert np.isnan(over(profile, 20.0)[2000 - 200 : 2000 + 200]).all()


def test_what_the_two_do_not_show_is_refused() -> None:
    nothing = np.zeros(10)
    with pytest.raises(
        BadInputError, match="band from 25 to 70 m has no waves of 5 m, which a versine over 10 m lacks"
    ):
        versine_over(nothing, nothing, STEP, D2, (10.0, 20.0))
    with pytest.raises(BadInputError, match="chord of 50 m: versines over 10 m determine chords to 40 m"):
        versine_over(nothing, nothing, STEP, D1, (10.0, 50.0))


def test_a_table_gets_what_its_columns_tell() -> None:
    zero = np.zeros(1000)
    table = pd.DataFrame({"level_mm": zero, "versine_level_mm": zero, "alignment_left_mm": zero})
    assert list(with_further_chords(table, STEP, D1, 10.0, [20.0]))[3:] == ["versine_level_20m_mm"]
    assert list(with_further_chords(table, STEP, D1, 10.0, [50.0]))[3:] == []
    assert list(with_further_chords(table, STEP, Band(25.0, 70.0), 10.0, [20.0]))[3:] == []

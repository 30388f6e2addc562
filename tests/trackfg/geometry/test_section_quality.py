from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from trackfg.errors import BadInputError
from trackfg.geometry.bands import D1, D2, D3, Band, band_pass, band_response
from trackfg.geometry.section_quality import index_channels, section_quality
from trackfg.geometry.versine_bands import band_of_versine, with_long_bands
from trackfg.geometry.versines import versine

STEP = 0.25


@pytest.mark.parametrize("band", [D2, D3])
@pytest.mark.parametrize("wavelength", [18.0, 25.0, 40.0, 70.0, 100.0, 150.0, 300.0])
def test_a_wave_comes_out_of_its_versine_with_the_bands_response(band: Band, wavelength: float) -> None:
    x = STEP * np.arange(16_000)
    wave = 3.0 * np.sin(2.0 * np.pi * x / wavelength)
    found = band_of_versine(versine(wave, STEP, 5.0, 5.0), STEP, 10.0, band)
    known = np.isfinite(found)
    assert known.sum() > 4000
    np.testing.assert_allclose(found[known], band_response(wavelength, band) * wave[known], atol=0.01)


def test_it_is_the_band_of_the_profile() -> None:
    rng = np.random.default_rng(2)
    profile = np.cumsum(np.cumsum(0.01 * rng.standard_normal(12_000)))
    table = pd.DataFrame({"chainage_m": STEP * np.arange(len(profile))})
    for quantity in ("level", "alignment"):
        table[f"versine_{quantity}_mm"] = versine(profile, STEP, 5.0, 5.0)
    bands = with_long_bands(table, STEP, 10.0)
    expected = band_pass(profile, STEP, D2)
    both = np.isfinite(expected) & bands["level_d2_mm"].notna().to_numpy()
    assert both.sum() > 8000
    np.testing.assert_allclose(bands["level_d2_mm"][both], expected[both], atol=2e-3 * np.std(expected[both]))
    with pytest.raises(BadInputError, match="shows waves from 20 m on"):
        band_of_versine(profile, STEP, 10.0, D1)


def test_the_index_is_the_sum_of_seven_standard_deviations() -> None:
    rng = np.random.default_rng(3)
    x = STEP * np.arange(2000)
    names = ("level_left", "level_right", "alignment_left", "alignment_right", "gauge", "cross_level", "twist", "level")
    table = pd.DataFrame({"chainage_m": x} | {f"{n}_mm": k * rng.standard_normal(len(x)) for k, n in enumerate(names)})
    channels = [name for name in table if name != "chainage_m"]
    beyond = {"twist": np.abs(table["twist_mm"].to_numpy()) > 6.0}
    sections = section_quality(table, channels, beyond=beyond)
    assert sections["from_m"].tolist() == [0.0, 200.0, 400.0]
    row, part = sections.iloc[0], table.iloc[:800]
    assert row["sd_twist_mm"] == pytest.approx(part["twist_mm"].std(ddof=0))
    assert row["tqi"] == pytest.approx(sum(part[f"{name}_mm"].std(ddof=0) for name in names[:-1]))
    assert row["share_beyond_twist"] == pytest.approx((part["twist_mm"].abs() > 6.0).mean())
    assert index_channels(["level_mm", "alignment_mm", "twist_mm"]) == ("level_mm", "alignment_mm", "twist_mm")

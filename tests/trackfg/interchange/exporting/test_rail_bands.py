"""The bands of the rails are those of their own profiles."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from trackfg.geometry.bands import BANDS, band_pass
from trackfg.geometry.versine_bands import with_long_bands
from trackfg.geometry.versines import versine
from trackfg.interchange.exporting.rail_bands import with_rail_bands

STEP, CHORD, BASE = 0.25, 10.0, 3.0


@pytest.mark.parametrize(("quantity", "apart"), [("level", "cross_level_mm"), ("alignment", "gauge_mm")])
def test_a_rail_s_bands_are_those_of_its_profile(quantity: str, apart: str) -> None:
    x = STEP * np.arange(24_000)
    waves = np.random.default_rng(4).uniform(0.5, 3.0, (2, 5, 2))
    rails = [
        sum(
            a * np.sin(2.0 * np.pi * x / length + p)
            for (a, p), length in zip(own, (8.0, 15.0, 40.0, 60.0, 110.0), strict=True)
        )
        for own in waves
    ]
    left, right = rails
    nominal = 1435.0 if apart == "gauge_mm" else 30.0
    centre = 0.5 * (left + right)
    geometry = pd.DataFrame(
        {"chainage_m": x, f"{quantity}_mm": band_pass(centre, STEP, BANDS["D1"]), apart: left - right + nominal}
    )
    for name in ("level", "alignment"):
        geometry[f"versine_{name}_mm"] = versine(centre, STEP, CHORD / 2.0, CHORD / 2.0)

    table = with_rail_bands(with_long_bands(geometry, STEP, CHORD), STEP, BASE)

    for side, profile in (("left", left), ("right", right)):
        for key in ("D1", "D2", "D3"):
            own, expected = table[f"{quantity}_{side}_{key.lower()}_mm"], band_pass(profile, STEP, BANDS[key])
            both = np.isfinite(own) & np.isfinite(expected)
            assert both.sum() > 8000
            np.testing.assert_allclose(own[both], expected[both], atol=0.1)  # the bands' tails are cut off differently


def test_a_cross_level_over_another_base_is_brought_to_the_rails() -> None:
    """Rails 1.067 m apart and a cross-level on 1.5 m: half of what is between the rails, not of the larger number."""
    x = STEP * np.arange(4000)
    wave = 3.0 * np.sin(2.0 * np.pi * x / 40.0)
    geometry = pd.DataFrame({"chainage_m": x, "level_d2_mm": 0.0 * x, "cross_level_mm": wave * 1.5 / 1.067})
    table = with_rail_bands(geometry, STEP, BASE, tops_over_base=1.067 / 1.5)
    expected = 0.5 * band_pass(wave, STEP, BANDS["D2"])
    np.testing.assert_allclose(table["level_left_d2_mm"], expected, atol=1e-9)
    np.testing.assert_allclose(table["level_right_d2_mm"], -expected, atol=1e-9)


def test_a_rail_that_was_measured_by_itself_keeps_its_band() -> None:
    x = STEP * np.arange(4000)
    flat = pd.DataFrame(
        dict.fromkeys(("level_mm", "alignment_mm", "cross_level_mm", "level_left_mm", "level_right_mm"), 0.0 * x)
    )
    table = with_rail_bands(flat.assign(chainage_m=x), STEP, BASE)
    assert "level_left_d1_mm" not in table
    assert not [name for name in table if name.startswith("alignment_left")]  # without a gauge

"""The sigmas of long bands: white errors of the curvature, and what a simulated run's errors are."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from trackfg.datasets.scenarios import simulate
from trackfg.evaluation.geometry_errors import geometry_errors
from trackfg.geometry.bands import BANDS, band_pass, band_variance
from trackfg.geometry.versine_bands import with_long_bands
from trackfg.geometry.versines import versine
from trackfg.interchange.exporting.rail_bands import with_rail_bands
from trackfg.results.result import Result
from trackfg.smoothing.smoother import smooth

STEP, CHORD = 0.25, 10.0


def test_of_white_errors_of_the_curvature_bands_have_their_sigmas() -> None:
    rng = np.random.default_rng(0)
    profile = np.cumsum(np.cumsum(rng.standard_normal(200_000))) * STEP**1.5
    table = pd.DataFrame({"chainage_m": STEP * np.arange(len(profile))})
    for name in ("level", "alignment"):
        column = f"versine_{name}_mm"
        table[column] = versine(profile, STEP, 0.5 * CHORD, 0.5 * CHORD)
        table[f"{column}_sd"] = table[column].std()
    assert table["versine_level_mm_sd"].iloc[0] == pytest.approx(np.sqrt(CHORD**3 / 48.0), rel=0.02)
    bands = with_long_bands(table, STEP, CHORD)
    for name in ("level_d2_mm", "level_d3_mm"):
        assert bands[name].std() == pytest.approx(bands[f"{name}_sd"].dropna().iloc[0], rel=0.1)


def test_of_a_white_slope_bands_have_their_variance() -> None:
    rng = np.random.default_rng(1)
    profile = np.cumsum(rng.standard_normal(200_000)) * np.sqrt(STEP)
    for key in ("D1", "D2"):
        spread = np.nanvar(band_pass(profile, STEP, BANDS[key]))
        assert spread == pytest.approx(band_variance(BANDS[key], 1) / np.pi, rel=0.1)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["mainline", "measuring-car"])
def test_errors_of_a_run_are_within_the_sigmas(name: str) -> None:
    run = simulate(name, seed=1, duration_s=250.0)
    result: Result = smooth(run.recording)
    meaning = result.summary.geometry

    def with_bands(geometry: pd.DataFrame) -> pd.DataFrame:
        long = with_long_bands(geometry, meaning.step_m, meaning.chord_m)
        return with_rail_bands(long, meaning.step_m, meaning.twist_base_m)

    errors = geometry_errors(with_bands(result.geometry), result.trajectory, run.truth, with_bands(run.truth_geometry))
    names = [f"{column}_sd" for column in errors if column.endswith(("_d2_mm", "_d3_mm"))]
    assert len(names) >= 8
    for sd in names:
        ratio = (errors[sd.removesuffix("_sd")] / errors[sd]).dropna()
        assert len(ratio) > 1000
        assert 0.3 < np.sqrt(np.mean(ratio**2)) < 1.3

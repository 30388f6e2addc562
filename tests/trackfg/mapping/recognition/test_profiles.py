from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from trackfg.mapping.recognition.profiles import (
    cell_means,
    clipped,
    forward_mean,
    irregularity,
    profile_of,
    short_waves,
)


def test_rows_stand_where_their_chainage_says() -> None:
    table = pd.DataFrame({"chainage_m": [-0.75, 0.0, 0.25, 1.5], "versine_level_mm": [1.0, 2.0, 3.0, 4.0]})
    profile = profile_of(table, ["versine_level_mm"], 0.25, "run")
    values = profile.features["versine_level_mm"]
    assert (profile.first, profile.first_cell, profile.rows) == (-4, -1, 12)
    assert values[[1, 4, 5, 10]].tolist() == [1.0, 2.0, 3.0, 4.0]
    assert np.isnan(values).sum() == 8
    assert profile.claimed_variance("versine_level_mm") == 0.0


def test_short_waves_have_no_constant_and_no_slope_but_short_waves() -> None:
    x = np.arange(300.0)
    wave = np.sin(2.0 * np.pi * x / 8.0)
    assert np.nanmax(np.abs(short_waves(3.0 + 0.2 * x))) < 1e-9
    assert np.nanmax(np.abs(short_waves(3.0 + wave) - wave)) < 0.25
    assert np.isnan(short_waves(wave)[:24]).all()


def test_a_small_hole_is_bridged_and_a_large_one_is_not() -> None:
    x = np.arange(300.0)
    x[100:102], x[200:210] = np.nan, np.nan
    known = np.isfinite(short_waves(x))
    assert known[24:176].all()
    assert not known[176:234].any()


def test_a_defect_is_clipped() -> None:
    rng = np.random.default_rng(1)
    run, reference = rng.standard_normal((2, 5000))
    run[100] = 50.0
    run, reference = clipped(run, reference)
    assert run.max() == pytest.approx(4.0, rel=0.1)
    assert reference.std() == pytest.approx(1.0, rel=0.1)


def test_irregularity_is_distinguished_from_curves() -> None:
    rng = np.random.default_rng(1)
    s = np.arange(40000) * 0.25
    curves = 2e-3 * np.clip(np.minimum(s % 1000.0 - 300.0, 800.0 - s % 1000.0) / 60.0, 0.0, 1.0)
    noise = 1e-4 * rng.standard_normal(len(s))
    sigma = irregularity(forward_mean(cell_means(curves + noise, 4), 20))
    assert sigma == pytest.approx(1e-4 / np.sqrt(80.0), rel=0.5)

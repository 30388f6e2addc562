"""Sections, sliding standard deviation and peaks."""

from __future__ import annotations

import numpy as np
import pytest

from trackfg.errors import BadInputError
from trackfg.geometry.statistics import peaks, section_statistics, sliding_sd


def test_sections_begin_at_whole_multiples() -> None:
    chainage = 150.0 + 0.25 * np.arange(1600)
    value = np.random.default_rng(1).normal(2.0, 3.0, 1600)
    value[5] = np.nan
    table = section_statistics(chainage, value, threshold=3.0)
    assert table["from_m"].tolist() == [0.0, 200.0, 400.0]
    assert table["to_m"].tolist() == [200.0, 400.0, 600.0]
    assert table["count"].tolist() == [199, 800, 600]
    part = value[200:1000]
    row = table.iloc[1]
    assert row["mean"] == pytest.approx(part.mean())
    assert row["sd"] == pytest.approx(part.std())
    assert row["mean_abs"] == pytest.approx(np.abs(part).mean())
    assert row["max_abs"] == np.abs(part).max()
    assert row["share_beyond"] == pytest.approx((np.abs(part) > 3.0).mean())


def test_a_place_on_a_border_belongs_to_the_section_that_begins_there() -> None:
    table = section_statistics(np.arange(0, 12) * 0.1, np.ones(12), section_m=0.3)
    assert table["count"].tolist() == [3, 3, 3, 3]
    with pytest.raises(BadInputError, match="section_m"):
        section_statistics([0.0], [0.0], section_m=0.0)
    with pytest.raises(BadInputError, match="one value per place"):
        section_statistics([0.0], [0.0, 1.0])


def test_sliding_standard_deviation_of_every_window() -> None:
    y = 100.0 + np.random.default_rng(2).normal(size=(2, 300))
    y[1, 100:110] = np.nan
    out = sliding_sd(y, 0.25, 10.0)
    assert np.isnan(out[:, :20]).all()
    assert np.isnan(out[:, -20:]).all()
    for row, place in ((0, 20), (0, 150), (1, 105), (1, 279)):
        assert out[row, place] == pytest.approx(np.nanstd(y[row, place - 20 : place + 21]), rel=1e-9)
    assert np.isnan(sliding_sd(y[:, :30], 0.25, 10.0)).all()


def test_a_window_of_too_few_values_has_none() -> None:
    y = np.full(100, np.nan)
    y[:30] = 1.0
    out = sliding_sd(y, 0.25, 5.0)
    assert out[15] == 0.0
    assert np.isnan(out[30:]).all()


def test_peaks_are_one_per_run_and_sign() -> None:
    x = np.arange(12) * 0.25
    value = np.array([0, 4, 6, 5, 0, -7, -4, 8, np.nan, 9, 1, 4.0])
    table = peaks(x, value, 3.0)
    assert table["value"].tolist() == [6, -7, 8, 9, 4]
    assert table["chainage_m"].tolist() == [0.5, 1.25, 1.75, 2.25, 2.75]
    assert table["from_m"].tolist() == [0.25, 1.25, 1.75, 2.25, 2.75]
    assert table["length_m"].tolist() == [0.5, 0.25, 0.0, 0.0, 0.0]
    assert peaks(x, value, 20.0).empty
    assert peaks(x, value, np.where(x < 1.0, 10.0, 7.5))["value"].tolist() == [8, 9]

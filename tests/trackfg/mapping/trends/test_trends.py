"""Forty defects grow over a year on 20 km, are tamped in month 7, and the rest of the line lies still."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta

import numpy as np
import pandas as pd
import pytest

from trackfg.mapping.trends.series import QUANTITIES, Series, section_series
from trackfg.mapping.trends.trends import trends_of
from trackfg.mapping.trends.wear import MONTH_DAYS
from trackfg.results.trends import Trends

LENGTH_M, STEP_M, SD_MM = 20_000.0, 1.0, 0.4
AT_M = 250.0 + 490.0 * np.arange(40)
RATES = np.linspace(0.5, 2.0, 40) * np.where(np.arange(40) % 2, 1.0, -1.0)


def made_up(months: int, *, tamped_in: int | None = None, rates: np.ndarray = RATES, seed: int = 1) -> Series:
    """Runs a month apart; errors of a run are alike over some 5 m, as a versine's are."""
    rng = np.random.default_rng(seed)
    chainage = np.arange(0.0, LENGTH_M, STEP_M)
    kernel = np.hanning(round(5.0 / STEP_M) + 2)[1:-1]
    kernel /= np.sqrt(np.sum(kernel**2))

    def errors() -> np.ndarray:
        return SD_MM * np.array(
            [np.convolve(rng.standard_normal(chainage.size), kernel, "same") for _ in range(months)]
        )

    value = {name: 3.0 * np.sin(chainage / 7.0) + errors() for name in QUANTITIES}
    grown = np.arange(months, dtype=np.float64)
    if tamped_in is not None:
        grown[tamped_in:] -= tamped_in
    shape = np.zeros(chainage.size)
    for at, rate in zip(AT_M, rates, strict=True):
        shape += rate * np.maximum(1.0 - (2.0 * (chainage - at) / 6.0) ** 2, 0.0) ** 3
    value["versine_level_mm"] += grown[:, None] * shape
    first = datetime(2026, 1, 5, tzinfo=UTC)
    return Series(
        runs=tuple(f"run{number}" for number in range(months)),
        dates=tuple(first + timedelta(days=MONTH_DAYS * number) for number in range(months)),
        chainage_m=chainage,
        step_m=STEP_M,
        value=value,
        sd={name: np.full((months, chainage.size), SD_MM) for name in QUANTITIES},
        sensors=("",) * months,
    )


def planted(found: Trends) -> tuple[pd.DataFrame, pd.DataFrame]:
    """The trends at a defect, each with its number, and the others."""
    level = found.trends["quantity"] == "versine_level_mm"
    nearest = np.abs(found.trends["at_m"].to_numpy()[:, None] - AT_M).argmin(axis=1)
    near = level & (np.abs(found.trends["at_m"] - AT_M[nearest]) < 5.0)
    return found.trends.assign(defect=nearest)[near], found.trends[~near]


@pytest.fixture(scope="module")
def by_month_6() -> Trends:
    return trends_of(made_up(7))


def test_growing_defects_are_found_by_month_6_with_their_rates_and_nothing_else(by_month_6: Trends) -> None:
    at_defects, others = planted(by_month_6)
    assert at_defects["defect"].nunique() >= 38
    assert len(others) == 0
    rows = at_defects.groupby("defect").first()
    error = rows["rate_mm_per_month"] - RATES[rows.index]
    assert np.mean(np.abs(error) < 2.0 * rows["rate_mm_per_month_sd"]) >= 0.85
    assert len(by_month_6.steps) == 0


def test_tamping_is_found_within_one_run_and_distinguished_from_drift() -> None:
    found = trends_of(made_up(8, tamped_in=7))
    steps = found.steps[found.steps["quantity"] == "versine_level_mm"]
    nearest = np.abs(steps["at_m"].to_numpy()[:, None] - AT_M).argmin(axis=1)
    large = np.flatnonzero(np.abs(RATES) * 7.0 > 12.0 * SD_MM)
    assert set(large) <= set(nearest)
    assert set(steps["date"]) == {"2026-08-06"}
    at_defects, others = planted(found)
    assert len(others) == 0
    assert at_defects["defect"].nunique() >= 36, "a small step that is not seen hides the rate"


def test_a_still_line_has_no_trend() -> None:
    false = [trends_of(made_up(6, rates=np.zeros(40), seed=seed)) for seed in (2, 3)]
    assert [len(found.trends) for found in false] == [0, 0]
    assert [len(found.steps) for found in false] == [0, 0]


def test_a_section_with_growing_defects_gets_rougher(by_month_6: Trends) -> None:
    sections = by_month_6.sections.set_index("chainage_m")
    assert list(sections.index[:3]) == [0.0, 200.0, 400.0]
    sigmas = sections["versine_level_mm_per_month"] / sections["versine_level_mm_per_month_sd"]
    with_defect = sections.index.isin(np.floor(AT_M / 200.0) * 200.0)
    assert sigmas[with_defect].tail(10).median() > 3.0
    assert np.abs(sigmas[~with_defect]).median() < 1.5


def test_sections_that_a_run_hardly_covers_have_no_value() -> None:
    cells = made_up(3)
    cells.value["twist_mm"][1, 25:200] = np.nan
    value = section_series(cells, 10.0).value["twist_mm"]
    assert np.isnan(value[:, 0]).tolist() == [False, True, False]

"""Rates per million tonnes, and the dates of limits that follow from the traffic to come."""

from __future__ import annotations

from datetime import UTC, date, datetime
from pathlib import Path

import numpy as np
import pytest

from trackfg.cli.trend_tables import read_tonnage
from trackfg.errors import BadInputError
from trackfg.geometry.limits import Limit
from trackfg.mapping.trends.series import Series
from trackfg.mapping.trends.trends import trends_of
from trackfg.mapping.trends.wear import Wear
from trackfg.results.trends import Trends


def test_a_track_that_wears_with_load_has_one_rate_per_load(by_load: Trends) -> None:
    (row,) = by_load.trends.to_dict("records")
    assert row["quantity"] == "versine_level_mm"
    assert abs(row["at_m"] - 250.0) < 2.0
    shape = max(1.0 - ((row["at_m"] - 250.0) / 3.0) ** 2, 0.0) ** 3
    assert abs(row["rate_mm_per_mt"] - 0.5 * shape) < 3.0 * row["rate_mm_per_mt_sd"]
    assert {"twist_mm_per_mt", "twist_mm_per_mt_sd"} <= set(by_load.cells)


def test_a_limit_is_reached_when_the_load_to_come_has_passed(by_load: Trends) -> None:
    (row,) = by_load.reached.to_dict("records")
    to_pass_mt = (row["limit_mm"] - row["value_mm"]) / row["rate_mm_per_mt"]
    assert 0.0 < to_pass_mt < 5.0
    expected = datetime(2026, 8, 1, tzinfo=UTC).timestamp() / 86400.0 + to_pass_mt / 5.0 * 153.0
    reached = datetime.combine(date.fromisoformat(row["reached_on"]), datetime.min.time(), UTC)
    assert abs(reached.timestamp() / 86400.0 - expected) <= 1.0
    assert row["earliest"] <= row["reached_on"] <= row["latest"]


def test_over_months_the_same_track_drifts_less_certainly(dip: Series, by_load: Trends) -> None:
    by_month, by_mt = trends_of(dip).trends.iloc[0], by_load.trends.iloc[0]
    sigmas = (
        row[f"rate_mm_per_{per}"] / row[f"rate_mm_per_{per}_sd"] for row, per in ((by_month, "month"), (by_mt, "mt"))
    )
    assert 2.0 * next(sigmas) < next(sigmas)


def test_beyond_the_last_row_the_mean_load_goes_on(load: Wear) -> None:
    years = (load.days[-1] - load.days[0]) / 365.25
    day = load.days_at(np.array([31.0 + 21.0 / years, np.inf]))
    np.testing.assert_allclose(day, [load.days[-1] + 365.25, np.inf])


def test_a_run_before_the_first_row_has_no_load(dip: Series, load: Wear) -> None:
    with pytest.raises(BadInputError, match="the load is not known on 2026-01-01"):
        trends_of(dip, load=Wear(load.days[1:], load.passed[1:], "mt"))


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("day,mt\n2026-01-01,1\n", "no column 'date'"),
        ("date,mt\n2026-01-01,1\nMay,2\n", "row 2, column date: 'May'; expected a date"),
        ("date,mt\n2026-01-01,1\n2026-02-01,much\n", "row 2, column mt: 'much'; expected million tonnes"),
        ("date,mt\n2026-01-01,1\n2026-01-01,2\n", "row 2, column date: '2026-01-01'; expected later dates"),
        ("date,mt\n2026-01-01,2\n2026-02-01,1\n", "row 2, column mt: '1'; expected what has passed in all"),
        ("date,mt\n2026-01-01,2\n2026-02-01,2\n", "no load between the first row and the last"),
        ("date,mt\n2026-01-01,1000,5\n2026-02-01,1001,5\n", "rows of 3 values; expected 2"),
        ("date,mt\n1000,2\n0900,3\n", "row 2, column date: '0900'; expected later dates"),
        ("date,mt\n2026-01-01,2\n", "no load between the first row and the last"),
    ],
)
def test_what_is_no_table_of_tonnage_is_refused(tmp_path: Path, text: str, reason: str) -> None:
    path = tmp_path / "tonnage.csv"
    path.write_text(text)
    with pytest.raises(BadInputError, match=reason):
        read_tonnage(path)


def test_a_table_of_tonnage_is_read(tmp_path: Path) -> None:
    path = tmp_path / "tonnage.csv"
    path.write_text("date,mt\n2026-01-01,10\n2026-02-01T12:00:00Z,11.5\n")
    wear = read_tonnage(path)
    assert wear.at([datetime(2026, 1, 16, 18, tzinfo=UTC)]).tolist() == [10.75]


def test_a_limit_that_a_trend_is_beyond_already_is_shown_with_the_largest_value(dip: Series, load: Wear) -> None:
    limit = Limit(standard="ours", parameter="level", level="alert", kind="peak", value_mm=3.5, chord_m=10.0)
    found = trends_of(dip, [(limit, "versine_level_mm")], load=load)
    (row,) = found.reached.to_dict("records")
    within = found.cells[found.cells["chainage_m"].between(row["from_m"], row["to_m"])]
    assert abs(row["value_mm"]) == within["versine_level_mm"].abs().max()
    assert row["reached_on"] == "2026-08-01"

"""Trends as others get them: a folder that reads back, a page, and layers of the map."""

from __future__ import annotations

import re
import sqlite3
from collections.abc import Callable
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from rich.text import Text

from trackfg.cli.trend_tables import of_trends
from trackfg.errors import BadInputError
from trackfg.mapping.trends.trend_layers import trend_layers
from trackfg.maps import FeatureMap, MapConventions, read_map, write_map
from trackfg.maps.feature_map import GRID_COLUMNS, LANDMARK_COLUMNS, LINE_COLUMNS, RUN_COLUMNS, TEXT_COLUMNS
from trackfg.maps.store import draw
from trackfg.report import write_report
from trackfg.results.trends import Trends

MakeMap = Callable[[], FeatureMap]


def empty(columns: tuple[str, ...]) -> pd.DataFrame:
    kinds = {"observations": "int64", "direction": "int64"}
    return pd.DataFrame(
        {name: pd.Series(dtype="str" if name in TEXT_COLUMNS else kinds.get(name, "float64")) for name in columns}
    )


@pytest.fixture
def straight(tmp_path: Path) -> Path:
    """A map of a straight track to the east, 500 m."""
    chainage, vertices = np.arange(0.0, 500.0, 0.5), np.arange(0.0, 500.0, 5.0)
    grid = pd.DataFrame({name: np.full(chainage.size, 0.1) for name in GRID_COLUMNS})
    line = pd.DataFrame({name: np.full(vertices.size, 0.1) for name in LINE_COLUMNS})
    made = FeatureMap(
        name="straight",
        conventions=MapConventions(1.5, 1.5, 10.0, 25.0, 10.0, 0.5),
        landmarks=empty(LANDMARK_COLUMNS),
        covariance=np.zeros((0, 0)),
        grid=grid.assign(chainage_m=chainage, observations=1),
        line=line.assign(chainage_m=vertices, east_m=vertices, north_m=0.0, up_m=0.0),
        runs=empty(RUN_COLUMNS),
        information={},
        configuration={},
        software={},
    )
    write_map(made, tmp_path / "line.gpkg", parent=None)
    return tmp_path / "line.gpkg"


def test_a_folder_of_trends_reads_back_but_for_values_elsewhere(by_load: Trends, tmp_path: Path) -> None:
    again = Trends.read(by_load.write(tmp_path / "trends"))
    for name in ("trends", "steps", "reached", "cells", "sections", "section_values"):
        pd.testing.assert_frame_equal(getattr(again, name), getattr(by_load, name), check_dtype=False)
    assert (again.per, again.left_out) == ("mt", {})
    places = set(by_load.trends["at_m"])
    of_runs = vars(again)["values"]
    assert set(of_runs["chainage_m"]) == places
    assert len(of_runs) == 8 * len(places)
    (tmp_path / "trends" / "cells.parquet").unlink()
    with pytest.raises(BadInputError, match=r"cells.parquet is missing; expected a trackfg folder of trends"):
        Trends.read(tmp_path / "trends")


def test_what_is_left_out_for_one_reason_is_named_together(by_load: Trends) -> None:
    found = replace(by_load, left_out={"limit a": "not followed", "run 7": "has no date", "limit b": "not followed"})
    assert list(found.left_out_by_reason()) == [(["limit a", "limit b"], "not followed"), (["run 7"], "has no date")]
    shown = [table.plain for table in of_trends(found) if isinstance(table, Text)]
    assert shown[-2:] == ["left out: limit a; limit b: not followed", "left out: run 7: has no date"]


@pytest.mark.parametrize(
    ("name", "damage", "message"),
    [
        ("cells", lambda table: table[:0], r"cells\.parquet: has no row"),
        ("cells", lambda table: table.drop(columns="twist_mm_per_mt_sd"), "has no column 'twist_mm_per_mt_sd'"),
        ("sections", lambda table: table.drop(columns="twist_mm"), "has no column 'twist_mm'"),
        ("sections", lambda table: table.assign(chainage_m=np.nan), "'chainage_m' is empty in some rows"),
        ("values", lambda table: table.assign(date="2026"), "expected a date in each row"),
        ("section_values", lambda table: table.assign(twist_mm=np.inf), "'twist_mm' holds an infinite number"),
    ],
)
def test_a_damaged_folder_of_trends_is_refused(
    name: str, damage: Callable[[pd.DataFrame], pd.DataFrame], message: str, by_load: Trends, tmp_path: Path
) -> None:
    file = by_load.write(tmp_path / "trends") / f"{name}.parquet"
    damage(pd.read_parquet(file)).to_parquet(file)
    with pytest.raises(BadInputError, match=message):
        Trends.read(tmp_path / "trends")


def test_the_page_says_when_a_limit_is_reached_and_how_fast_the_track_gets_there(
    by_load: Trends, tmp_path: Path
) -> None:
    by_load.write(tmp_path / "trends")
    text = write_report(tmp_path / "trends", tmp_path / "trends.html").read_text()
    (trend,), (limit,) = by_load.trends.to_dict("records"), by_load.reached.to_dict("records")
    assert limit["reached_on"] in text
    assert f"{1e-3 * trend['at_m']:.3f}" in text
    assert "rate, mm per million tonnes" in text
    menu = text.partition("<nav")[2].partition("</nav>")[0]
    assert re.findall(r">([^<>]+)</a>", menu) == [
        "Summary",
        "Limits",
        "Trends",
        "Over time",
        "Rates",
        "Steps",
        "Sections",
        "Made",
    ]  # fits a window of 800 px
    assert "trackfg map trends wrote" in text
    with pytest.raises(BadInputError, match=r"holds trends.*; expected official places beside a result only"):
        write_report(tmp_path / "trends", tmp_path / "again.html", km=True)


def test_layers_lie_along_the_map_and_leave_the_map_as_it_is(by_load: Trends, straight: Path) -> None:
    before = read_map(straight)
    for _ in range(2):
        draw(straight, before, trend_layers(by_load, before))
    after = read_map(straight)
    assert (after.version, len(after.grid)) == (1, 1000)
    with closing(sqlite3.connect(straight)) as database:
        (row,) = database.execute("SELECT geom, version, at_m, rate_mm, per FROM trends").fetchall()
        (trend,) = by_load.trends.to_dict("records")
        assert row[1:] == (1, trend["at_m"], trend["rate_mm_per_mt"], "mt")
        ends = np.frombuffer(row[0][-32:], "<f8")  # the last vertex: east, north, up, measure
        assert ends.tolist() == [trend["to_m"], 0.0, 0.0, trend["to_m"]]
        sections = database.execute("SELECT from_m, to_m, versine_level_rate_mm FROM trend_sections").fetchall()
        assert [section[:2] for section in sections] == [(0.0, 200.0), (200.0, 400.0), (400.0, 600.0)]
        assert database.execute("SELECT count(*) FROM trend_steps").fetchone() == (0,)
        drawn = database.execute("SELECT table_name FROM gpkg_geometry_columns ORDER BY 1").fetchall()
    assert [name for (name,) in drawn] == [
        "landmarks",
        "reference_line",
        "trend_limits",
        "trend_sections",
        "trend_steps",
        "trends",
    ]


def test_a_table_of_the_users_own_is_left_alone(by_load: Trends, straight: Path) -> None:
    with closing(sqlite3.connect(straight)) as database:
        database.execute("CREATE TABLE trends (mine TEXT)")
        database.commit()
    feature_map = read_map(straight)
    with pytest.raises(BadInputError, match="another table trends; it is left alone"):
        draw(straight, feature_map, trend_layers(by_load, feature_map))

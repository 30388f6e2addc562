"""The command on results made up on a map: what it refuses, and what it writes."""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Callable
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest

from trackfg.datasets.line.defects import Defect
from trackfg.datasets.scenarios import scenario, simulate
from trackfg.datasets.sensors.positioning import BaliseModel
from trackfg.errors import BadInputError
from trackfg.geometry.twist import twist
from trackfg.mapping import build_map
from trackfg.mapping.trends.series import QUANTITIES, series
from trackfg.maps import write_map
from trackfg.results.result import Result
from trackfg.smoothing.smoother import smooth

RATES_MM = {350.0: 2.0, 550.0: 1.0}


@pytest.fixture(scope="module")
def year(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Four runs of a measuring car a month apart over two growing dips, and a map of the first two."""
    folder = tmp_path_factory.mktemp("year")
    results = []
    for month in range(4):
        dips = tuple(Defect("dip", at_m=at, size_m=1e-3 * rate * month, length_m=6.0) for at, rate in RATES_MM.items())
        plan = replace(scenario("measuring-car"), balises=BaliseModel(spacing_m=200.0, sd_m=0.1))
        plan = replace(plan, defects=dips if month else ())
        recording = simulate(plan, seed=5, run=month, duration_s=100.0).recording
        start = pd.Timestamp(f"2026-{month + 1:02d}-05T03:12:00Z").to_pydatetime()
        description = recording.description.model_copy(update={"start": start})
        results.append(smooth(replace(recording, description=description)))
        results[-1].write(folder / f"out{month}")
    write_map(build_map(results[:2], name="line"), folder / "line.gpkg", parent=None)
    return folder


@pytest.mark.slow
def test_the_command_finds_growing_dips_and_when_they_reach_a_limit(year: Path, trackfg: Callable[..., Any]) -> None:
    limits = 'standard = "ours"\nparameter = "level"\nchord_m = 10.0\nlevel = "alert"\nkind = "peak"\nvalue_mm = 20.0\n'
    (year / "limits.toml").write_text(f"[[limits]]\n{limits}")
    command = ["map", "trends", year / "line.gpkg", *(year / f"out{month}" for month in range(4))]
    command += ["--limits", year / "limits.toml", "--layers"]
    done = trackfg(*command, "-o", year / "trends", "--json")
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    level = [row for row in found["trends"] if row["quantity"] == "versine_level_mm"]
    rates = sorted(row["rate_mm_per_month"] for row in level)
    assert rates == pytest.approx([-2.0, -1.0], rel=0.1)
    assert found["steps"] == []
    assert {row["limit_mm"] for row in found["reached"]} == {20.0}
    assert all("2026-05" < row["earliest"] <= row["reached_on"] <= row["latest"] for row in found["reached"])
    cells = pd.read_parquet(year / "trends" / "cells.parquet")
    assert cells["versine_level_mm_per_month"].min() == pytest.approx(-2.0, rel=0.1)
    assert pd.read_parquet(year / "trends" / "values.parquet")["run"].nunique() == 4
    with closing(sqlite3.connect(year / "line.gpkg")) as database:
        drawn = database.execute("SELECT rate_mm, per FROM trends WHERE quantity = 'versine_level_mm'").fetchall()
    assert [rate for rate, _ in sorted(drawn)] == pytest.approx(rates, rel=1e-9)
    assert {per for _, per in drawn} == {"month"}
    (year / "passed.csv").write_text("date,mt\n2026-01-01,10\n2026-05-01,12\n")
    done = trackfg(*command, "--tonnage", year / "passed.csv", "--json")
    assert done.returncode == 0, done.stderr
    mt_a_month = 2.0 / 120.0 * 365.25 / 12.0
    level = [row for row in json.loads(done.stdout)["trends"] if row["quantity"] == "versine_level_mm"]
    assert sorted(row["rate_mm_per_mt"] * mt_a_month for row in level) == pytest.approx(rates, rel=0.02)


@pytest.mark.slow
def test_a_map_knows_the_results_that_it_was_made_of(year: Path, trackfg: Callable[..., Any]) -> None:
    place, outs = year / "all.gpkg", [year / f"out{month}" for month in range(4)]
    trackfg("map", "build", *outs, "-o", place).check_returncode()
    named, alone = (trackfg("map", "trends", place, *given, "--json") for given in (outs, []))
    assert named.returncode == alone.returncode == 0
    assert json.loads(alone.stdout) == json.loads(named.stdout)
    (year / "out3").rename(year / "elsewhere")
    done = trackfg("map", "trends", place, "--json")
    assert done.returncode == 0, done.stderr
    (reason,) = json.loads(done.stdout)["left_out"].values()
    assert "out3: not a readable trackfg result" in reason
    nowhere = trackfg("map", "trends", year / "line.gpkg")
    assert (nowhere.returncode, nowhere.stderr.count("does not say where its result is")) == (2, 1)


def test_limits_by_speed_need_the_speed_of_the_line(
    trackfg: Callable[..., Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    limit = 'standard = "ours"\nparameter = "level"\nchord_m = 10.0\nlevel = "alert"\nkind = "peak"\nvalue_mm = 20.0\n'
    (tmp_path / "limits.toml").write_text(f"[[limits]]\n{limit}speed_to_kmh = 80\n")
    errors = []
    for speed in ([], ["--line-speed", "60"]):
        done = trackfg("map", "trends", "line.gpkg", "--limits", "limits.toml", *speed)
        assert done.returncode == 2
        errors.append(done.stderr)
    assert "give the line's speed (--line-speed)" in errors[0]
    assert "line.gpkg: no such file" in errors[1]


def test_what_no_trend_can_be_computed_from_is_refused(make_result: Callable[..., Result]) -> None:
    unused: Any = None
    undated = make_result(rows=20)
    with pytest.raises(BadInputError, match="made-up: its recording has no start"):
        series([undated], unused)
    facts = {"content_sha256": "0" * 64, "direction": 1, "anchored": False, "mount_roll_sd_rad": 0.0}
    dated = make_result(rows=20, run={**facts, "start": "2026-05-01"})
    with pytest.raises(BadInputError, match="'made-up' has the measurements of run 'made-up'"):
        series([dated, dated], unused)


def test_recordings_with_one_id_are_distinguished_by_what_they_measured(
    make_result: Callable[..., Result], monkeypatch: pytest.MonkeyPatch
) -> None:
    chainage = 0.25 * np.arange(100)
    columns = {n: np.ones(100) for q in QUANTITIES for n in (q, f"{q}_sd")}
    changes = SimpleNamespace(cells=pd.DataFrame({"chainage_m": chainage} | columns), other_track=False)
    monkeypatch.setattr("trackfg.mapping.trends.series.find_changes", lambda result, feature_map: changes)
    feature_map: Any = SimpleNamespace(grid=changes.cells, conventions=SimpleNamespace(step_m=0.25))
    facts = {"direction": 1, "anchored": False, "mount_roll_sd_rad": 0.0}
    runs = [
        make_result(rows=20, run={**facts, "start": f"2026-0{number}-01", "content_sha256": f"{number:064x}"})
        for number in (3, 1, 2)
    ]
    found, _ = series(runs, feature_map)
    assert found.runs == ("made-up", "made-up-2", "made-up-3")
    assert [date.month for date in found.dates] == [1, 2, 3]


def test_the_twist_of_a_map_is_that_of_the_runs(
    make_result: Callable[..., Result], monkeypatch: pytest.MonkeyPatch
) -> None:
    chainage, level = 0.25 * np.arange(200), np.random.default_rng(3).standard_normal(200)
    on_map = pd.DataFrame({"chainage_m": chainage, **dict.fromkeys(QUANTITIES, level)})
    unchanged = pd.DataFrame({"chainage_m": chainage} | {n: 0.0 * level for q in QUANTITIES for n in (q, f"{q}_sd")})
    changes = SimpleNamespace(cells=unchanged, other_track=False)
    monkeypatch.setattr("trackfg.mapping.trends.series.find_changes", lambda result, feature_map: changes)
    facts = {"content_sha256": "0" * 64, "direction": 1, "anchored": False, "mount_roll_sd_rad": 0.0}
    meaning = make_result(rows=20).summary.geometry.model_copy(update={"twist_base_m": 3.0, "twist_anchor": "ahead"})
    runs = [
        make_result(rows=20, recording_id=day, run={**facts, "start": day}, geometry=meaning)
        for day in ("2026-05-01", "2026-06-01", "2026-07-01")
    ]
    feature_map: Any = SimpleNamespace(grid=on_map, conventions=SimpleNamespace(step_m=0.25))
    found, _ = series(runs, feature_map)
    np.testing.assert_allclose(found.value["twist_mm"][0], twist(level, 0.25, 3.0, "ahead"))

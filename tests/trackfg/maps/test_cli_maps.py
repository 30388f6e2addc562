"""The commands about maps, through the real entry point, on maps made by hand."""

from __future__ import annotations

import dataclasses
import io
import json
import sqlite3
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from rich.console import Console, RenderableType

from trackfg.cli.mapping import map_tables
from trackfg.datasets.scenarios import simulate
from trackfg.mapping.changes.changes import Changes
from trackfg.maps import FeatureMap, read_map, read_versions, write_map
from trackfg.smoothing.smoother import smooth

MakeMap = Callable[..., FeatureMap]
Run = Callable[..., tuple[int, str, str]]


@pytest.fixture
def run(trackfg: Callable[..., Any]) -> Run:
    def run(*arguments: object, command: tuple[str, ...] = ("map",)) -> tuple[int, str, str]:
        done = trackfg(*command, *arguments)
        return done.returncode, done.stdout, done.stderr

    return run


@pytest.fixture
def line(make_map: MakeMap, tmp_path: Path) -> Path:
    """Two versions: one run more, every radius 5 m longer, a landmark less, and a hole in the grid."""
    path = tmp_path / "line.gpkg"
    first = make_map(cells=2001)
    write_map(first, path, parent=None)
    kept = slice(0, 12)
    marks = first.landmarks.iloc[kept]
    second = dataclasses.replace(
        make_map(cells=2001, runs=3),
        landmarks=marks.assign(radius_m=marks["radius_m"] + 5.0, radius_m_sd=0.9 * marks["radius_m_sd"]),
        covariance=first.covariance[kept, kept],
        grid=first.grid.drop(index=range(400, 800)).reset_index(drop=True),
    )
    write_map(second, path, parent=1)
    return path


@pytest.mark.parametrize("command", ["show", "diff"])
def test_help_has_an_example(run: Run, command: str) -> None:
    status, out, _ = run(command, "--help")
    assert status == 0
    assert f"Example: trackfg map {command}" in out


def test_show(run: Run, line: Path) -> None:
    status, out, err = run("show", line)
    assert (status, err) == (0, "")
    assert "line, version 2" in out
    assert "0.00 to 99.75 m, 200.00 to 500.00 m" in out
    assert "not georeferenced" in out
    assert "versine of alignment of the grid, mm" in out
    assert "C002-ETC" in out
    assert "Balise 7" not in out
    assert "2026-05-03-down" in out
    _, older, _ = run("show", line, "--version", 1)
    assert "line, version 1" in older
    assert "Balise 7" in older


def test_show_as_json(run: Run, line: Path) -> None:
    content = json.loads(run("show", line, "--json")[1])
    assert content["version"] == 2
    assert content["stretches_m"] == [[0.0, 99.75], [200.0, 500.0]]
    assert len(content["landmarks"]) == 12
    assert [row["version"] for row in content["versions"]] == [1, 2]
    assert content["versions"][0]["parent"] is None
    assert {row["quantity"] for row in content["sigmas"]} >= {"chainage_m", "versine_level_mm"}
    assert json.loads(run("show", line, "--version", 1, "--json")[1])["landmarks"][-1]["radius_m"] is None


def test_diff_of_the_last_version(run: Run, line: Path) -> None:
    """Nothing named: against the version it was made from."""
    status, out, err = run("diff", line)
    assert (status, err) == (0, "")
    assert "the second has all of the first's, and more" in out
    assert "0 added, 400 removed" in out
    assert "Landmarks removed" in out
    assert "fix-1" in out
    assert "12 of 60 quantities of landmarks moved by 3 sigmas or more" in out
    assert "radius, m" in out
    assert out == run("diff", line, "--from-version", 1, "--to-version", 2)[1]
    assert "0 of 64" in run("diff", line, "--from-version", 1, "--to-version", 1)[1]


def test_diff_of_two_maps_as_json(run: Run, line: Path, make_map: MakeMap, tmp_path: Path) -> None:
    other = tmp_path / "other.gpkg"
    write_map(make_map(cells=2001, name="other"), other, parent=None)
    content = json.loads(run("diff", other, line, "--to-version", 1, "--json")[1])
    assert content["a"] == {"name": "other", "version": 1}
    assert content["b"] == {"name": "line", "version": 1}
    assert content["relation"] == "same"
    assert {row["difference"] for row in content["moved"]} == {0.0}
    newest = json.loads(run("diff", other, line, "--json")[1])
    assert newest["b"]["version"] == 2
    assert newest["cells_removed"] == 400


def test_what_cannot_be_done(run: Run, line: Path, make_map: MakeMap, tmp_path: Path) -> None:
    first = make_map(cells=9)
    conventions = dataclasses.replace(first.conventions, step_m=0.5)
    grid = first.grid.assign(chainage_m=0.5 * np.arange(9))
    write_map(dataclasses.replace(first, conventions=conventions, grid=grid), tmp_path / "coarse.gpkg", parent=None)
    for arguments, message in (
        (("show", tmp_path / "nowhere.gpkg"), "nowhere.gpkg"),
        (("show", line, "--version", 7), "versions 1 to 2"),
        (("diff", line, "--to-version", 1), "version 1 of 'line' was made from no earlier version"),
        (("diff", line, tmp_path / "coarse.gpkg"), "expected the same step"),
    ):
        status, out, err = run(*arguments)
        assert status == 2, arguments
        assert message in err
        assert len(err.splitlines()) == 1
        assert out == ""


def shown(tables: Iterable[RenderableType], width: int = 120) -> str:
    console = Console(width=width, file=io.StringIO(), record=True)
    for table in tables:
        console.print(table)
    return console.export_text()


def test_a_landmark_and_a_run_take_one_line_of_eighty_characters(line: Path) -> None:
    found = read_map(line)
    places = found.landmarks.assign(chainage_m=123456.789, radius_m=1234.56, transition_length_m=123.4, cant_mm=123.4)
    runs = found.runs.assign(offset_m=-123.45, offset_m_sd=1.23, scale=0.99, cross_level_bias_mm=-1.234, start="")
    runs = runs.assign(recording_id=runs["run_id"])
    text = shown(map_tables.of_map(dataclasses.replace(found, landmarks=places, runs=runs), read_versions(line)), 80)
    assert max(len(row) for row in text.splitlines()) <= 80
    for row in places.itertuples():
        of_landmark = next(part for part in text.splitlines() if part.startswith(row.landmark_id))
        assert "123456.79 ± " in of_landmark
        assert "clothoid" in of_landmark
    for row in runs.itertuples():
        assert "-123.45 ± 1.23" in next(part for part in text.splitlines() if part.startswith(row.run_id))


def test_changes_are_shown() -> None:
    one = {
        "from_m": [12.0],
        "to_m": [18.25],
        "quantity": ["versine_level_mm"],
        "change": [-2.9],
        "change_sd": [0.07],
        "sigmas": [41.4],
        "before": [0.4],
        "after": [-2.5],
        "kind": ["dip"],
    }
    thresholds = {
        "quantity": ["versine_level_mm"],
        "sigmas": [6.5],
        "floor": [1.0],
        "noise_factor": [1.02],
        "compared_m": [400.0],
    }
    coverage = {"from_m": [0.0, 200.0], "to_m": [200.0, 400.0], "versine_level_mm": [1.0, np.nan]}
    found = Changes(pd.DataFrame(one), pd.DataFrame(), pd.DataFrame(thresholds), pd.DataFrame(coverage))
    text = shown(map_tables.of_changes(found))
    assert "-2.90 ± 0.07" in text
    assert "versine of level, mm" in text
    content = json.loads(map_tables.changes_json(found))
    assert content["changes"][0]["kind"] == "dip"
    assert content["coverage"][1]["versine_level_mm"] is None
    none = dataclasses.replace(found, table=found.table.iloc[:0])
    assert "No change" in shown(map_tables.of_changes(none))


@pytest.fixture(scope="module")
def short_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a recording of its first metres in ``rec``, and the result of 200 m in ``out``."""
    folder = tmp_path_factory.mktemp("short")
    simulation = simulate("trolley", seed=0, duration_s=300.0)
    simulate("trolley", seed=0, duration_s=80.0).write(folder / "rec")
    smooth(simulation.recording).write(folder / "out")
    return folder


@pytest.mark.parametrize("where", ["before the host", "in the query"])
def test_no_command_shows_or_stores_a_password(
    run: Run, short_run: Path, server: Any, tmp_path: Path, where: str
) -> None:
    schema = where.replace(" ", "_")
    place = f"postgresql://trackfg@/plain?host={server.folder}&password=s3cr3t&schema={schema}"
    if where == "before the host":
        place = f"postgresql://trackfg:s3cr3t@/plain?host={server.folder}&schema={schema}"
    result = short_run / "out"
    said = []
    for arguments, expected in (
        (("map", "build", result, "-o", place), 0),
        (("map", "build", result, "-o", place), 2),
        (("map", "build", result, "-o", place, "--name", "another"), 2),
        (("map", "show", place), 0),
        (("map", "show", place, "--json"), 0),
        (("map", "show", place, "--version", 9), 2),
        (("map", "show", place.replace("/plain", "/absent")), 2),
        (("map", "diff", place), 2),
        (("map", "diff", place, "--from-version", 1), 0),
        (("map", "changes", result, place), 0),
        (("smooth", short_run / "rec", "-o", tmp_path / "located", "--map", place), 0),
        (("stream", short_run / "rec", "-o", tmp_path / "live", "--lag", 5, "--map", place), 0),
    ):
        status, out, err = run(*arguments[1:]) if arguments[0] == "map" else run(*arguments, command=())
        assert status == expected, (arguments, out, err)
        said.append(out + err)
    assert "s3cr3t" not in "".join(said)
    assert said[0].startswith(f"map: postgresql://trackfg{':***' if where == 'before the host' else ''}@/plain?schema=")
    feature_map = read_map(place)
    assert feature_map.name == schema
    stored = server.sql("plain", f"SELECT string_agg(v::text, ' ') FROM {schema}.map_versions v")
    assert "s3cr3t" not in stored
    written = [path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()]
    assert written
    assert not any(b"s3cr3t" in content for content in written)


@pytest.mark.parametrize(
    "place",
    [
        "postgresql:admin:s3cr3t@host/tracks",
        " postgresql://admin:s3cr3t@host/tracks",
        " postgresql://admin:s3cr3t@host/tracks.gpkg",
        "POSTGRESQL://admin:s3cr3t@host/tracks.gpkg",
        "postgresql://admin:one@s3cr3t@host/tracks",
        "postgresql://ad/min:s3cr3t@host/tracks",
        "postgresql://admin:s3cr3t@host:port/tracks",
        "mysql://admin:s3cr3t@host/tracks",
        "host=db password=s3cr3t dbname=tracks",
        "admin:s3cr3t@host/tracks",
    ],
)
def test_no_password_is_shown_of_what_is_no_url(run: Run, place: str, short_run: Path) -> None:
    for arguments in (("show", place), ("build", short_run / "out", "-o", place)):
        status, out, err = run(*arguments)
        assert status == 2
        assert "s3cr3t" not in out + err
        assert "expected" in err
        assert len(err.splitlines()) == 1


def test_nothing_of_a_map_controls_the_terminal(run: Run, make_map: MakeMap, tmp_path: Path) -> None:
    path, evil = tmp_path / "line.gpkg", "\x1b]0;OWNED\x07\x1b[31m[bold][/x]\u202e\x9b"
    made = make_map(cells=41)
    landmarks = made.landmarks.assign(name=evil)
    runs = made.runs.assign(recording_id=evil, start=evil)
    write_map(dataclasses.replace(made, name=evil, landmarks=landmarks, runs=runs), path, parent=None)
    write_map(
        dataclasses.replace(made, name=evil, landmarks=landmarks.iloc[:0], covariance=np.zeros((0, 0))), path, parent=1
    )
    with sqlite3.connect(path) as connection:
        connection.execute("UPDATE map_versions SET written_at = ?, software = json_object('trackfg', ?)", (evil, evil))
    for arguments in (("show", path), ("show", path, "--version", 1), ("diff", path), ("show", path, "--json")):
        status, out, err = run(*arguments)
        assert (status, err) == (0, "")
        assert all(c.isprintable() or c == "\n" for c in out)
        assert "OWNED" in out
        if "--json" in arguments:
            assert json.loads(out)["name"] == evil
        else:
            assert "[31m[bold][/x]" in out.replace("\n", "")
    status, out, err = run("diff", path, "--to-version", 1)
    assert status == 2
    assert err.strip().isprintable()

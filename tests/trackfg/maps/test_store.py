"""Maps come back as they were written, version by version; what is no map is refused and left alone."""

from __future__ import annotations

import dataclasses
import os
import sqlite3
import sys
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from trackfg.errors import BadInputError, TrackfgError
from trackfg.maps import FeatureMap, MapConflictError, read_map, read_versions, write_map
from trackfg.maps.location import locate
from trackfg.maps.rows import insert_frame

MakeMap = Callable[..., FeatureMap]
Same = Callable[[FeatureMap, FeatureMap], None]


@pytest.fixture
def run_program(forked: Callable[..., Any]) -> Callable[..., str]:
    """Return what runs a Python program in a process of its own, and returns what it prints."""

    def run(program: str, *arguments: object) -> str:
        done = forked(program, *arguments)
        assert done.returncode == 0, done.stderr
        return str(done.stdout)

    return run


def sqlite(path: str | Path, statement: str) -> list[Any]:
    with closing(sqlite3.connect(path)) as connection, connection:
        return connection.execute(statement).fetchall()


@pytest.mark.parametrize("origin", [None, (35.2, 137.1, 40.0)])
def test_comes_back_as_written(make_map: MakeMap, assert_same_map: Same, location: str, origin: Any) -> None:
    made = make_map(origin=origin)
    written = write_map(made, location, parent=None)
    assert (written.version, written.parent) == (1, None)
    found = read_map(location)
    assert_same_map(found, made)
    assert (found.version, found.parent, found.written_at) == (1, None, written.written_at)


def test_a_map_of_an_earlier_version_has_no_column_of_what_all_runs_say(make_map: MakeMap, tmp_path: Path) -> None:
    made, path = make_map(cells=41, curves=1, runs=1), tmp_path / "line.gpkg"
    made = dataclasses.replace(made, pooled=made.information["run0"])
    write_map(made, path, parent=None)
    found = read_map(path).pooled
    assert found is not None
    assert found.variables == made.information["run0"].variables
    np.testing.assert_array_equal(found.R, made.information["run0"].R)
    sqlite(path, "ALTER TABLE map_versions DROP COLUMN pooled_sha256")
    assert read_map(path).pooled is None
    write_map(made, path, parent=1)
    assert read_map(path, 2).pooled is None


def test_a_map_without_content_comes_back(make_map: MakeMap, assert_same_map: Same, location: str) -> None:
    made = make_map(cells=41, curves=1, runs=1)
    empty = dataclasses.replace(
        made,
        landmarks=made.landmarks.iloc[:0],
        covariance=np.empty((0, 0)),
        grid=made.grid.iloc[:0],
        line=made.line.iloc[:0],
        runs=made.runs.iloc[:0],
        information={},
    )
    write_map(empty, location, parent=None)
    assert_same_map(read_map(location), empty)


def test_information_may_be_missing_for_some_runs(make_map: MakeMap, assert_same_map: Same, location: str) -> None:
    made = make_map(cells=41, runs=3)
    made = dataclasses.replace(made, information={"run1": made.information["run1"]})
    write_map(made, location, parent=None)
    assert_same_map(read_map(location), made)


def test_old_versions_stay(make_map: MakeMap, assert_same_map: Same, location: str) -> None:
    """Also when a later one is georeferenced, has fewer landmarks, or another name."""
    made = [
        make_map(runs=1),
        make_map(runs=2, seed=1, origin=(35.2, 137.1, 40.0)),
        make_map(curves=2, runs=3, seed=2, name="renamed"),
    ]
    for parent, one in zip([None, 1, 2], made, strict=True):
        write_map(one, location, parent=parent)
    for version, one in enumerate(made, start=1):
        assert_same_map(read_map(location, version), one)
    assert_same_map(read_map(location), made[-1])
    table = read_versions(location)
    assert table["version"].tolist() == [1, 2, 3]
    assert table["parent"].isna().tolist() == [True, False, False]
    assert table["parent"].tolist()[1:] == [1, 2]
    assert table["runs"].tolist() == [1, 2, 3]
    assert table["name"].tolist() == ["line", "line", "renamed"]
    assert table["trackfg"].tolist() == ["0.1"] * 3
    with pytest.raises(BadInputError, match="holds versions 1 to 3, not 4"):
        read_map(location, 4)


def test_what_a_run_said_is_stored_once(make_map: MakeMap, tmp_path: Path) -> None:
    path = tmp_path / "line.gpkg"
    write_map(make_map(runs=2), path, parent=None)
    write_map(make_map(runs=3, seed=1), path, parent=1)
    # three runs, and a covariance for each of the two versions
    assert sqlite(path, "SELECT count(*) FROM map_matrices") == [(5,)]


def test_read_and_written_elsewhere(make_map: MakeMap, assert_same_map: Same, location: str, tmp_path: Path) -> None:
    made = make_map(origin=(35.2, 137.1, 40.0))
    write_map(make_map(seed=3), location, parent=None)
    write_map(made, location, parent=1)
    copy = tmp_path / "copy.gpkg"
    assert write_map(read_map(location), copy, parent=None).version == 1
    assert_same_map(read_map(copy), made)


@pytest.mark.parametrize(("parent", "message"), [(None, "made from no earlier version"), (1, "made from version 1")])
def test_an_overtaken_write_is_refused(make_map: MakeMap, location: str, parent: int | None, message: str) -> None:
    write_map(make_map(), location, parent=None)
    write_map(make_map(seed=1), location, parent=1)
    with pytest.raises(MapConflictError, match=f"{message}, but the newest there is version 2") as caught:
        write_map(make_map(seed=2), location, parent=parent)
    assert (caught.value.parent, caught.value.newest) == (parent, 2)
    assert len(read_versions(location)) == 2


def test_rows_of_a_version_that_was_deleted_are_not_overwritten(make_map: MakeMap, location: str) -> None:
    write_map(make_map(), location, parent=None)
    place = locate(location)
    with place.connect("write") as connection:
        connection.execute(place.schema.versions.delete())
    with pytest.raises(
        BadInputError, match=r"table map_landmarks has rows of a version after 0, which table map_versions"
    ):
        write_map(make_map(), location, parent=None)


def test_a_parent_that_is_not_there(make_map: MakeMap, location: str, tmp_path: Path) -> None:
    with pytest.raises((MapConflictError, BadInputError), match=r"there is no version|no such file"):
        write_map(make_map(), location, parent=3)
    with pytest.raises(BadInputError):
        read_map(location)
    assert list(tmp_path.iterdir()) == []


TWO_AT_ONCE = """
    # Both children read from a pipe until it is closed. Then this process closes it, and both write at the same time.
    import dataclasses, os, sys
    from trackfg.maps import MapConflictError, read_map, write_map

    location, source, parent = sys.argv[1:]
    made = read_map(source)
    begin, hold = os.pipe()
    for name in ("Anna", "Boris"):
        if os.fork() == 0:
            os.close(hold)
            os.read(begin, 1)
            try:
                end = write_map(dataclasses.replace(made, name=name), location, parent=int(parent) or None).version
            except MapConflictError as error:
                end = f"conflict {error.parent} {error.newest}"
            os.write(1, f"{name}: {end}\\n".encode())
            os._exit(0)
    os.close(hold)
    assert [os.wait()[1] for _ in range(2)] == [0, 0]
"""


@pytest.mark.parametrize("location", ["gpkg", "plain"], indirect=True)
@pytest.mark.parametrize("parent", [1, pytest.param(0, marks=pytest.mark.slow)])
def test_of_two_writers_at_once_one_is_reported(
    make_map: MakeMap,
    assert_same_map: Same,
    location: str,
    tmp_path: Path,
    parent: int,
    run_program: Callable[..., str],
) -> None:
    """Also where there is nothing yet, and both would make it."""
    made = make_map(cells=10_001)
    source = tmp_path / "source.gpkg"
    write_map(made, source, parent=None)
    if parent:
        write_map(made, location, parent=None)
    ends = dict(line.split(": ") for line in run_program(TWO_AT_ONCE, location, source, parent).splitlines())
    assert sorted(ends) == ["Anna", "Boris"]
    assert sorted(ends.values()) == [str(parent + 1), f"conflict {parent or None} {parent + 1}"]
    winner = next(name for name, end in ends.items() if end == str(parent + 1))
    assert_same_map(read_map(location), dataclasses.replace(made, name=winner))
    if parent:
        assert_same_map(read_map(location, 1), made)


KILLED_AT_EVERY_STATEMENT = """
    # A child writes and kills itself just before its n-th statement, n = 1, 3, ..., until it lives to the end.
    import os, signal, sys
    from trackfg.maps import read_map, read_versions, write_map
    from trackfg.errors import BadInputError

    location, source = sys.argv[1:]
    made = read_map(source)

    def versions():
        try:
            return len(read_versions(location))
        except BadInputError:
            return 0

    def die_at(n):
        count = 0
        def on_call(frame, event, argument):
            nonlocal count
            if event == "call" and frame.f_code.co_name in ("do_execute", "do_executemany", "do_commit"):
                count += 1
                if count == n:
                    os.kill(os.getpid(), signal.SIGKILL)
        sys.setprofile(on_call)

    n = 1
    before = versions()
    while True:
        child = os.fork()
        if child == 0:
            die_at(n)
            write_map(made, location, parent=before or None)
            os._exit(0)
        _, status = os.waitpid(child, 0)
        if status == 0:
            break
        assert os.WTERMSIG(status) == signal.SIGKILL
        if before:
            assert read_map(location).version == before
        else:
            assert versions() == 0
        n += 2
    assert read_map(location).version == before + 1
    print(n)
"""


@pytest.mark.parametrize("location", ["gpkg", "plain"], indirect=True)
@pytest.mark.parametrize("there_before", [True, pytest.param(False, marks=pytest.mark.slow)])
def test_killed_within_a_write(
    make_map: MakeMap, location: str, tmp_path: Path, there_before: bool, run_program: Callable[..., str]
) -> None:
    """The old version is there, whole, and the next write succeeds."""
    write_map(make_map(cells=81, origin=(35.2, 137.1, 40.0)), tmp_path / "source.gpkg", parent=None)
    if there_before:
        write_map(make_map(cells=81), location, parent=None)
    moments = int(run_program(KILLED_AT_EVERY_STATEMENT, location, tmp_path / "source.gpkg"))
    assert moments > 10


KILLED_IN_COMMIT = """
    # The file grows in the commit alone: there the child is killed, with half of the pages written.
    import os, signal, sys
    from trackfg.maps import read_map, write_map

    path = sys.argv[1]
    made = read_map(path)
    torn = 0
    while torn < 2:
        parent = read_map(path).version
        before = os.stat(path).st_size
        child = os.fork()
        if child == 0:
            write_map(made, path, parent=parent)
            os._exit(0)
        while os.stat(path).st_size == before and os.waitpid(child, os.WNOHANG) == (0, 0):
            pass
        try:
            os.kill(child, signal.SIGKILL)
            os.waitpid(child, 0)
        except (ProcessLookupError, ChildProcessError):
            pass
        torn += os.path.exists(path + "-journal")
        found = read_map(path)
        assert found.version in (parent, parent + 1)
        assert found.grid.equals(made.grid)
"""


def test_killed_in_the_commit_of_a_file(make_map: MakeMap, tmp_path: Path, run_program: Callable[..., str]) -> None:
    path = tmp_path / "line.gpkg"
    write_map(make_map(cells=30_001), path, parent=None)
    run_program(KILLED_IN_COMMIT, path)
    assert sqlite(path, "PRAGMA integrity_check") == [("ok",)]
    assert not Path(f"{path}-journal").exists()


def test_a_map_is_read_while_another_is_written(make_map: MakeMap, assert_same_map: Same, location: str) -> None:
    made = make_map()
    write_map(made, location, parent=None)
    place = locate(location)
    with place.connect("write") as connection:
        insert_frame(connection, place.schema.grid, 2, made.grid)
        assert_same_map(read_map(location), made)


def test_other_tables_in_the_database_are_left_alone(make_map: MakeMap, server: Any) -> None:
    server.sql("plain", "CREATE SCHEMA shared; CREATE TABLE shared.mine AS SELECT 1 AS x")
    for schema in ("shared", "second"):
        write_map(make_map(cells=41, name=schema), server.url("plain", schema), parent=None)
    assert server.sql("plain", "SELECT x FROM shared.mine") == "1"
    assert read_map(server.url("plain", "shared")).name == "shared"
    assert read_map(server.url("plain", "second")).name == "second"


def test_no_such_server_or_database(server: Any, tmp_path: Path) -> None:
    with pytest.raises(BadInputError, match="absent"):
        read_map(server.url("absent", "line"))
    with pytest.raises(BadInputError, match="No such file or directory"):
        read_map(f"postgresql://user:secret@/x?host={tmp_path}&password=secret")


def test_without_the_driver(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "psycopg", None)
    with pytest.raises(TrackfgError, match=r"pip install 'trackfg\[postgres\]'"):
        read_map("postgresql://host/database")


def test_passwords_are_not_shown(tmp_path: Path) -> None:
    pytest.importorskip("psycopg")
    with pytest.raises(BadInputError) as caught:
        read_map(f"postgresql://user:secret@/x?host={tmp_path}&password=secret")
    assert "secret" not in str(caught.value)


@pytest.mark.parametrize(
    ("location", "message"),
    [
        ("line.sqlite", r"expected the path of a \.gpkg file"),
        ("mysql://host/database", "postgresql:// URL"),
        ("http://host/line.gpkg", "postgresql:// URL"),
        ("postgresql://host/database?schema=Robert'); DROP", "one name of small letters"),
        ("postgresql://host/database?schema=pg_catalog", "one name of small letters"),
        ("postgresql://host:port/database", "not a URL of a database"),
        ("absent.gpkg", "no such file"),
        ("absent/line.gpkg", "no such file"),
        ("folder.gpkg", "is no regular file"),
        ("text.gpkg", "is not a GeoPackage"),
        ("empty.gpkg", "holds no feature map"),
        ("torn.gpkg", "malformed|not a database"),
        ("foreign.gpkg", "holds no feature map"),
        ("a\0b.gpkg", "expected the path of a"),
    ],
)
def test_refuses_to_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, location: str, message: str) -> None:
    monkeypatch.chdir(tmp_path)
    Path("folder.gpkg").mkdir()
    Path("text.gpkg").write_text("chainage_m,cant_mm\n")
    Path("empty.gpkg").touch()
    Path("torn.gpkg").write_bytes(b"SQLite format 3\0" + bytes(range(256)) * 40)
    sqlite("foreign.gpkg", "CREATE TABLE rivers (fid INTEGER PRIMARY KEY)")
    before = sorted(os.listdir())
    with pytest.raises(BadInputError, match=message):
        read_map(location)
    assert sorted(os.listdir()) == before


@pytest.mark.parametrize("name", ["text.gpkg", "foreign.gpkg", "folder.gpkg", "absent/line.gpkg"])
def test_refuses_to_write(make_map: MakeMap, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    monkeypatch.chdir(tmp_path)
    Path("folder.gpkg").mkdir()
    Path("text.gpkg").write_text("chainage_m,cant_mm\n")
    sqlite("foreign.gpkg", "CREATE TABLE rivers (fid INTEGER PRIMARY KEY)")
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir() if path.is_file()}
    with pytest.raises(BadInputError):
        write_map(make_map(cells=41), name, parent=None)
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir() if path.is_file()} == before


@pytest.mark.parametrize(
    ("statement", "message"),
    [
        ("UPDATE map_format SET format = 'trackfg-map/2'", "has format 'trackfg-map/2'; this version of trackfg reads"),
        ("DROP TABLE map_grid", "table map_grid is missing"),
        ("ALTER TABLE map_grid DROP COLUMN cant_mm", "cant_mm"),
        ("DELETE FROM map_versions", "holds no version"),
        ("DELETE FROM map_matrices", "matrix .* is missing"),
        ("UPDATE map_matrices SET data = substr(data, 9)", "numbers: expected"),
        ("UPDATE map_matrices SET data = 'text'", "version 1 is damaged"),
        ("UPDATE map_versions SET configuration = '{'", "version 1 is damaged"),
        ("UPDATE map_landmarks SET kind = 'BVC'", "kind: expected one of"),
        ("UPDATE map_landmarks SET chainage_m_sd = 3", "covariance: expected the squares"),
        ("UPDATE map_grid SET chainage_m = 'x'", "version 1 is damaged"),
        ("DELETE FROM map_landmarks WHERE kind = 'fix'", "covariance is of other landmarks"),
        ("DELETE FROM map_grid WHERE chainage_m = 5", "map_grid: rows are missing .1.; expected all that were written"),
        (
            "ALTER TABLE map_grid RENAME COLUMN cant_mm TO cant",
            "no such column: .*; expected the columns of a feature map",
        ),
        ("UPDATE map_format SET format = 'evil'", "has format 'evil'"),
        ("UPDATE map_format SET format = ''", "has format ''"),
        ("UPDATE map_versions SET configuration = '[]'", "configuration: expected a JSON object"),
        ("UPDATE map_versions SET software = '{\"trackfg\": 1}'", "expected versions as text"),
        (f"UPDATE map_versions SET configuration = '{'[' * 100000}'", "version 1 is damaged"),
        ("UPDATE map_versions SET gauge_m = 'wide'", "gauge_m is 'wide': expected a length"),
        ("UPDATE map_versions SET chord_m = 0", "chord_m is 0.0: expected a length"),
        ("UPDATE map_versions SET name = x'ff'", "damaged"),
        ("UPDATE map_runs SET direction = 9e999", "version 1 is damaged"),
        ("UPDATE map_grid SET observations = 9e999", "version 1 is damaged"),
        ("UPDATE map_grid SET cross_level_mm = 1e300", "cross_level_mm: expected numbers up to 1e"),
        ("UPDATE map_grid SET cross_level_mm_sd = 1e300", "cross_level_mm_sd: expected numbers up to 1e"),
        ("UPDATE map_grid SET chainage_m = 1e9 WHERE chainage_m = 10", "chainage_m: expected numbers up to 1e"),
        ("UPDATE map_landmarks SET radius_m = 1e300", "radius_m: expected numbers up to 1e"),
        ("UPDATE map_landmarks SET radius_m = -5", "radius_m: expected positive numbers"),
        ("UPDATE map_runs SET offset_m = 1e300", "offset_m: expected numbers up to 1e"),
    ],
)
def test_refuses_a_damaged_map(make_map: MakeMap, tmp_path: Path, statement: str, message: str) -> None:
    path = tmp_path / "line.gpkg"
    write_map(make_map(cells=41), path, parent=None)
    sqlite(path, statement)
    with pytest.raises(BadInputError, match=message) as caught:
        read_map(path)
    assert str(path) in str(caught.value)


@pytest.mark.parametrize(
    "damage",
    [
        *(f"software = '{text}'" for text in ("[]", "{", "7", "[" * 100000)),
        *(f"parent = {value}" for value in ("9e999", "0.5", "'x'")),
    ],
)
def test_a_damaged_list_of_versions(make_map: MakeMap, tmp_path: Path, damage: str) -> None:
    path = tmp_path / "line.gpkg"
    write_map(make_map(cells=41), path, parent=None)
    sqlite(path, f"UPDATE map_versions SET {damage}")
    with pytest.raises(BadInputError, match="table of versions is damaged"):
        read_versions(path)


@pytest.mark.parametrize("table", ["map_versions", "MAP_GRID", "map_matrices", "gpkg_contents"])
def test_a_strangers_triggers_do_not_run(make_map: MakeMap, tmp_path: Path, table: str) -> None:
    path = tmp_path / "line.gpkg"
    write_map(make_map(cells=41), path, parent=None)
    sqlite(path, f"CREATE TRIGGER evil AFTER INSERT ON {table} BEGIN DELETE FROM map_grid; END")
    with pytest.raises(BadInputError, match=r"trigger 'evil' on table .*: expected none"):
        write_map(make_map(cells=41), path, parent=1)
    assert len(read_map(path).grid) == 41


def test_triggers_on_a_layer_and_on_other_tables_stay_allowed(make_map: MakeMap, tmp_path: Path) -> None:
    """They are a spatial index that a GIS made."""
    path = tmp_path / "line.gpkg"
    write_map(make_map(cells=41), path, parent=None)
    sqlite(path, "CREATE TABLE bridges (fid INTEGER PRIMARY KEY)")
    for table in ("landmarks", "bridges"):
        sqlite(path, f"CREATE TRIGGER index_{table} AFTER INSERT ON {table} BEGIN SELECT gis(); END")
    assert write_map(make_map(cells=41), path, parent=1).version == 2


def test_a_newer_format_is_not_written_to(make_map: MakeMap, tmp_path: Path) -> None:
    path = tmp_path / "line.gpkg"
    write_map(make_map(cells=41), path, parent=None)
    sqlite(path, "UPDATE map_format SET format = 'trackfg-map/2'")
    with pytest.raises(BadInputError, match="trackfg-map/2"):
        write_map(make_map(cells=41), path, parent=1)


@pytest.mark.parametrize("name", ["a?mode=memory.gpkg", "a%20b#c&d.gpkg", "Gleis Ä 駅.gpkg", "-o.gpkg", "a'b\".GPKG"])
def test_every_name_of_a_file_is_a_name(
    make_map: MakeMap, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    monkeypatch.chdir(tmp_path)
    write_map(make_map(cells=41), name, parent=None)
    assert os.listdir() == [name]
    assert read_map(name).version == 1


def test_settings_that_json_cannot_hold(make_map: MakeMap, tmp_path: Path) -> None:
    made = dataclasses.replace(make_map(cells=41), configuration={"gate": float("nan")})
    with pytest.raises(ValueError, match="JSON"):
        write_map(made, tmp_path / "line.gpkg", parent=None)
    assert list(tmp_path.iterdir()) == []


def test_a_view_is_not_taken_for_a_table(make_map: MakeMap, tmp_path: Path) -> None:
    """Reading one would run what a stranger put into it."""
    path = tmp_path / "line.gpkg"
    write_map(make_map(cells=41), path, parent=None)
    sqlite(path, "ALTER TABLE map_grid RENAME TO hidden")
    sqlite(path, "CREATE VIEW map_grid AS SELECT * FROM hidden")
    with pytest.raises(BadInputError, match="table map_grid is missing"):
        read_map(path)


def test_a_pipe_is_no_map(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "line.gpkg")
    with pytest.raises(BadInputError, match="is no regular file"):
        read_map(tmp_path / "line.gpkg")

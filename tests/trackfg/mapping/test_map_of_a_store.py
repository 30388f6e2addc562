"""Maps of the runs that a store holds, line by line, through the real commands."""

from __future__ import annotations

import subprocess
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from trackfg.cli.mapping import map_file
from trackfg.cli.mapping.map_file import FleetRuns, build_map_file
from trackfg.errors import BadInputError
from trackfg.fleet.catalogue import Run
from trackfg.fleet.key_figures import done_row, failed_row
from trackfg.fleet.store import Store
from trackfg.mapping.joining import build
from trackfg.maps import read_map
from trackfg.results.result import Result

Ride = Callable[..., Any]


def put(store: Store, name: str, line: str, result: Result) -> None:
    """Put a result into a store, as a batch does."""
    folder = result.write(store.result(name))
    store.write([done_row(Run(name, f"/recordings/{name}", line), folder)])


@pytest.fixture
def store(ride: Ride, tmp_path: Path) -> Store:
    store = Store(tmp_path / "store")
    for number in range(2):
        put(store, f"up{number}", "7 up", ride(number).result)
    put(store, "other", "8", ride(0, seed=4).result)
    store.write([failed_row(Run("broken", "/recordings/broken", "7 up"), "crashed with SIGSEGV", "")])
    return store


def test_runs_of_a_line_are_joined_once(store: Store, ride: Ride, tmp_path: Path) -> None:
    place, line = tmp_path / "line.gpkg", FleetRuns(line="7 up")
    first = build_map_file([store.place], place, fleet=line)
    by_hand = build_map_file([store.result(f"up{number}") for number in range(2)], tmp_path / "by_hand.gpkg")
    assert first.grid.equals(by_hand.grid)
    assert np.array_equal(first.covariance, by_hand.covariance)
    put(store, "up2", "7 up", ride(2).result)
    assert (build_map_file([store.place], place, fleet=line).version, len(read_map(place).runs)) == (2, 3)
    assert build_map_file([store.place], place, fleet=line).version == 2


def test_a_run_that_is_not_of_the_line_is_named(
    store: Store, ride: Ride, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    put(store, "astray", "7 up", ride(1, seed=4).result)
    built = build_map_file([store.place], tmp_path / "line.gpkg", fleet=FleetRuns(line="7 up"))
    joined = [ride(number).result.summary.recording_id for number in range(2)]
    assert sorted(built.runs["recording_id"]) == sorted(joined)
    lost = ride(1, seed=4).result.summary.recording_id
    assert f"trackfg: warning: left out: run {lost}: its track is not recognised" in capsys.readouterr().err
    again = build_map_file([store.place], tmp_path / "line.gpkg", fleet=FleetRuns(line="7 up"))
    assert again.version == 1, "no version without a new run"


def test_a_store_of_several_lines_needs_one(store: Store, tmp_path: Path) -> None:
    with pytest.raises(BadInputError, match="runs of line 7 up, 8: expected one of these as --line"):
        build_map_file([store.place], tmp_path / "line.gpkg")
    with pytest.raises(BadInputError, match="expected one of these as --line"):
        build_map_file([store.place], tmp_path / "line.gpkg", fleet=FleetRuns(line="9"))
    with pytest.raises(BadInputError, match="--line chooses among the runs of a store"):
        build_map_file([store.result("up0")], tmp_path / "line.gpkg", fleet=FleetRuns(line="7 up"))


def test_a_store_whose_runs_all_failed_has_no_line_to_choose(tmp_path: Path) -> None:
    place = str(tmp_path / "failed")
    Store(place, create=True)
    with pytest.raises(BadInputError, match="failed: has no run with a result; expected one"):
        build_map_file([place], tmp_path / "line.gpkg")


@pytest.mark.slow
def test_processes_make_the_same_map(
    trackfg: Callable[..., subprocess.CompletedProcess[str]],
    store: Store,
    ride: Ride,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Two runs one after another, and two blocks of two for the processes."""
    from .joining.test_many_runs import repeated

    monkeypatch.setattr(build, "_ONE_BY_ONE", 2)
    for module in (build, map_file):
        monkeypatch.setattr(module, "BLOCK", 2)
    for number in range(6):
        put(store, f"many{number:02d}", "9", repeated(ride(number % 2).result, number))
    maps = []
    for jobs in (1, 2):
        place = tmp_path / f"{jobs}.gpkg"
        options = ("--line", "9", "--name", "line", "-o", place, "--jobs", jobs)
        assert trackfg("map", "build", store.place, *options).returncode == 0
        maps.append(read_map(place))
    alone, shared = (replace(each, written_at=None) for each in maps)
    assert len(alone.runs) == 6
    assert all(getattr(alone, name).equals(getattr(shared, name)) for name in ("grid", "landmarks", "line", "runs"))

"""Maps kept in a file: begun, made longer, and by two writers at once; through the real commands."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pandas as pd
import pytest

from trackfg.cli.mapping import map_file
from trackfg.cli.mapping.map_file import build_map_file
from trackfg.errors import BadInputError
from trackfg.io.reader import read_recording, write_recording
from trackfg.maps import read_map, read_versions, write_map
from trackfg.smoothing.smoother import smooth

Ride = Callable[..., Any]


@pytest.fixture
def out(ride: Ride, tmp_path: Path) -> Callable[[int], Path]:
    """The folder of a run's result."""
    return lambda run: ride(run).result.write(tmp_path / f"out{run}")


def test_begun_and_made_longer(out: Callable[[int], Path], tmp_path: Path) -> None:
    place = tmp_path / "line.gpkg"
    shown: list[float] = []
    first = build_map_file([out(0), out(1)], place, progress=lambda what, done: shown.append(done))
    assert (first.name, first.version, first.parent) == ("line", 1, None)
    assert shown == sorted(shown)
    second = build_map_file([out(2)], place)
    assert (second.version, second.parent) == (2, 1)
    assert len(second.runs) == 3
    again = read_map(place)
    pd.testing.assert_frame_equal(again.grid, second.grid, check_exact=False, rtol=1e-12)
    assert set(first.landmarks["landmark_id"]) == set(second.landmarks["landmark_id"])
    with pytest.raises(BadInputError, match="in the map already"):
        build_map_file([out(2)], place)
    with pytest.raises(BadInputError, match="is the map 'line'"):
        build_map_file([out(3)], place, name="another")
    assert len(read_versions(place)) == 2


def test_a_second_writer_meanwhile_loses_nothing(
    out: Callable[[int], Path], ride: Ride, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    place = tmp_path / "line.gpkg"
    build_map_file([out(0)], place)
    right = map_file.with_runs
    others = [1]

    def overtaken(*args: Any, **kwargs: Any) -> Any:
        joined = right(*args, **kwargs)
        while others:
            write_map(right(read_map(place), [ride(others.pop()).result]), place, parent=1)
        return joined

    monkeypatch.setattr(map_file, "with_runs", overtaken)
    built = build_map_file([out(2)], place)
    assert built.version == 3
    assert sorted(built.runs["recording_id"]) == sorted(ride(run).result.summary.recording_id for run in (0, 1, 2))


def test_the_commands(out: Callable[[int], Path], ride: Ride, trackfg: Callable[..., Any], tmp_path: Path) -> None:
    place = tmp_path / "line.gpkg"
    built = trackfg("map", "build", out(0), out(1), out(2), "-o", place, "--name", "Short line")
    assert built.returncode == 0, built.stderr
    assert "version 1: 3 runs" in built.stdout

    run = ride(5)
    recording = tmp_path / "rec"
    made = run.simulation.recording
    write_recording(
        replace(made, description=made.description.model_copy(update={"fixes": None}), fixes=None), recording
    )
    located = trackfg("smooth", recording, "-o", tmp_path / "located", "--map", place, "--json")
    assert located.returncode == 0, located.stderr
    use = json.loads(located.stdout)["map"]
    assert (use["name"], use["version"]) == ("Short line", 1)
    assert use["sections"] > 5

    changes = trackfg("map", "changes", tmp_path / "located", place, "-o", tmp_path / "changes.csv")
    assert changes.returncode == 0, changes.stderr
    assert len(pd.read_csv(tmp_path / "changes.csv")) == 0

    refused = trackfg("map", "build", tmp_path / "located", "-o", place)
    assert refused.returncode == 2
    assert "smoothed with a map" in refused.stderr


def test_readme(trackfg: Callable[..., Any], tmp_path: Path) -> None:
    """The runs' description gives the roll of the mounting without a sigma, as most do."""
    for run in range(3):
        simulated = trackfg("simulate", "mainline", "-o", tmp_path / f"run{run}", "--run", run, "--duration", 200)
        assert simulated.returncode == 0, simulated.stderr
    for run in range(2):
        smoothed = trackfg("smooth", tmp_path / f"run{run}", "-o", tmp_path / f"out{run}")
        assert smoothed.returncode == 0, smoothed.stderr
    place = tmp_path / "line.gpkg"
    built = trackfg("map", "build", tmp_path / "out0", tmp_path / "out1", "-o", place)
    assert (built.returncode, built.stderr) == (0, "")
    located = trackfg("smooth", tmp_path / "run2", "-o", tmp_path / "located", "--map", place, "--json")
    assert located.returncode == 0, located.stderr
    assert json.loads(located.stdout)["map"]["sections"] > 10
    information = read_map(place).information
    assert not any(name.startswith("sensor/") for run in information.values() for name in run.variables)


def test_runs_of_two_hundred_metres(trackfg: Callable[..., Any], tmp_path: Path) -> None:
    for run in range(2):
        simulated = trackfg("simulate", "trolley", "-o", tmp_path / f"run{run}", "--run", run, "--duration", 300)
        assert simulated.returncode == 0, simulated.stderr
        smoothed = trackfg("smooth", tmp_path / f"run{run}", "-o", tmp_path / f"out{run}")
        assert smoothed.returncode == 0, smoothed.stderr
    at_once, later = tmp_path / "at_once.gpkg", tmp_path / "later.gpkg"
    built = trackfg("map", "build", tmp_path / "out0", tmp_path / "out1", "-o", at_once)
    assert (built.returncode, built.stderr) == (0, "")
    assert "version 1: 2 runs, 0.2 km" in built.stdout
    for run in range(2):
        added = trackfg("map", "build", tmp_path / f"out{run}", "-o", later)
        assert (added.returncode, added.stderr) == (0, "")
    grids = read_map(at_once).grid.merge(read_map(later).grid, on="chainage_m", suffixes=("", "_later"))
    assert len(grids) == len(read_map(at_once).grid)
    assert (grids["cross_level_mm"] - grids["cross_level_mm_later"]).abs().max() < 1e-3

    # Recognised, but between two places that the runs before are tied to.
    made = read_recording(tmp_path / "run1")
    description = made.description.model_copy(update={"fixes": None})
    result = smooth(replace(made, description=description, fixes=None))
    inside = result.geometry["chainage_m"].between(20.0, 200.0)
    replace(result, geometry=result.geometry[inside].reset_index(drop=True)).write(tmp_path / "inside")
    refused = trackfg("map", "build", tmp_path / "out0", tmp_path / "inside", "-o", tmp_path / "no.gpkg")
    assert refused.returncode == 2
    assert "passes none of the map's anchors" in refused.stderr

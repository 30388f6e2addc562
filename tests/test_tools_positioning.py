"""The benchmark of positioning: what counts as found, missed and false, what is cut out of a run, and the table."""

from __future__ import annotations

import importlib
import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from trackfg.datasets.line.defects import Defect
from trackfg.datasets.scenarios import simulate

TOOLS = Path(__file__).parents[1] / "tools"

DESIGNED = np.array(
    [
        [1000.0, 1060.0, 1300.0, 1360.0, 1 / 400, -60.0],
        [2000.0, 2050.0, 2200.0, 2250.0, -1 / 500, 50.0],
        [3000.0, 3050.0, 3200.0, 3250.0, 1 / 500, -50.0],
    ]
)


@pytest.fixture
def tools(monkeypatch: pytest.MonkeyPatch) -> SimpleNamespace:
    monkeypatch.syspath_prepend(TOOLS)
    names = ("runs", "map", "localise", "changes")
    modules = {name: importlib.import_module(f"positioning.{name}") for name in names}
    return SimpleNamespace(benchmark=importlib.import_module("benchmark"), **modules)


def landmark_table(*curves: tuple[str, str, list[float]]) -> pd.DataFrame:
    """Name, sense and four chainages of each curve, and a fix before all."""
    rows = [("", "fix", "", 10.0)]
    for name, sense, places in curves:
        rows += [(name, kind, sense, at) for kind, at in zip(("BTC", "BCC", "ECC", "ETC"), places, strict=True)]
    table = pd.DataFrame(rows, columns=["curve_id", "kind", "sense", "chainage_m"])
    return table.sort_values("chainage_m", ignore_index=True)


def test_landmarks_are_held_against_the_curve_that_they_belong_to(tools: SimpleNamespace) -> None:
    landmarks = landmark_table(
        ("a", "left", [1001.0, 1059.0, 1300.0, 1364.0]),
        ("b", "left", [2000.0, 2050.0, 2200.0, 2250.0]),  # turns the other way than the designed one
        ("c", "left", [2990.0, 3040.0, 3100.0, 3110.0]),  # two where one is designed
        ("d", "left", [3120.0, 3130.0, 3190.0, 3240.0]),
    )
    covariance = np.diag(np.r_[1.0, np.full(16, 4.0)])
    covariance[1, 2] = covariance[2, 1] = -4.0
    found = tools.map.landmark_errors(landmarks, covariance, DESIGNED)
    assert found.seen.tolist() == [True, False, False]
    assert found.false == 1  # the one that turns the other way; halves of a curve are at least where one is
    errors = found.errors.set_index("point")
    assert errors["error_m"].to_dict() == {
        "BTC": 1.0, "BCC": -1.0, "ECC": 0.0, "ETC": 4.0, "middle in": 0.0, "middle out": 2.0
    }  # fmt: skip
    assert errors["sd_m"].to_dict() == {
        "BTC": 2.0, "BCC": 2.0, "ECC": 2.0, "ETC": 2.0, "middle in": 0.0, "middle out": pytest.approx(np.sqrt(2.0))
    }  # fmt: skip


def test_a_map_without_curves_misses_all(tools: SimpleNamespace) -> None:
    found = tools.map.landmark_errors(landmark_table(), np.eye(1), DESIGNED)
    assert found.errors.empty
    assert not found.seen.any()
    assert found.false == 0


def test_changes_belong_to_defects_within_20_m(tools: SimpleNamespace) -> None:
    placed = (Defect("dip", 100.0, 3e-3, 5.0), Defect("twist", 500.0, 3e-3, 5.0))
    table = pd.DataFrame({"from_m": [80.0, 140.0, 480.0], "to_m": [82.0, 150.0, 530.0]})
    near = tools.changes.near_defects(table, placed)
    assert near.tolist() == [[True, False], [False, False], [False, True]]
    assert tools.changes.near_defects(table, ()).shape == (3, 0)
    assert tools.changes.near_defects(table.iloc[:0], placed).shape == (0, 2)


def test_defects_lie_within_the_line_and_apart(tools: SimpleNamespace) -> None:
    for seed in range(50):
        extents = np.array([defect.extent_m for defect in tools.changes.defects(seed)])
        assert extents.min() > 400.0
        assert extents.max() < 7700.0
        assert np.all(extents[1:, 0] - extents[:-1, 1] > 700.0)


def test_a_recording_is_cut_and_loses_its_fixes(tools: SimpleNamespace) -> None:
    recording = simulate("shuttle", duration_s=60.0).recording
    assert recording.fixes is not None
    part = tools.runs.cut(recording, 20.0, 40.0)
    assert part.fixes is None
    assert part.description.fixes is None
    assert len(part.imu) == 20 * 200
    assert part.tach["t_s"].agg(["min", "max"]).tolist() == [20.0, 40.0]
    first = tools.runs.with_fixes(recording, [0])
    assert len(first.fixes) == 1
    assert first.imu is recording.imu


@pytest.mark.parametrize("direction", [1, -1])
def test_recordings_end_past_the_curves_after_their_start(tools: SimpleNamespace, direction: int) -> None:
    t = np.arange(0.0, 400.5, 0.5)
    chainage = 10.0 * t if direction == 1 else 4000.0 - 10.0 * t
    run = SimpleNamespace(
        truth=pd.DataFrame({"t_s": t, "chainage_m": chainage}), ride=SimpleNamespace(direction=direction)
    )
    for _, start, until in tools.localise._cuts(run, DESIGNED, np.random.default_rng(0)):
        first = {1: 1000.0, -1: 4000.0 - 3250.0}[direction]
        assert 0.0 <= 10.0 * start <= first
        ends = {1: DESIGNED[:, 3], -1: 4000.0 - DESIGNED[::-1, 0]}[direction]
        np.testing.assert_allclose(10.0 * until, ends + tools.localise.PAST_CURVE_M, atol=5.0)


def test_shares_and_errors_are_pooled_over_seeds(tools: SimpleNamespace) -> None:
    measured = pd.DataFrame({"found": [9.0, 0.0], "asked": [10.0, 90.0], "rms": [3.0, np.nan], "count": [4.0, 0.0]})
    assert tools.benchmark.ratio(measured, "found", "asked") == pytest.approx(0.09)
    assert tools.benchmark.pooled_rms(measured, "rms", "count") == pytest.approx(3.0)
    assert np.isnan(tools.benchmark.pooled_rms(measured.iloc[1:], "rms", "count"))
    part = tools.benchmark.Part("map", "a map", lambda seed: {}, lambda measured: [])
    lines = [
        tools.benchmark.at_most("error, m", 0.3, 0.4, [0.2, 0.5, np.nan], paper="10"),
        tools.benchmark.at_least("recall", np.nan, 0.95),
        tools.benchmark.Figure("curves", 8.0),
    ]
    table = tools.benchmark.table_of(part, lines)
    assert list(table["met"]) == ["yes", "NO", ""]
    shown = tools.benchmark.printed(table)
    assert "0.2 .. 0.5" in shown
    assert "<= 0.4" in shown


HALF_AS_LONG = """
import functools
from positioning import main, slips

slips.simulate = functools.partial(slips.simulate, duration_s=620.0)
main.main()
"""


@pytest.mark.slow
def test_one_seed_of_one_part(tmp_path: Path) -> None:
    """The wheel slips in the first half of the runs, too."""
    lines, per_seed = tmp_path / "lines.csv", tmp_path / "seeds.json"
    command = [sys.executable, "-c", HALF_AS_LONG, "--parts", "slips", "--seeds", "1", "--jobs", "1"]
    command += ["--out", str(lines), "--per-seed", str(per_seed)]
    done = subprocess.run(
        command, capture_output=True, text=True, check=True, env={**os.environ, "PYTHONPATH": str(TOOLS)}
    )
    assert "slips  Slip and slide" in done.stdout
    table = pd.read_csv(lines).set_index("quantity")
    assert table.loc["slippery-line: rms error of a leg with slip, %", "value"] < 0.2
    measured = json.loads(per_seed.read_text(encoding="utf-8"))
    assert measured["slips"]["0"]["line slips count"] > 0


def test_bad_arguments_are_refused(refusal: Callable[..., str]) -> None:
    assert "invalid choice: 'maps'" in refusal("positioning", "--parts", "maps")
    assert "expected a name" in refusal("positioning", "--per-seed", "x.txt")

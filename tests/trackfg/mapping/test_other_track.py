"""Two tracks of one line: the same curves, other irregularities."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import pytest

from trackfg.datasets.line.line_file import read_line_file
from trackfg.datasets.scenarios import scenario, simulate
from trackfg.mapping import build_map, find_changes, with_runs
from trackfg.mapping.joining.build import Joining
from trackfg.mapping.trends.series import series
from trackfg.results.result import Result
from trackfg.smoothing.smoother import smooth

LINE = """
format = "trackfg-line/1"
id = "double"
speed_limit = [{chainage_m = 0.0, kmh = 80}]
element = [
    {type = "straight", length_m = 700.0},
    {type = "transition", length_m = 80.0},
    {type = "curve", radius_m = 500.0, length_m = 400.0, cant_mm = 100},
    {type = "transition", length_m = 80.0},
    {type = "straight", length_m = 900.0},
    {type = "transition", length_m = 60.0},
    {type = "curve", radius_m = -700.0, length_m = 300.0, cant_mm = 70},
    {type = "transition", length_m = 60.0},
    {type = "straight", length_m = 1500.0},
]
"""


@pytest.fixture(scope="module")
def passed(tmp_path_factory: pytest.TempPathFactory) -> Callable[[int, int], Result]:
    """``passed(track, run)``: a smoothed run over one of the tracks."""
    path: Path = tmp_path_factory.mktemp("line") / "double.toml"
    path.write_text(LINE, encoding="utf-8")
    plan = scenario("mainline").on(read_line_file(path))

    @cache
    def run_over(track: int, run: int) -> Result:
        return smooth(simulate(plan, seed=track, run=run, duration_s=200.0).recording)

    return run_over


def dated(result: Result, month: int) -> Result:
    assert result.summary.run is not None
    facts = result.summary.run.model_copy(update={"start": f"2026-{month:02d}-05T03:12:00Z"})
    return replace(result, summary=result.summary.model_copy(update={"run": facts}))


def test_trends_name_a_run_on_the_track_beside(passed: Callable[[int, int], Result]) -> None:
    runs = [dated(passed(0, run), 1 + run) for run in range(3)]
    feature_map, beside = build_map(runs[:2], name="up"), dated(passed(1, 0), 4)
    found, left_out = series([*runs, beside], feature_map)
    assert not left_out
    (said,) = found.doubts.values()
    assert said.startswith(f"run {beside.summary.recording_id}: its curves are those of the map 'up', but")


def test_a_run_on_the_track_beside_is_named(passed: Callable[[int, int], Result]) -> None:
    feature_map = build_map([passed(0, 0), passed(0, 1)], name="up")
    same, beside = passed(0, 2), passed(1, 0)
    assert not find_changes(same, feature_map).other_track
    assert find_changes(beside, feature_map).other_track
    reported: list[str] = []
    longer = with_runs(feature_map, [same, beside], joining=Joining(warn=reported.append))
    assert len(longer.runs) == 4
    assert len(reported) == 1
    assert reported[0].startswith(f"run {beside.summary.recording_id}: its curves are those of the map 'up', but")

"""The acceptance of the stream: what its faults leave alone, what counts as a loss, and what it says of cost."""

from __future__ import annotations

import importlib
import os
import subprocess
import sys
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from trackfg.results.columns import TRAJECTORY_COLUMNS
from trackfg.streaming.sinks.parquet_parts import ParquetParts
from trackfg.streaming.stream_counts import StreamCounts

TOOLS = Path(__file__).parents[1] / "tools"


@pytest.fixture
def tools(monkeypatch: pytest.MonkeyPatch) -> SimpleNamespace:
    monkeypatch.syspath_prepend(TOOLS)
    names = ("base_cases", "fault_injection", "kill_and_resume", "faults", "fault_table", "cost", "accuracy")
    return SimpleNamespace(**{name: importlib.import_module(f"streaming.{name}") for name in names})


def trajectory(until_s: float, rate_hz: float) -> pd.DataFrame:
    t = np.arange(0.0, until_s + 1e-9, 1.0 / rate_hz)
    return pd.DataFrame({name: t if name == "t_s" else np.ones(len(t)) for name in TRAJECTORY_COLUMNS})


@pytest.mark.parametrize("name", ["line", "gnss", "trolley"])
def test_what_comes_before_a_fault_is_as_it_was(tools: SimpleNamespace, name: str) -> None:
    own = tools.base_cases.base_case(name)
    for kind, damage in tools.fault_injection.DAMAGES.items():
        for seed in range(3):
            damaged = damage(own, np.random.default_rng(seed))
            assert (
                tools.fault_injection.EARLIEST_S
                <= damaged.begin_s
                <= damaged.end_s
                < tools.base_cases.DURATION_S - 10.0
            ), kind
            for table, before in own.stream.tables.items():
                after = damaged.stream.tables[table]
                first, same = (np.flatnonzero(part.at < damaged.begin_s - 1e-9) for part in (before, after))
                np.testing.assert_array_equal(before.rows[first], after.rows[same], err_msg=f"{kind} {table}")
            again = damage(own, np.random.default_rng(seed))
            assert again.said == damaged.said


def test_every_fault_does_something(tools: SimpleNamespace) -> None:
    own = tools.base_cases.base_case("gnss")
    for kind, damage in tools.fault_injection.DAMAGES.items():
        damaged = damage(own, np.random.default_rng(1)).stream.tables
        same = all(
            np.array_equal(damaged[name].at, table.at) and np.array_equal(damaged[name].rows, table.rows, True)
            for name, table in own.stream.tables.items()
        )
        assert same == (kind in ("none", "throw")), kind


def test_raw_rows_and_lines_hold_what_canonical_ones_do(tools: SimpleNamespace) -> None:
    for name in ("gnss", "trolley"):
        own = tools.base_cases.base_case(name)
        given = Counter({table: len(rows.at) for table, rows in own.stream.tables.items()})
        came: Counter[str] = Counter()
        for batch in own.stream.source():
            came.update({table: len(rows) for table, rows in batch.tables.items()})
        assert came == given


def test_losses_are_seen(tools: SimpleNamespace) -> None:
    own = tools.base_cases.base_case("line")
    damaged = tools.fault_injection.none(own, np.random.default_rng(0))
    rows = sum(len(table.at) for table in own.stream.tables.values())
    filtered, smoothed = trajectory(60.0, 2.0), trajectory(60.0, 10.0)
    events = pd.DataFrame({"rows": [3, 0]})

    def losses(*, used: int = rows - 3, filtered: pd.DataFrame = filtered, smoothed: pd.DataFrame = smoothed) -> str:
        counts = StreamCounts(rows, used, len(filtered))
        result = tools.faults.Streamed(counts, {"events": events})
        return "; ".join(tools.faults._losses(damaged, result, filtered, smoothed))

    assert losses() == ""
    assert f"{rows - 4} used, 3 in events" in losses(used=rows - 4)
    assert "no filtered row from 9.50 to 10.50 s" in losses(filtered=filtered.drop(index=20))
    assert "smoothed rows do not follow each other: 600" in losses(smoothed=smoothed.drop(index=300))
    assert "filtered ones to 60.00 s" in losses(smoothed=smoothed.iloc[:-5])
    broken = filtered.copy()
    broken.loc[7, "roll_rad"] = np.nan
    assert "filtered: NaN in roll_rad" in losses(filtered=broken)


def test_errors_are_taken_where_the_clock_of_the_stream_says(tools: SimpleNamespace) -> None:
    own = tools.base_cases.base_case("line")
    truth = own.run.truth
    damaged = tools.fault_injection.Damaged(own.stream, 20.0, 20.0, "", ahead_s=5.0)
    later = truth[truth["t_s"] > 30.0]
    table = pd.DataFrame({name: np.full(len(later), 0.5) for name in TRAJECTORY_COLUMNS})
    table["t_s"] = later["t_s"].to_numpy() + 5.0
    for name in tools.faults.JUDGED:
        table[name] = later[name].to_numpy() + 2.0
    for name, error, sd in tools.faults.errors(own, damaged, table, 5.0):
        np.testing.assert_allclose(error, 2.0 - tools.faults.JUDGED[name], atol=1e-6)
        np.testing.assert_array_equal(sd, 0.5)


def test_what_was_written_must_be_the_beginning_of_the_whole(tools: SimpleNamespace, tmp_path: Path) -> None:
    whole = {"filtered": trajectory(20.0, 2.0), "smoothed": trajectory(20.0, 10.0)}
    sink = ParquetParts(tmp_path, rows_per_part=10)
    sink.write("filtered", whole["filtered"].iloc[:25])
    assert tools.kill_and_resume._not_whole(tmp_path, whole) == ""
    sink.checkpoint()
    assert tools.kill_and_resume._not_whole(tmp_path, whole) == ""
    assert tools.kill_and_resume._not_all(tmp_path, whole) == "filtered: 25 rows; expected 41"
    sink.write("filtered", whole["filtered"].iloc[26:])
    sink.close()
    assert tools.kill_and_resume._not_whole(tmp_path, whole) == "filtered: 40 rows are not the first of 41"


def test_cases_are_counted_by_kind(tools: SimpleNamespace) -> None:
    z = {"filtered roll_rad": np.array([0.5, -1.0, 3.0])}
    done = [
        tools.faults.Outcome("nan", 0, failed={"crash": "KeyError"}),
        tools.faults.Outcome("nan", 1, failed={"loss": "a row", "outside": "far"}, z=z),
        tools.faults.Outcome("slip", 0, z={"filtered roll_rad": np.array([0.1])}),
    ]
    table = tools.fault_table.by_kind(done).set_index("kind")
    assert table.loc["nan", ["cases", "failed", "crash", "loss", "outside"]].tolist() == [2, 2, 1, 1, 1]
    assert table.loc["all", ["cases", "failed", "worst"]].tolist() == [3, 2, 3.0]
    assert tools.fault_table.of_quantities(done)["within_percent"].tolist() == [75.0]


def test_files_of_rows_are_read_as_they_were_written(tools: SimpleNamespace, tmp_path: Path) -> None:
    tools.cost.write_rows(tmp_path, 0, 130.0)
    source = tools.cost.RowFiles(tmp_path)
    batches = list(source)
    parts = [batch.tables["imu"] for batch in batches if "imu" in batch.tables]
    imu = np.concatenate(parts)
    assert len(imu) == 130 * 200
    assert (np.diff(imu[:, 0]) > 0.0).all()
    assert max(np.ptp(rows[:, 0]) for rows in parts) < 0.1
    assert sum(len(batch.tables.get("tach", ())) for batch in batches) in (130 * 50, 130 * 50 + 1)


def test_a_slope_is_known_as_well_as_the_scatter_lets_it(tools: SimpleNamespace) -> None:
    rng = np.random.default_rng(0)
    minutes = pd.Series(10.0 + rng.normal(0.0, 0.1, 360), index=np.arange(360))
    slope, sigma, mean = tools.cost.slope(minutes)
    assert abs(slope) < 3.0 * sigma
    assert mean == pytest.approx(10.0, abs=0.05)
    slope, sigma, _ = tools.cost.slope(minutes + minutes.index / 60.0)
    assert slope == pytest.approx(1.0, abs=3.0 * sigma)
    measured = {f"{what} {part}": value for what in ("update", "all", "control", "memory") for part, value in
                (("slope", 1.0), ("sigma", 0.01), ("mean", 10.0))}  # fmt: skip
    times = {"p50 ms": 3.0, "p99 ms": 30.0, "max ms": 40.0, "longest ms": 40.0, "first ms": 80.0}
    speeds = {"times real time, same": 160.0, "times real time, default": 240.0}
    row = pd.DataFrame([{**measured, **times, **speeds, "hours": 6.0, "stored": 1.0}])
    met = {figure.quantity: figure.met for figure in tools.cost.figures(row)}
    assert met["latency of a keyframe, median, ms"] is True
    assert met["latency of a keyframe, 99 %, ms"] is False
    assert met["times real time, 1 h from a store, default keyframes"] is True
    assert [grown for name, grown in met.items() if "growth over" in name] == [False] * 3


def test_a_machine_that_slows_down_is_no_growth(tools: SimpleNamespace) -> None:
    t = np.arange(0.0, 7200.0, 0.1)
    slowing, growing = 1.0 + t / 7200.0, 1.0 + 0.1 * t / 7200.0
    puts = pd.DataFrame({"t_s": t, "ms": 2.0 * slowing * growing, "keyframes": np.arange(len(t)) % 5 == 0})
    controls = pd.DataFrame({"t_s": t, "ms": slowing})[::20]
    memory = pd.DataFrame({"t_s": t, "mb": 300.0})[::600]
    minutes = tools.cost.per_minute(puts, controls, memory)
    per_hour, _, mean = tools.cost.slope(tools.cost.beside_control(minutes, "update_ms"))
    assert 2.0 * per_hour / mean == pytest.approx(0.1 / 1.05, rel=0.05)


def test_the_stream_is_held_against_batch_and_best_baseline(tools: SimpleNamespace) -> None:
    errors = {"stream": 1.2, "smoother": 1.0, "gyro": 4.0, "complementary": 2.0}
    away = {f"mainline/roll_rad/away/{moment}": by for moment, by in ((0.25, 0.3), (0.5, -0.4), (0.75, np.nan))}
    measured = pd.DataFrame([{f"mainline/{name}/twist, mm": error for name, error in errors.items()} | away])
    met = {figure.quantity: (figure.value, figure.met) for figure in tools.accuracy.figures(measured)}
    assert met["mainline: twist, mm: over batch"] == (pytest.approx(1.2), True)
    assert met["mainline: twist, mm: over complementary"] == (pytest.approx(0.6), True)
    assert met["mainline: roll: away from a batch of what had come, sigmas"][0] == pytest.approx(np.sqrt(0.125))


@pytest.mark.slow
def test_cases_run_again_by_themselves(tmp_path: Path) -> None:
    command = [sys.executable, TOOLS / "streaming.py", "--per-case", tmp_path / "cases.csv", "--case"]
    done = subprocess.run([*command, "nan:0", "sink-full:0"], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    cases = pd.read_csv(tmp_path / "cases.csv")
    assert sorted(cases["case"]) == ["nan:0", "sink-full:0"]


FORKED = """
from multiprocessing import get_context
from streaming import cost, main

cost.get_context = lambda method: get_context("fork")
raise SystemExit(main.main())
"""


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="processes are forked")
def test_a_short_stream_has_its_cost(tmp_path: Path) -> None:
    """Its three processes are forks, which import nothing."""
    command = [sys.executable, "-c", FORKED, "--parts", "cost", "--hours", "0.02", "--out", tmp_path / "lines.csv"]
    environment = {**os.environ, "PYTHONPATH": str(TOOLS)}
    done = subprocess.run(command, capture_output=True, text=True, env=environment)
    assert done.returncode in (0, 1), done.stderr
    lines = pd.read_csv(tmp_path / "lines.csv").set_index("quantity")
    for keyframes in ("", ", default keyframes"):
        assert lines.loc[f"times real time, 0.02 h from a store{keyframes}", "value"] > 1.0


@pytest.mark.parametrize("more", [["--case", "nan"], ["--kinds", "nothing"], ["--hours", "0"], ["--parts", "slips"]])
def test_bad_arguments_are_refused(more: list[str], refusal: Callable[..., str]) -> None:
    said = refusal("streaming", *more)
    assert "expected" in said or "invalid choice" in said

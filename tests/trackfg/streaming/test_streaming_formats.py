"""docs/streaming-formats.md is true: its examples are read and written, its tables are the code's."""

from __future__ import annotations

import io
import json
import re
from pathlib import Path
from typing import Any

import pandas as pd
import pytest

from trackfg.datasets.scenarios import simulate
from trackfg.output.events import EVENT_TABLES
from trackfg.results.columns import TRAJECTORY_COLUMNS
from trackfg.results.events import DOUBT, Event
from trackfg.streaming.events import LOSS_KINDS, event_table
from trackfg.streaming.intake.intake import Intake
from trackfg.streaming.sinks.parquet_parts import ROWS_PER_PART, ParquetParts
from trackfg.streaming.sinks.sink import TABLES, json_lines
from trackfg.streaming.sources.json_lines import JsonLinesSource

PAGE = (Path(__file__).parents[3] / "docs" / "streaming-formats.md").read_text(encoding="utf-8")
SOURCES = Path(__file__).parents[3] / "trackfg" / "streaming"


def blocks(language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", PAGE, flags=re.DOTALL | re.MULTILINE)


def listed(heading: str) -> set[str]:
    """The first column of the table under a heading of its first row."""
    table = PAGE.split(f"| {heading} |", 1)[1].split("\n\n", 1)[0]
    cells = [line.split("|")[1] for line in table.splitlines()[2:]]
    return {name for cell in cells for name in re.findall(r"`([^`]+)`", cell)}


def test_the_lines_shown_are_rows() -> None:
    rows_in, _ = blocks("json")
    source = JsonLinesSource(io.BytesIO(rows_in.encode()))
    intake = Intake.of(source)
    events = [event for batch in source for event in intake.push(batch)[1]]
    rows, last = intake.finish()
    assert not [*events, *last]
    assert rows.imu.shape[0] == 2
    assert rows.tach.shape[0] == 1
    assert rows.imu[0, 6] == pytest.approx(1.001 * 9.80665)


def test_the_lines_shown_are_what_is_written() -> None:
    filtered, late, slip = (json.loads(line) for line in blocks("json")[1].splitlines())
    assert tuple(filtered) == ("table", *TRAJECTORY_COLUMNS)
    written = json_lines(filtered.pop("table"), pd.DataFrame([filtered]))
    assert written == blocks("json")[1].splitlines(keepends=True)[0]
    event = Event("late", "tach", 11.9, 12.1, 3, f"{LOSS_KINDS['late']}: up to 0.4 s behind the IMU's")
    assert json.loads(json_lines("events", event_table([event]))) == late
    event = Event("slip", "tach", 9.3, 10.1, 0, "", 1021.5, 0.2, 0.75, 0.125)
    assert json.loads(json_lines("events", event_table([event]))) == slip


def test_the_python_shown_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    sink = ParquetParts("live1")
    sink.write("smoothed", pd.DataFrame({"chainage_m": [1.0, 2.5]}))
    sink.close()
    simulate("trolley", seed=0, duration_s=15.0).write(Path("run1"))
    names: dict[str, Any] = {}
    for block in blocks("python"):
        exec(compile(block, "streaming-formats.md", "exec"), names)
    assert names["count"] == 1000
    assert capsys.readouterr().out.startswith("2.5\n")
    assert names["last"][1].smoothed["t_s"].iloc[-1] > 14.89


def test_every_kind_of_event_is_listed() -> None:
    code = "".join(path.read_text(encoding="utf-8") for path in SOURCES.rglob("*.py"))
    noted = {*re.findall(r'\bEvent\("([a-z-]+)"', code), DOUBT}
    assert listed("kind | rows left out") == set(LOSS_KINDS) | {"bad-line", "bad-message", "other-topic"}
    assert listed("kind | what happened, without loss") == noted - {"other-topic"}
    assert listed("kind | what") == {kind for kind in EVENT_TABLES if "landmark" not in kind}


def test_the_numbers_are_the_codes() -> None:
    assert f"have {ROWS_PER_PART} rows" in PAGE
    assert listed("table | a row | columns") == set(TABLES)

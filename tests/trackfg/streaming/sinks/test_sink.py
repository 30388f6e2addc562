"""What is written is whole at any moment, goes on after a checkpoint without doubling, and fails with one error."""

from __future__ import annotations

import errno
import io
import json
import os
import time
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from trackfg.errors import BadInputError, OutputError
from trackfg.results.events import Event
from trackfg.streaming.events import event_table
from trackfg.streaming.sinks.parquet_parts import NOTHING_WRITTEN, ParquetParts, read_parts
from trackfg.streaming.sinks.sink import Callback, JsonLines, Sink, json_lines


def frame(first: int, last: int) -> pd.DataFrame:
    i = np.arange(first, last)
    return pd.DataFrame({"t_s": 0.1 * i, "chainage_m": 1.5 * i, "chainage_m_sd": np.where(i % 3, 0.1, np.nan)})


EVENTS = event_table([Event("late", "tach", 1.0, 2.0, 3, "x"), Event("bad-line", rows=1)])


def test_parts_hold_what_was_written(tmp_path: Path) -> None:
    sink = ParquetParts(tmp_path / "out", rows_per_part=10)
    for i in range(0, 37, 4):
        sink.write("filtered", frame(i, min(i + 4, 37)))
    sink.write("smoothed", frame(0, 25))
    sink.write("events", EVENTS)
    sink.close()
    pd.testing.assert_frame_equal(read_parts(tmp_path / "out", "filtered"), frame(0, 37), check_exact=True)
    pd.testing.assert_frame_equal(read_parts(tmp_path / "out", "smoothed"), frame(0, 25), check_exact=True)
    pd.testing.assert_frame_equal(read_parts(tmp_path / "out", "events"), EVENTS)
    names = sorted(path.name for path in (tmp_path / "out" / "filtered").iterdir())
    assert names == [f"part-{i:06d}.parquet" for i in (1, 2, 3, 4)]
    assert len(pd.read_parquet(tmp_path / "out" / "filtered" / names[0])) == 10


def test_numbering_goes_on_after_a_restart(tmp_path: Path) -> None:
    for i in range(3):
        sink = ParquetParts(tmp_path, rows_per_part=10)
        sink.write("filtered", frame(15 * i, 15 * i + 15))
        sink.close()
    assert len(list((tmp_path / "filtered").iterdir())) == 6
    pd.testing.assert_frame_equal(read_parts(tmp_path, "filtered"), frame(0, 45))


@given(
    steps=st.lists(st.integers(1, 25), min_size=1, max_size=12),
    checkpoint=st.integers(0, 12),
    killed=st.integers(0, 12),
)
@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_a_sink_goes_on_from_a_checkpoint_as_if_nothing_had_been(
    steps: list[int], checkpoint: int, killed: int, tmp_path_factory: pytest.TempPathFactory
) -> None:
    folder = tmp_path_factory.mktemp("out")
    edges = [0, *np.cumsum(steps).tolist()]
    frames = [frame(a, b) for a, b in pairwise(edges)]
    at = min(checkpoint, len(frames))
    state: dict[str, Any] = {}
    parts, lines = ParquetParts(folder, rows_per_part=10), JsonLines(folder / "lines")
    for k, rows in enumerate(frames[: max(killed, at)]):
        if k == at:
            state = {"parts": parts.checkpoint(), "lines": lines.checkpoint()}
        parts.write("filtered", rows)
        lines.write("filtered", rows)
    if not state:
        state = {"parts": parts.checkpoint(), "lines": lines.checkpoint()}
    state = json.loads(json.dumps(state))
    lines.close()
    (folder / "filtered" / ".unfinished-part-000009.parquet").write_bytes(b"half")
    parts, lines = (
        ParquetParts(folder, rows_per_part=10, state=state["parts"]),
        JsonLines(folder / "lines", state["lines"]),
    )
    for rows in frames[at:]:
        parts.write("filtered", rows)
        lines.write("filtered", rows)
    parts.close()
    lines.close()
    whole = pd.concat(frames, ignore_index=True)
    pd.testing.assert_frame_equal(read_parts(folder, "filtered"), whole, check_exact=True)
    assert (folder / "lines").read_text() == json_lines("filtered", whole)
    sizes = [len(pd.read_parquet(path)) for path in sorted((folder / "filtered").iterdir())]
    assert sizes[:-1] == [10] * (len(sizes) - 1)


def full_disk(*_: object) -> int:
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def test_rows_are_there_before_their_part_is_full(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each second of the clock, which stands still here and then goes on."""
    now = [0.0]
    monkeypatch.setattr("trackfg.streaming.sinks.parquet_parts.time.monotonic", lambda: now[0])
    sink = ParquetParts(tmp_path)
    sink.write("filtered", frame(0, 5))
    assert not list((tmp_path / "filtered").iterdir())
    now[0] = 1.0
    sink.write("filtered", frame(5, 8))
    pd.testing.assert_frame_equal(read_parts(tmp_path, "filtered"), frame(0, 8))
    sink.write("filtered", frame(8, 9))
    assert len(read_parts(tmp_path, "filtered")) == 8
    now[0] = 2.0
    sink.write("smoothed", frame(0, 0))  # no row of this table: those of the other come to the disk all the same
    pd.testing.assert_frame_equal(read_parts(tmp_path, "filtered"), frame(0, 9))


def test_rows_are_there_although_no_others_come(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("trackfg.streaming.sinks.parquet_parts.EVERY_S", 0.05)
    sink = ParquetParts(tmp_path)
    sink.write("filtered", frame(0, 5))
    until = time.monotonic() + 5.0
    while time.monotonic() < until and read_parts(tmp_path, "filtered").empty:
        time.sleep(0.01)
    pd.testing.assert_frame_equal(read_parts(tmp_path, "filtered"), frame(0, 5))
    with monkeypatch.context() as full:
        full.setattr(os, "fsync", full_disk)
        sink.write("filtered", frame(5, 6))
        time.sleep(0.3)
        with pytest.raises(OutputError, match="cannot be written"):
            sink.checkpoint()
    sink.close()
    pd.testing.assert_frame_equal(read_parts(tmp_path, "filtered"), frame(0, 6))


def test_a_full_disk_is_one_error_and_leaves_no_half_part(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("trackfg.streaming.sinks.parquet_parts.EVERY_S", np.inf)
    sink = ParquetParts(tmp_path, rows_per_part=10)
    sink.write("filtered", frame(0, 12))
    with monkeypatch.context() as full:
        full.setattr(os, "fsync", full_disk)
        with pytest.raises(OutputError, match=r"part-000002\.parquet: cannot be written \(No space left on device\)"):
            sink.write("filtered", frame(12, 25))
    assert [path.name for path in (tmp_path / "filtered").iterdir()] == ["part-000001.parquet"]
    sink.close()
    pd.testing.assert_frame_equal(read_parts(tmp_path, "filtered"), frame(0, 25))


def test_a_disk_that_fills_within_a_line_keeps_whole_lines(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    sink = JsonLines(tmp_path / "out.jsonl")
    sink.write("filtered", frame(0, 3))
    write, calls = os.pwrite, []

    def short(file: int, content: memoryview, at: int) -> int:
        calls.append(at)
        return write(file, content[:30], at) if len(calls) < 4 else full_disk()

    with monkeypatch.context() as full:
        full.setattr(os, "pwrite", short)
        with pytest.raises(OutputError, match=r"out\.jsonl: cannot be written \(No space left on device\)"):
            sink.write("filtered", frame(3, 6))
    assert (tmp_path / "out.jsonl").read_text() == json_lines("filtered", frame(0, 3))
    sink.write("filtered", frame(3, 6))
    sink.close()
    assert (tmp_path / "out.jsonl").read_text() == json_lines("filtered", frame(0, 6))


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no device that is always full")
def test_a_device_that_is_full() -> None:
    sink = JsonLines("/dev/full")
    with pytest.raises(OutputError, match="/dev/full: cannot be written"):
        sink.write("events", EVENTS)
    sink.close()


def test_a_closed_pipe_is_one_error() -> None:
    reader, writer = os.pipe()
    stream = os.fdopen(writer, "wb", buffering=0)
    sink = JsonLines(stream)
    sink.write("events", EVENTS)
    os.close(reader)
    with pytest.raises(OutputError, match="closed by its reader"):
        sink.write("events", EVENTS)
    stream.close()
    with pytest.raises(OutputError, match="cannot be written"):
        sink.write("events", EVENTS)


@pytest.mark.parametrize("make", [lambda p: ParquetParts(p / "file" / "out"), lambda p: JsonLines(p / "file" / "out")])
def test_a_place_that_cannot_be_written_is_one_error(make: Any, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("x")
    with pytest.raises(OutputError, match="file"):
        make(tmp_path)


def test_lines_are_json_with_every_digit(tmp_path: Path) -> None:
    out = io.StringIO()
    values = np.array([0.1 + 0.2, 1e-300, np.nan, np.inf])
    JsonLines(out).write("smoothed", pd.DataFrame({"t_s": values}))
    rows = [json.loads(line) for line in out.getvalue().splitlines()]
    assert [row["t_s"] for row in rows] == [0.1 + 0.2, 1e-300, None, None]
    JsonLines(out).write("events", EVENTS)
    assert json.loads(out.getvalue().splitlines()[-1]) == {
        "table": "events", "kind": "bad-line", "input": "", "t_s": None, "until_s": None, "rows": 1, "detail": "",
        "chainage_m": None, "chainage_m_sd": None, "distance_removed_m": None, "distance_removed_m_sd": None,
    }  # fmt: skip
    (tmp_path / "old").write_text("not ended")
    sink = JsonLines(tmp_path / "old")
    sink.write("smoothed", frame(0, 1))
    sink.close()
    assert (tmp_path / "old").read_text().startswith('not ended\n{"table": "smoothed", "t_s": 0.0')


def test_a_callback_gets_the_tables() -> None:
    got: list[tuple[str, int]] = []
    sink: Sink = Callback(lambda table, rows: got.append((table, len(rows))))
    sink.write("filtered", frame(0, 3))
    sink.write("filtered", frame(0, 0))
    assert sink.checkpoint() == {}
    sink.close()
    assert got == [("filtered", 3)]


def test_parts_that_are_not_there_or_damaged_are_one_error(tmp_path: Path) -> None:
    with pytest.raises(BadInputError, match="no such folder"):
        read_parts(tmp_path / "none", "filtered")
    sink = ParquetParts(tmp_path, rows_per_part=10)
    assert read_parts(tmp_path, "filtered").empty
    sink.write("filtered", frame(0, 35))
    state = sink.checkpoint()
    with pytest.raises(BadInputError, match="no such folder; expected one of filtered, smoothed, geometry, events"):
        read_parts(tmp_path, "others")
    (tmp_path / "filtered" / "part-000004.parquet").write_bytes(b"PAR1")
    with pytest.raises(BadInputError, match=r"part-000004\.parquet: cannot be read"):
        read_parts(tmp_path, "filtered")
    with pytest.raises(BadInputError, match=r"part-000004\.parquet: cannot be read"):
        ParquetParts(tmp_path, state=state)
    (tmp_path / "filtered" / "part-000002.parquet").unlink()
    for use in (lambda: read_parts(tmp_path, "filtered"), lambda: ParquetParts(tmp_path, state=state)):
        with pytest.raises(BadInputError, match=r"part-000002\.parquet is missing"):
            use()
    (tmp_path / "lines").write_text("")
    with pytest.raises(BadInputError, match="has 0 bytes; expected at least 10"):
        JsonLines(tmp_path / "lines", {"bytes": 10})


@pytest.mark.parametrize("part", [0, 10**30, "1", None])
def test_a_state_that_is_none_is_refused(part: Any, tmp_path: Path) -> None:
    state = {**NOTHING_WRITTEN, "smoothed": {"part": part, "rows": 0}}
    for given_state in (state, {}, {**NOTHING_WRITTEN, "smoothed": None}):
        with pytest.raises(BadInputError, match="the checkpoint does not say how far the table"):
            ParquetParts(tmp_path, state=given_state)

"""Streams that end before their end: the process is killed, or the disk is full.

What was written until then must be whole, and the same as what a stream that nothing happened to writes first. Then the
stream is resumed from its last checkpoint until it ends; its output must be that of a stream without interruption.
"""

from __future__ import annotations

import contextlib
import errno
import io
import json
import os
import resource
import signal
import tempfile
import threading
from collections.abc import Callable, Iterator, Mapping
from multiprocessing import get_context
from pathlib import Path
from types import MappingProxyType

import numpy as np
import pandas as pd

from streaming.base_cases import CONFIG, DURATION_S, LAG_S
from streaming.fault_injection import BaseCase
from trackfg import FixedLagSmoother
from trackfg.errors import OutputError
from trackfg.streaming.checkpoint.checkpoint import Checkpoint, Checkpoints
from trackfg.streaming.run import Stream, run_stream
from trackfg.streaming.sinks.parquet_parts import NOTHING_WRITTEN, ParquetParts, read_parts
from trackfg.streaming.sinks.sink import TABLES, Callback, JsonLines, Sink
from trackfg.streaming.sources.source import Batch, Source

Tables = dict[str, pd.DataFrame]
Break = Callable[[BaseCase, np.random.Generator, Tables], tuple[str, dict[str, str]]]
"""From a base case, a generator and what the stream writes when nothing happens: what was done, and what went wrong."""

MOST_KILLS = 4
ROWS_PER_PART = (20, 400)
CHECKPOINT_S = (2.0, 20.0)


def kill(base: BaseCase, rng: np.random.Generator, whole: Tables) -> tuple[str, dict[str, str]]:
    """Killed and resumed some times, at any moments."""
    kills = int(rng.integers(1, MOST_KILLS + 1))
    rows_per_part, every_s = int(rng.integers(*ROWS_PER_PART)), float(rng.uniform(*CHECKPOINT_S))
    text = f"killed {kills} times; parts of {rows_per_part} rows, a checkpoint every {every_s:.1f} s"
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for _ in range(kills):
            moment = float(rng.random()), float(rng.uniform(0.0, 0.05))
            code = _in_a_process(_written, base, folder, rows_per_part, every_s, moment)
            if code not in (-signal.SIGKILL, 0):
                return text, {"crash": f"the process ended with {code}"}
            if failed := _not_whole(folder, whole):
                return text, {"loss": failed}
        return text, _undisturbed(base, folder, whole, rows_per_part, every_s, "resumed")


def disk_full(base: BaseCase, rng: np.random.Generator, whole: Tables) -> tuple[str, dict[str, str]]:
    """Parquet parts, or lines in a file, on a disk that has no room for them until it is made."""
    lines = bool(rng.random() < 0.5)
    room = int(np.exp(rng.uniform(np.log(1e3), np.log(4e5 if lines else 3e4))))
    text = f"{'lines' if lines else 'parts'} on a disk with room for {room} bytes a file"
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write = _lines_written if lines else _parts_written
        code = _in_a_process(write, base, folder, room)
        if code not in (0, _REFUSED):
            return text, {"crash": f"the process ended with {code}; expected an OutputError"}
        tables = _tables_of_lines(folder / _LINES, whole) if lines else None
        if failed := _not_whole(folder, whole, tables):
            return text, {"loss": failed}
        if lines:
            return text, {}
        return text, _undisturbed(base, folder, whole, _PART_ROWS, _EVERY_S, "with room again")


def _undisturbed(
    base: BaseCase, folder: Path, whole: Tables, rows_per_part: int, every_s: float, when: str
) -> dict[str, str]:
    """What is wrong after going on to the end."""
    code = _in_a_process(_written, base, folder, rows_per_part, every_s, None)
    if code != 0:
        return {"crash": f"{when}, the process ended with {code}"}
    failed = _not_whole(folder, whole) or _not_all(folder, whole)
    return {"before": failed} if failed else {}


def refused(base: BaseCase, rng: np.random.Generator, whole: Tables) -> tuple[str, dict[str, str]]:
    """A sink of somebody's own, or a device, that says that it is full."""
    if rng.random() < 0.5:
        text = "lines to a device that is full"
        with open("/dev/full", "w", encoding="utf-8") as full:
            try:
                run_stream(base.stream.source(), _smoother(base), JsonLines(full))
            except OutputError:
                return text, {}
            finally:
                _close(full)
        return text, {"loss": "nothing was said of it"}
    last = int(rng.integers(1, len(whole["filtered"])))
    text, taken = f"a callback that is full after {last} tables", []

    def take(table: str, frame: pd.DataFrame) -> None:
        if len(taken) == last:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        taken.append((table, frame))

    try:
        run_stream(base.stream.source(), _smoother(base), Callback(take))
    except OSError as error:
        if error.errno != errno.ENOSPC:
            return text, {"crash": repr(error)}
    else:
        return text, {"loss": "nothing was said of it"}
    tables = {name: _under_each_other(frame for table, frame in taken if table == name) for name in TABLES}
    failed = _not_whole(Path(), whole, tables)
    return text, {"before": failed} if failed else {}


BREAKS: Mapping[str, Break] = MappingProxyType({"kill": kill, "disk-full": disk_full, "sink-full": refused})

_LINES = "lines.jsonl"
_REFUSED = 3
_PART_ROWS, _EVERY_S = 100, 5.0


def _smoother(base: BaseCase) -> FixedLagSmoother:
    return FixedLagSmoother(base.stream.description, CONFIG, lag_s=LAG_S)


def _close(file: io.TextIOBase) -> None:
    with contextlib.suppress(OSError):
        file.close()


class _Killing:
    """A source that goes on at a position, in a process that is killed a moment after its rows reach ``at_s``."""

    def __init__(self, source: Source, at_s: float, delay_s: float) -> None:
        self._source, self._at_s, self._delay_s = source, at_s, delay_s
        self.description, self.canonical = source.description, source.canonical
        self.gnss_origin, self.live, self.length = source.gnss_origin, source.live, source.length

    def __iter__(self) -> Iterator[Batch]:
        for batch in self._source:
            if "imu" in batch.tables and batch.tables["imu"][-1, 0] >= self._at_s:
                self._at_s = np.inf
                threading.Timer(self._delay_s, os.kill, (os.getpid(), signal.SIGKILL)).start()
            yield batch


def _written(
    base: BaseCase, folder: Path, rows_per_part: int, every_s: float, moment: tuple[float, float] | None
) -> None:
    """The stream into a folder, from its last checkpoint if it has one. ``moment`` of its end: at which part of what
    is left of it, and how many seconds after.
    """
    checkpoints = Checkpoints(folder / "checkpoint", every_s=every_s)
    saved = checkpoints.read() if checkpoints.path.exists() else None
    if saved is not None and saved.finished:
        return
    begin = 0.0 if saved is None or saved.until_s is None else saved.until_s
    share, delay_s = (np.inf, 0.0) if moment is None else moment
    source = base.stream.source(0 if saved is None else saved.position)
    stream = Stream.of(_Killing(source, begin + share * (DURATION_S - begin), delay_s), _smoother(base), saved)
    if saved is None:
        checkpoints.write(Checkpoint(stream.settings, NOTHING_WRITTEN))
    sink = ParquetParts(folder, rows_per_part=rows_per_part, state=NOTHING_WRITTEN if saved is None else saved.sink)
    stream.run(sink, checkpoints)


def _parts_written(base: BaseCase, folder: Path, room: int) -> None:
    _with_room(room, lambda: _written(base, folder, _PART_ROWS, _EVERY_S, None))


def _lines_written(base: BaseCase, folder: Path, room: int) -> None:
    def write() -> None:
        sink: Sink = JsonLines(folder / _LINES)
        run_stream(base.stream.source(), _smoother(base), sink)

    _with_room(room, write)


def _with_room(room: int, write: Callable[[], None]) -> None:
    resource.setrlimit(resource.RLIMIT_FSIZE, (room, room))
    try:
        write()
    except OutputError:
        os._exit(_REFUSED)


def _in_a_process(function: Callable[..., None], *arguments: object) -> int:
    process = get_context("fork").Process(target=function, args=arguments)
    process.start()
    process.join()
    assert process.exitcode is not None
    return process.exitcode


def _tables_of_lines(path: Path, whole: Tables) -> Tables:
    """Raises ``ValueError`` where a line is none."""
    rows: dict[str, list[dict[str, object]]] = {name: [] for name in TABLES}
    if path.exists():
        for line in path.read_bytes().splitlines():
            row = json.loads(line)
            rows[row.pop("table")].append(row)
    return {
        name: pd.DataFrame(of, columns=whole[name].columns).astype(whole[name].dtypes)
        for name, of in rows.items()
        if name in whole or of
    }


def _under_each_other(frames: Iterator[pd.DataFrame]) -> pd.DataFrame:
    parts = list(frames)
    return pd.concat(parts, ignore_index=True) if parts else pd.DataFrame()


def _not_whole(folder: Path, whole: Tables, tables: Tables | None = None) -> str:
    """Why what is there is not the beginning of the whole; empty where it is."""
    for name in TABLES:
        if tables is None and not (folder / name).is_dir():
            continue
        rows = read_parts(folder, name) if tables is None else tables.get(name, pd.DataFrame())
        if rows.empty:
            continue
        expected = whole[name].iloc[: len(rows)].reset_index(drop=True)
        same = len(rows) == len(expected) and all(
            expected[column].equals(rows[column].reset_index(drop=True)) for column in rows
        )
        if not same:
            return f"{name}: {len(rows)} rows are not the first of {len(whole[name])}"
    return ""


def _not_all(folder: Path, whole: Tables) -> str:
    for name, rows in whole.items():
        if (count := len(read_parts(folder, name))) != len(rows):
            return f"{name}: {count} rows; expected {len(rows)}"
    return ""

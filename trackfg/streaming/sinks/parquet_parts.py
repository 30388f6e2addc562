"""Parquet parts hold estimates, and are whole from the moment that they are there.

    FOLDER/filtered/part-000001.parquet, part-000002.parquet, ...

A part is written beside its place, put on the disk and renamed. All parts of a table but the last have the same number
of rows; the last one is written as far as it is, each second and by a checkpoint, and replaced by a longer one of the
same number later. Where no rows come for a while, a thread of its own writes what is left.
"""

from __future__ import annotations

import io
import re
import threading
import time
import weakref
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa

from trackfg.errors import BadInputError, OutputError, first_line
from trackfg.files.atomic_file import UNFINISHED, write_whole
from trackfg.files.parquet import read_parquet, write_parquet
from trackfg.numerics.float_table import columns_of
from trackfg.streaming.sinks.sink import TABLES

ROWS_PER_PART = 6000
"""Rows of a part: ten minutes at 10 Hz."""

EVERY_S = 1.0
"""Seconds from one writing of the last parts to the next: who watches the folder sees rows within two seconds."""

_PART = re.compile(r"part-(\d{6})\.parquet")
_MOST_PARTS = 999_999
_MOST_ARRAYS = 200

NOTHING_WRITTEN = {name: {"part": 1, "rows": 0} for name in TABLES}
"""The state of the checkpoint before the first row."""


@dataclass
class _Table:
    """``number`` of the part that is being filled, its rows so far by column, and how many of them its file has."""

    folder: Path
    number: int = 1
    pending: dict[str, list[Any]] = field(default_factory=dict)
    rows: int = 0
    written: int = 0
    schema: pa.Schema | None = None

    def add(self, frame: pd.DataFrame) -> None:
        """Arrays are kept as they are: making an Arrow table of every few rows would take longer than all else. But
        many short ones would take more memory than their numbers.
        """
        for name, values in columns_of(frame).items():
            parts = self.pending.setdefault(name, [])
            parts.append(values)
            if len(parts) == _MOST_ARRAYS:
                self.pending[name] = [np.concatenate(parts)]
        self.rows += len(frame)

    def content(self) -> pa.Table:
        columns = {name: np.concatenate(parts) for name, parts in self.pending.items()}
        if self.schema is None:
            self.schema = pa.table(columns).schema
        try:
            return pa.table(columns, schema=self.schema)
        except (pa.ArrowException, KeyError, ValueError) as error:
            raise BadInputError(f"{_place(self)}: has other columns than the stream ({first_line(error)})") from error

    def keep(self, rows: pa.Table) -> None:
        self.pending = {name: [rows[name].to_numpy()] for name in rows.column_names} if rows.num_rows else {}
        self.rows = rows.num_rows


class ParquetParts:
    """A sink for :data:`~trackfg.streaming.sinks.sink.TABLES`.

    Parts that are there are kept, and numbering goes on after them; with the ``state`` of a checkpoint the parts after
    it are removed. Raises :class:`OutputError` where the folder cannot be written, and :class:`BadInputError` where it
    does not hold what the checkpoint says.
    """

    def __init__(
        self, folder: Path | str, *, rows_per_part: int = ROWS_PER_PART, state: Mapping[str, Any] | None = None
    ) -> None:
        self._rows_per_part = rows_per_part
        self._tables: dict[str, _Table] = {}
        self._written_s = time.monotonic()
        self._lock = threading.RLock()
        self._timer: threading.Timer | None = None
        self._failure: OutputError | None = None
        for name in TABLES:
            table = _Table(Path(folder) / name)
            if table.folder.is_symlink():
                raise BadInputError(f"{table.folder}: is a link; expected a folder of this stream alone")
            try:
                table.folder.mkdir(parents=True, exist_ok=True)
                for leftover in table.folder.glob(f"{UNFINISHED}*"):
                    leftover.unlink()
                if state is None:
                    table.number = max(_numbers(table.folder), default=0) + 1
                else:
                    _go_back(table, *_counted(state, name))
            except OSError as error:
                raise OutputError(f"{table.folder}: cannot be written ({error.strerror})") from error
            self._tables[name] = table

    def write(self, table: str, frame: pd.DataFrame) -> None:
        """Collect rows, and write every part that is full; each second the last parts too, as far as they are."""
        with self._lock:
            if len(frame):
                self._add(self._tables[table], frame)
            if time.monotonic() - self._written_s >= EVERY_S:
                self._write_last()
            elif len(frame) and self._timer is None:
                self._write_later(EVERY_S)

    def _add(self, to: _Table, frame: pd.DataFrame) -> None:
        to.add(frame)
        while to.rows >= self._rows_per_part:
            content = to.content()
            _write(_place(to), content.slice(0, self._rows_per_part))
            to.number, to.written = to.number + 1, 0
            to.keep(content.slice(self._rows_per_part))

    def checkpoint(self) -> dict[str, Any]:
        """Write the last parts as far as they are."""
        with self._lock:
            self._write_last()
            return {name: {"part": table.number, "rows": table.rows} for name, table in self._tables.items()}

    def close(self) -> None:
        """Write what is left."""
        with self._lock:
            if self._timer is not None:
                self._timer.cancel()
            self._write_last()

    def _write_later(self, wait_s: float) -> None:
        """Have the last parts written after a time unless they are by then."""
        self._timer = threading.Timer(min(wait_s, threading.TIMEOUT_MAX), _write_if_due, [weakref.ref(self)])
        self._timer.daemon = True
        self._timer.start()

    def _write_if_due(self) -> None:
        with self._lock:
            self._timer = None
            if all(table.rows == table.written for table in self._tables.values()):
                return
            wait_s = self._written_s + EVERY_S - time.monotonic()
            if wait_s > 0.0:
                self._write_later(wait_s)
                return
            try:
                self._write_last()
            except OutputError as error:
                self._failure = error  # raised where rows come next

    def _write_last(self) -> None:
        if self._failure is not None:
            failure, self._failure = self._failure, None
            raise failure
        for table in self._tables.values():
            if table.rows > table.written:
                _write(_place(table), table.content())
                table.written = table.rows
        self._written_s = time.monotonic()


def _write_if_due(sink: weakref.ref[ParquetParts]) -> None:
    """Write what is left; nothing of a sink that was discarded, since another may be open in its folder."""
    if (held := sink()) is not None:
        held._write_if_due()


def read_parts(folder: Path | str, table: str) -> pd.DataFrame:
    """All parts of one table of a :class:`ParquetParts` folder, also while it is being written; empty if it has none.

    Raises :class:`BadInputError` where the folder is none, or a part is missing or damaged.
    """
    place = Path(folder) / table
    if table not in TABLES or not place.is_dir():
        raise BadInputError(f"{place}: no such folder; expected one of {', '.join(TABLES)} in {folder}")
    numbers = sorted(_numbers(place))
    if missing := sorted(set(range(1, len(numbers) + 1)) - set(numbers)):
        raise BadInputError(f"{place}: part-{missing[0]:06d}.parquet is missing; expected every part up to the last")
    frames = [_read(place / f"part-{number:06d}.parquet").to_pandas() for number in numbers]
    return pd.concat(frames, ignore_index=True) if frames else pd.DataFrame()


def _numbers(folder: Path) -> list[int]:
    return [int(match[1]) for path in folder.iterdir() if (match := _PART.fullmatch(path.name))]


def _place(table: _Table) -> Path:
    return table.folder / f"part-{table.number:06d}.parquet"


def _counted(state: Mapping[str, Any], name: str) -> tuple[int, int]:
    try:
        part, rows = state[name]["part"], state[name]["rows"]
    except (KeyError, TypeError):
        part, rows = None, None
    if type(part) is not int or type(rows) is not int or not 1 <= part <= _MOST_PARTS or rows < 0:
        raise BadInputError(f"the checkpoint does not say how far the table {name} was written")
    return part, rows


def _go_back(table: _Table, part: int, rows: int) -> None:
    """Go back to where ``part`` had so many ``rows``."""
    table.number = part
    numbers = sorted(_numbers(table.folder))
    if missing := sorted(set(range(1, part + (rows > 0))) - set(numbers)):
        raise BadInputError(f"{table.folder}: part-{missing[0]:06d}.parquet is missing; the checkpoint knows of it")
    if numbers and numbers[-1] > max(part, len(numbers)):
        raise BadInputError(f"{table.folder}: part-{numbers[-1]:06d}.parquet is not this stream's: move it away")
    if rows:
        part_table = _read(_place(table))
        if part_table.num_rows < rows:
            raise BadInputError(f"{_place(table)}: {part_table.num_rows} rows; expected {rows} as at the checkpoint")
        table.schema = part_table.schema
        table.keep(part_table.slice(0, rows))
        _write(_place(table), table.content())
        table.written = rows
    for number in _numbers(table.folder):
        if number > part or (number == part and not rows):
            (table.folder / f"part-{number:06d}.parquet").unlink()


def _read(path: Path) -> pa.Table:
    try:
        return read_parquet(pa.BufferReader(path.read_bytes()))
    except (pa.ArrowException, OSError, ValueError) as error:
        raise BadInputError(f"{path}: cannot be read ({first_line(error)})") from error


def _write(path: Path, rows: pa.Table) -> None:
    if not path.parent.is_dir():  # a folder made anew would not have the parts before
        raise OutputError(f"{path.parent}: the folder no longer exists; what was written into it is lost")
    content = io.BytesIO()
    write_parquet(rows, content)
    write_whole(path, content.getbuffer())

"""A sink takes estimates: tables by name, a few rows at a time.

A sink takes any table with named columns; a stream writes :data:`TABLES`. ``checkpoint`` puts everything written so far
on the disk and gives a JSON state; a sink opened with that state goes on from there, and what was written after it is
replaced, never doubled. Parquet: :mod:`trackfg.streaming.sinks.parquet_parts`.
"""

from __future__ import annotations

import contextlib
import io
import json
import math
import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import IO, Any, Protocol

import pandas as pd

from trackfg.errors import BadInputError, OutputError
from trackfg.numerics.float_table import columns_of

TABLES = ("filtered", "smoothed", "geometry", "events")


class Sink(Protocol):
    """Takes tables. Raises :class:`OutputError` where they cannot be written; nothing is half written then, and a sink
    opened from the last checkpoint goes on.
    """

    def write(self, table: str, frame: pd.DataFrame) -> None:
        """Take rows of a table, in their order."""

    def checkpoint(self) -> dict[str, Any]:
        """Make safe what was written; return what is needed to go on from here, as JSON values."""

    def close(self) -> None:
        """Close: no more rows come."""


class Callback:
    """Calls ``take(table, frame)`` for every table; what it raises goes through."""

    def __init__(self, take: Callable[[str, pd.DataFrame], None]) -> None:
        self._take = take

    def write(self, table: str, frame: pd.DataFrame) -> None:
        """Hand the rows on, if there are any."""
        if len(frame):
            self._take(table, frame)

    def checkpoint(self) -> dict[str, Any]:
        """Return an empty state: nothing is kept here."""
        return {}

    def close(self) -> None:
        """Do nothing."""


class JsonLines:
    """One JSON object per row, ``{"table": "filtered", "t_s": ..., ...}``; what is not known (NaN) is ``null``.

    ``target`` is a stream, which is flushed after every table, or a file, which is appended to. With a ``state`` the
    file is first cut to what it was at that checkpoint; raises :class:`BadInputError` where it is shorter.
    """

    def __init__(self, target: IO[str] | IO[bytes] | Path | str, state: Mapping[str, Any] | None = None) -> None:
        self._file = _LinesFile(Path(target), state) if isinstance(target, Path | str) else None
        self._stream: Any = None if isinstance(target, Path | str) else target

    def write(self, table: str, frame: pd.DataFrame) -> None:
        """Write and flush the rows, if there are any."""
        if not len(frame):
            return
        text = json_lines(table, frame)
        if self._file is not None:
            self._file.append(text.encode())
            return
        try:
            self._stream.write(text if isinstance(self._stream, io.TextIOBase) else text.encode())
            self._stream.flush()
        except BrokenPipeError as error:
            raise OutputError("the output was closed by its reader") from error
        except (OSError, ValueError) as error:
            raise OutputError(f"the output cannot be written ({error})") from error

    def checkpoint(self) -> dict[str, Any]:
        """Return how long the file is, once it is on the disk."""
        return {} if self._file is None else self._file.checkpoint()

    def close(self) -> None:
        """Close the file; a stream stays open."""
        if self._file is not None:
            self._file.close()


def json_lines(table: str, frame: pd.DataFrame) -> str:
    """Return the rows of a table as lines."""
    columns = columns_of(frame)
    rows = zip(*(values.tolist() for values in columns.values()), strict=True)
    return "".join(
        json.dumps({"table": table, **dict(zip(columns, map(_known, row), strict=True))}, allow_nan=False) + "\n"
        for row in rows
    )


def _known(value: Any) -> Any:
    return None if isinstance(value, float) and not math.isfinite(value) else value


class _LinesFile:
    """A file that only ever holds whole lines of ours."""

    def __init__(self, path: Path, state: Mapping[str, Any] | None) -> None:
        self._path = path
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._file = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o666)
            self._bytes = os.lseek(self._file, 0, os.SEEK_END)
        except OSError as error:
            raise OutputError(f"{path}: cannot be opened ({error.strerror})") from error
        if state is not None:
            self._cut(int(state["bytes"]))
        elif self._bytes and os.pread(self._file, 1, self._bytes - 1) != b"\n":
            self.append(b"\n")

    def _cut(self, size: int) -> None:
        if self._bytes < size:
            os.close(self._file)
            raise BadInputError(
                f"{self._path}: has {self._bytes} bytes; expected at least {size}, as at the checkpoint"
            )
        os.ftruncate(self._file, size)
        self._bytes = size

    def append(self, content: bytes) -> None:
        """Write all of it or nothing."""
        view, at = memoryview(content), self._bytes
        try:
            while view:
                count = os.pwrite(self._file, view, at)
                view, at = view[count:], at + count
        except OSError as error:
            with contextlib.suppress(OSError):
                os.ftruncate(self._file, self._bytes)
            raise OutputError(f"{self._path}: cannot be written ({error.strerror})") from error
        self._bytes = at

    def checkpoint(self) -> dict[str, Any]:
        try:
            os.fsync(self._file)
        except OSError as error:
            raise OutputError(f"{self._path}: cannot be written ({error.strerror})") from error
        return {"bytes": self._bytes}

    def close(self) -> None:
        os.close(self._file)

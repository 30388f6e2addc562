"""VBO files of Racelogic's VBOX loggers: text in sections, with the columns' names and units apart from the rows.

Latitude and longitude are in minutes, longitude positive to the west, and the time is that of the day in UTC as
HHMMSS.SS (Racelogic, "VBO file format"). The date is that of the line ``File created on``.
"""

from __future__ import annotations

import io
import re
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pandas as pd

from trackfg.errors import BadInputError, first_line
from trackfg.interchange.importing.source_format import DialectFor, SourceFormat
from trackfg.interchange.importing.source_table import SourceTable
from trackfg.interchange.importing.times.clock import as_ns
from trackfg.numerics.arrays import Array

_SECTION = re.compile(r"^\[(.+)\]\s*$")
_CREATED = re.compile(r"File created on (\d{1,2})/(\d{1,2})/(\d{4})", re.IGNORECASE)
_DEGREES = {"lat": ("latitude", 1.0 / 60.0), "long": ("longitude", -1.0 / 60.0)}
"""Names and factors of the columns of positions."""
_DAY_S = 86_400.0
_UNITS = {"velocity": "km/h", "height": "m", "heading": "deg"}
"""Of the columns that every file has."""


class Vbo(SourceFormat):
    """The rows are one table with latitude and longitude in degrees, and times since 1970 where the file has a date."""

    key = "vbo"
    title = "VBO (.vbo) of Racelogic VBOX"

    def recognises(self, path: Path) -> bool:
        """Return whether it is a .vbo file, or a folder with one."""
        return bool(_files(path))

    def tables(self, path: Path, dialect_for: DialectFor) -> Sequence[SourceTable]:
        """Read the file; of a folder the only one."""
        files = _files(path)
        if len(files) > 1:
            raise BadInputError(f"{path.name}: has {len(files)} .vbo files; expected one, since a recording is one run")
        return [_table(files[0] if files else path)]


def _files(path: Path) -> list[Path]:
    files = sorted(path.iterdir()) if path.is_dir() else [path]
    return [file for file in files if file.suffix.casefold() == ".vbo" and file.is_file()]


def _table(path: Path) -> SourceTable:
    try:
        text = path.read_bytes().decode("utf-8-sig", errors="replace")
    except OSError as error:
        raise BadInputError(f"{path.name}: cannot be read ({error.strerror}); expected a VBO file") from error
    head, marker, rows = text.partition("[data]")
    sections = _sections(head)
    names = " ".join(sections.get("column names", [])).split()
    if not marker or not names:
        raise BadInputError(f"{path.name}: has no [column names] or no [data]; expected the sections of a VBO file")
    first_row = head.count("\n") + 2
    frame = _rows(path, rows.lstrip(" \t\r").removeprefix("\n"), names, first_row)
    units = [unit for unit in sections.get("channel units", []) if unit]
    stated = dict(zip(names[len(names) - len(units) :], units, strict=True)) if len(units) <= len(names) else {}
    for name, (renamed, factor) in _DEGREES.items():
        if name in frame:
            frame[renamed] = frame.pop(name) * factor
    if "time" not in frame:
        raise BadInputError(f"{path.name}: has no column time among {', '.join(names[:20])}; expected one")
    seconds = _seconds_of_day(path, frame.pop("time").to_numpy(), first_row)
    created = _CREATED.search(head)
    if created is None:
        return SourceTable(path.name, frame.assign(time_s=seconds), {**_UNITS, **stated, "time_s": "s"}, first_row)
    midnight = as_ns(_date(path, created))
    ns = midnight + np.round(seconds * 1e9).astype(np.int64)
    return SourceTable(path.name, frame.assign(time_ns=ns), {**_UNITS, **stated, "time_ns": "ns"}, first_row)


def _sections(head: str) -> dict[str, list[str]]:
    """Return the lines of each section, by its name in small letters."""
    sections: dict[str, list[str]] = {}
    name = ""
    for line in head.splitlines():
        if match := _SECTION.match(line):
            name = match[1].strip().casefold()
        elif line.strip():
            sections.setdefault(name, []).append(line.strip())
    return sections


def _rows(path: Path, text: str, names: list[str], first_row: int) -> pd.DataFrame:
    lines = text.splitlines()
    for number, line in enumerate(lines):
        count = len(line.split())
        if count not in (0, len(names)):
            row = first_row + number
            raise BadInputError(f"{path.name}: row {row} has {count} cells; expected {len(names)}, as [column names]")
    try:
        frame = pd.read_csv(io.StringIO(text), sep=r"\s+", header=None, names=names, dtype=np.float64)
    except ValueError as error:
        raise BadInputError(f"{path.name}: {first_line(error)}; expected numbers below [data]") from error
    if frame.empty:
        raise BadInputError(f"{path.name}: has no rows below [data]; expected some")
    return frame


def _seconds_of_day(path: Path, written: Array, first_row: int) -> Array:
    """Return seconds since midnight of the first day, from HHMMSS.SS."""
    hours, rest = np.divmod(written, 10_000.0)
    minutes, seconds = np.divmod(rest, 100.0)
    wrong = ~((hours < 24.0) & (minutes < 60.0) & (seconds < 61.0) & (written >= 0.0))
    if wrong.any():
        i = int(np.argmax(wrong))
        raise BadInputError(f"{path.name}: row {first_row + i}: time is {written[i]:g}; expected HHMMSS.SS")
    t = 3600.0 * hours + 60.0 * minutes + np.round(seconds, 6)
    days = np.cumsum(np.diff(t, prepend=t[0]) < -0.5 * _DAY_S)
    return np.asarray(t + _DAY_S * days)


def _date(path: Path, created: re.Match[str]) -> datetime:
    try:
        return datetime(int(created[3]), int(created[2]), int(created[1]), tzinfo=UTC)
    except ValueError as error:
        raise BadInputError(f"{path.name}: {created[0]!r} has no date; expected day/month/year") from error

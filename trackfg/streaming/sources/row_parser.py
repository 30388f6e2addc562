"""The row parser makes batches of rows that come as JSON objects; nothing in them is trusted.

A row of table ``imu`` is an object with the columns that the description names, time included, each a number; ``null``
and NaN are a missing value, other keys are ignored. What is no such object is an event: one for each kind of fault and
batch, with the first place, how many there were, and what was expected.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from trackfg.errors import BadInputError, did_you_mean
from trackfg.files.small_file import json_of
from trackfg.io.description_reader import FORMAT, validated
from trackfg.numerics import units
from trackfg.recording.description import RecordingDescription, Table
from trackfg.recording.findings import errors
from trackfg.streaming.events import UnreadableRows
from trackfg.streaming.rows import raw_columns
from trackfg.streaming.sources.source import BATCH_S, Batch

LONGEST_BYTES = 1_000_000
"""Of one row."""

MOST_IN_BATCH = 10_000


class RowError(ValueError):
    """An object is no row; the message says what is wrong and what was expected.

    ``fault`` is what it has in common with others that are wrong in the same way; the message unless given.
    """

    def __init__(self, message: str, fault: str = "") -> None:
        super().__init__(message)
        self.fault = fault or message


class RowParser:
    """Collects rows of one description until they make a batch of ``batch_s`` seconds of the IMU.

    ``place`` names where rows come from in messages: ``"line"``.
    """

    def __init__(self, description: RecordingDescription, place: str, batch_s: float = BATCH_S) -> None:
        self._columns = raw_columns(description)
        self._seconds = units.to_si("time", description.imu.time_unit)
        self._place, self._batch_s = place, batch_s
        self._rows: dict[str, list[list[float]]] = {}
        self._faults: dict[str, UnreadableRows] = {}
        self._count = 0
        self._start_s: float | None = None
        self._full = False

    def take(self, table: str, values: dict[str, Any]) -> None:
        """Take one row in. Raises :class:`RowError` where it is none."""
        row = self.numbers(table, values)
        self._count += 1
        self._rows.setdefault(table, []).append(row)
        if table == "imu" and math.isfinite(row[0]):
            t = row[0] * self._seconds
            if self._start_s is None:
                self._start_s = t
            self._full = abs(t - self._start_s) >= self._batch_s

    def refuse(self, number: int, fault: RowError) -> None:
        """Count the object at place ``number`` as no row."""
        self._count += 1
        place = f"{self._place} {number}"
        event = UnreadableRows.of(f"bad-{self._place}", 1, fault.fault, f"{place}: {fault}", place)
        previous = self._faults.get(fault.fault)
        self._faults[fault.fault] = event if previous is None else previous.joined(event)

    @property
    def full(self) -> bool:
        """Return whether a batch is complete."""
        return self._full or self._count >= MOST_IN_BATCH

    def batch(self, position: int) -> Batch:
        """Return what was collected; ``position`` is where the source stands."""
        tables = {name: np.array(rows, dtype=np.float64) for name, rows in self._rows.items()}
        events = tuple(self._faults.values())
        self._rows, self._faults, self._count, self._start_s, self._full = {}, {}, 0, None, False
        return Batch(tables, events, position)

    def numbers(self, table: str, values: dict[str, Any]) -> list[float]:
        """Return the numbers of a row in the order of its columns. Raises :class:`RowError` where it is none."""
        columns = self._columns.get(table)
        if columns is None:
            names = ", ".join(self._columns)
            hint = did_you_mean(table, self._columns)
            raise RowError(f"table {_shown(table)}: expected one of {names}" + (f"; {hint}" if hint else ""))
        try:
            return [_number(values[column]) for column in columns]
        except KeyError as missing:
            raise RowError(f"{table}: no column {missing}; expected {', '.join(columns)}") from None
        except TypeError:
            wrong = next(column for column in columns if type(values[column]) not in _NUMBERS)
            raise RowError(
                f"{table}: {wrong!r} is {_shown(values[wrong])}; expected a number", f"{table}: {wrong!r} is no number"
            ) from None


_NUMBERS = (float, int, type(None))


def _number(value: object) -> float:
    if type(value) is float:
        return value
    if type(value) is int:
        try:
            return float(value)
        except OverflowError:
            return math.inf
    if value is None:
        return math.nan
    raise TypeError


def json_object(text: bytes) -> dict[str, Any]:
    """Return one JSON object. Raises :class:`RowError`."""
    if len(text) > LONGEST_BYTES:
        raise RowError(f"longer than {LONGEST_BYTES} bytes")
    try:
        value = json_of(text)
    except ValueError:
        raise RowError("not JSON; expected one object") from None
    if not isinstance(value, dict):
        raise RowError("is no object; expected one, like {...}")
    return value


def stream_description(given: object, place: str) -> RecordingDescription:
    """Return a description as it comes on a stream: as ``recording.toml``, but ``file`` may be left out of its tables,
    and is never opened. Raises :class:`BadInputError`.
    """
    if not isinstance(given, dict):
        raise BadInputError(f"{place}: the description is no object; expected the keys of recording.toml")
    data = {"format": FORMAT, **{key: _with_file(value) for key, value in given.items()}}
    if "known_line" in data:
        raise BadInputError(f"{place}: known_line: a stream uses none; expected no such key. Hint: use trackfg smooth")
    read = validated(data, place)
    if read.description is None:
        faults = errors(read.findings)
        more = f" ({len(faults) - 1} more errors)" if len(faults) > 1 else ""
        raise BadInputError(f"{faults[0]}{more}")
    return read.description


def _with_file(part: object) -> object:
    if isinstance(part, list):
        return [_with_file(item) for item in part]
    tables = set(Table.model_fields) | {"gyro", "column", "chainage", "position"}
    if isinstance(part, dict) and (tables & part.keys()) and "file" not in part:
        return {"file": "-", **part}
    return part


def _shown(value: object) -> str:
    text = ascii(value)
    return text if len(text) <= 40 else text[:37] + "..."

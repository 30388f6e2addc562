"""Nested records, as of JSON, become a table with a column for each path within them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np
import pandas as pd

from trackfg.errors import BadInputError
from trackfg.interchange.importing.source_table import SourceTable

_DEPTH = 4
"""Records are nested no deeper."""
_GEOJSON = ("longitude", "latitude", "height")
"""Coordinates of a point of GeoJSON, in this order (RFC 7946, section 3.1.1)."""
_AXES = 6
"""Axes of gyro and accelerometer: fewer lists beside each other are matrices, quaternions and the like."""


def table_of_records(records: Iterable[dict[str, Any]], name: str) -> SourceTable:
    """Return the table of records, a column for each path within them; what a record has not is empty.

    A record with lists of several samples, as devices send them in packets, has a row for each of these; its other
    values, such as the time of the packet, are those of all of its rows.
    """
    columns: dict[str, list[Any]] = {}
    rows = 0
    for i, record in enumerate(one for packet in records for one in _samples_of(packet)):
        rows = i + 1
        for path, value in _cells(record, "", _DEPTH):
            column = columns.setdefault(path, [])
            column += [None] * (i - len(column))
            column.append(value)
    for column in columns.values():
        column += [None] * (rows - len(column))
    if not rows:
        raise BadInputError(f"{name}: the file is empty; expected a record in each line")
    return SourceTable(name, pd.DataFrame({path: _column(cells) for path, cells in columns.items()}))


def _samples_of(packet: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """Yield a record for each sample of a packet; the packet itself where it holds no lists of several samples."""
    count = _length(packet, _DEPTH)
    yield from (_nth(packet, i, count, _DEPTH) for i in range(count)) if count else (packet,)


def _length(value: Any, depth: int) -> int:
    """Return how long the lists of samples within a value are; 0 where there are none, or of different lengths."""
    if isinstance(value, list):
        return len(value) if len(value) > 1 and all(isinstance(sample, dict) for sample in value) else 0
    if not isinstance(value, dict) or not depth:
        return 0
    if (axes := _length_of_axes(value)) > 0:
        return axes
    lengths = {length for part in value.values() if (length := _length(part, depth - 1))}
    return lengths.pop() if len(lengths) == 1 else 0


def _length_of_axes(packet: dict[str, Any]) -> int:
    """Return how long the lists are that hold the samples of an axis each; 0 where these are not as many, or differ."""
    lists = [value for value in packet.values() if isinstance(value, list) and len(value) > 1]
    lists = [value for value in lists if all(isinstance(sample, int | float) for sample in value)]
    lengths = {len(value) for value in lists}
    return lengths.pop() if len(lists) >= _AXES and len(lengths) == 1 else 0


def _nth(value: Any, i: int, count: int, depth: int) -> Any:
    """Return a value with the sample ``i`` in place of each list of ``count`` samples."""
    if isinstance(value, dict) and depth:
        of_axes = _length_of_axes(value) == count
        return {
            name: part[i]
            if of_axes and isinstance(part, list) and len(part) == count
            else _nth(part, i, count, depth - 1)
            for name, part in value.items()
        }
    return value[i] if _length(value, 0) == count else value


def _cells(record: dict[str, Any], prefix: str, depth: int) -> Iterator[tuple[str, Any]]:
    for key, value in record.items():
        path = f"{prefix}{key}"
        if isinstance(value, dict) and value.get("type") == "Point" and isinstance(value.get("coordinates"), list):
            yield from (
                (f"{path}.{part}", number) for part, number in zip(_GEOJSON, value["coordinates"], strict=False)
            )
        elif isinstance(value, dict) and depth:
            yield from _cells(value, f"{path}.", depth - 1)
        elif isinstance(value, list) and len(value) == 3:
            yield from ((f"{path}.{axis}", part) for axis, part in zip("xyz", value, strict=True))
        elif isinstance(value, str | int | float) or value is None:
            yield path, value


def _column(cells: list[Any]) -> pd.Series:
    filled = [cell for cell in cells if cell is not None]
    if filled and all(isinstance(cell, int) for cell in filled) and len(filled) == len(cells):
        return pd.Series(cells, dtype=np.int64) if max(map(abs, filled)) < 2**63 else pd.Series(cells, dtype=np.float64)
    if all(isinstance(cell, int | float) for cell in filled):
        return pd.Series(cells, dtype=np.float64)
    numbers = pd.to_numeric(pd.Series(cells, dtype="string"), errors="coerce")
    if filled and numbers.notna().sum() == len(filled):  # numbers that were written as text
        return numbers.astype(np.float64) if len(filled) < len(cells) else numbers
    return pd.Series([None if cell is None else str(cell) for cell in cells], dtype="string")

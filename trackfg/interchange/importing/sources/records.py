"""JSON: a record for each row, in a list or a line each, or a list of numbers for each column."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from trackfg.errors import BadInputError, first_line
from trackfg.interchange.importing.shapes.array_tables import tables_of_arrays
from trackfg.interchange.importing.source_format import readable
from trackfg.interchange.importing.source_table import SourceTable

JSON_SUFFIXES = (".json", ".jsonl", ".ndjson")

_DEPTH = 4
"""Records are nested no deeper."""


def read_records(path: Path) -> list[SourceTable]:
    """Read a file of JSON; none where it has no list of records and none of numbers. Raises :class:`BadInputError`."""
    with readable(path, "JSON", (OSError, ValueError, RecursionError)):
        if path.suffix.casefold() == ".json":
            return list(_tables(_content(path.read_text(encoding="utf-8-sig")), path.name, _DEPTH))
        with path.open(encoding="utf-8-sig") as lines:
            return [_of_records(_records(lines, path.name), path.name)]


def _content(text: str) -> Any:
    """Return the value of a JSON text, or the values of its lines where it has one in each."""
    try:
        return json.loads(text)
    except ValueError as error:
        first = text.lstrip().partition("\n")[0]
        if not first.startswith("{") or not first.rstrip().endswith("}"):
            raise
        try:
            return [json.loads(line) for line in text.splitlines() if line.strip()]
        except ValueError:
            raise error from None


def _records(lines: Iterable[str], name: str) -> Iterator[dict[str, Any]]:
    for number, line in enumerate(lines, start=1):
        if not line.strip():
            continue
        try:
            record = json.loads(line)
        except ValueError as error:
            raise BadInputError(f"{name}: row {number} is no JSON ({first_line(error)}); expected a record") from error
        if not isinstance(record, dict):
            raise BadInputError(f'{name}: row {number} is no record; expected one such as {{"t": 0.01, ...}}')
        yield record


def _tables(content: Any, name: str, depth: int) -> Iterator[SourceTable]:
    """Yield the tables within a value: lists of records, and objects with lists of numbers."""
    if isinstance(content, list):
        if len(content) > 1 and all(isinstance(record, dict) for record in content):
            yield _of_records(content, name)
        return
    if not isinstance(content, dict) or not depth:
        return
    names, rows = content.get("columns"), content.get("data")
    if (
        isinstance(names, list)
        and isinstance(rows, list)
        and all(isinstance(row, list) and len(row) == len(names) for row in rows)
    ):
        yield _of_records([dict(zip(map(str, names), row, strict=True)) for row in rows], name)
        return
    arrays = {key: value for key, value in content.items() if _are_numbers(value)}
    if arrays:
        yield from tables_of_arrays(arrays, name)
    for key, value in content.items():
        if key not in arrays:
            yield from _tables(value, f"{name}/{key}", depth - 1)


def _are_numbers(value: Any) -> bool:
    if not isinstance(value, list) or len(value) < 2:
        return False
    cells = (
        value if not isinstance(value[0], list) else [cell for row in value if isinstance(row, list) for cell in row]
    )
    return all(isinstance(cell, int | float) for cell in cells)


def _of_records(records: Iterable[dict[str, Any]], name: str) -> SourceTable:
    """Return the table of records, a column for each path within them; what a record has not is empty."""
    columns: dict[str, list[Any]] = {}
    rows = 0
    for i, record in enumerate(records):
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


def _cells(record: dict[str, Any], prefix: str, depth: int) -> Iterator[tuple[str, Any]]:
    for key, value in record.items():
        path = f"{prefix}{key}"
        if isinstance(value, dict) and depth:
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

"""JSON: a record for each row, in a list or a line each, or a list of numbers for each column."""

from __future__ import annotations

import ast
import json
import re
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from trackfg.errors import BadInputError, first_line
from trackfg.interchange.importing.shapes.array_tables import tables_of_arrays
from trackfg.interchange.importing.shapes.record_table import table_of_records
from trackfg.interchange.importing.source_format import readable
from trackfg.interchange.importing.source_table import SourceTable

JSON_SUFFIXES = (".json", ".jsonl", ".ndjson")

_DEPTH = 4
"""Records are nested no deeper."""
_LONGEST_RECORD = 1_000_000
"""Characters of a record by which lines of records are recognised."""
_VALUES = ("values", "data", "samples")
_ROW_KEY = re.compile(r"-?\d+(\.\d+)?$|\d{4}-\d\d-\d\d[T ]\d\d:\d\d")
_UNITS = ("unit", "units")
"""What the numbers of a column are called within an object that also has their unit."""


def read_records(path: Path) -> list[SourceTable]:
    """Read a file of JSON; none where it has no list of records and none of numbers. Raises :class:`BadInputError`."""
    with readable(path, "JSON", (OSError, ValueError, RecursionError)):
        if path.suffix.casefold() == ".json":
            return list(_tables(_content(path.read_text(encoding="utf-8-sig")), path.name, _DEPTH))
        with path.open(encoding="utf-8-sig") as lines:
            return [table_of_records(_records(lines, path.name), path.name)]


def holds_records(path: Path) -> bool:
    """Return whether a file of any suffix begins with a line that is a record of JSON."""
    with path.open(encoding="utf-8-sig", errors="replace") as lines:
        first = lines.readline(_LONGEST_RECORD).strip()
    try:
        return first.startswith("{") and isinstance(_value_of(first), dict)
    except (ValueError, SyntaxError, RecursionError):
        return False


def _value_of(line: str) -> Any:
    """Return the value of a line of JSON, or of a dictionary as Python prints it: ``{'t': 0.01, 'ok': True}``."""
    try:
        return json.loads(line)
    except ValueError:
        if not line.lstrip().startswith("{'"):
            raise
        return ast.literal_eval(line.strip())


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
            record = _value_of(line)
        except (ValueError, SyntaxError) as error:
            raise BadInputError(f"{name}: row {number} is no JSON ({first_line(error)}); expected a record") from error
        if not isinstance(record, dict):
            raise BadInputError(f'{name}: row {number} is no record; expected one such as {{"t": 0.01, ...}}')
        yield record


def _tables(content: Any, name: str, depth: int) -> Iterator[SourceTable]:
    """Yield the tables within a value: lists of records, and objects with lists of numbers."""
    if isinstance(content, list):
        if content and all(isinstance(record, dict) and _rows_of(record) is not None for record in content):
            for number, record in enumerate(content):
                yield from _tables(record, name if len(content) == 1 else f"{name}/{number}", depth)
        elif len(content) > 1 and all(isinstance(record, dict) for record in content):
            yield table_of_records(content, name)
        elif content and depth:
            for number, part in enumerate(content):
                yield from _tables(part, f"{name}/{number}", depth - 1)
        return
    if not isinstance(content, dict) or not depth:
        return
    if (rows := _rows_of(content) or _keyed_rows(content)) is not None:
        yield table_of_records(rows, name)
        return
    arrays = {key: numbers for key, value in content.items() if (numbers := _numbers_in(value)) is not None}
    units = {key: str(content[key][unit]) for key in arrays for unit in _UNITS if unit in content[key]}
    if arrays:
        yield from tables_of_arrays(arrays, name, units)
    for key, value in content.items():
        if key not in arrays:
            yield from _tables(value, f"{name}/{key}", depth - 1)


def _rows_of(content: dict[str, Any]) -> list[dict[str, Any]] | None:
    """Return the rows of an object that has the names of its columns once, as those of pandas and InfluxDB do; None
    where it has not.
    """
    names = content.get("columns")
    rows = next((content[key] for key in _VALUES if key in content), None)
    if not isinstance(names, list) or not isinstance(rows, list):
        return None
    if not all(isinstance(row, list) and len(row) == len(names) for row in rows):
        return None
    return [dict(zip(map(str, names), row, strict=True)) for row in rows]


def _keyed_rows(content: dict[str, Any]) -> list[dict[str, Any]] | None:
    """Return the rows of an object whose keys are their times or numbers, or whose columns have such keys each, as
    pandas writes them by default; None where it is neither.
    """
    parts = list(content.values())
    if not parts or not all(isinstance(part, dict) and part for part in parts):
        return None
    if _are_row_keys(content):
        name = _name_of(content)
        return [{name: key, **part} for key, part in content.items()]
    keys = list(parts[0])
    of_columns = all(len(part) == len(keys) and part.keys() == parts[0].keys() for part in parts)
    if not of_columns or not _are_row_keys(keys) or any(isinstance(part[keys[0]], dict | list) for part in parts):
        return None
    name = _name_of(keys)
    return [{name: key, **{column: content[column][key] for column in content}} for key in keys]


def _are_row_keys(keys: Iterable[str]) -> bool:
    """Return whether keys are numbers or dates, and several."""
    listed = list(keys)
    return len(listed) > 1 and all(_ROW_KEY.match(key) for key in listed)


def _name_of(keys: Iterable[str]) -> str:
    """Return what keys of rows are: their numbers, from 0, or their times."""
    return "index" if all(key == str(number) for number, key in enumerate(keys)) else "time"


def _numbers_in(value: Any) -> Any:
    """Return the numbers of a column: a list, or that of an object with its unit; None where it is neither."""
    if isinstance(value, dict) and any(unit in value for unit in _UNITS):
        value = next((value[key] for key in _VALUES if key in value), None)
    return value if _are_numbers(value) else None


def _are_numbers(value: Any) -> bool:
    if not isinstance(value, list) or len(value) < 2:
        return False
    cells = (
        value if not isinstance(value[0], list) else [cell for row in value if isinstance(row, list) for cell in row]
    )
    return all(isinstance(cell, int | float) for cell in cells)

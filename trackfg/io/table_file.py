"""One table of a recording, CSV or Parquet, opened safely and read column by column into float64 arrays.

Files outside the recording's folder are refused: a recording from elsewhere must not read what it does not own.
CSV is comma-separated with a header; numbers are parsed to the nearest double, so that a written recording reads back
exactly. Rows are counted from 1, without the header and without blank lines.
"""

from __future__ import annotations

import csv
import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path, PurePosixPath, PureWindowsPath

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.csv
import pyarrow.parquet as pq

from trackfg.errors import did_you_mean, first_line
from trackfg.numerics.arrays import Array
from trackfg.recording.findings import Finding

TABLE_SUFFIXES = (".parquet", ".csv")
_EMPTY_CELLS = ("", "NaN", "nan", "NA", "N/A", "null", "NULL", "None")
_HEADER_LIMIT = 1_000_000
_ROWS_AT_A_TIME = 1 << 18
"""Rows of Parquet that are unpacked at a time: 2 MB of a column."""
_BLOCK_BYTES = 4096
"""Of a disk: what was not written reads as so many null bytes."""


@dataclass(frozen=True)
class TableFile:
    """An open table: every column's name, and the arrays, or the faults, of those that were asked for."""

    name: str
    columns: tuple[str, ...]
    values: Mapping[str, Array] = field(default_factory=dict)
    faults: Mapping[str, Finding] = field(default_factory=dict)

    def numbers(self, column: str) -> tuple[Array | None, list[Finding]]:
        """Return the column as float64, NaN where a cell is empty; or None and why not."""
        if column in self.faults:
            return None, [self.faults[column]]
        if column in self.values:
            return self.values[column], []
        hint = did_you_mean(column, self.columns)
        if len(self.columns) == 1 and any(separator in self.columns[0] for separator in ";\t"):
            hint = "separate the cells by commas"
        expected = f"one of {', '.join(self.columns[:30])}" if self.columns else "a header: the file is empty"
        return None, [_fault("missing-column", "no such column", self.name, column, expected, hint)]


def _fault(code: str, message: str, file: str, column: str, expected: str, hint: str | None = None) -> Finding:
    """Return an error of a column."""
    return Finding("error", code, message, file=file, column=column, expected=expected, hint=hint)


def resolve_inside(folder: Path, name: str) -> tuple[Path | None, list[Finding]]:
    """Return the existing file ``name`` of ``folder``; or None and why not. Nothing outside ``folder`` is touched."""

    def refused(code: str, message: str, expected: str, hint: str | None = None) -> tuple[None, list[Finding]]:
        return None, [Finding("error", code, message, file=name, expected=expected, hint=hint)]

    inside = "a file in the recording's folder, named relative to it"
    posix, windows = PurePosixPath(name), PureWindowsPath(name)
    if posix.is_absolute() or windows.is_absolute() or windows.drive or ".." in windows.parts:
        return refused("path-outside", "the path leads out of the recording", inside, "copy the table into the folder")
    try:
        path = (folder / name).resolve()
        if not path.is_relative_to(folder.resolve()):
            hint = "copy the table into the folder instead of linking to it"
            return refused("path-outside", "the link leads out of the recording", inside, hint)
        if path.is_file():
            if ends_in_nulls(path):
                hint = "copy the file again from its source"
                return refused("unreadable-table", "ends in null bytes: it was not written whole", "a whole file", hint)
            return path, []
        siblings = [p.relative_to(folder).as_posix() for p in (folder / name).parent.glob("*") if p.is_file()]
    except (OSError, ValueError, RuntimeError):  # name too long, null byte, endless link
        return refused("missing-file", "not a usable file name", inside)
    tables = [sibling for sibling in siblings if sibling.endswith(TABLE_SUFFIXES)]
    return refused("missing-file", "no such file", f"a table in {folder}", did_you_mean(name, tables))


def ends_in_nulls(path: Path) -> bool:
    """Return whether the end of a file is an empty block of the disk: one is enough to know, however many there are."""
    try:
        with path.open("rb") as file:
            file.seek(-min(_BLOCK_BYTES, path.stat().st_size), os.SEEK_END)
            end = file.read(_BLOCK_BYTES)
    except OSError:  # whoever reads it says why
        return False
    return bool(end) and not end.strip(b"\0")


def open_table(folder: Path, name: str, wanted: Iterable[str]) -> tuple[TableFile | None, list[Finding]]:
    """Open a table and read the ``wanted`` columns that it has; or None and why it cannot be read. Never raises."""
    path, findings = resolve_inside(folder, name)
    if path is None:
        return None, findings
    wanted = list(dict.fromkeys(wanted))
    try:
        if name.endswith(".parquet"):
            return _open_parquet(path, name, wanted), []
        if name.endswith(".csv"):
            return _open_csv(path, name, wanted)
    except (pa.ArrowException, OSError, ValueError, csv.Error) as error:
        kind = "Parquet" if name.endswith(".parquet") else "comma-separated UTF-8"
        hint = "copy the file again from its source: it may be truncated"
        message = f"cannot be read ({first_line(error)})"
        return None, [Finding("error", "unreadable-table", message, file=name, expected=f"a {kind} table", hint=hint)]
    expected = f"a file in {' or '.join(TABLE_SUFFIXES)}"
    return None, [Finding("error", "table-format", "unknown kind of table", file=name, expected=expected)]


def text_column(folder: Path, name: str, column: str) -> tuple[list[str] | None, list[Finding]]:
    """Return the cells of a column as text, whole numbers without decimals, an empty cell as ``""``; or None and why
    not. The table was opened before, so that its rows are sound. Never raises.
    """
    path, findings = resolve_inside(folder, name)
    if path is None:
        return None, findings
    try:
        if name.endswith(".parquet"):
            file = pq.ParquetFile(path)
            names = file.schema_arrow.names
            # On this thread alone: see trackfg.files.parquet.
            cells = file.read(columns=[column], use_threads=False)[column] if names.count(column) == 1 else None
        else:
            names = _header(path)
            convert = pa.csv.ConvertOptions(include_columns=[column], column_types={column: pa.string()})
            cells = pa.csv.read_csv(path, convert_options=convert)[column] if names.count(column) == 1 else None
    except (pa.ArrowException, OSError, ValueError, csv.Error) as error:
        return None, [Finding("error", "unreadable-table", f"cannot be read ({first_line(error)})", file=name)]
    if cells is None:
        return None, [*_repeated(names, [column], name).values()] or TableFile(name, tuple(names)).numbers(column)[1]
    return [_as_text(cell) for cell in cells.to_pylist()], []


def _as_text(cell: object) -> str:
    if cell is None or cell != cell:
        return ""
    return str(int(cell)) if isinstance(cell, float) and cell.is_integer() else str(cell).strip()


def _open_parquet(path: Path, name: str, wanted: list[str]) -> TableFile:
    with pq.ParquetFile(path) as parquet:
        schema, values = parquet.schema_arrow, {}
        faults = _repeated(schema.names, wanted, name)
        for column in wanted:
            if schema.names.count(column) != 1:
                continue
            kind = schema.field(column).type
            if pa.types.is_integer(kind) or pa.types.is_floating(kind) or pa.types.is_decimal(kind):
                values[column] = _parquet_column(parquet, column)
                continue
            hint = "store seconds since the start as numbers" if pa.types.is_temporal(kind) else "store it as numbers"
            faults[column] = _fault("not-numeric", f"has type {kind}", name, column, "numbers", hint)
    return TableFile(name, tuple(schema.names), values, faults)


def _parquet_column(parquet: pq.ParquetFile, column: str) -> Array:
    """Return a column, read some rows at a time: Arrow never holds more of it."""
    out, end = np.empty(parquet.metadata.num_rows), 0
    for batch in parquet.iter_batches(_ROWS_AT_A_TIME, columns=[column]):
        begin, end = end, end + len(batch)
        out[begin:end] = pc.cast(batch.column(0), pa.float64(), safe=False).to_numpy(zero_copy_only=False)
    return out


def _header(path: Path) -> list[str]:
    """Return the names of the columns of a CSV file, none where it is empty."""
    with path.open(encoding="utf-8-sig", newline="") as stream:
        return next(csv.reader([stream.readline(_HEADER_LIMIT)]), [])


def _open_csv(path: Path, name: str, wanted: list[str]) -> tuple[TableFile | None, list[Finding]]:
    header = _header(path)
    present = [column for column in wanted if header.count(column) == 1]
    faults = _repeated(header, wanted, name)
    if not present:
        return TableFile(name, tuple(header), {}, faults), []
    convert = pa.csv.ConvertOptions(
        include_columns=present, column_types=dict.fromkeys(present, pa.float64()), null_values=list(_EMPTY_CELLS)
    )
    try:
        table = pa.csv.read_csv(path, convert_options=convert)
    except (pa.ArrowInvalid, pa.ArrowKeyError):
        return _search_csv(path, name, header, present, faults)
    values = {column: np.asarray(table[column].to_numpy(), dtype=np.float64) for column in present}
    return TableFile(name, tuple(header), values, faults), []


def _search_csv(
    path: Path, name: str, header: list[str], present: list[str], faults: dict[str, Finding]
) -> tuple[TableFile | None, list[Finding]]:
    """Read a faulty CSV file cell by cell, to say which cell is wrong."""
    cells: dict[str, list[float]] = {column: [] for column in present}
    wrong: dict[str, list[tuple[int, str]]] = {column: [] for column in present}
    places = [(column, header.index(column)) for column in present]
    with path.open(encoding="utf-8-sig", newline="") as stream:
        rows = csv.reader(stream)
        next(rows, None)
        number = 0
        for row in rows:
            if not row:
                continue
            number += 1
            if len(row) != len(header):
                message, expected = f"{len(row)} cells", f"{len(header)}, as in the header"
                return None, [Finding("error", "row-length", message, file=name, row=number, expected=expected)]
            for column, i in places:
                value = _parse(row[i])
                if value is None:
                    wrong[column].append((number, row[i]))
                cells[column].append(np.nan if value is None else value)
    for column, wrong_cells in wrong.items():
        if wrong_cells:
            row_number, text = wrong_cells[0]
            more = f" ({len(wrong_cells)} such cells)" if len(wrong_cells) > 1 else ""
            message = f"{text[:40]!r} is not a number{more}"
            hint = "write decimals with a point, without units or thousands separators"
            fault = _fault("not-numeric", message, name, column, "a number", hint)
            faults[column] = replace(fault, row=row_number)
    values = {column: np.array(cells[column]) for column in present if not wrong[column]}
    return TableFile(name, tuple(header), values, faults), []


def _parse(cell: str) -> float | None:
    """Return the number in a cell as Arrow reads it: NaN for an empty one, None for what is no number."""
    cell = cell.strip(" \t")
    if cell in _EMPTY_CELLS:
        return float("nan")
    try:
        return None if "_" in cell else float(cell)
    except ValueError:
        return None


def _repeated(names: list[str], wanted: list[str], file: str) -> dict[str, Finding]:
    twice = [column for column in wanted if names.count(column) > 1]
    return {
        column: _fault("repeated-column", "appears more than once", file, column, "each name once") for column in twice
    }

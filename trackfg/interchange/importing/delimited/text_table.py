"""A file of delimited text is read as its dialect says, and every fault in it has a row."""

from __future__ import annotations

import csv
import re
from pathlib import Path

import pandas as pd
import pyarrow as pa
import pyarrow.compute
import pyarrow.csv

from trackfg.errors import BadInputError, first_line, printable
from trackfg.interchange.importing.delimited.cells import EMPTY_CELLS, cells, without_blank_before_noon
from trackfg.interchange.importing.delimited.data_rows import is_remark, names_a_summary, summary_rows
from trackfg.interchange.importing.delimited.dialect import Dialect, DialectOptions, NoRowsError, dialect_of
from trackfg.interchange.importing.delimited.written_numbers import numbers_of
from trackfg.interchange.importing.source_table import SourceTable
from trackfg.io.table_file import ends_in_nulls

_LETTERS = re.compile(r"[^\W\d_]{2}")
"""What a row of names has, and one of numbers has not."""
_BLOCK_BYTES = 1 << 22
"""Text that is changed at a time."""


def read_text(path: Path, options: DialectOptions | None = None) -> SourceTable:
    """Read a file of delimited text. Raises :class:`BadInputError`, with the row if one is to blame."""
    if ends_in_nulls(path):
        hint = "copy the file again from its source"
        raise BadInputError(f"{path.name}: ends in null bytes: it was not written whole; expected text. Hint: {hint}")
    dialect = dialect_of(path, options)
    notes: tuple[str, ...] = ()
    try:
        frame = _parsed(_source(path, dialect), dialect)
        fault = None
    except (pa.ArrowException, UnicodeError) as error:
        fault = error
    if fault is not None or _is_summed_up(frame) or _has_names_again(frame, dialect):
        rows, notes = _rows_of_data(path, dialect)
        if rows is not None:
            try:
                frame = _parsed(pa.BufferReader(rows), dialect)
            except pa.ArrowException as second:
                raise BadInputError(_fault(path, dialect, second)) from second
        elif fault is not None:
            raise BadInputError(_fault(path, dialect, fault)) from fault
    if frame.empty:
        raise NoRowsError(f"{path.name}: the table has no rows; expected data from row {dialect.first_row} on")
    return SourceTable(path.name, frame, dialect.units, dialect.first_row, remarks=dialect.remarks, notes=notes)


def _source(path: Path, dialect: Dialect) -> Path | pa.BufferReader:
    """Return what Arrow reads: the file, or its text where columns are parted by blanks."""
    if not dialect.by_blanks:
        return path
    whole = bytearray()
    with path.open(encoding=_codec(dialect.encoding)) as stream:
        while lines := stream.readlines(_BLOCK_BYTES):
            whole += _parted("".join(lines))
    return pa.BufferReader(whole)


def _parted(text: str) -> bytes:
    """Return text with one tab in place of the blanks between its columns."""
    lines = re.sub(r"[ \t]+", "\t", without_blank_before_noon(text))
    return re.sub(r"(?m)^\t|\t$", "", lines).encode()


def _parsed(source: Path | pa.BufferReader, dialect: Dialect) -> pd.DataFrame:
    encoding = _codec(dialect.encoding) if isinstance(source, Path) else "utf-8"
    read = pa.csv.ReadOptions(column_names=list(dialect.names), skip_rows=dialect.first_row - 1, encoding=encoding)
    delimiter = "\t" if dialect.by_blanks else dialect.delimiter
    parse = pa.csv.ParseOptions(delimiter=delimiter, ignore_empty_lines=True)
    convert = pa.csv.ConvertOptions(
        null_values=EMPTY_CELLS, strings_can_be_null=True, decimal_point=dialect.decimal, timestamp_parsers=["none"]
    )
    return _as_frame(pa.csv.read_csv(source, read, parse, convert), dialect.decimal)


def _is_summed_up(frame: pd.DataFrame) -> bool:
    """Return whether the table may end in rows that sum it up, whose first cell is a word."""
    if frame.empty or not pd.api.types.is_string_dtype(frame.iloc[:, 0]):
        return False
    return names_a_summary(str(frame.iloc[-1, 0]), str(frame.iloc[0, 0]))


def _has_names_again(frame: pd.DataFrame, dialect: Dialect) -> bool:
    """Return whether a cell below a name is that name, as where a logger has started anew."""
    for row in _rows_above(dialect):
        at = _first_filled(row)
        if pd.api.types.is_string_dtype(frame.iloc[:, at]) and (frame.iloc[:, at] == row[at]).any():
            return True
    return False


def _rows_above(dialect: Dialect) -> list[list[str]]:
    """Return the rows of names and units above the data."""
    rows = (cells(line, dialect.delimiter) for line in dialect.remarks.splitlines())
    return [row for row in rows if len(row) == len(dialect.names) and any(row)]


def _first_filled(row: list[str]) -> int:
    """Return the place of the first cell that is not empty: a row of names may begin with an empty one."""
    return next(i for i, cell in enumerate(row) if cell)


def _rows_of_data(path: Path, dialect: Dialect) -> tuple[bytes | None, tuple[str, ...]]:
    """Return the file without remarks among and below its rows, and without rows that sum it up or have the names of
    the columns again, on which are notes.

    None where it has none of them.
    """
    try:
        with path.open(encoding=dialect.encoding) as stream:
            lines = list(stream)
        above, rows = lines[: dialect.first_row - 1], lines[dialect.first_row - 1 :]
        kept = [line for line in rows if not is_remark(line.rstrip("\n"), dialect.delimiter)]
        names, with_names = _rows_above(dialect), len(kept)
        if _has_names(kept, names, dialect.delimiter):
            kept = [line for line in kept if cells(line.rstrip("\n"), dialect.delimiter) not in names]
        again = with_names - len(kept)
        summary = summary_rows(kept, dialect.delimiter)
    except (UnicodeDecodeError, csv.Error):
        return None, ()
    kept, below = kept[: len(kept) - summary], [line.strip() for line in kept[len(kept) - summary :] if line.strip()]
    if len(kept) == len(rows):
        return None, ()
    text = "".join((*above, *kept))
    content = _parted(text) if dialect.by_blanks else text.encode()
    notes = []
    if again:
        rows_again = "1 row that has" if again == 1 else f"{again} rows that have"
        notes.append(f"{path.name}: {rows_again} the names or units of the columns again: left out")
    if below:
        beginning = printable(below[0])[:40]
        notes.append(
            f"{path.name}: rows below the data are left out: {len(below)}, the first of which is {beginning!r}"
        )
    return content, tuple(notes)


def _has_names(lines: list[str], names: list[list[str]], delimiter: str) -> bool:
    """Return whether a line begins as one of the rows of names does: to part all lines into cells takes long."""
    beginnings = tuple({(delimiter * _first_filled(row)) + row[_first_filled(row)] for row in names})
    return bool(beginnings) and any(line.lstrip(' "\ufeff').startswith(beginnings) for line in lines)


def _as_frame(table: pa.Table, decimal: str) -> pd.DataFrame:
    """Return numbers as numbers, and dates, times and all else as text, as they are written."""
    columns = {}
    for name in table.column_names:
        column = table.column(name)
        numeric = pa.types.is_integer(column.type) or pa.types.is_floating(column.type)
        columns[name] = (column if numeric else numbers_of(column.cast(pa.string()), decimal)).to_pandas()
        table = table.drop_columns([name])  # no column is there twice
    return pd.DataFrame(columns, copy=False)


def _codec(encoding: str) -> str:
    return "utf-8" if encoding == "utf-8-sig" else encoding  # the mark is in a row that is skipped, or Arrow drops it


def _fault(path: Path, dialect: Dialect, error: Exception) -> str:
    """Return what is wrong with the file: the first row that differs, if one does."""
    width = len(dialect.names)
    try:
        with path.open(encoding=dialect.encoding, newline="") as stream:
            for number, line in enumerate(stream, start=1):
                if number >= dialect.first_row and line.strip():
                    count = len(cells(line.rstrip("\r\n"), dialect.delimiter))
                    if count != width and not is_remark(line.rstrip("\r\n"), dialect.delimiter):
                        cut = count < width and not any(later.strip() for later in stream)
                        hint = ""
                        if cut:
                            hint = ". Hint: it is the last row: where the file was cut off, delete it to read the rest"
                        elif _LETTERS.search(line):
                            hint = ". Hint: where another table begins there, give each a file of its own"
                        several = "1 cell" if count == 1 else f"{count} cells"
                        return f"{path.name}: row {number} has {several}; expected {width}, as in the others{hint}"
    except UnicodeDecodeError as fault:
        return f"{path.name}: byte {fault.start} is not {dialect.encoding}; expected another encoding"
    except csv.Error as fault:
        return f"{path.name}: row {number}: {fault}; expected {width} cells"
    return f"{path.name}: cannot be read ({printable(first_line(error))}); expected delimited text"

"""Spreadsheets (.xlsx, and .xls of older programs): each sheet with a header and rows is a table."""

from __future__ import annotations

import datetime as dt
import io
from dataclasses import replace
from pathlib import Path
from typing import Any

import pandas as pd

from trackfg.errors import BadInputError
from trackfg.files.libraries import library
from trackfg.interchange.importing.delimited.data_rows import first_data_row
from trackfg.interchange.importing.delimited.header import header_of
from trackfg.interchange.importing.source_format import readable
from trackfg.interchange.importing.source_table import SourceTable

SPREADSHEETS = (".xlsx", ".xls")
_HEAD_ROWS = 200
"""Rows of a sheet among which its first row of values is looked for."""


def read_spreadsheet(path: Path) -> list[SourceTable]:
    """Read every sheet that has a header and rows; its name is ``file.xlsx`` for one sheet, else ``file.xlsx/sheet``.

    Raises :class:`BadInputError` where the file cannot be read or has no such sheet.
    """
    with readable(path, f"a spreadsheet ({path.suffix})"):
        sheets = _rows_of_xls(path) if path.suffix.casefold() == ".xls" else _rows_of_xlsx(path)
    tables = [table for title, rows in sheets.items() if (table := _table(rows, f"{path.name}/{title}")) is not None]
    if not tables:
        raise BadInputError(f"{path.name}: no sheet has a header and rows below it; expected one")
    return [replace(tables[0], name=path.name)] if len(tables) == 1 else tables


def _rows_of_xlsx(path: Path) -> dict[str, list[list[Any]]]:
    book = library("openpyxl", "excel").load_workbook(path, read_only=True, data_only=True)
    sheets = {sheet.title: [list(row) for row in sheet.iter_rows(values_only=True)] for sheet in book.worksheets}
    book.close()
    return sheets


def _rows_of_xls(path: Path) -> dict[str, list[list[Any]]]:
    xlrd = library("xlrd", "excel")

    def value(cell: Any) -> Any:
        if cell.ctype == xlrd.XL_CELL_DATE:
            date = xlrd.xldate_as_datetime(cell.value, book.datemode)
            return date if cell.value >= 1.0 else date.time()
        return None if cell.ctype in (xlrd.XL_CELL_EMPTY, xlrd.XL_CELL_BLANK, xlrd.XL_CELL_ERROR) else cell.value

    with path.open("rb") as stream, xlrd.open_workbook(file_contents=stream.read(), logfile=io.StringIO()) as book:
        return {sheet.name: [[value(cell) for cell in row] for row in sheet.get_rows()] for sheet in book.sheets()}


def _table(rows: list[list[Any]], name: str) -> SourceTable | None:
    """Return the rows of values below the names of their columns, as in text; None where there are none."""
    head = [["" if cell is None else _as_text(cell).strip() for cell in row] for row in rows[:_HEAD_ROWS]]
    width = max((j for row in head for j, cell in enumerate(row, start=1) if cell), default=0)
    head = [row[:width] for row in head]
    first = first_data_row(head, width)
    if first is None or width < 2:
        return None
    names, units = header_of(head, first, width, None)
    body = [row[:width] for row in rows[first:] if any(cell is not None for cell in row)]
    frame = pd.DataFrame({name: _column([row[j] for row in body]) for j, name in enumerate(names)})
    remarks = "\n".join("\t".join(cell for cell in row if cell) for row in head[:first])
    return SourceTable(name, frame, units, first + 1, remarks=remarks)


def _column(cells: list[Any]) -> pd.Series:
    filled = [cell for cell in cells if cell is not None]
    if filled and all(isinstance(cell, int | float) and not isinstance(cell, bool) for cell in filled):
        return pd.Series([float("nan") if cell is None else cell for cell in cells])
    if filled and all(isinstance(cell, dt.datetime) and cell.time() == dt.time() for cell in filled):
        cells = [None if cell is None else cell.date() for cell in cells]  # a date beside a time of day
    return pd.Series([None if cell is None else _as_text(cell) for cell in cells], dtype="string")


def _as_text(cell: Any) -> str:
    return cell.isoformat() if isinstance(cell, dt.datetime | dt.date | dt.time) else str(cell)

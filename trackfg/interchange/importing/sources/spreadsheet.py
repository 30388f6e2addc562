"""Spreadsheets (.xlsx): each sheet with a header and rows is a table."""

from __future__ import annotations

import datetime as dt
import zipfile
from pathlib import Path
from typing import Any

import pandas as pd

from trackfg.errors import BadInputError
from trackfg.files.libraries import library
from trackfg.interchange.importing.source_table import SourceTable

SPREADSHEETS = (".xlsx",)


def read_spreadsheet(path: Path) -> list[SourceTable]:
    """Read every sheet that has a header and rows; its name is ``file.xlsx`` for one sheet, else ``file.xlsx/sheet``.

    Raises :class:`BadInputError` where the file cannot be read or has no such sheet.
    """
    openpyxl = library("openpyxl", "excel")
    try:
        book = openpyxl.load_workbook(path, read_only=True, data_only=True)
        sheets = {sheet.title: [list(row) for row in sheet.iter_rows(values_only=True)] for sheet in book.worksheets}
        book.close()
    except (OSError, KeyError, ValueError, TypeError, zipfile.BadZipFile, SyntaxError) as error:
        # openpyxl lets through what its parsers raise: KeyError for a missing part, SyntaxError for damaged XML.
        raise BadInputError(f"{path.name}: cannot be read ({error}); expected a spreadsheet (.xlsx)") from error
    tables = {title: _table(rows) for title, rows in sheets.items()}
    found = {title: table for title, table in tables.items() if table is not None}
    if not found:
        raise BadInputError(f"{path.name}: no sheet has a header and rows below it; expected one")
    alone = len(found) == 1
    return [
        SourceTable(path.name if alone else f"{path.name}/{title}", frame, first_row=first)
        for title, (frame, first) in found.items()
    ]


def _table(rows: list[list[Any]]) -> tuple[pd.DataFrame, int] | None:
    """Return the rows below the first one whose cells are all text, and the number of the first of them."""
    for i, row in enumerate(rows):
        filled = [cell for cell in row if cell is not None]
        if len(filled) >= 2 and all(isinstance(cell, str) for cell in filled):
            body = [cells for cells in rows[i + 1 :] if any(cell is not None for cell in cells)]
            if not body:
                return None
            width = max(j for j, cell in enumerate(row) if cell is not None) + 1
            names = [str(cell).strip() if cell is not None else f"c{j + 1}" for j, cell in enumerate(row[:width])]
            columns = {name: _column([cells[j] for cells in body]) for j, name in enumerate(names)}
            return pd.DataFrame(columns), i + 2
    return None


def _column(cells: list[Any]) -> pd.Series:
    filled = [cell for cell in cells if cell is not None]
    if filled and all(isinstance(cell, int | float) and not isinstance(cell, bool) for cell in filled):
        return pd.Series([float("nan") if cell is None else cell for cell in cells])
    return pd.Series([None if cell is None else _as_text(cell) for cell in cells], dtype="string")


def _as_text(cell: Any) -> str:
    return cell.isoformat() if isinstance(cell, dt.datetime | dt.date | dt.time) else str(cell)

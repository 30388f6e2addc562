"""Numbers that are written as text, with a decimal comma or digits in groups, become numbers."""

from __future__ import annotations

import re
from dataclasses import replace

import pandas as pd
import pyarrow as pa
import pyarrow.compute

from trackfg.interchange.importing.columns.column_names import meaning
from trackfg.interchange.importing.delimited.cells import EMPTY_CELLS
from trackfg.interchange.importing.delimited.separators import decimal_of
from trackfg.interchange.importing.source_table import SourceTable

_FIRST_CELLS = 500
"""Rows that show the decimal sign of a table."""
_NO_GROUP = re.compile(r"[+\-\u2212]?\d*,(?!\d{3}$)\d+([eE][+-]?\d+)?$")
"""A number with a comma that is none between digits in groups."""
_WHOLE = r"[+-]?[0-8]?\d{1,18}"
"""A whole number that 64 bits hold, such as a time in ns."""
_WRITTEN = ("station", "balise")
"""Kinds of columns that hold text, even if it is digits."""


def with_numbers(table: SourceTable) -> SourceTable:
    """Return a table of a format whose columns have types, with numbers in place of those that are written as text.

    Cells such as ``1,234`` alone do not show whether their comma is a decimal sign: they stay as they are.
    """
    texts = [name for name in table.columns if pd.api.types.is_string_dtype(table.frame[name])]
    texts = [name for name in texts if meaning(name) not in _WRITTEN and table.frame[name].notna().any()]
    if not texts:
        return table
    first = table.frame[texts].head(_FIRST_CELLS).astype("string").fillna("").apply(lambda cells: cells.str.strip())
    rows = first.to_numpy().tolist()
    decimal = decimal_of(rows)
    if decimal == "," and not any(_NO_GROUP.match(cell) for row in rows for cell in row):
        return table
    columns = {}
    for name in texts:
        cells = table.frame[name].astype("string").str.strip()
        if cells.dropna().str.fullmatch(_WHOLE).all():
            columns[name] = pd.to_numeric(cells) if cells.notna().all() else pd.to_numeric(cells).astype("float64")
            continue
        numbers = numbers_of(pa.chunked_array([pa.array(cells, type=pa.string(), from_pandas=True)]), decimal)
        if pa.types.is_floating(numbers.type):
            columns[name] = pd.Series(numbers.to_numpy(), index=cells.index)
    return replace(table, frame=table.frame.assign(**columns)) if columns else table


def numbers_of(column: pa.ChunkedArray, decimal: str) -> pa.ChunkedArray:
    """Return a column of text as numbers where all its cells are, some with digits in groups of three: ``1.234,5``.

    Their minus may be that of typesetters. Cells that are empty but for blanks, which Arrow takes for text, are none.
    """
    trimmed = pa.compute.utf8_trim_whitespace(column)
    empty = pa.compute.is_in(trimmed, value_set=pa.array(EMPTY_CELLS))
    column, trimmed = (pa.compute.if_else(empty, None, cells) for cells in (column, trimmed))
    trimmed = pa.compute.replace_substring(trimmed, "\u2212", "-")
    signs = "['\u2019\u00a0\u202f " + ("." if decimal == "," else ",") + "]"
    number = rf"^[+-]?(\d{{1,3}}({signs}\d{{3}})+|\d+)([{decimal}]\d*)?([eE][+-]?\d+)?$"
    for part in (trimmed.slice(0, 100), trimmed):
        grouped = pa.compute.match_substring_regex(part, number)
        if part.null_count == len(part) or not pa.compute.all(grouped).as_py():
            return column
    plain = pa.compute.replace_substring_regex(trimmed, signs, "")
    return pa.compute.replace_substring(plain, decimal, ".").cast(pa.float64())

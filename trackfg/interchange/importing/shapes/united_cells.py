"""Cells with their unit behind the number, ``9.81 m/s^2`` or ``12,3 km/h``, become numbers in that unit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd

from trackfg.errors import BadInputError, printable
from trackfg.interchange.importing.columns.column_meaning import full_name
from trackfg.interchange.importing.columns.column_names import meaning
from trackfg.interchange.importing.columns.written_units import QUANTITY_CELL, number_and_unit
from trackfg.interchange.importing.source_table import SourceTable
from trackfg.numerics.chainage.km_notation import metres_of

_FIRST_CELLS = 100
_STRAY = 0.1
"""Share of the cells below which another unit is a fault of theirs, not another kind of column."""


def without_units_in_cells(table: SourceTable) -> SourceTable:
    """Return a table whose columns of numbers with units are numbers, in the unit that all of a column's cells have.

    Places (``12.3 km``) stay as they are written. Raises :class:`BadInputError` where a few cells are in another unit.
    """
    columns, units = dict[str, pd.Series](), dict(table.units)
    for name in table.columns:
        column = table.frame[name]
        if not pd.api.types.is_string_dtype(column) or meaning(full_name(table, name)) in _WRITTEN:
            continue
        cells = column.dropna().str.strip()
        first = cells.iloc[:_FIRST_CELLS]
        if not len(first) or any(number_and_unit(cell) is None for cell in first):
            continue
        if (unit := _unit_of(table, name, cells)) is None:
            continue
        numbers = column.str.strip().str.extract(QUANTITY_CELL)[0]
        plain = numbers.str.replace(",", ".", regex=False).str.replace("\u2212", "-", regex=False)
        columns[name], units[name] = pd.to_numeric(plain).astype("float64"), unit
    return replace(table, frame=table.frame.assign(**columns), units=units) if columns else table


_WRITTEN = ("station", "balise")
"""Kinds of columns that hold text."""


def _unit_of(table: SourceTable, name: str, cells: pd.Series) -> str | None:
    """Return the unit behind all numbers of a column; None where it is none, or there are several."""
    written = cells.str.extract(QUANTITY_CELL)[1]
    unit = str(written.iloc[0])
    others = (written != unit).fillna(value=True).to_numpy(dtype=bool)
    is_place = meaning(full_name(table, name)) is None and metres_of(str(cells.iloc[0])) is not None
    if is_place or others.mean() > _STRAY:
        return None
    if others.any():
        at = int(others.argmax())
        row = table.first_row + int(np.flatnonzero(table.frame[name].notna())[at])
        cell = printable(str(cells.iloc[at]))[:40]
        more = f" ({others.sum()} such cells)" if others.sum() > 1 else ""
        raise BadInputError(
            f"{table.name}: column {name!r}, row {row}: {cell!r} is not in {unit}{more}; expected one unit for the "
            "whole column. Hint: correct such cells, or give each unit a column of its own"
        )
    return unit

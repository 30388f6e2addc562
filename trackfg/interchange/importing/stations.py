"""Places along a line, as people write them: ``12+345.6``, ``km 12,345``, ``12.345 km``, ``12345 m``."""

from __future__ import annotations

import re

import numpy as np
import pandas as pd

from trackfg.errors import BadInputError, printable
from trackfg.interchange.importing.source_table import SourceTable
from trackfg.numerics.arrays import Array

_PLUS = re.compile(r"^(?:km\s*)?(?P<sign>-)?(?P<km>\d+)\s*\+\s*(?P<m>-?\d+(?:\.\d+)?)\s*m?$", re.IGNORECASE)
_KM = re.compile(r"^(?:km\s*(?P<a>-?\d+(?:\.\d+)?)|(?P<b>-?\d+(?:\.\d+)?)\s*km)$", re.IGNORECASE)
_M = re.compile(r"^(?P<m>-?\d+(?:\.\d+)?)\s*m?$", re.IGNORECASE)


def metres_of(cell: str) -> float | None:
    """Return the metres that a written place means; None where it means none. A bare number is in metres."""
    text = cell.strip().replace(",", ".")
    if match := _PLUS.match(text):
        value = 1000.0 * float(match["km"]) + float(match["m"])
        return -value if match["sign"] else value
    if match := _KM.match(text):
        return 1000.0 * float(match["a"] or match["b"])
    if match := _M.match(text):
        return float(match["m"])
    return None


def read_stations(table: SourceTable, name: str, unit: str) -> Array:
    """Return the chainage (n,), m, of a column of numbers in ``unit`` (m or km), or of written places.

    Raises :class:`BadInputError` with the first row that means no place.
    """
    column = table.column(name)
    if not pd.api.types.is_string_dtype(column):
        return table.numbers(name) * {"m": 1.0, "km": 1000.0}[unit]
    factor = {"m": 1.0, "km": 1000.0}[unit]
    metres = np.empty(len(column))
    for i, cell in enumerate(column):
        value = None if pd.isna(cell) else metres_of(str(cell))
        if value is None:
            shown = "" if pd.isna(cell) else printable(str(cell))[:40]
            raise BadInputError(
                f"{table.name}: column {name!r}, row {table.first_row + i}: {shown!r} is no place; expected one such "
                "as 12+345, km 12.345 or 12345"
            )
        plain = _M.match(str(cell).strip().replace(",", "."))
        metres[i] = value * factor if plain else value
    return metres

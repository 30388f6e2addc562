"""A column of places along a line becomes chainages."""

from __future__ import annotations

from typing import Literal

import numpy as np
import pandas as pd

from trackfg.errors import BadInputError, printable
from trackfg.interchange.importing.source_table import SourceTable
from trackfg.numerics.arrays import Array
from trackfg.numerics.km_notation import METRES_PER, metres_of


def read_stations(table: SourceTable, name: str, unit: Literal["m", "km"]) -> Array:
    """Return the chainage (n,), m, of a column of numbers in ``unit``, or of written places.

    Raises :class:`BadInputError` with the first row that means no place.
    """
    column = table.column(name)
    if not pd.api.types.is_string_dtype(column):
        return table.numbers(name) * METRES_PER[unit]
    metres = np.empty(len(column))
    for i, cell in enumerate(column):
        value = None if pd.isna(cell) else metres_of(str(cell), unit)
        if value is None:
            shown = "" if pd.isna(cell) else printable(str(cell))[:40]
            raise BadInputError(
                f"{table.name}: column {name!r}, row {table.first_row + i}: {shown!r} is no place; expected one such "
                "as 12+345, km 12.345 or 12345"
            )
        metres[i] = value
    return metres

"""A column of places along a line becomes chainages."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from trackfg.errors import BadInputError, printable
from trackfg.interchange.importing.source_table import SourceTable
from trackfg.numerics.arrays import Array
from trackfg.numerics.km_notation import METRES_PER, Bare, is_metres, metres_of

if TYPE_CHECKING:
    from trackfg.numerics.kilometrage import Kilometrage


def read_stations(table: SourceTable, name: str, unit: Bare, kilometrage: Kilometrage | None = None) -> Array:
    """Return the chainage (n,), m, of a column of numbers in ``unit``, or of written places; NaN where it is empty.

    Kilometres are official places, metres are chainages; both are the same without a ``kilometrage``. Raises
    :class:`BadInputError` with the first row that means no place, or none of the line.
    """
    column = table.column(name)
    if not pd.api.types.is_string_dtype(column):
        numbers = table.numbers(name)
        if kilometrage is None or unit == "m":
            return numbers * METRES_PER[unit]
        column = pd.Series([f"{number:.6f}" if np.isfinite(number) else None for number in numbers])
    chainage_of = _metres(unit) if kilometrage is None else _chainage(unit, kilometrage)
    chainage = np.full(len(column), np.nan)
    for i, cell in enumerate(column):
        if pd.isna(cell) or not str(cell).strip():
            continue
        try:
            chainage[i] = chainage_of(str(cell))
        except ValueError as error:
            where = f"{table.name}: column {name!r}, row {table.first_row + i}"
            raise BadInputError(f"{where}: {printable(str(error))}") from error
    return chainage


def _metres(unit: Bare) -> Callable[[str], float]:
    def chainage_of(text: str) -> float:
        metres = metres_of(text, unit)
        if metres is None:
            raise ValueError(f"{text[:40]!r} is no place; expected one such as 12+345, km 12.345 or 12345")
        return metres

    return chainage_of


def _chainage(unit: Bare, kilometrage: Kilometrage) -> Callable[[str], float]:
    in_metres = _metres(unit)
    return lambda text: in_metres(text) if is_metres(text, unit) else kilometrage.read(text)

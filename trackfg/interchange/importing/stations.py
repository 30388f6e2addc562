"""Places along a line, in one column or in two, become chainages.

Of two columns the first has the kilometre or the milepost, and the second the length from there: metres, or feet, yards
or chains.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from trackfg.errors import BadInputError, printable
from trackfg.interchange.importing.source_table import SourceTable
from trackfg.numerics.arrays import Array
from trackfg.numerics.chainage.km_notation import LENGTHS, METRES_FROM_POST, METRES_PER, Bare, is_metres, metres_of

if TYPE_CHECKING:
    from trackfg.numerics.chainage.kilometrage import Kilometrage

PlaceColumns = str | tuple[str, str]
"""The column of the place, or those of the kilometre or milepost and of the length from there."""

_POSTS: dict[Bare, re.Pattern[str]] = {
    "km": re.compile(r"^(km|kilomet(er|re)s?|公里|里程)$", re.IGNORECASE),
    "mi": re.compile(r"^(mp|mile[\s_.-]?posts?|miles?|mi)([\s_.-]?(no|nr|number))?\.?$", re.IGNORECASE),
}
"""Names of columns with the number of a post."""
_BARE: dict[Bare, re.Pattern[str]] = {
    "km": re.compile(r"\bkm\b|^[pk][kp]$|kilomet"),
    "mi": re.compile(r"mile.?post|\bmi(les?)?\b|^mp$"),
    "ft": re.compile(r"\b(ft|feet|foot)\b"),
}
"""Units of bare numbers, by how a column states them."""
_FROM_POST = {
    "km": {"m": re.compile(r"^(m|met(er|re)s?|米)$", re.IGNORECASE)},
    "mi": {
        unit: re.compile(rf"(^|[\s_.-])({words})$", re.IGNORECASE)
        for unit, words in {"ft": "ft|feet|foot", "yd": "yds?|yards?", "ch": "ch|chains?"}.items()
    },
}
"""Units of the length from a post, by the unit of its column or else by its name."""


def place_columns(table: SourceTable) -> tuple[tuple[str, str], Bare] | None:
    """Return the columns of whole posts and of lengths from them, and the unit of the posts; None without such two."""
    for unit, pattern in _POSTS.items():
        post = next((name for name in table.columns if pattern.match(name.strip()) and _whole(table, name)), None)
        rest = next((name for name in table.columns if name != post and _unit_from_post(table, name, unit)), None)
        if post is not None and rest is not None:
            return (post, rest), unit
    return None


def quoted(place: PlaceColumns) -> str:
    """Return the columns of a place as messages name them."""
    return repr(place) if isinstance(place, str) else " and ".join(map(repr, place))


def bare_unit(table: SourceTable, name: str) -> Bare:
    """Return the unit of a place's bare numbers, by the column's unit or its name; metres where neither says."""
    stated = table.units.get(name, "").casefold() or name.casefold().replace("_", " ")
    return next((unit for unit, pattern in _BARE.items() if pattern.search(stated)), "m")


def read_stations(table: SourceTable, name: PlaceColumns, unit: Bare, kilometrage: Kilometrage | None = None) -> Array:
    """Return the chainage (n,), m, of a column of numbers in ``unit``, or of written places; NaN where it is empty.

    Kilometres are official places, metres are chainages; both are the same without a ``kilometrage``. Of two columns
    ``unit`` is that of the first, miles or else kilometres. Raises :class:`BadInputError` with the first row that means
    no place, or none of the line.
    """
    if not isinstance(name, str):
        return _from_posts(table, name, unit, kilometrage)
    column = table.column(name)
    if not pd.api.types.is_string_dtype(column):
        numbers = table.numbers(name)
        if kilometrage is None or unit in LENGTHS:
            return numbers * METRES_PER[unit]
        column = pd.Series([f"{number:.6f}" if np.isfinite(number) else None for number in numbers])
    return _written(table, name, column, unit, kilometrage)


def _from_posts(table: SourceTable, names: tuple[str, str], unit: Bare, kilometrage: Kilometrage | None) -> Array:
    post, rest = (table.numbers(name) for name in names)
    of_post: Bare = "mi" if unit == "mi" else "km"
    of_rest = _unit_from_post(table, names[1], of_post) or {"km": "m", "mi": "ft"}[of_post]
    if kilometrage is None:
        return METRES_PER[of_post] * post + METRES_FROM_POST[of_rest] * rest
    known = np.isfinite(post) & np.isfinite(rest)
    joint = "+" if of_post == "km" else " mi "
    text = [f"{a:g}{joint}{b:.6f} {of_rest}" if k else None for a, b, k in zip(post, rest, known, strict=True)]
    return _written(table, names, pd.Series(text), unit, kilometrage)


def _unit_from_post(table: SourceTable, name: str, of_post: str) -> str | None:
    stated = table.units.get(name) or name.strip()
    return next((unit for unit, pattern in _FROM_POST[of_post].items() if pattern.search(stated)), None)


def _whole(table: SourceTable, name: str) -> bool:
    column = table.column(name)
    return pd.api.types.is_numeric_dtype(column) and bool((column.dropna() % 1 == 0).all())


def _written(
    table: SourceTable, place: PlaceColumns, column: pd.Series, unit: Bare, kilometrage: Kilometrage | None
) -> Array:
    """Return the chainage (n,), m, of written places."""
    chainage = np.full(len(column), np.nan)
    for i, cell in enumerate(column):
        if pd.isna(cell) or not str(cell).strip():
            continue
        try:
            chainage[i] = _chainage(str(cell), unit, kilometrage)
        except ValueError as error:
            where = f"{table.name}: column {quoted(place)}, row {table.first_row + i}"
            raise BadInputError(f"{where}: {printable(str(error))}") from error
    return chainage


def _chainage(text: str, unit: Bare, kilometrage: Kilometrage | None) -> float:
    if kilometrage is not None and not is_metres(text, unit):
        return kilometrage.read(text)
    metres = metres_of(text, unit)
    if metres is None:
        raise ValueError(f"{text[:40]!r} is no place; expected one such as 12+345, km 12.345 or 12345")
    return metres

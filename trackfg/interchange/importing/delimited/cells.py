"""What a cell of delimited text holds: a value, or nothing."""

from __future__ import annotations

import csv
import re
from functools import lru_cache

from trackfg.interchange.importing.columns.written_units import number_and_unit
from trackfg.numerics.chainage.km_notation import metres_of

BLANKS = "blanks"
"""The delimiter of columns that are aligned by any number of blanks."""

EMPTY_CELLS = (
    *("", "-", "--", "---", "----", "*", "**", "***", "?", ".", "NaN", "nan", "NAN", "NA", "N/A", "n/a", "#N/A", "#NV"),
    *(
        "#DIV/0!",
        "#VALUE!",
        "#REF!",
        "#NUM!",
        "#NAME?",
        "#NULL!",
        "#WERT!",
        "#BEZUG!",
        "#ZAHL!",
        "#VALEUR!",
        "#NOMBRE!",
    ),
    *("null", "NULL", "Null", "None", "none", "nil", "\\N", "missing", "inf", "-inf", "Inf", "-Inf", "INF", "-INF"),
    *(
        f"{sign}1.#{name}{zeros}"
        for sign in ("", "-")
        for name in ("QNAN", "IND", "INF", "SNAN")
        for zeros in ("", "0", "00")
    ),
)
"""What a cell without a value holds, also as spreadsheets show a formula without one, and as C libraries of Windows
print it (``-1.#IND``)."""

_EMPTY = frozenset(cell.casefold() for cell in EMPTY_CELLS)

NUMBER = re.compile(
    r"[+\-\u2212]?(\d+([.,]\d*)?|[.,]\d+|\d{1,3}([.,'\u2019\u00a0\u202f ])\d{3}(\3\d{3})*([.,]\d*)?)([eEdD][+-]?\d+)?$"
)
"""Its digits may be in groups of three, and its sign that of typesetters, as Swedish and other locales write it."""

_TEMPORAL = re.compile(r"(-?\d+ days?,? \+?)?\d{1,4}[-./:]\d{1,2}([-./:T ]\d{1,4}[^,;|\t]*(,\d+[^,;|\t]*)?)?$")
"""A date, a time of day, both, or a number of days and a time.

It has at most one comma, before decimals; other signs and words begin a new cell.
"""

_LISTED = re.compile(r"[\[(][\s\d.,;eE+-]+[\])]$")
"""Numbers in brackets, as lists are written."""


_BLANK_BEFORE_NOON = re.compile(r"(\d:\d\d(?:[.,]\d+)?) (?=[AaPp][Mm]\b)")
"""The blank within a time of day with AM or PM."""


def without_blank_before_noon(text: str) -> str:
    """Return text whose times of day have no blank before AM and PM: they are one cell where blanks part cells."""
    return _BLANK_BEFORE_NOON.sub(r"\1", text)


def cells(line: str, delimiter: str) -> list[str]:
    """Return the cells of a line, without the blanks around them."""
    if delimiter == BLANKS:
        return without_blank_before_noon(line).split()
    return [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter), [])]


@lru_cache(maxsize=1 << 16)
def is_value(cell: str) -> bool:
    """Return whether a cell is a number, a time or a place as a whole, or holds nothing."""
    cell = cell.strip('"')
    if cell.casefold() in _EMPTY or any(pattern.match(cell) for pattern in (NUMBER, _TEMPORAL, _LISTED)):
        return True
    return metres_of(cell) is not None or number_and_unit(cell) is not None

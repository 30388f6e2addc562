"""Cells of text that are all of one pattern are taken apart."""

from __future__ import annotations

import pandas as pd

_FIRST_CELLS = 20
"""Cells that are looked at before a whole column is."""


def parts_of_cells(column: pd.Series, pattern: str, blank: str | None = None) -> pd.DataFrame | None:
    """Return the named groups of a ``pattern`` with a group ``x`` in the cells of a column of text, a column each.

    None where a cell is not of the pattern, but for empty ones and, behind the first ones, those that contain
    ``blank``.
    """
    cells = column.str.strip()
    first = cells.dropna().iloc[:_FIRST_CELLS]
    if not len(first) or not first.str.match(pattern).all():
        return None
    parts = cells.str.extract(pattern)
    unread = parts["x"].isna() & cells.notna()
    if blank is not None:
        unread &= ~cells.str.contains(blank, na=True)
    return None if unread.any() else parts

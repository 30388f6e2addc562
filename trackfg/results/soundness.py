"""Tables of a result hold numbers that can be computed with; anything else is refused on reading and on writing."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd

_GREATEST = 1e12
"""Greatest magnitude of a value or a sigma, in the columns' units: its square, and sums of squares, stay finite."""
LEAST_SIGMA = 1e-15
"""Least sigma, in the columns' units: no quantity is known as well, and its weight stays finite."""


def refuse_unsound(
    what: str, table: pd.DataFrame, ascending: str | None, complete: bool, *, sigmas: bool = True
) -> None:
    """Raise ``ValueError``, naming table, column and row, unless the numbers of a table are sound.

    All are at most :data:`_GREATEST` in magnitude, sigmas at least :data:`LEAST_SIGMA`; column ``ascending`` rises from
    row to row. Where the table is ``complete`` every number is there; else a value may be NaN where it is not known,
    and its sigma with it. Without ``sigmas`` these may be NaN beside a value, too.
    """
    for name in table.columns:
        column = table[name]
        if column.dtype.kind not in "fiu":
            raise ValueError(f"{what}: column {name!r} is {column.dtype}: expected numbers")
        values = column.to_numpy(dtype=np.float64)
        missing = np.isnan(values)
        if complete or name == ascending:
            _refuse(what, name, values, missing, "a number")
        _refuse(what, name, values, ~missing & ~(np.abs(values) <= _GREATEST), f"at most {_GREATEST:g}")
        if name.endswith("_sd"):
            _refuse(what, name, values, ~missing & ~(values > 0.0), "a sigma above 0")
            _refuse(what, name, values, values < LEAST_SIGMA, f"a sigma of {LEAST_SIGMA:g} or more")
            value_missing = table[name.removesuffix("_sd")].isna().to_numpy()
            if sigmas:
                _refuse(what, name, values, missing & ~value_missing, "a sigma beside every value")
        if name == ascending:
            _refuse(what, name, values, np.diff(values, prepend=-np.inf) <= 0.0, "more than in the row before")


def refuse_other_than_numbers(what: str, table: pd.DataFrame, columns: Sequence[str], texts: Sequence[str]) -> None:
    """Raise ``ValueError``, naming table and column, unless a table has these columns and no others than ``texts`` hold
    anything but finite numbers, or none.
    """
    if missing := [name for name in columns if name not in table]:
        raise ValueError(f"{what}: has no column {missing[0]!r}")
    for name in table.columns.difference(list(texts)):
        if len(table) and table[name].dtype.kind not in "fiu":
            raise ValueError(f"{what}: column {name!r} is {table[name].dtype}: expected numbers")
        if len(table) and np.isinf(table[name]).any():
            raise ValueError(f"{what}: column {name!r} holds an infinite number")


def refuse_empty(what: str, table: pd.DataFrame, column: str) -> None:
    """Raise ``ValueError``, naming table and column, unless a column has a number in each row."""
    if table[column].isna().any():
        raise ValueError(f"{what}: column {column!r} is empty in some rows; expected a number in each")


def _refuse(what: str, name: str, values: np.ndarray, wrong: np.ndarray, expected: str) -> None:
    if wrong.any():
        row = int(np.argmax(wrong))
        raise ValueError(f"{what}: column {name!r}, row {row + 1}: is {values[row]:g}: expected {expected}")

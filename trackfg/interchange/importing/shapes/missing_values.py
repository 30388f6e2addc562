"""Numbers that stand for a value that is not there, such as -9999, become empty cells."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd

from trackfg.interchange.importing.source_table import SourceTable
from trackfg.numerics.arrays import Array

_STAND_INS = (
    *(
        sign * value
        for value in (999.0, 9999.0, 99999.0, 999999.0, 32768.0, 2147483648.0, 1e30)
        for sign in (-1.0, 1.0)
    ),
    -999.25,
    float(np.finfo(np.float32).max),
    -float(np.finfo(np.float32).max),
    2147483647.0,
)
"""What loggers write for a value that they do not have: nines, the ends of integers and floats, and LAS's -999.25."""
_BEYOND = 5.0
"""Such a number is that many times as large as all others, or the only negative one."""
_LEAST = 2
"""A value occurs once; what stands for a missing one repeats."""


def without_stand_ins(table: SourceTable) -> SourceTable:
    """Return a table whose columns of numbers have NaN where a number stands for none, with a note on them."""
    changed: dict[str, Array] = {}
    stood: dict[str, list[str]] = {}
    for name in table.columns:
        column = table.frame[name]
        if not pd.api.types.is_numeric_dtype(column) or pd.api.types.is_bool_dtype(column) or len(column) < _LEAST:
            continue
        for value in _stand_ins(column):
            values = changed.get(name, column.to_numpy(dtype=np.float64, na_value=np.nan))
            changed[name] = np.where(values == value, np.nan, values)
            stood.setdefault(f"{value:g}", []).append(name)
    if not changed:
        return table
    notes = [
        f"{table.name}: cells of {value} are taken as empty ({', '.join(names)})" for value, names in stood.items()
    ]
    return replace(table, frame=table.frame.assign(**changed), notes=(*table.notes, *notes))


def _stand_ins(column: pd.Series) -> list[float]:
    """Return the numbers of a column that stand for none: an end of its range that is far from all others."""
    low, high = float(column.min()), float(column.max())
    if low not in _STAND_INS and high not in _STAND_INS:
        return []
    values = column.to_numpy(dtype=np.float64, na_value=np.nan)
    extremes = []
    for end in (low, high):
        others = values[np.isfinite(values) & (values != end)]
        if end not in _STAND_INS or not others.size or (values == end).sum() < _LEAST:
            continue
        alone = end < 0.0 <= float(others.min()) and end == np.floor(end)
        if alone or abs(end) > _BEYOND * float(np.abs(others).max()):
            extremes.append(end)
    return extremes

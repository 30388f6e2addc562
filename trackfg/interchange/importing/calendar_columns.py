"""A date that a table has in parts, a column each for year, month, day, hour, minute and second, becomes one column."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pandas as pd

from trackfg.interchange.importing.source_table import SourceTable

COMPOSED = "date_and_time_ns"
"""The column that is added: ns since 1970."""

_PARTS = ("year", "month", "day", "hour", "minute", "second")
_FRACTIONS = {"nano": 1, "nanosecond": 1, "microsecond": 1_000, "millisecond": 1_000_000}
"""Columns of what is beyond the whole seconds, ns."""


def with_whole_dates(table: SourceTable) -> SourceTable:
    """Return a table with the column :data:`COMPOSED` where it has all parts of a date, else the table as it is."""
    parts = [_column(table, part) for part in _PARTS]
    if any(part is None for part in parts):
        return table
    numbers = {part: table.frame[name] for part, name in zip(_PARTS, parts, strict=True)}
    if not all(pd.api.types.is_numeric_dtype(column) and column.notna().all() for column in numbers.values()):
        return table
    whole = {part: np.floor(column).astype(np.int64) for part, column in numbers.items()}
    dates = pd.to_datetime(pd.DataFrame(whole), errors="coerce")
    if dates.isna().any():
        return table
    ns = dates.astype("datetime64[ns]").astype(np.int64).to_numpy()
    ns = ns + np.round((numbers["second"] - whole["second"]).to_numpy(dtype=np.float64) * 1e9).astype(np.int64)
    for fraction, factor in _FRACTIONS.items():
        name = _column(table, fraction)
        if name is not None and pd.api.types.is_integer_dtype(table.frame[name]):
            ns = ns + table.frame[name].to_numpy(dtype=np.int64) * factor
            break
    return replace(table, frame=table.frame.assign(**{COMPOSED: ns}), units={**table.units, COMPOSED: "ns"})


def _column(table: SourceTable, part: str) -> str | None:
    pattern = re.compile(rf"(^|[\s_.]){part}s?$", re.IGNORECASE)
    return next((name for name in table.columns if pattern.search(name.strip())), None)

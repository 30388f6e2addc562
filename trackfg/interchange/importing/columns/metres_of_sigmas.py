"""Sigmas of positions in another unit of length, ``HAccuracy [0.01 m]``, ``hAcc (mm)``, become metres."""

from __future__ import annotations

from dataclasses import replace

import pandas as pd

from trackfg.interchange.importing.columns.column_meaning import kind_in
from trackfg.interchange.importing.columns.column_names import parts_of
from trackfg.interchange.importing.columns.written_units import factor_of
from trackfg.interchange.importing.source_table import SourceTable

_SIGMAS = ("sd_horizontal", "sd_vertical")


def with_sigmas_in_metres(table: SourceTable) -> SourceTable:
    """Return a table whose horizontal and vertical accuracies are in m where another unit of length is stated."""
    columns, units = dict[str, pd.Series](), dict(table.units)
    for name in table.columns:
        if kind_in(table, name) not in _SIGMAS or not pd.api.types.is_numeric_dtype(table.frame[name]):
            continue
        factor = factor_of(table.units.get(name) or parts_of(name).unit, "length")
        if factor not in (None, 1.0):
            columns[name], units[name] = table.frame[name] * factor, "m"
    return replace(table, frame=table.frame.assign(**columns), units=units) if columns else table

"""Vectors that stand in one cell, ``[0.1, 0.2, 9.8]`` as Python and NumPy write lists, become columns x, y and z."""

from __future__ import annotations

from dataclasses import replace

import pandas as pd

from trackfg.interchange.importing.shapes.cell_patterns import parts_of_cells
from trackfg.interchange.importing.source_table import SourceTable

_N = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"
_VECTOR = rf"^[\[(]\s*(?P<x>{_N})[,;\s]\s*(?P<y>{_N})[,;\s]\s*(?P<z>{_N})\s*[\])]$"


def with_vectors(table: SourceTable) -> SourceTable:
    """Return a table with three columns in place of each whose cells are all vectors of three numbers."""
    columns, units = dict[str, pd.Series](), dict[str, str]()
    for name in table.columns:
        parts = _parts(table.frame[name])
        names = [name] if parts is None else [f"{name} {axis}" for axis in parts.columns]
        columns |= dict(
            zip(names, [table.frame[name]] if parts is None else [p for _, p in parts.items()], strict=True)
        )
        if name in table.units:
            units |= dict.fromkeys(names, table.units[name])
    return table if len(columns) == len(table.columns) else replace(table, frame=pd.DataFrame(columns), units=units)


def _parts(column: pd.Series) -> pd.DataFrame | None:
    """Return the parts (n, 3) of vectors in text; None where a cell is none."""
    if not pd.api.types.is_string_dtype(column):
        return None
    parts = parts_of_cells(column, _VECTOR)
    if parts is None:
        return None
    return pd.DataFrame({axis: pd.to_numeric(part).astype("float64") for axis, part in parts.items()})

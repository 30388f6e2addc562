"""Positions in the Earth-centred, Earth-fixed frame (ECEF) become latitude, longitude and height.

Nothing else that a vehicle logs is as large as its distance from the centre of the Earth, so that the values show it,
and whether they are in metres, centimetres or millimetres.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd

from trackfg.interchange.importing.columns.column_names import axis_and_rest, complete_vectors
from trackfg.interchange.importing.columns.plan_columns import plan_columns
from trackfg.interchange.importing.source_table import SourceTable
from trackfg.numerics import geodesy
from trackfg.numerics.arrays import Array

_FROM_CENTRE_M = (6_356_000.0, 6_387_500.0)
"""From the poles, 6356.8 km from the centre, to the highest place near the equator, 6384.4 km (WGS 84)."""
_PER_METRE = (1.0, 100.0, 1000.0)
_SOME_ROWS = 1000
"""Rows by which most vectors are known to be no positions, without taking all rows of a large table."""
_GEODETIC = {"latitude": "deg", "longitude": "deg", "height": "m"}
"""The columns that they become, and their units."""


def with_geodetic(table: SourceTable) -> SourceTable:
    """Return a table with latitude, longitude and height in place of a position from the centre of the Earth.

    Rows of zeros, as receivers write them without a position, have none. A table that has positions in plan, or none
    from the centre of the Earth, stays as it is.
    """
    if plan_columns(table) is not None or set(_GEODETIC) & set(table.columns):
        return table
    for names in _vectors(table):
        some = _stacked(table, names, slice(None, None, max(1, len(table.frame) // _SOME_ROWS)))
        if _has_length(some) and _in_metres(some) is None:
            continue
        if (ecef := _in_metres(_stacked(table, names, slice(None)))) is None:
            continue
        place = np.full_like(ecef, np.nan)
        known = np.isfinite(ecef).all(axis=1)
        place[known] = geodesy.ecef_to_geodetic(ecef[known])
        columns = dict(zip(_GEODETIC, place.T, strict=True))
        frame = table.frame.drop(columns=list(names)).assign(**columns)
        units = {name: unit for name, unit in table.units.items() if name not in names}
        return replace(table, frame=frame, units={**units, **_GEODETIC})
    return table


def _stacked(table: SourceTable, names: tuple[str, str, str], rows: slice) -> Array:
    """Return some rows of three columns, shape (n, 3)."""
    return np.stack([table.numbers(name)[rows] for name in names], axis=1)


def _has_length(values: Array) -> bool:
    """Return whether one of the vectors (n, 3) is neither zero nor unknown."""
    return bool((np.isfinite(values).all(axis=1) & (values != 0.0).any(axis=1)).any())


def _vectors(table: SourceTable) -> list[tuple[str, str, str]]:
    """Return the columns x, y, z of numbers that have equal names but for the axis."""
    groups: dict[str, dict[str, str]] = {}
    for name in table.columns:
        axis, rest = axis_and_rest(name)
        if axis is not None and pd.api.types.is_numeric_dtype(table.frame[name]):
            groups.setdefault(rest, {})[axis] = name
    return complete_vectors(groups)


def _in_metres(values: Array) -> Array | None:
    """Return vectors (n, 3) in metres, NaN where they are zero; None where they are no positions on the Earth."""
    values = np.where((values == 0.0).all(axis=1, keepdims=True), np.nan, values)
    with np.errstate(over="ignore", invalid="ignore"):  # damaged values may be of any size
        length = np.linalg.norm(values, axis=1)
    length = length[np.isfinite(length)]
    for per_metre in _PER_METRE if length.size else ():
        low, high = (bound * per_metre for bound in _FROM_CENTRE_M)
        if low < length.min() and length.max() < high:
            return np.asarray(values / per_metre)
    return None

"""Positions that stand in one cell, ``POINT(7.4 46.9)`` or ``46.9, 7.4``, become columns.

Well-known text (OGC 06-103r4, with the SRID of PostGIS before it) has the longitude first. Where both numbers stand
alone the name says their order (``latlon``), or else the latitude is first, as people write it, with a note.
"""

from __future__ import annotations

import re
from dataclasses import replace

import pandas as pd

from trackfg.interchange.importing.columns.plan_columns import plan_columns
from trackfg.interchange.importing.shapes.cell_patterns import parts_of_cells
from trackfg.interchange.importing.source_table import SourceTable

_N = r"[+-]?\d+(?:\.\d*)?(?:[eE][+-]?\d+)?"
_POINT = (
    rf"^(?i:(?:SRID=(?P<srid>\d+);)?\s*POINT\s*(?P<kind>ZM|Z|M)?)\s*"
    rf"\(\s*(?P<x>{_N})\s+(?P<y>{_N})(?:\s+(?P<z>{_N}))?(?:\s+{_N})?\s*\)$"
)
_PAIR = rf"^[(\[]?\s*(?P<x>{_N})\s*[,;\s]\s*(?P<y>{_N})\s*[)\]]?$"
_LATITUDE_FIRST = re.compile(r"lat\w*\W*l(o?ng?|ng)", re.IGNORECASE)
_LONGITUDE_FIRST = re.compile(r"l(o?ng?|ng)\w*\W*lat", re.IGNORECASE)
_PLACE = re.compile(r"^(gps|gnss|geo)?[\s_.]?(location|position|coord(inate)?s?|point|pos|gps)$", re.IGNORECASE)
_WGS_84 = "4326"
_LATITUDES, _LONGITUDES = (-90.0, 90.0), (-180.0, 180.0)


def with_points(table: SourceTable) -> SourceTable:
    """Return a table whose points in text are columns; one without any, or with positions, stays as it is."""
    if plan_columns(table) is not None:
        return table
    for name in table.columns:
        if pd.api.types.is_string_dtype(table.frame[name]) and (columns := _columns(name, table.frame[name])):
            named, note = columns
            named = {other: values for other, values in named.items() if other not in table.columns}
            notes = (*table.notes, f"{table.name}: {name}: {note}") if note else table.notes
            return replace(table, frame=table.frame.drop(columns=name).assign(**named), notes=notes)
    return table


def _columns(name: str, column: pd.Series) -> tuple[dict[str, pd.Series], str] | None:
    """Return the columns of points in a column of text, and a note on what was assumed; None where it holds none."""
    points = parts_of_cells(column, _POINT, blank="EMPTY")
    parts = parts_of_cells(column, _PAIR, blank="EMPTY") if points is None else points
    if parts is None:
        return None
    numbers = {part: pd.to_numeric(parts[part]).astype("float64") for part in ("x", "y", "z") if part in parts}
    x, y = numbers["x"], numbers["y"]
    if points is None:
        return _of_pair(name, x, y)
    z = numbers["z"] if numbers["z"].notna().any() and "M" not in set(parts["kind"].dropna()) else None
    named = named_point(x, y, z, set(parts["srid"].dropna()))
    return None if named is None else (named, "")


def named_point(x: pd.Series, y: pd.Series, z: pd.Series | None, srids: set[str]) -> dict[str, pd.Series] | None:
    """Return the columns of points (n,) by their names; None where they are not of the system that they state.

    ``srids`` are codes of EPSG: of several, or of none where the points are no longitudes and latitudes, none is known.
    """
    height = {} if z is None else {"height": z}
    known = x.notna() & y.notna()
    if srids <= {_WGS_84} and x[known].between(*_LONGITUDES).all() and y[known].between(*_LATITUDES).all():
        return {"longitude": x, "latitude": y, **height}
    if srids == {_WGS_84}:
        return None  # no longitude is as large: the order is another one
    system = f" EPSG:{next(iter(srids))}" if len(srids) == 1 else ""
    return {f"easting{system}": x, f"northing{system}": y, **height}


def _of_pair(name: str, first: pd.Series, second: pd.Series) -> tuple[dict[str, pd.Series], str] | None:
    named = bool(_LATITUDE_FIRST.search(name)), bool(_LONGITUDE_FIRST.search(name))
    if not any(named) and not _PLACE.match(name.strip()):
        return None
    is_latitude_first = named[0] or not named[1]
    latitude, longitude = (first, second) if is_latitude_first else (second, first)
    known = latitude.notna()
    if not latitude[known].between(*_LATITUDES).all() or not longitude[known].between(*_LONGITUDES).all():
        return None
    note = "" if any(named) else "the first number is taken for the latitude, the second one for the longitude"
    return {"latitude": latitude, "longitude": longitude}, note

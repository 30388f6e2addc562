"""Points in well-known binary, as GeoParquet, GeoPandas and PostGIS hold them, become columns.

A point is a byte that says the order of bytes, the type, in PostGIS perhaps the SRID, and two to four numbers, the
longitude first (OGC 06-103r4, section 8.2, and PostGIS for the flags of its types). GeoParquet states the reference
system apart; where it states none it is longitude and latitude (GeoParquet 1.1.0).
"""

from __future__ import annotations

import json
import struct
from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd

from trackfg.interchange.importing.shapes.written_points import named_point

_POINT, _PER_DIMENSION = 1, 1000
"""The type of a point; ISO adds 1000 for a height, 2000 for a measure, 3000 for both."""
_Z, _M, _SRID = 0x80000000, 0x40000000, 0x20000000
"""Flags of PostGIS in the type."""
_NUMBER_BYTES = 8


def points_of(cells: Sequence[bytes | None], srids: set[str]) -> dict[str, pd.Series] | None:
    """Return the columns of points, with ``srids`` as codes of EPSG unless they state their own; None of other bytes.

    Rows without a point are NaN.
    """
    filled = [cell for cell in cells if cell is not None]
    first = filled[0] if filled else b""
    if len(first) < 5 or first[0] not in (0, 1):
        return None
    order = "<" if first[0] else ">"
    (kind,) = struct.unpack_from(f"{order}I", first, 1)
    begin = 9 if kind & _SRID else 5
    plain = kind & ~(_Z | _M | _SRID)
    has_height = bool(kind & _Z) or plain // _PER_DIMENSION in (1, 3)
    size, rest = divmod(len(first) - begin, _NUMBER_BYTES)
    alike = all(len(cell) == len(first) and cell[:begin] == first[:begin] for cell in filled)
    if plain % _PER_DIMENSION != _POINT or rest or not 2 <= size <= 4 or not alike:
        return None
    numbers = np.frombuffer(b"".join(cell[begin:] for cell in filled), dtype=f"{order}f8").reshape(-1, size)
    places = np.full((len(cells), size), np.nan)
    places[[cell is not None for cell in cells]] = numbers
    if kind & _SRID:
        srids = {str(struct.unpack_from(f"{order}I", first, 5)[0])}
    x, y, *more = (pd.Series(part) for part in places.T)
    return named_point(x, y, more[0] if has_height and more else None, srids)


def systems_of(metadata: Mapping[bytes, bytes] | None) -> dict[str, set[str]]:
    """Return the codes of EPSG that the metadata of GeoParquet state, by column; an empty set where they state none."""
    try:
        columns = json.loads((metadata or {}).get(b"geo", b"{}")).get("columns", {})
        codes = {name: (column.get("crs") or {}).get("id", {}) for name, column in columns.items()}
        return {name: {str(code["code"])} if code.get("authority") == "EPSG" else set() for name, code in codes.items()}
    except (ValueError, AttributeError, KeyError):
        return {}

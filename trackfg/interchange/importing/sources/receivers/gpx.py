"""Tracks of GPX 1.0 and 1.1 (topografix.com/GPX/1/1): positions with dates, and perhaps heights, dilution and speeds.

A speed is an element of GPX 1.0, or of an extension of Garmin's (TrackPointExtension v2), in m/s.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from trackfg.errors import BadInputError
from trackfg.files.xml_file import xml_root
from trackfg.interchange.importing.source_table import SourceTable

TRACK = ".gpx"
"""The suffix of these files."""
_COLUMNS = {"latitude": "lat", "longitude": "lon", "height_m": "ele", "hdop": "hdop", "speed_mps": "speed"}
"""What a column is called, and its attribute or element of a point."""


def read_gpx(path: Path) -> SourceTable:
    """Read the points of all tracks that have a time. Raises :class:`BadInputError` where there are none."""
    root = xml_root(path.read_bytes(), path, "a GPX track")
    points = [_cells(node) for node in root.iter() if _tag(node) == "trkpt"]
    frame = pd.DataFrame([cells for cells in points if "time" in cells])
    if frame.empty:
        raise BadInputError(f"{path.name}: has {len(points)} points, none with a time; expected a track with times")
    try:
        dates = pd.to_datetime(frame["time"], format="ISO8601", utc=True).dt.tz_localize(None)
        columns = {name: frame[cell].astype(np.float64) for name, cell in _COLUMNS.items() if cell in frame}
    except ValueError as error:
        raise BadInputError(f"{path.name}: {error}; expected numbers, and times as 2026-05-01T03:12:00Z") from error
    return SourceTable("gnss", pd.DataFrame({"time_ns": dates.astype("datetime64[ns]").astype(np.int64), **columns}))


def _cells(point: Any) -> dict[str, str]:
    """Return the attributes of a point, and the texts of its elements by their names."""
    texts = {_tag(node): node.text.strip() for node in point.iter() if node is not point and node.text}
    return {**texts, **dict(point.attrib)}


def _tag(node: Any) -> str:
    return str(node.tag).rpartition("}")[2]

"""The layers are the newest version as a GIS draws it: points of landmarks, and the line in pieces of a kilometre."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import pandas as pd

from trackfg.maps.feature_map import LANDMARK_COLUMNS, FeatureMap
from trackfg.maps.schema import KEY
from trackfg.maps.sql import sa
from trackfg.numerics.arrays import Array
from trackfg.numerics.geodesy import enu_to_geodetic
from trackfg.numerics.key_figures import Outlined

LAYERS = ("landmarks", "reference_line")
"""Tables that a GIS draws."""
WGS_84 = 4326
"""EPSG number of longitude and latitude of WGS 84."""
_PIECE_M = 1000.0
"""Length of a piece of the line, m."""


@dataclass(frozen=True, repr=False)
class Layer(Outlined):
    """A layer of a map: ``attributes``, one row per feature, and the ``coordinates`` of each.

    These are (3,) or (n, 4), None where the feature has no place.
    """

    name: str
    description: str
    geometry: Literal["POINT", "LINESTRING"]
    georeferenced: bool
    attributes: pd.DataFrame
    coordinates: tuple[Array | None, ...]

    @property
    def is_measured(self) -> bool:
        """True if vertices have a measure; all have a height."""
        return self.geometry == "LINESTRING"

    @property
    def extent(self) -> tuple[float, float, float, float] | None:
        """(min x, min y, max x, max y), None of a layer without any place."""
        places = [np.atleast_2d(place)[:, :2] for place in self.coordinates if place is not None]
        if not places:
            return None
        every = np.concatenate(places)
        (x0, y0), (x1, y1) = every.min(axis=0), every.max(axis=0)
        return float(x0), float(y0), float(x1), float(y1)

    def table(self, schema: str | None, geometry: sa.types.TypeEngine[bytes]) -> sa.Table:
        """Return the layer's table, its geometry in column ``geom``."""
        return sa.Table(
            self.name,
            sa.MetaData(schema=schema),
            sa.Column("fid", KEY, primary_key=True),
            sa.Column("geom", geometry),
            sa.Column("version", sa.Integer(), nullable=False),
            *(_column(str(name), values.dtype.kind) for name, values in self.attributes.items()),
            sqlite_autoincrement=True,
        )

    def rows(self, version: int, geometries: list[bytes | None]) -> list[dict[str, object]]:
        """Return the rows of the table, NaN as None."""
        attributes = self.attributes.astype(object).where(self.attributes.notna(), None)
        return [
            {"fid": fid, "geom": geom, "version": version, **{str(name): value for name, value in row.items()}}
            for fid, (geom, row) in enumerate(zip(geometries, attributes.to_dict("records"), strict=True), start=1)
        ]


def _column(name: str, kind: str) -> sa.Column[Any]:
    """Return the column of an attribute of a kind of numpy's: only numbers that are not whole may be NULL."""
    if kind == "f":
        return sa.Column(name, sa.Double())
    return sa.Column(name, sa.Integer() if kind in "iu" else sa.Text(), nullable=False)


def layers(feature_map: FeatureMap) -> tuple[Layer, Layer]:
    """Return the layers of landmarks and of the reference line."""
    marks = feature_map.landmarks
    pieces = _pieces(_vertices(feature_map))
    spans = np.array([piece[[0, -1], 3] for piece in pieces]).reshape(-1, 2)
    georeferenced = feature_map.origin is not None
    return (
        Layer(
            LAYERS[0],
            "Curve points and fixes of the newest version",
            "POINT",
            georeferenced,
            marks[list(LANDMARK_COLUMNS)],
            tuple(place if np.isfinite(place).all() else None for place in _placed(feature_map, marks)),
        ),
        Layer(
            LAYERS[1],
            "Centre line of the newest version; M is the chainage in m",
            "LINESTRING",
            georeferenced,
            pd.DataFrame(spans, columns=["from_m", "to_m"]),
            tuple(pieces),
        ),
    )


def stretches(name: str, description: str, attributes: pd.DataFrame, feature_map: FeatureMap) -> Layer:
    """Return a layer with a line per row: the stretch of the track from ``from_m`` to ``to_m``.

    A stretch of one cell is drawn as long as that is.
    """
    vertices, half = _vertices(feature_map), 0.5 * feature_map.conventions.step_m
    ends = attributes[["from_m", "to_m"]].to_numpy(dtype=np.float64)
    ends += np.where(ends[:, :1] == ends[:, 1:], [-half, half], 0.0)
    lines = tuple(_between(vertices, start, end) for start, end in ends)
    return Layer(name, description, "LINESTRING", feature_map.origin is not None, attributes, lines)


def _between(vertices: Array, start: float, end: float) -> Array | None:
    """Return the line from one chainage to another, as far as there is one; None where it is broken or there is none.

    A vertex without a position breaks it.
    """
    if not len(vertices):
        return None
    chainage = vertices[:, 3]
    inner = vertices[(chainage > start) & (chainage < end)]
    ends = np.clip([start, end], *chainage[[0, -1]])
    first, last = np.column_stack([np.interp(ends, chainage, column) for column in vertices.T])
    line = np.vstack([first, inner, last])
    return line if ends[1] > ends[0] and np.isfinite(line).all() else None


def _vertices(feature_map: FeatureMap) -> Array:
    """Return the vertices of the centre line (n, 4), the last column their chainage."""
    return np.column_stack([_placed(feature_map, feature_map.line), feature_map.line["chainage_m"]])


def _placed(feature_map: FeatureMap, table: pd.DataFrame) -> Array:
    enu = table[["east_m", "north_m", "up_m"]].to_numpy(dtype=np.float64)
    if feature_map.origin is None:
        return enu
    return enu_to_geodetic(enu, feature_map.origin)[:, [1, 0, 2]]


def _pieces(vertices: Array) -> list[Array]:
    """Return the line cut at whole kilometres, neighbours sharing a vertex, and where positions are missing."""
    placed: np.ndarray = np.all(np.isfinite(vertices), axis=1)
    stretch = np.cumsum(~placed)
    kilometre = np.floor(vertices[:, 3] / _PIECE_M)
    starts = np.flatnonzero(placed & np.r_[True, (np.diff(stretch) > 0) | ~placed[:-1] | (np.diff(kilometre) != 0)])
    ends = np.r_[starts[1:], len(vertices)] if starts.size else starts
    pieces = []
    for start, end in zip(starts, ends, strict=True):
        shared = end < len(vertices) and placed[end] and stretch[end] == stretch[start]
        piece = vertices[start : end + 1 if shared else end]
        piece = piece[placed[start : start + len(piece)]]
        if len(piece) > 1:
            pieces.append(piece)
    return pieces

"""What lies behind the path on a page's map: lines and named points of a GeoJSON file or a GeoPackage of the user.

GeoJSON is in longitude and latitude of WGS 84 (RFC 7946). A layer of a GeoPackage is in WGS 84 too, in the run's own
east and north where its reference system is undefined, or in any other that pyproj knows, where that is installed.
"""

from __future__ import annotations

import json
import os
import sqlite3
from collections.abc import Callable, Iterator, Mapping
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from trackfg.errors import BadInputError
from trackfg.numerics.arrays import Array
from trackfg.numerics.geodesy import geodetic_to_enu
from trackfg.numerics.geometry_blob import geopackage_vertices
from trackfg.results.result import Result

_NAMES = ("name", "ref", "id")
"""Properties that name a point, the first that it has."""
_WGS_84 = (4326, 4979)
"""EPSG codes of latitude and longitude, without and with height."""
_NEAR_M = 150.0
"""A named point nearer to the path is a station on the strips: half a long platform and the width of a yard, m."""

Origin = tuple[float, float, float]


@dataclass(frozen=True)
class Background:
    """Lines (n, 2) and named points in the east and north of a result, m."""

    lines: tuple[Array, ...] = ()
    points: tuple[tuple[str, float, float], ...] = ()

    def stations(self, result: Result) -> list[tuple[str, float]]:
        """Return name and chainage, m, of the points beside the path, each where the path is nearest."""
        path = result.trajectory[["east_m", "north_m"]].to_numpy()
        chainage = result.trajectory["chainage_m"].to_numpy()
        found = []
        for name, east, north in self.points if len(path) else ():
            away = np.hypot(*(path - (east, north)).T)
            nearest = int(np.argmin(away))
            if away[nearest] <= _NEAR_M:
                found.append((name, float(chainage[nearest])))
        return found


@dataclass(frozen=True)
class _Feature:
    """A name, empty for none, and vertices (n, 2) as the file has them."""

    name: str
    vertices: Array


def read_background(path: str | os.PathLike[str], origin: Origin | None) -> Background:
    """Read a background. ``origin`` is that of the result: latitude and longitude, deg, and height, m.

    Raises :class:`BadInputError` for a file that is neither GeoJSON nor a GeoPackage, for a reference system that is
    not known here, and for one on the Earth where the result has no origin.
    """
    path = Path(path)
    if path.suffix.lower() == ".gpkg":
        return _background(_of_geopackage(path, origin))
    if path.suffix.lower() in (".geojson", ".json"):
        return _background(_of_geojson(path, origin))
    raise BadInputError(f"{path}: expected a background that ends in .geojson, .json or .gpkg")


def _background(features: Iterator[_Feature]) -> Background:
    lines, points = [], []
    for feature in features:
        if len(feature.vertices) > 1:
            lines.append(feature.vertices)
        elif feature.name:
            east, north = feature.vertices[0].tolist()
            points.append((feature.name, east, north))
    return Background(tuple(lines), tuple(points))


def _of_geojson(path: Path, origin: Origin | None) -> Iterator[_Feature]:
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise BadInputError(f"{path}: not readable as GeoJSON: {error}") from error
    features = content.get("features") if isinstance(content, dict) else None
    if not isinstance(features, list):
        raise BadInputError(f"{path}: has no features; expected a FeatureCollection of GeoJSON")
    crs = (
        str(content.get("crs", {}).get("properties", {}).get("name", ""))
        if isinstance(content.get("crs"), dict)
        else ""
    )
    if crs and not crs.endswith(("CRS84", "4326")):
        raise BadInputError(f"{path}: is in {crs}; expected longitude and latitude of WGS 84, as RFC 7946 has it")
    to_plane = _from_wgs_84(path, origin)
    for number, feature in enumerate(features, start=1):
        try:
            name = _name(feature.get("properties") or {})
            for vertices in _geojson_vertices(feature.get("geometry") or {}):
                yield _Feature(name, to_plane(vertices))
        except (AttributeError, KeyError, TypeError, ValueError, IndexError) as error:
            raise BadInputError(f"{path}, feature {number}: expected a geometry of GeoJSON with numbers") from error


def _geojson_vertices(geometry: Mapping[str, Any]) -> Iterator[Array]:
    """Yield longitude and latitude of each point, line and ring, (n, 2)."""
    if "geometries" in geometry:
        for part in geometry["geometries"]:
            yield from _geojson_vertices(part)
    elif "coordinates" in geometry:
        yield from _nested(geometry["coordinates"], points=geometry["type"] in ("Point", "MultiPoint"))


def _nested(coordinates: Any, *, points: bool) -> Iterator[Array]:
    if not isinstance(coordinates, list):
        raise TypeError("expected a list")
    if not coordinates:
        return
    if isinstance(coordinates[0], int | float):
        yield np.array([coordinates[:2]], dtype=np.float64)
    elif not points and isinstance(coordinates[0][0], int | float):
        yield np.array([vertex[:2] for vertex in coordinates], dtype=np.float64)
    else:
        for part in coordinates:
            yield from _nested(part, points=points)


def _of_geopackage(path: Path, origin: Origin | None) -> Iterator[_Feature]:
    try:
        with closing(sqlite3.connect(f"{path.resolve().as_uri()}?mode=ro", uri=True)) as database:
            layers = database.execute(
                "SELECT g.table_name, g.column_name, s.srs_id, s.organization_coordsys_id FROM gpkg_geometry_columns g "
                "JOIN gpkg_spatial_ref_sys s ON s.srs_id = g.srs_id"
            ).fetchall()
            for table, column, srs, epsg in layers:
                to_plane = _projection(path, table, (srs, epsg), origin)
                quoted = '"' + str(table).replace('"', '""') + '"'
                rows = database.execute(f"SELECT * FROM {quoted}")
                heads = [head[0] for head in rows.description]
                for number, row in enumerate(rows, start=1):
                    values = dict(zip(heads, row, strict=True))
                    blob = values.pop(column)
                    if blob is None:
                        continue
                    try:
                        found = [to_plane(one) for one in geopackage_vertices(blob)]
                    except ValueError as error:
                        raise BadInputError(f"{path}, layer {table!r}, row {number}: {error}") from error
                    yield from (_Feature(_name(values), vertices) for vertices in found)
    except sqlite3.Error as error:
        raise BadInputError(f"{path}: not readable as a GeoPackage: {error}") from error


def _name(properties: Mapping[str, Any]) -> str:
    lower = {str(key).lower(): value for key, value in properties.items()}
    return next((str(lower[key]) for key in _NAMES if lower.get(key) not in (None, "")), "")


def _from_wgs_84(path: Path, origin: Origin | None) -> Callable[[Array], Array]:
    if origin is None:
        raise BadInputError(
            f"{path}: is in latitude and longitude, but the result knows no place on the Earth; expected one of a run "
            "with GNSS. Hint: a GeoPackage with an undefined reference system is taken in the run's east and north"
        )

    def to_plane(vertices: Array) -> Array:
        """Return east and north of longitude and latitude, at the height of the origin."""
        geodetic = np.column_stack([vertices[:, 1], vertices[:, 0], np.full(len(vertices), origin[2])])
        return geodetic_to_enu(geodetic, np.asarray(origin))[:, :2]

    return to_plane


def _projection(path: Path, table: str, codes: tuple[int, int], origin: Origin | None) -> Callable[[Array], Array]:
    """Return what brings a layer's coordinates to east and north; ``codes`` are GeoPackage's and EPSG's numbers."""
    srs, epsg = codes
    if srs == -1:  # GeoPackage's undefined Cartesian system
        return lambda vertices: vertices
    from_wgs_84 = _from_wgs_84(path, origin)
    if epsg in _WGS_84:
        return from_wgs_84
    try:
        from pyproj import Transformer
    except ImportError as error:
        what = f"{path}, layer {table!r}: is in EPSG:{epsg}; expected WGS 84 (EPSG:4326)"
        raise BadInputError(f"{what}. Hint: pip install pyproj reads others") from error
    transformer = Transformer.from_crs(epsg, 4326, always_xy=True)
    return lambda vertices: from_wgs_84(np.column_stack(transformer.transform(vertices[:, 0], vertices[:, 1])))

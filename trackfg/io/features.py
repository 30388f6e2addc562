"""Features of GeoJSON, GeoPackages, shapefiles, KML and GPX: points, lines and areas with properties, and their
reference system.

GeoJSON is in longitude and latitude of WGS 84 (RFC 7946), unless it has a ``crs`` as its first version (2008) allowed.
A GeoPackage is SQLite; the reference system of each of its layers is in it (OGC 12-128r14). A shapefile's is in the
``.prj`` beside it.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from trackfg.errors import BadInputError, first_line, printable
from trackfg.files.libraries import library
from trackfg.files.small_file import json_of, read_small
from trackfg.io.xml_features import XML_SUFFIXES, xml_lines
from trackfg.numerics.arrays import Array
from trackfg.numerics.geometry_blob import geometry_of_wkb, geopackage_geometry

WGS_84 = "EPSG:4326"
"""Longitude and latitude, which GeoJSON has without saying so."""
LOCAL = "local"
"""East and north in the local frame of a recording: what a GeoPackage calls an undefined Cartesian system."""
SHAPEFILE = ".shp"
SUFFIXES = (".geojson", ".json", ".gpkg", SHAPEFILE, *XML_SUFFIXES)
"""Of files that :func:`read_features` reads."""

_MOST_BYTES = 2**28
"""Size of a GeoJSON file, bytes: all tracks of a country of 5000 km have 60 MB."""
_NESTING = {"Point": 0, "MultiPoint": 1, "LineString": 1, "MultiLineString": 2, "Polygon": 2, "MultiPolygon": 3}
"""Lists around a position in GeoJSON."""
_UNDEFINED = {-1: LOCAL, 0: WGS_84}
"""GeoPackage's undefined Cartesian and undefined geographic system (OGC 12-128r14, 1.1.2.1.2)."""
_SAME_AS_WGS_84 = ("4326", "4979")
"""EPSG codes of longitude and latitude of WGS 84, without and with height."""


@dataclass(frozen=True)
class Feature:
    """A feature: ``where`` it is in its file, the ``kind`` of its geometry as GeoJSON calls it, empty for none.

    ``parts`` are x and y, (n, 2), of each point, line and ring, in the reference ``system``: ``EPSG:N`` or
    :data:`LOCAL`. ``id`` is that of GeoJSON, which is apart from the properties.
    """

    where: str
    kind: str = ""
    parts: tuple[Array, ...] = ()
    system: str = WGS_84
    properties: dict[str, Any] = field(default_factory=dict)
    id: str | int | None = None


def read_features(path: Path) -> list[Feature]:
    """Return the features of a file that ends in one of :data:`SUFFIXES`, of a GeoPackage those of all its layers.

    Raises :class:`BadInputError` with file, feature and what was expected.
    """
    suffix = path.suffix.lower()
    if suffix == ".gpkg":
        return _of_geopackage(path)
    if suffix == SHAPEFILE:
        return list(_of_shapefile(path))
    if suffix in XML_SUFFIXES:
        parts = xml_lines(path)
        return [Feature(where, kind, tuple(lines), WGS_84, about) for where, kind, lines, about in parts]
    return list(_of_geojson(path))


def in_wgs_84(xy: Array, system: str, where: str, hint: str = "", each: str = "vertex") -> Array:
    """Return x and y (n, 2) of a reference system as latitude and longitude, deg.

    Raises :class:`BadInputError`, which ends in ``hint``, where they are none of that system; ``each`` is one of them.
    """
    if system == WGS_84:
        longitude, latitude = xy.T
    elif not system:
        raise BadInputError(f"{where}: the file has no .prj: expected the reference system of its coordinates{hint}")
    else:
        try:
            longitude, latitude = _to_wgs_84(system)(xy[:, 0], xy[:, 1])
        except ValueError as error:
            raise BadInputError(f"{where}: {error}") from error
    bad = ~((np.abs(longitude) <= 360.0) & (np.abs(latitude) <= 90.0))
    if bad.any():
        k = int(np.argmax(bad))
        place = f"{where}, {each} {k + 1}: ({xy[k, 0]:g}, {xy[k, 1]:g})"
        raise BadInputError(f"{place} is no place in {system}: expected longitude and latitude there{hint}")
    return np.column_stack([latitude, longitude])


_Transform = Callable[[Array, Array], tuple[Array, Array]]


@lru_cache(maxsize=16)
def _to_wgs_84(system: str) -> _Transform:
    """Return what gives longitudes and latitudes. Raises ``ValueError`` for a system that PROJ does not know."""
    pyproj = library("pyproj", "gis")
    try:
        transform: _Transform = pyproj.Transformer.from_crs(system, WGS_84, always_xy=True).transform
    except pyproj.exceptions.CRSError as error:
        raise ValueError(f"unknown reference system {printable(system)!r}: expected one such as EPSG:3067") from error
    return transform


def _of_geojson(path: Path) -> Iterator[Feature]:
    try:
        content = json_of(read_small(path, _MOST_BYTES).decode("utf-8-sig"))
    except OSError as error:
        raise BadInputError(f"{path}: cannot be read: {error.strerror}: expected a GeoJSON file") from error
    except ValueError as error:
        raise BadInputError(f"{path}: not readable as GeoJSON: {first_line(error)}: expected JSON in UTF-8") from error
    content = content if isinstance(content, dict) else {}
    features = content.get("features")
    if content.get("type") == "Feature":
        features = [content]
    elif "coordinates" in content:
        features = [{"geometry": content}]
    if not isinstance(features, list):
        raise BadInputError(f"{path}: has no list of features: expected a FeatureCollection of GeoJSON")
    crs = content.get("crs")
    try:
        system = WGS_84 if crs is None else _system_of(str(crs["properties"]["name"]))
    except (LookupError, TypeError) as error:
        raise BadInputError(f"{path}: crs has no name: expected properties.name, such as EPSG:3067") from error
    for number, feature in enumerate(features, start=1):
        where = f"feature {number}"
        if not isinstance(feature, dict) or not isinstance(feature.get("properties") or {}, dict):
            raise BadInputError(f"{path}: {where}: is no object: expected a GeoJSON Feature")
        geometry, its_id = feature.get("geometry"), feature.get("id")
        geometry = geometry if isinstance(geometry, dict) else {}
        try:
            parts = tuple(_geojson_parts(geometry))
        except RecursionError as error:
            raise BadInputError(f"{path}: {where}: is nested too deeply: expected a geometry of GeoJSON") from error
        except ValueError as error:
            raise BadInputError(f"{path}: {where}: {error}") from error
        its_id = its_id if isinstance(its_id, str | int) else None
        yield Feature(where, str(geometry.get("type", "")), parts, system, feature.get("properties") or {}, its_id)


def _system_of(name: str) -> str:
    """Return a reference system by its short name: ``urn:ogc:def:crs:OGC:1.3:CRS84`` is WGS 84."""
    parts = [part for part in name.split(":") if part]
    if parts and (parts[-1].upper() == "CRS84" or parts[-1] in _SAME_AS_WGS_84):
        return WGS_84
    return f"EPSG:{parts[-1]}" if "EPSG" in (part.upper() for part in parts) else name


def _geojson_parts(geometry: dict[str, Any]) -> Iterator[Array]:
    """Yield x and y of each point, line and ring. Raises ``ValueError`` with what was expected."""
    if isinstance(geometry.get("geometries"), list):
        for part in geometry["geometries"]:
            yield from _geojson_parts(part if isinstance(part, dict) else {})
        return
    kind = str(geometry.get("type"))
    if kind not in _NESTING:
        return
    coordinates: Any = geometry.get("coordinates")
    lists: list[Any] = [[coordinates]] if kind == "Point" else [coordinates]
    for _ in range(_NESTING[kind] - 1):
        if not all(isinstance(part, list) for part in lists):
            raise ValueError("coordinates are no list: expected one of lines")
        lists = [part for several in lists for part in several]
    for vertices in lists:
        try:
            xy = np.array([[float(x), float(y)] for x, y, *_ in vertices], dtype=np.float64).reshape(-1, 2)
        except (TypeError, ValueError, OverflowError) as error:
            raise ValueError("a vertex is no position: expected pairs of numbers") from error
        yield from np.split(xy, len(xy)) if kind == "MultiPoint" else [xy]


def _of_geopackage(path: Path) -> list[Feature]:
    if not path.is_file():
        raise BadInputError(f"{path}: cannot be read: expected a GeoPackage")
    try:
        with closing(sqlite3.connect(f"{path.resolve().as_uri()}?mode=ro", uri=True)) as database:
            database.row_factory = sqlite3.Row
            layers = database.execute(
                "SELECT g.table_name, g.column_name, s.srs_id, s.organization_coordsys_id FROM gpkg_geometry_columns g "
                "JOIN gpkg_spatial_ref_sys s ON s.srs_id = g.srs_id"
            ).fetchall()
            features: list[Feature] = []
            for table, column, srs, epsg in layers:
                system = _UNDEFINED.get(srs, _system_of(f"EPSG:{epsg}"))
                features += _rows(path, database, str(table), str(column), system)
            for table in _tables_without_geometry(database):
                features += _rows(path, database, table)
            return features
    except sqlite3.Error as error:
        raise BadInputError(f"{path}: not readable as a GeoPackage: {first_line(error)}") from error


def _of_shapefile(path: Path) -> Iterator[Feature]:
    """Yield the features of a shapefile, whose system is empty where no ``.prj`` states it."""
    pyogrio = library("pyogrio", "gis")
    try:
        about, _, blobs, columns = pyogrio.raw.read(path)
    except (OSError, ValueError, RuntimeError) as error:  # pyogrio's own errors are RuntimeErrors
        raise BadInputError(f"{path}: not readable as a shapefile: {first_line(error)}") from error
    crs = about.get("crs") or ""
    system = _system_of(crs) if crs.upper().startswith("EPSG:") else crs
    for number, blob in enumerate(blobs, start=1):
        values = [column[number - 1] for column in columns]
        properties = {
            name: value.item() if isinstance(value, np.generic) else value
            for name, value in zip(about["fields"].tolist(), values, strict=True)
        }
        try:
            kind, parts = ("", []) if blob is None else geometry_of_wkb(blob)
        except ValueError as error:
            raise BadInputError(f"{path}: feature {number}: {error}") from error
        yield Feature(f"feature {number}", kind, tuple(part[:, :2] for part in parts), system, properties)


def _tables_without_geometry(database: sqlite3.Connection) -> list[str]:
    names = [name for (name,) in database.execute("SELECT name FROM sqlite_master WHERE type = 'table'")]
    if "gpkg_contents" not in names:
        return []
    attributes = database.execute("SELECT table_name FROM gpkg_contents WHERE data_type = 'attributes'")
    return [name for (name,) in attributes if name in names]


def _rows(
    path: Path, database: sqlite3.Connection, table: str, column: str | None = None, system: str = WGS_84
) -> Iterator[Feature]:
    """Yield the rows of a table, without the number that is the key of its rows alone."""
    quoted = '"' + table.replace('"', '""') + '"'
    keys = {about["name"] for about in database.execute(f"PRAGMA table_info({quoted})") if about["pk"]}
    for number, row in enumerate(database.execute(f"SELECT * FROM {quoted}"), start=1):
        where = f"layer {printable(table)}, row {number}"
        properties = {name: row[name] for name in row.keys() if name != column and name not in keys}  # noqa: SIM118
        if column is not None and column not in row.keys():  # noqa: SIM118
            raise BadInputError(f"{path}: {where}: has no column {printable(column)!r}: expected its geometry there")
        blob = None if column is None else row[column]
        try:
            kind, parts = ("", []) if blob is None else geopackage_geometry(blob)
        except ValueError as error:
            raise BadInputError(f"{path}: {where}: {error}") from error
        yield Feature(where, kind, tuple(parts), system, properties)

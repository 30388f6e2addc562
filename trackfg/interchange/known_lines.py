"""Centre lines and networks of tracks from GeoJSON and GeoPackage.

A track is a ``LineString`` with an id; a *netrelation* is a feature of any geometry whose properties ``netelementA``,
``positionOnA`` (0 to 1), ``netelementB``, ``positionOnB`` and ``navigability`` (``both``, ``AB``, ``BA``, ``none``) say
where a vehicle can go from one track (*netelement*) to another, as in extracts of RINF and of Infrabel's network.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from trackfg.errors import BadInputError, first_line, printable
from trackfg.files.small_file import read_small
from trackfg.interchange.libraries import library
from trackfg.numerics.arrays import Array
from trackfg.numerics.geometry_blob import lines_of_wkb
from trackfg.recording.known_line import KnownLine
from trackfg.recording.track_joints import Relation

WGS_84 = "EPSG:4326"
"""Longitude and latitude, which GeoJSON has without saying so (RFC 7946)."""
LOCAL = "local"
"""East and north in the local frame of the recording."""
SUFFIXES = (".geojson", ".json", ".gpkg")
"""Of files that :func:`read_known_line` reads."""

_MOST_BYTES = 2**28
"""Size of a GeoJSON file, bytes: all tracks of a country of 5000 km have 60 MB."""
_NAVIGABLE = {"both": (True, True), "AB": (True, False), "BA": (False, True), "none": (False, False)}
"""From A to B, and back."""
_ID_COLUMNS = ("id", "netelement_id", "track_id", "name")
"""Properties that name a track, in order of preference, in any case."""


class _Feature(NamedTuple):
    """A feature of a file: where it is in it, its id if it has one, the lines of its geometry, and its properties."""

    where: str
    id: str | None
    lines: list[Array]
    properties: dict[str, Any]


def read_known_line(path: Path | str, system: str | None = None) -> KnownLine:
    """Return the tracks of a ``.geojson`` or ``.gpkg`` file.

    ``system``: the reference system of its coordinates, as ``EPSG:3067``, or :data:`LOCAL`, instead of the file's own.
    Raises :class:`BadInputError` with file, feature and what was expected.
    """
    path = Path(path)
    match path.suffix.lower():
        case ".geojson" | ".json":
            features, own = _geojson(path)
        case ".gpkg":
            features, own = _geopackage(path)
        case _:
            raise BadInputError(f"{path}: expected one of {', '.join(SUFFIXES)}, or LandXML (.xml)")
    system = system or own
    ids, vertices, relations, netrelations = [], [], [], 0
    for number, feature in enumerate(features, start=1):
        if "netelementA" in feature.properties:
            netrelations += 1
            relations += [relation] if (relation := _relation(path, feature)) else []
        for line in feature.lines:
            ids.append(feature.id or str(number))
            vertices.append(in_wgs_84(line[:, :2], system, f"{path}: {feature.where}"))
    if not ids:
        raise BadInputError(f"{path}: has no line: expected tracks as features of the geometry LineString")
    known = set(ids)
    within = tuple(relation for relation in relations if {relation.a, relation.b} <= known)
    return KnownLine(path.name, tuple(ids), tuple(vertices), within if netrelations else None, system == LOCAL)


def known_line(name: str, tracks: Mapping[str, Array], system: str) -> KnownLine:
    """Return tracks by id as a known line; their vertices (m, 2) are east and north, m, in a reference system."""
    vertices = tuple(in_wgs_84(line, system, f"{name}: track {its_id!r}") for its_id, line in tracks.items())
    return KnownLine(name, tuple(tracks), vertices, is_local=system == LOCAL)


def in_wgs_84(xy: Array, system: str, where: str) -> Array:
    """Return east and north, or longitude and latitude (n, 2), of a reference system as latitude and longitude, deg.

    :data:`LOCAL` coordinates stay as they are. Raises :class:`BadInputError` where they are none of that system.
    """
    if not np.isfinite(xy).all():
        raise BadInputError(f"{where}: a coordinate is not finite: expected numbers")
    if system == LOCAL:
        return xy
    if system == WGS_84:
        longitude, latitude = xy.T
    else:
        pyproj = library("pyproj", "gis")
        try:
            transformer = pyproj.Transformer.from_crs(system, WGS_84, always_xy=True)
        except pyproj.exceptions.CRSError as error:
            raise BadInputError(
                f"{where}: unknown reference system {printable(system)!r}: expected one such as EPSG:3067"
            ) from error
        longitude, latitude = transformer.transform(xy[:, 0], xy[:, 1])
    bad = ~((np.abs(longitude) <= 360.0) & (np.abs(latitude) <= 90.0))
    if bad.any():
        k = int(np.argmax(bad))
        raise BadInputError(
            f"{where}, vertex {k + 1}: ({xy[k, 0]:g}, {xy[k, 1]:g}) is no place in {system}: expected longitude and "
            "latitude there. Hint: --line-crs says in which reference system the coordinates are"
        )
    return np.column_stack([latitude, longitude])


def _relation(path: Path, feature: _Feature) -> Relation | None:
    """Return the relation of a feature, None where no vehicle can go."""
    about = feature.properties
    where = f"{path}: {feature.where}"
    ends = [about.get(name) for name in ("netelementA", "netelementB")]
    if not all(isinstance(end, str | int) for end in ends):
        raise BadInputError(f"{where}: netelementA or netelementB is missing: expected the ids of two tracks")
    shares = []
    for name in ("positionOnA", "positionOnB"):
        share = about.get(name)
        if isinstance(share, bool) or not isinstance(share, int | float) or not 0.0 <= share <= 1.0:
            raise BadInputError(f"{where}: {name} is {share!r}: expected a share of the track's length, 0 to 1")
        shares.append(float(share))
    navigability = about.get("navigability", "both")
    if navigability not in _NAVIGABLE:
        raise BadInputError(f"{where}: navigability is {navigability!r}: expected one of {', '.join(_NAVIGABLE)}")
    forth, back = _NAVIGABLE[navigability]
    return Relation(str(ends[0]), shares[0], str(ends[1]), shares[1], forth, back) if forth or back else None


def _id_of(feature_id: object, properties: dict[str, Any]) -> str | None:
    by_name = {name.lower(): value for name, value in reversed(properties.items())}
    for value in (feature_id, *(by_name.get(name) for name in _ID_COLUMNS)):
        if isinstance(value, str | int) and str(value).strip():
            return printable(str(value))
    return None


def _geojson(path: Path) -> tuple[list[_Feature], str]:
    try:
        content = json.loads(read_small(path, _MOST_BYTES).decode("utf-8-sig"))
    except OSError as error:
        raise BadInputError(f"{path}: cannot be read: {error.strerror}: expected a GeoJSON file") from error
    except (ValueError, RecursionError) as error:
        raise BadInputError(f"{path}: not JSON in UTF-8: {first_line(error)}: expected a GeoJSON file") from error
    features = content.get("features") if isinstance(content, dict) else None
    if not isinstance(features, list):
        raise BadInputError(f"{path}: has no list of features: expected a GeoJSON FeatureCollection")
    crs = content.get("crs")
    try:
        system = WGS_84 if crs is None else _system_of(str(crs["properties"]["name"]))
    except (KeyError, TypeError) as error:
        raise BadInputError(f"{path}: crs has no name: expected properties.name, such as EPSG:3067") from error
    return [_feature(path, k, feature) for k, feature in enumerate(features, start=1)], system


def _system_of(name: str) -> str:
    """Return a reference system by its short name: ``urn:ogc:def:crs:OGC:1.3:CRS84`` is WGS 84."""
    parts = [part for part in name.split(":") if part]
    if parts[-1].upper() == "CRS84":
        return WGS_84
    return f"EPSG:{parts[-1]}" if "EPSG" in (part.upper() for part in parts) else name


def _feature(path: Path, number: int, feature: object) -> _Feature:
    where = f"feature {number}"
    if not isinstance(feature, dict) or not isinstance(feature.get("properties") or {}, dict):
        raise BadInputError(f"{path}: {where}: is no object: expected a GeoJSON Feature")
    properties: dict[str, Any] = feature.get("properties") or {}
    geometry = feature.get("geometry")
    its_id = _id_of(feature.get("id"), properties)
    if its_id is not None:
        where += f" ({its_id!r})"
    if not isinstance(geometry, dict):
        return _Feature(where, its_id, [], properties)
    kind, coordinates = geometry.get("type"), geometry.get("coordinates")
    parts: Iterable[Any] = {"LineString": [coordinates], "MultiLineString": coordinates}.get(str(kind)) or []
    if not isinstance(parts, list):
        raise BadInputError(f"{path}: {where}: coordinates are no list: expected one of lines")
    return _Feature(where, its_id, [_vertices(path, where, part) for part in parts], properties)


def _vertices(path: Path, where: str, coordinates: Any) -> Array:
    try:
        line = np.array([[float(x), float(y)] for x, y, *_ in coordinates], dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise BadInputError(f"{path}: {where}: a vertex is no position: expected pairs of numbers") from error
    return _line(path, where, line)


def _line(path: Path, where: str, line: Array) -> Array:
    if len(line) < 2 or not np.any(line[1:, :2] != line[0, :2]):
        raise BadInputError(f"{path}: {where}: has {len(line)} vertices at one place: expected a line of two or more")
    return line


def _geopackage(path: Path) -> tuple[list[_Feature], str]:
    """Return the features of all layers of lines, and of tables of relations. Layers share one reference system."""
    raw, errors = library("pyogrio.raw", "gis"), library("pyogrio.errors", "gis")
    if not path.is_file():
        raise BadInputError(f"{path}: cannot be read: expected a GeoPackage")
    features: list[_Feature] = []
    systems: dict[str, str] = {}
    try:
        for layer, _ in library("pyogrio", "gis").list_layers(path).tolist():
            meta, _, shapes, values = raw.read(path, layer=layer)
            columns = [str(name) for name in meta["fields"]]
            rows = list(_rows(path, layer, shapes, dict(zip(columns, values, strict=True))))
            if any(feature.lines for feature in rows) and meta["crs"]:
                systems[str(meta["crs"])] = layer
            features += [feature for feature in rows if feature.lines or "netelementA" in feature.properties]
    except errors.DataSourceError as error:
        raise BadInputError(f"{path}: not a GeoPackage: {first_line(error)}") from error
    if len(systems) > 1:
        raise BadInputError(f"{path}: layers are in {' and '.join(sorted(systems))}: expected one reference system")
    return features, next(iter(systems), WGS_84)


def _rows(path: Path, layer: str, shapes: Any, columns: dict[str, Any]) -> Iterator[_Feature]:
    count = max((len(values) for values in columns.values()), default=0 if shapes is None else len(shapes))
    for k in range(count):
        where = f"layer {printable(layer)}, row {k + 1}"
        properties = {name: _plain(values[k]) for name, values in columns.items()}
        try:
            lines = [] if shapes is None or shapes[k] is None else lines_of_wkb(bytes(shapes[k]))
        except ValueError as error:
            raise BadInputError(f"{path}: {where}: {error}: expected a line") from error
        yield _Feature(where, _id_of(None, properties), [_line(path, where, line) for line in lines], properties)


def _plain(value: Any) -> Any:
    """Return a number of numpy's as one of Python's."""
    return value.item() if isinstance(value, np.generic) else value

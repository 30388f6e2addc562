"""Centre lines and networks of tracks from files of geographic features (:mod:`trackfg.io.features`).

A track is a ``LineString`` with an id; a *netrelation* is a feature of any geometry whose properties ``netelementA``,
``positionOnA`` (0 to 1), ``netelementB``, ``positionOnB`` and ``navigability`` (``both``, ``AB``, ``BA``, ``none``) say
where a vehicle can go from one track (*netelement*) to another, as in extracts of RINF and of Infrabel's network.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from trackfg.errors import BadInputError, TrackfgError, printable
from trackfg.io.features import LOCAL, SUFFIXES, Feature, in_wgs_84, read_features
from trackfg.io.table_file import resolve_inside
from trackfg.numerics.arrays import Array
from trackfg.recording.description import KnownLineFile
from trackfg.recording.findings import Finding
from trackfg.recording.known_line import KnownLine
from trackfg.recording.track_joints import Relation

_LINES = ("LineString", "MultiLineString")
"""Geometries that are tracks."""
_NAVIGABLE = {"both": (True, True), "AB": (True, False), "BA": (False, True), "none": (False, False)}
"""From A to B, and back."""
_ID_COLUMNS = ("id", "netelement_id", "track_id", "name")
"""Properties that name a track, in order of preference, in any case."""


def read_known_line(path: Path | str, system: str | None = None) -> KnownLine:
    """Return the tracks of a file of features: GeoJSON, GeoPackage, shapefile, KML or GPX.

    ``system``: the reference system of its coordinates, as ``EPSG:3067``, or ``local``, instead of the file's own.
    Raises :class:`BadInputError` with file, feature and what was expected.
    """
    path = Path(path)
    if path.suffix.lower() not in SUFFIXES:
        hint = "Hint: trackfg smooth --line reads LandXML (.xml), too"
        raise BadInputError(f"{path}: expected one of {', '.join(SUFFIXES)}. {hint}")
    features = read_features(path)
    tracks = [(number, feature) for number, feature in enumerate(features, start=1) if feature.kind in _LINES]
    systems = sorted({feature.system for _, feature in tracks})
    if system is None and len(systems) > 1:
        raise BadInputError(f"{path}: layers are in {' and '.join(systems)}: expected one reference system")
    ids, vertices = [], []
    for number, feature in tracks:
        its_id, where = _id_of(feature), f"{path}: {_where(feature)}"
        for line in feature.parts:
            if len(line) < 2 or not np.any(line[1:] != line[0]):
                at = f"{where}: has {len(line)} vertices at one place"
                raise BadInputError(f"{at}: expected a line of two or more")
            ids.append(its_id or str(number))
            vertices.append(_placed(line, system or feature.system, where))
    netrelations = [feature for feature in features if "netelementA" in feature.properties]
    relations = [_relation(feature.properties, f"{path}: {_where(feature)}") for feature in netrelations]
    if not ids:
        raise BadInputError(f"{path}: has no line: expected tracks as features of the geometry LineString")
    within = tuple(relation for relation in relations if relation is not None and {relation.a, relation.b} <= set(ids))
    is_local = (system or systems[0]) == LOCAL
    return KnownLine(path.name, tuple(ids), tuple(vertices), within if netrelations else None, is_local)


def line_of_recording(folder: Path, part: KnownLineFile) -> tuple[KnownLine | None, list[Finding]]:
    """Return the tracks of a recording's own file; or None and why there are none. Never raises."""
    path, findings = resolve_inside(folder, part.file)
    if path is None:
        return None, findings
    try:
        line = read_known_line(path, part.crs)
        return line.only(part.path) if part.path else line, findings
    except TrackfgError as error:
        message = str(error).removeprefix(f"{path}: ")
        return None, [*findings, Finding("error", "known-line", message, file=part.file)]


def line_written(line: KnownLine) -> bytes:
    """Return tracks as GeoJSON, so that reading gives the same ones."""
    features: list[dict[str, Any]] = []
    for its_id, vertices in zip(line.ids, line.vertices, strict=True):
        xy = (vertices if line.is_local else vertices[:, ::-1]).tolist()  # longitude first
        geometry = {"type": "LineString", "coordinates": xy}
        features.append({"type": "Feature", "properties": {"id": its_id}, "geometry": geometry})
    ways = {both: name for name, both in _NAVIGABLE.items()}
    for to in line.relations or ():
        about = {"netelementA": to.a, "positionOnA": to.on_a, "netelementB": to.b, "positionOnB": to.on_b}
        about["navigability"] = ways[to.forth, to.back]
        features.append({"type": "Feature", "properties": about, "geometry": None})
    if line.relations == ():  # none of the file's relations is left: tracks must not be joined where they touch
        nowhere = {"netelementA": line.ids[0], "positionOnA": 0, "netelementB": line.ids[0], "positionOnB": 0}
        features.append({"type": "Feature", "properties": nowhere | {"navigability": "none"}, "geometry": None})
    return json.dumps({"type": "FeatureCollection", "features": features}).encode()


def known_line(name: str, tracks: Mapping[str, Array], system: str) -> KnownLine:
    """Return tracks by id as a known line; their vertices (m, 2) are east and north, m, in a reference system."""
    vertices = tuple(_placed(line, system, f"{name}: track {its_id!r}") for its_id, line in tracks.items())
    return KnownLine(name, tuple(tracks), vertices, is_local=system == LOCAL)


def _placed(xy: Array, system: str, where: str) -> Array:
    """Return east and north, or longitude and latitude (n, 2), of a reference system as latitude and longitude, deg.

    Local coordinates stay as they are. Raises :class:`BadInputError` where they are none of that system.
    """
    if not np.isfinite(xy).all():
        raise BadInputError(f"{where}: a coordinate is not finite: expected numbers")
    if system == LOCAL:
        return xy
    hint = ". Hint: --line-crs says in which reference system the coordinates are"
    return in_wgs_84(xy, system, where, hint)


def _where(feature: Feature) -> str:
    its_id = _id_of(feature)
    return feature.where if its_id is None else f"{feature.where} ({its_id!r})"


def _id_of(feature: Feature) -> str | None:
    by_name = {name.lower(): value for name, value in reversed(feature.properties.items())}
    for value in (feature.id, *(by_name.get(name) for name in _ID_COLUMNS)):
        if isinstance(value, str | int) and str(value).strip():
            return printable(str(value))
    return None


def _relation(about: dict[str, Any], where: str) -> Relation | None:
    """Return the relation of a feature, None where no vehicle can go."""
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

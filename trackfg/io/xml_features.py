"""Lines and points of KML, KMZ and GPX, which are in longitude and latitude of WGS 84 by definition.

Coordinates of KML are ``longitude,latitude[,height]`` (OGC 12-007r2); GPX 1.1 has attributes ``lon`` and ``lat``.
"""

from __future__ import annotations

import io
import lzma
import zipfile
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from trackfg.errors import BadInputError
from trackfg.files.small_file import read_small
from trackfg.files.xml_file import xml_root
from trackfg.numerics.arrays import Array

XML_SUFFIXES = (".kml", ".kmz", ".gpx")

_MOST_BYTES = 2**28
"""Size of a file, bytes: all tracks of a country of 5000 km have less in any form."""


def xml_lines(path: Path) -> Iterator[tuple[str, str, list[Array], dict[str, Any]]]:
    """Yield of each placemark, track and route where it is, the kind of its geometry, x and y (n, 2), and properties.

    Raises :class:`BadInputError` with the place and what was expected.
    """
    root = _root(path)
    if _tag(root) == "gpx":
        yield from _gpx(root, path)
        return
    placemarks = [node for node in root.iter() if _tag(node) == "Placemark"]
    for number, placemark in enumerate(placemarks, start=1):
        where = f"placemark {number}"
        kind, parts = _kml_geometry(placemark, f"{path}: {where}")
        yield where, kind, parts, _properties(placemark)


def _root(path: Path) -> Any:
    try:
        content = read_small(path, _MOST_BYTES)
        if path.suffix.lower() == ".kmz":
            content = _within_kmz(content)
    except OSError as error:
        raise BadInputError(f"{path}: cannot be read: {error.strerror}: expected a {path.suffix} file") from error
    except (zipfile.BadZipFile, ValueError, RuntimeError, EOFError, zlib.error, lzma.LZMAError) as error:
        raise BadInputError(f"{path}: cannot be unpacked: {error}: expected a zip with a .kml file") from error
    root = xml_root(content, path, f"a {path.suffix} file")
    if _tag(root) not in ("kml", "gpx"):
        raise BadInputError(f"{path}: its root is {_tag(root)}: expected kml or gpx")
    return root


def _within_kmz(content: bytes) -> bytes:
    """Return the first .kml of a zip. Raises ``ValueError`` where there is none, or it is too large."""
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        members = [member for member in archive.infolist() if member.filename.lower().endswith(".kml")]
        if not members:
            raise ValueError("no .kml in it")
        if members[0].file_size > _MOST_BYTES:
            raise ValueError("above 256 MiB")
        return archive.read(members[0])


def _tag(node: Any) -> str:
    return str(node.tag).rpartition("}")[2]


def _kml_geometry(placemark: Any, where: str) -> tuple[str, list[Array]]:
    """Return the kind and the lines of a placemark; points where it has no line."""
    lines = [_coordinates(node, where) for node in placemark.iter() if _tag(node) == "LineString"]
    lines += [_track(node, where) for node in placemark.iter() if _tag(node) == "Track"]
    lines = [line for line in lines if len(line)]
    if lines:
        return ("LineString" if len(lines) == 1 else "MultiLineString"), lines
    points = [_coordinates(node, where) for node in placemark.iter() if _tag(node) == "Point"]
    return ("Point", points[:1]) if points else ("", [])


def _coordinates(geometry: Any, where: str) -> Array:
    text = " ".join(node.text or "" for node in geometry.iter() if _tag(node) == "coordinates")
    return _numbers([vertex.split(",") for vertex in text.split()], where)


def _track(geometry: Any, where: str) -> Array:
    """Return the places of a track with times (``gx:Track``)."""
    return _numbers([(node.text or "").split() for node in geometry.iter() if _tag(node) == "coord"], where)


def _numbers(vertices: list[list[str]], where: str) -> Array:
    try:
        return np.array([[float(x), float(y)] for x, y, *_ in vertices], dtype=np.float64).reshape(-1, 2)
    except ValueError as error:
        raise BadInputError(f"{where}: a vertex is no position: expected longitude,latitude") from error


def _properties(placemark: Any) -> dict[str, Any]:
    """Return the name of a placemark and its data."""
    out: dict[str, Any] = {}
    for node in placemark.iter():
        if _tag(node) == "Data":
            value = next((child.text for child in node if _tag(child) == "value"), None)
            out[str(node.get("name"))] = value
        elif _tag(node) == "SimpleData":
            out[str(node.get("name"))] = node.text
        elif _tag(node) == "name" and node.getparent() is placemark:
            out["name"] = node.text
    return out


def _gpx(root: Any, path: Path) -> Iterator[tuple[str, str, list[Array], dict[str, Any]]]:
    tracks = [node for node in root.iter() if _tag(node) in ("trk", "rte")]
    for number, track in enumerate(tracks, start=1):
        where = f"track {number}"
        segments = [track] if _tag(track) == "rte" else [node for node in track if _tag(node) == "trkseg"]
        lines = [_numbers(_points(segment), f"{path}: {where}") for segment in segments]
        lines = [line for line in lines if len(line)]
        name = next((node.text for node in track if _tag(node) == "name"), None)
        yield where, "MultiLineString" if len(lines) > 1 else "LineString" if lines else "", lines, {"name": name}


def _points(segment: Any) -> list[list[str]]:
    return [[point.get("lon", ""), point.get("lat", "")] for point in segment if _tag(point) in ("trkpt", "rtept")]

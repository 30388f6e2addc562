"""Points and lines as bytes: well-known binary of ISO 13249-3 (Z is type + 1000, ZM + 3000), and GeoPackage's header.

A GeoPackage geometry is ``"GP", version 0, flags, srs_id, envelope`` before the well-known binary, all little-endian
here (GeoPackage 1.2, clause 2.1.3). A point needs no envelope; a line has (min x, max x, min y, max y), by which
readers skip what they do not draw.
"""

from __future__ import annotations

import struct

import numpy as np

from trackfg.numerics.arrays import Array

_LITTLE_ENDIAN = 1
"""Byte order of a geometry (ISO 13249-3)."""
_POINT_Z = 1001
"""Code of a point with height."""
_LINESTRINGS = {3: 1002, 4: 3002}
"""Code of a line by the numbers of a vertex: with height, and with a measure too."""
_POINT, _LINE, _POLYGON = 1, 2, 3
_COLLECTIONS = (4, 5, 6, 7)
"""Codes without the thousands: of many points, lines, polygons, and of anything."""
_KINDS = {
    _POINT: "Point",
    _LINE: "LineString",
    _POLYGON: "Polygon",
    4: "MultiPoint",
    5: "MultiLineString",
    6: "MultiPolygon",
    7: "GeometryCollection",
}
"""Kinds of geometries by their codes, as GeoJSON calls them."""
_OLD_Z, _OLD_M = 0x80000000, 0x40000000
"""Flags of height and measure in well-known binary before ISO's thousands, which GDAL writes still."""
_NO_ENVELOPE, _ENVELOPE_XY = 0, 1
"""Codes of the extent in GeoPackage's header: none, and x and y (OGC 12-128r14, 2.1.3)."""
_ENVELOPE_BYTES = (0, 32, 48, 48, 64)
"""Bytes of GeoPackage's extent by its code."""


def point_wkb(xyz: Array) -> bytes:
    """Return a point with height, shape (3,)."""
    return struct.pack("<BI3d", _LITTLE_ENDIAN, _POINT_Z, *xyz)


def line_wkb(vertices: Array) -> bytes:
    """Return a line of vertices with height, shape (n, 3), or with height and measure, shape (n, 4)."""
    head = struct.pack("<BII", _LITTLE_ENDIAN, _LINESTRINGS[vertices.shape[1]], len(vertices))
    return head + np.ascontiguousarray(vertices, dtype="<f8").tobytes()


def geopackage_point(xyz: Array, srs_id: int) -> bytes:
    """Return :func:`point_wkb` with GeoPackage's header."""
    return _header(srs_id, _NO_ENVELOPE) + point_wkb(xyz)


def geopackage_line(xyzm: Array, srs_id: int) -> bytes:
    """Return :func:`line_wkb` with GeoPackage's header and the extent in x and y."""
    (x0, y0), (x1, y1) = xyzm[:, :2].min(axis=0), xyzm[:, :2].max(axis=0)
    return _header(srs_id, _ENVELOPE_XY) + struct.pack("<4d", x0, x1, y0, y1) + line_wkb(xyzm)


def _header(srs_id: int, envelope: int) -> bytes:
    return b"GP" + struct.pack("<BBi", 0, envelope << 1 | _LITTLE_ENDIAN, srs_id)


def geometry_of_wkb(blob: bytes, at: int = 0) -> tuple[str, list[Array]]:
    """Return the kind of a geometry as GeoJSON calls it, and the vertices (n, 2 to 4) of each point, line and ring.

    ``at`` is the byte where it begins. Both byte orders, with or without heights and measures, also as they were marked
    before ISO 13249-3. Raises ``ValueError`` for bytes that end too soon and for other kinds.
    """
    try:
        _, kind, _ = _head(blob, at)
        parts, _ = _vertices(blob, at)
    except struct.error as error:
        raise ValueError("the geometry is cut off: expected a whole one") from error
    return _KINDS[kind], parts


def geopackage_geometry(blob: bytes) -> tuple[str, list[Array]]:
    """Return the kind of a geometry with GeoPackage's header, and x and y (n, 2) of each point, line and ring.

    Raises ``ValueError`` for bytes that are no such geometry.
    """
    if not isinstance(blob, bytes) or blob[:2] != b"GP" or len(blob) < 8:
        raise ValueError("no GeoPackage geometry: expected bytes that begin with GP")
    code = blob[3] >> 1 & 7
    if code >= len(_ENVELOPE_BYTES):
        raise ValueError(f"no GeoPackage geometry: the extent has the code {code}: expected 0 to 4")
    kind, parts = geometry_of_wkb(blob, 8 + _ENVELOPE_BYTES[code])
    return kind, [part[:, :2] for part in parts]


def _head(blob: bytes, at: int) -> tuple[str, int, int]:
    """Return byte order, kind and numbers of a vertex of the well-known binary at a byte."""
    order = "<" if blob[at : at + 1] == bytes([_LITTLE_ENDIAN]) else ">"
    (number,) = struct.unpack_from(f"{order}I", blob, at + 1)
    flags = number & (_OLD_Z | _OLD_M)
    thousands, kind = divmod(number - flags, 1000)
    return order, kind, 2 + flags.bit_count() + (0, 1, 1, 2)[min(thousands, 3)]


def _vertices(blob: bytes, at: int) -> tuple[list[Array], int]:
    """Return the vertices (n, 2 to 4) of each part of the well-known binary at a byte, and the byte after it."""
    order, kind, dims = _head(blob, at)
    at += 5

    def count() -> int:
        return int(struct.unpack_from(f"{order}I", blob, at)[0])

    def row(number: int) -> Array:
        if len(blob) < at + 8 * dims * number:
            raise struct.error("beyond the end")
        return np.frombuffer(blob, f"{order}f8", dims * number, at).reshape(number, dims).astype(np.float64)

    vertices: list[Array] = []
    if kind == _POINT:
        return [row(1)], at + 8 * dims
    if kind in (_LINE, _POLYGON):
        lines = 1
        if kind == _POLYGON:
            lines, at = count(), at + 4
        for _ in range(lines):
            number, at = count(), at + 4
            vertices.append(row(number))
            at += 8 * dims * number
        return vertices, at
    if kind not in _COLLECTIONS:
        raise ValueError(f"a geometry of the kind {kind} cannot be read: expected points, lines or polygons")
    parts, at = count(), at + 4
    for _ in range(parts):
        part, at = _vertices(blob, at)
        vertices += part
    return vertices, at

"""The file of a known line: tracks of GeoJSON or GeoPackage, or alignments of LandXML."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from trackfg.datasets.line.landxml import read_plans
from trackfg.errors import BadInputError
from trackfg.io.content import line_sha256
from trackfg.io.known_lines import known_line, read_known_line

if TYPE_CHECKING:
    from trackfg.recording.known_line import KnownLine

_VERTEX_M = 5.0
"""Vertices of an alignment are so far apart, m: their chords leave a curve of 150 m by 2 cm."""


def read_line(path: Path, system: str | None, alignment: str | None) -> KnownLine:
    """Return the tracks of a file, or of LandXML the ``alignment`` alone, with the digest of the file."""
    if path.suffix.lower() == ".xml":
        line = _of_landxml(path, system, alignment)
    elif alignment is not None:
        raise BadInputError(f"--alignment chooses one of a LandXML file: {path} is none")
    else:
        line = read_known_line(path, system)
    return replace(line, content_sha256=line_sha256(path))


def _of_landxml(path: Path, system: str | None, alignment: str | None) -> KnownLine:
    tracks, code = read_plans(path, name=alignment, step_m=_VERTEX_M)
    if system is None and code is None:
        raise BadInputError(
            f"{path}: has no CoordinateSystem with an epsgCode: expected the reference system of its coordinates. "
            "Hint: give --line-crs EPSG:N, or --line-crs local where the recording has the same frame"
        )
    return known_line(path.name, tracks, system or f"EPSG:{code}")

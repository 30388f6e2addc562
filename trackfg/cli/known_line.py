"""The known line of ``trackfg smooth``: tracks of GeoJSON or GeoPackage, or an alignment of LandXML."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
import typer

from trackfg.cli.options import Json
from trackfg.errors import BadInputError

if TYPE_CHECKING:
    from trackfg.recording.known_line import KnownLine

_VERTEX_M = 5.0
"""Vertices of an alignment are so far apart, m: their chords leave a curve of 150 m by 2 cm."""


@dataclass(frozen=True)
class SmoothOptions:
    """The options of ``trackfg smooth``."""

    recording: Annotated[Path, typer.Argument(metavar="REC", help="Folder of the recording.", show_default=False)]
    out: Annotated[Path, typer.Option("-o", "--out", metavar="OUT", help="Folder for the result.")]
    config: Annotated[
        Path | None, typer.Option(metavar="C.toml", help="Settings other than the defaults.", show_default=False)
    ] = None
    map_location: Annotated[
        str | None,
        typer.Option(
            "--map", metavar="MAP", help="A map to locate the run on: its newest version.", show_default=False
        ),
    ] = None
    line: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Known tracks that the run is on: GeoJSON, GeoPackage (.gpkg) or LandXML (.xml).",
            show_default=False,
        ),
    ] = None
    path: Annotated[
        list[str] | None,
        typer.Option(
            metavar="ID", help="A track of the line that the run takes; may be given again.", show_default=False
        ),
    ] = None
    line_crs: Annotated[
        str | None,
        typer.Option(
            metavar="EPSG:N",
            help="Reference system of the line's coordinates, or local: that of the recording's positions.",
            show_default=False,
        ),
    ] = None
    alignment: Annotated[
        str | None, typer.Option(metavar="NAME", help="The alignment, of several in LandXML.", show_default=False)
    ] = None
    json: Json = False

    def known_line(self) -> KnownLine | None:
        """Return the tracks of the file, or those of the path. Raises :class:`BadInputError` for one not usable."""
        if self.line is None:
            given = {"--path": self.path, "--line-crs": self.line_crs, "--alignment": self.alignment}
            for option, value in given.items():
                if value:
                    raise BadInputError(f"{option} is of a known line: expected --line too")
            return None
        line = read_line(self.line, self.line_crs, self.alignment)
        return line.only(self.path) if self.path else line


def read_line(path: Path, system: str | None, alignment: str | None) -> KnownLine:
    """Return the tracks of a file, or the ``alignment`` of LandXML as its only one."""
    from trackfg.interchange.known_lines import read_known_line

    if path.suffix.lower() == ".xml":
        return _of_landxml(path, system, alignment)
    if alignment is not None:
        raise BadInputError(f"--alignment chooses one of a LandXML file: {path} is none")
    return read_known_line(path, system)


def _of_landxml(path: Path, system: str | None, alignment: str | None) -> KnownLine:
    from trackfg.datasets.line.landxml import read_landxml
    from trackfg.datasets.line.landxml_file import open_landxml
    from trackfg.interchange.known_lines import known_line

    designed = read_landxml(path, name=alignment, speed_limit_mps=np.inf)
    of_file = open_landxml(path).child("CoordinateSystem")
    code = None if of_file is None else of_file.text("epsgCode")
    if system is None and not code:
        raise BadInputError(
            f"{path}: has no CoordinateSystem with an epsgCode: expected the reference system of its coordinates. "
            "Hint: give --line-crs EPSG:N, or --line-crs local where the recording has the same frame"
        )
    line = designed.line
    steps = max(int(np.ceil(line.length_m / _VERTEX_M)), 1)
    east_north = designed.start_m[:2] + line.position(np.linspace(0.0, line.length_m, steps + 1))[:, :2]
    return known_line(path.name, {designed.name or "1": east_north}, system or f"EPSG:{code}")

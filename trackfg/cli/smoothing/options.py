"""The options of ``trackfg smooth``."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from trackfg.cli.options import Config, Json
from trackfg.errors import BadInputError

if TYPE_CHECKING:
    from contextlib import AbstractContextManager

    from trackfg.recording.known_line import KnownLine


@dataclass(frozen=True)
class SmoothOptions:
    """A recording, its result, and what the run is smoothed with besides."""

    recording: Annotated[Path, typer.Argument(metavar="REC", help="Folder of the recording.")]
    out: Annotated[Path, typer.Option("-o", "--out", metavar="OUT", help="Folder for the result.")]
    config: Config = None
    map_location: Annotated[
        str | None, typer.Option("--map", metavar="MAP", help="A map to locate the run on: its newest version.")
    ] = None
    line: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="Known tracks that the run is on: GeoJSON, GeoPackage (.gpkg) or LandXML (.xml)."
        ),
    ] = None
    path: Annotated[
        list[str] | None, typer.Option(metavar="ID", help="A track of the line that the run takes; may be given again.")
    ] = None
    line_crs: Annotated[
        str | None,
        typer.Option(
            metavar="EPSG:N",
            help="Reference system of the line's coordinates, or local: that of the recording's positions.",
        ),
    ] = None
    alignment: Annotated[str | None, typer.Option(metavar="NAME", help="This one alone of several in LandXML.")] = None
    memory: Annotated[
        float,
        typer.Option(
            metavar="GB", min=0.001, help="About the most memory, GB: what is beyond lies in a file beside OUT."
        ),
    ] = 2.0
    json: Json = False

    def bounded_memory(self) -> AbstractContextManager[None]:
        """Keep to the memory inside the ``with``; the file is in the first folder above the result that there is."""
        from trackfg import bounded_memory

        above = next(folder for folder in self.out.absolute().parents if folder.is_dir())
        return bounded_memory(round(self.memory * 1e9), above)

    def known_line(self) -> KnownLine | None:
        """Return the tracks of the file, or those of the path. Raises :class:`BadInputError` for one not usable."""
        if self.line is None:
            given = {"--path": self.path, "--line-crs": self.line_crs, "--alignment": self.alignment}
            for option, value in given.items():
                if value:
                    raise BadInputError(f"{option} is of a known line: expected --line too")
            return None
        from trackfg.cli.smoothing.line_file import read_line

        line = read_line(self.line, self.line_crs, self.alignment)
        return line.only(self.path) if self.path else line

"""``trackfg limits`` and ``trackfg report``: where a result exceeds limits, and its page."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from trackfg.cli.options import (
    LIMITS_HELP,
    Json,
    Km,
    Level,
    Limits,
    LineSpeed,
    ResultFolder,
    TableFile,
    limit_choice,
    out_file,
    refuse_inside,
    with_options,
)
from trackfg.cli.terminal import note, print_unless_quiet, show_unless_written, working
from trackfg.files.atomic_folder import beside


def limits(
    result: ResultFolder,
    source: Annotated[str, typer.Option("--limits", metavar="FILE|NAME", help=LIMITS_HELP)],
    level: Level = None,
    line_speed: LineSpeed = None,
    out: TableFile = None,
    km: Km = None,
    json: Json = False,
) -> None:
    """List where the track geometry of a result exceeds limits: place, length, peak and sigma of each exceedance.

    Limits that the geometry does not suffice for are listed with the reason.
    """
    from trackfg.cli import limit_tables
    from trackfg.cli.tables import warn_of_doubt
    from trackfg.geometry.limits import LimitChoice
    from trackfg.report.track_limits import judge, write_exceedances
    from trackfg.results.result import Result

    if out is not None:
        refuse_inside(result, out)
    chosen = LimitChoice(source, level).table()
    with working("limits"):
        content = Result.read(result)
        judgement = judge(content, chosen, line_speed, km=km)
    warn_of_doubt(content, result)
    if out is not None:
        write_exceedances(judgement, out)
    if json:
        print(limit_tables.judgement_json(judgement))
        return
    show_unless_written(*limit_tables.of_judgement(judgement), written=None if out is None else f"exceedances: {out}")


@dataclass(frozen=True)
class ReportOptions:
    """Options of a page: its subject, and what it shows besides."""

    folder: Annotated[Path, typer.Argument(metavar="OUT", help="Folder of a result, a comparison or trends.")]
    out: Annotated[Path | None, out_file("Page: .html. OUT.html if absent.")] = None
    recording: Annotated[
        Path | None, typer.Option(metavar="REC", help="The recording of the result, to show its truth and the errors.")
    ] = None
    limits: Limits = None
    level: Level = None
    line_speed: LineSpeed = None
    km: Km = None
    background: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Lines and stations behind the map: GeoJSON, .gpkg, .shp, .kml, .gpx."),
    ] = None


@with_options(ReportOptions)
def report(options: ReportOptions) -> None:
    """Write one self-contained page about a result, a comparison or trends, opened in a browser without a network."""
    from trackfg.report import write_report
    from trackfg.report.truth import is_without_truth

    with working("page"):
        page = write_report(
            options.folder,
            options.out or beside(options.folder, ".html"),
            recording=options.recording,
            limits=limit_choice(options.limits, options.level, options.line_speed),
            km=options.km,
            background=options.background,
        )
    if options.recording is not None and is_without_truth(options.recording):
        note(f"trackfg: note: {options.recording}: has no [truth]: the page shows no errors")
    print_unless_quiet(f"report: {page}")

"""Commands about feature maps, ``trackfg map ...``."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from trackfg.cli.options import Commands, Json, Km, Level, Limits, LineSpeed, TableFile, limit_choice, with_options
from trackfg.cli.terminal import complain, print_unless_quiet, progress_bar, show_unless_written, working
from trackfg.cli.terminal import show as show_table
from trackfg.errors import BadInputError, counted, printable

if TYPE_CHECKING:
    from collections.abc import Sequence

    from trackfg.mapping.joining.build import JoinableRun
    from trackfg.maps.feature_map import FeatureMap
    from trackfg.numerics.chainage.kilometrage import Kilometrage
    from trackfg.results.result import Result

maps = Commands(help="Feature maps: what repeated runs say together about a line.")

_PLACE = "Path of a .gpkg, or postgresql://... URL."
MapPlace = Annotated[str, typer.Argument(metavar="MAP", help=_PLACE)]
Version = Annotated[int | None, typer.Option(metavar="N", help="Version of the map. The newest if absent.")]


@maps.command(example="trackfg map build out1 out2 run3 -o line.gpkg", loads="trackfg.cli.mapping.map_file")
def build(
    runs: Annotated[list[str], typer.Argument(metavar="RUN", help="Folders of results, or of recordings; a store.")],
    place: Annotated[str, typer.Option("-o", "--out", metavar="MAP", help=_PLACE)],
    name: Annotated[str | None, typer.Option(metavar="NAME", help="Name of the line, for a new map.")] = None,
    config: Annotated[
        Path | None, typer.Option(metavar="C.toml", help="Settings for recordings, which are smoothed first.")
    ] = None,
    line: Annotated[
        str | None, typer.Option(metavar="LINE", help="Line whose runs are joined, of a store with several.")
    ] = None,
    jobs: Annotated[
        int | None, typer.Option(metavar="N", min=1, help="Processes. As many as cores and memory allow if absent.")
    ] = None,
    scheduler: Annotated[
        str | None, typer.Option(metavar="URL", help="Compute on a running dask.distributed cluster: tcp://HOST:8786.")
    ] = None,
) -> None:
    """Join runs into a map: a new one, or the newest version of the one that is there.

    Runs may go either way, with any wheel and sensor, and need no fix if the map knows where it is. A run in the map
    already is refused. What is there stays readable as the version before. Of a store, the runs are joined that are not
    in the map yet.
    """
    from trackfg.cli.mapping.map_file import FleetRuns, build_map_file
    from trackfg.config import SmoothConfig
    from trackfg.maps.location import locate

    settings = SmoothConfig.from_toml(config) if config else None
    with progress_bar() as progress:
        fleet = FleetRuns(line, jobs, scheduler)
        built = build_map_file(runs, place, name=name, config=settings, fleet=fleet, progress=progress)
    curves = built.landmarks["curve_id"].replace("", None).nunique()
    km = 1e-3 * len(built.grid) * built.conventions.step_m
    contents = f"{counted(len(built.runs), 'run')}, {km:.1f} km, {counted(curves, 'curve')}"
    print_unless_quiet(f"map: {locate(place).shown} version {built.version}: {contents}")


@maps.command(example="trackfg map changes out5 line.gpkg -o changes.csv", loads="trackfg.mapping")
def changes(
    run: Annotated[Path, typer.Argument(metavar="OUT", help="Folder of a result.")],
    place: MapPlace,
    out: TableFile = None,
    version: Version = None,
    floor: Annotated[
        float, typer.Option(metavar="MM", min=0.0, help="Least change of cross-level, twist and versines, mm.")
    ] = 1.0,
    km: Km = None,
    json: Json = False,
) -> None:
    """List where a run shows other track than the map: significant changes, each with place, size and sigma."""
    from trackfg.cli.mapping import map_tables
    from trackfg.mapping import find_changes
    from trackfg.mapping.recognition.other_track import other_track_message
    from trackfg.maps import read_map
    from trackfg.results.official_places import with_km
    from trackfg.results.result import Result

    feature_map = read_map(place, version)
    kilometrage = _kilometrage(feature_map, km)
    with working("changes"):
        result = Result.read(run)
        track_changes = find_changes(result, feature_map, floor_mm=floor)
    if track_changes.other_track:
        message = other_track_message(result.summary.recording_id, feature_map.name)
        complain(f"trackfg: warning: {printable(message)}")
    track_changes = replace(track_changes, table=with_km(track_changes.table, kilometrage, of="from_m"))
    if out is not None:
        track_changes.write(out)
    if json:
        print(map_tables.changes_json(track_changes))
        return
    show_unless_written(*map_tables.of_changes(track_changes), written=None if out is None else f"changes: {out}")


@dataclass(frozen=True)
class TrendChoices:
    """The options of ``trackfg map trends``."""

    place: MapPlace
    runs: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="OUT", help="Folders of results, each of a date. Those that the map was made of if absent."
        ),
    ] = None
    out: Annotated[Path | None, typer.Option("-o", "--out", metavar="DIR", help="Folder for the tables.")] = None
    limits: Limits = None
    level: Level = None
    line_speed: LineSpeed = None
    version: Version = None
    floor: Annotated[float, typer.Option(metavar="MM", min=0.0, help="Least rate of a trend, mm per month.")] = 0.1
    tonnage: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Million tonnes that had passed by each date (.csv: date, mt): rates are per million tonnes then.",
        ),
    ] = None
    layers: Annotated[bool, typer.Option("--layers", help="Put the trends into the map, as layers for a GIS, too.")] = (
        False
    )
    json: Json = False


@maps.command(
    example="trackfg map trends line.gpkg out1 out2 out3 --limits ours.toml -o trends",
    loads="trackfg.mapping.trends.trends",
)
@with_options(TrendChoices)
def trends(options: TrendChoices) -> None:
    """Find how fast the track changes from run to run, where it jumped, and when it will reach limits.

    Rates, values and dates come with their uncertainty, for every 0.25 m and every 200 m. An earlier folder of tables
    is replaced in one step.
    """
    from trackfg.cli import trend_tables
    from trackfg.cli.mapping.stored_runs import runs_of_map
    from trackfg.geometry.limits import at_line_speed
    from trackfg.mapping.trends.trend_layers import trend_layers
    from trackfg.mapping.trends.trends import find_trends
    from trackfg.maps import read_map
    from trackfg.maps.location import locate
    from trackfg.maps.store import draw
    from trackfg.results.result import Result
    from trackfg.results.trends import TRENDS_FOLDER

    choice = limit_choice(options.limits, options.level, options.line_speed)
    chosen = () if choice is None else at_line_speed(choice.table(), choice.line_speed_kmh)
    load = None if options.tonnage is None else trend_tables.read_tonnage(options.tonnage)
    if options.out is not None:
        TRENDS_FOLDER.refuse_foreign(options.out)
    feature_map, missing = read_map(options.place, options.version), dict[str, str]()
    runs: Sequence[Result | JoinableRun]
    if options.runs:
        runs = [Result.read(run) for run in options.runs]
    else:
        runs, missing = runs_of_map(feature_map)
    with working("trends"):
        result = find_trends(runs, feature_map, chosen, floor_mm_per_month=options.floor, load=load)
    result = replace(result, left_out={**missing, **result.left_out})
    for doubt in result.doubts.values():
        complain(f"trackfg: warning: {printable(doubt)}")
    if options.out is not None:
        result.write(options.out)
    written = [] if options.out is None else [f"trends: {options.out}"]
    if options.layers:
        draw(options.place, feature_map, trend_layers(result, feature_map))
        written.append(f"layers: {locate(options.place).shown}")
    if options.json:
        print(result.as_json())
        return
    show_unless_written(*trend_tables.of_trends(result), written="\n".join(written) or None)


@maps.command(example="trackfg map show line.gpkg", loads="trackfg.maps")
def show(
    place: MapPlace,
    version: Version = None,
    km: Km = None,
    json: Json = False,
) -> None:
    """Show what a map covers and how well, its runs, landmarks and versions."""
    from trackfg.cli.mapping import map_tables
    from trackfg.maps import read_map, read_versions

    versions, feature_map = read_versions(place), read_map(place, version)
    kilometrage = _kilometrage(feature_map, km)
    if json:
        print(map_tables.map_json(feature_map, versions, kilometrage))
        return
    for table in map_tables.of_map(feature_map, versions, kilometrage):
        show_table(table)


@maps.command(example="trackfg map diff line.gpkg --from-version 1 --to-version 3", loads="trackfg.mapping")
def diff(
    first: Annotated[str, typer.Argument(metavar="A", help=_PLACE)],
    second: Annotated[str | None, typer.Argument(metavar="B", help="Another map; A itself if absent.")] = None,
    from_version: Annotated[
        int | None,
        typer.Option(metavar="N", help="Version of A. If absent the newest; without B the one that B's is made from."),
    ] = None,
    to_version: Annotated[int | None, typer.Option(metavar="N", help="Version of B. The newest if absent.")] = None,
    km: Km = None,
    json: Json = False,
) -> None:
    """Compare two maps, or two versions of one: what moved, and by how many sigmas.

    Without B and versions: what the last version changed.
    """
    from trackfg.cli.mapping import map_tables
    from trackfg.mapping import difference
    from trackfg.maps import read_map
    from trackfg.results.official_places import with_km

    b = read_map(first if second is None else second, to_version)
    if second is None and from_version is None:
        if b.parent is None:
            made = f"version {b.version} of {b.name!r} was made from no earlier version"
            raise BadInputError(f"{made}: expected another map, or --from-version")
        from_version = b.parent
    a = read_map(first, from_version)
    try:
        comparison = difference(a, b)
    except ValueError as error:
        raise BadInputError(f"the maps cannot be compared: {error}") from error
    kilometrage = _kilometrage(b, km)
    added, removed = (with_km(part, kilometrage) for part in (comparison.added, comparison.removed))
    comparison = replace(comparison, added=added, removed=removed)
    if json:
        print(map_tables.difference_json(a, b, comparison))
        return
    for table in map_tables.of_difference(a, b, comparison):
        show_table(table)


def _kilometrage(feature_map: FeatureMap, wanted: bool | None) -> Kilometrage | None:
    """Return the kilometrage by which places are shown; None where they are not."""
    from trackfg.results.official_places import kilometrage_of_map

    line = kilometrage_of_map(feature_map.name, feature_map.configuration, wanted)
    return None if line is None else line.kilometrage()

"""The commands about feature maps, ``trackfg map ...``."""

from __future__ import annotations

from typing import Annotated

import typer

from trackfg.errors import BadInputError
from trackfg.terminal import show as show_table

maps = typer.Typer(no_args_is_help=True, help="Feature maps: what repeated runs say together about a line.")

_PLACE = "Path of a .gpkg, or postgresql://... URL."
MapPlace = Annotated[str, typer.Argument(metavar="MAP", help=_PLACE, show_default=False)]
Json = Annotated[bool, typer.Option("--json", help="Print JSON instead of tables.")]
_NEWEST = "The newest if absent."


@maps.command(epilog="Example: trackfg map show line.gpkg")
def show(
    place: MapPlace,
    version: Annotated[int | None, typer.Option(metavar="N", help=_NEWEST, show_default=False)] = None,
    json: Json = False,
) -> None:
    """Show what a map covers and how well, its runs, landmarks and versions."""
    from trackfg import map_tables
    from trackfg.maps import read_map, read_versions

    versions, feature_map = read_versions(place), read_map(place, version)
    if json:
        print(map_tables.map_json(feature_map, versions))
        return
    for table in map_tables.of_map(feature_map, versions):
        show_table(table)


@maps.command(epilog="Example: trackfg map diff line.gpkg --from-version 1 --to-version 3")
def diff(
    first: Annotated[str, typer.Argument(metavar="A", help=_PLACE, show_default=False)],
    second: Annotated[
        str | None, typer.Argument(metavar="B", help="Another map; A itself if absent.", show_default=False)
    ] = None,
    from_version: Annotated[
        int | None,
        typer.Option(
            metavar="N",
            help="Version of A. If absent the newest; without B the one that B's is made from.",
            show_default=False,
        ),
    ] = None,
    to_version: Annotated[
        int | None, typer.Option(metavar="N", help="Version of B. The newest if absent.", show_default=False)
    ] = None,
    json: Json = False,
) -> None:
    """Compare two maps, or two versions of one: what moved, and by how many sigmas.

    Without B and versions: what the last version changed.
    """
    from trackfg import map_tables
    from trackfg.maps import difference, read_map

    b = read_map(first if second is None else second, to_version)
    if second is None and from_version is None:
        if b.parent is None:
            raise BadInputError(f"version {b.version} of {b.name!r} is made from none: expected another map or version")
        from_version = b.parent
    a = read_map(first, from_version)
    try:
        found = difference(a, b)
    except ValueError as error:
        raise BadInputError(f"the maps cannot be compared: {error}") from error
    if json:
        print(map_tables.difference_json(a, b, found))
        return
    for table in map_tables.of_difference(a, b, found):
        show_table(table)

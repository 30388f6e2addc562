"""``trackfg export``: a result goes to another system's format."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from rich.console import RenderableType

Folder = Annotated[Path, typer.Argument(metavar="OUT", help="Folder of the result.", show_default=False)]


def export(
    result: Folder,
    to: Annotated[
        str, typer.Option("--to", metavar="FORMAT", help="Its name; `trackfg export --list OUT` shows all.")
    ] = "csv",
    out: Annotated[
        Path | None, typer.Option("-o", "--out", metavar="FILE", help="File to write; by default OUT and its suffix.")
    ] = None,
    table: Annotated[str, typer.Option(metavar="NAME", help="geometry, trajectory or events, for csv.")] = "geometry",
    template: Annotated[
        Path | None, typer.Option(metavar="T.toml", help="Columns of a channel file.", show_default=False)
    ] = None,
    step: Annotated[float, typer.Option(metavar="M", min=0.01, help="Spacing of drawn vertices.")] = 1.0,
    list_formats: Annotated[bool, typer.Option("--list", help="List the formats and stop.")] = False,
) -> None:
    """Write a result in the format of another system: tables, geographic data, LandXML, RCM-DX, TUM, MCAP."""
    from trackfg.cli.terminal import show
    from trackfg.errors import BadInputError
    from trackfg.interchange.exporting.channels import read_template
    from trackfg.interchange.exporting.export import export_result
    from trackfg.interchange.exporting.registry import result_format, result_formats
    from trackfg.interchange.exporting.result_format import ExportOptions
    from trackfg.results.result import Result

    if list_formats:
        show(_formats({name: form.title for name, form in result_formats().items()}))
        return
    tables = ("geometry", "trajectory", "events")
    if table not in tables:
        raise BadInputError(f"no table {table!r}; expected one of {', '.join(tables)}")
    form = result_format(to)
    channels = read_template(template) if template is not None else ()
    target = out or result.with_name(f"{result.name}{form.suffix}")
    export_result(Result.read(result), form, target, ExportOptions(table, channels, step))
    print(target)


def _formats(titles: dict[str, str]) -> RenderableType:
    from trackfg.cli.tables import titled

    table = titled("Formats")
    for heading in ("--to", "what"):
        table.add_column(heading)
    for name, title in titles.items():
        table.add_row(name, title)
    return table

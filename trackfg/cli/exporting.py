"""``trackfg export``: a result goes to another system's format."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from trackfg.cli.options import ResultFolder, out_file, with_options
from trackfg.cli.terminal import print_unless_quiet, show, titled, working


@dataclass(frozen=True)
class ExportChoices:
    """The options of ``trackfg export``."""

    result: ResultFolder
    to: Annotated[
        str, typer.Option("--to", metavar="FORMAT", help="Format to write; `trackfg export OUT --list` shows all.")
    ] = "csv"
    out: Annotated[Path | None, out_file("File to write; by default named after OUT.")] = None
    table: Annotated[str, typer.Option(metavar="NAME", help="geometry, trajectory, events or balises, for csv.")] = (
        "geometry"
    )
    template: Annotated[Path | None, typer.Option(metavar="T.toml", help="Columns of a channel file.")] = None
    step: Annotated[float, typer.Option(metavar="M", min=0.01, help="Spacing of drawn vertices, m.")] = 1.0
    km: Annotated[bool, typer.Option("--km", help="Write official places, such as 12+345.60, too.")] = False
    bands: Annotated[bool, typer.Option("--bands", help="Level and alignment in the bands D2 and D3, in tables.")] = (
        False
    )
    list_formats: Annotated[bool, typer.Option("--list", help="List the formats and stop.")] = False


@with_options(ExportChoices)
def export(options: ExportChoices) -> None:
    """Write a result in the format of another system: tables, geographic data, LandXML, RCM-DX, TUM, MCAP."""
    from trackfg.cli.tables import warn_of_doubt
    from trackfg.errors import BadInputError, expected_one_of
    from trackfg.interchange.exporting.channels import read_template
    from trackfg.interchange.exporting.export import export_result
    from trackfg.interchange.exporting.registry import result_format, result_formats
    from trackfg.interchange.exporting.result_format import ExportOptions
    from trackfg.results.result import Result

    if options.list_formats:
        table = titled("Formats", "--to", "what")
        for name, form in result_formats().items():
            table.add_row(name, form.title)
        show(table)
        return
    tables = ("geometry", "trajectory", "events", "balises")
    if options.table not in tables:
        raise BadInputError(f"no table {options.table!r}; {expected_one_of(tables, options.table)}")
    form = result_format(options.to)
    channels = read_template(options.template) if options.template is not None else ()
    wanted = ExportOptions(options.table, channels, options.step, options.km, options.bands)
    target = options.out or options.result.with_name(form.file_name(options.result.name, wanted))
    with working("export"):
        content = Result.read(options.result)
        export_result(content, form, target, wanted)
    warn_of_doubt(content, options.result)
    print_unless_quiet(str(target))

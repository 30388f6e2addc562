"""``trackfg statistics``: standard deviations, track quality index and shares beyond limits by sections of a line."""

from __future__ import annotations

import json as json_text
import math
from pathlib import Path
from typing import Annotated

import typer

from trackfg.cli.options import Json, Limits, LineSpeed, TableFile
from trackfg.cli.terminal import numbers, show_unless_written, titled, working

_MOST_COLUMNS = 8
"""Columns that are shown in a terminal."""


def statistics(
    result: Annotated[Path, typer.Argument(metavar="OUT", help="A result, or a recording car's channel table.")],
    section: Annotated[float, typer.Option(metavar="M", min=1.0, help="Length of the sections, m.")] = 200.0,
    limits: Limits = None,
    line_speed: LineSpeed = None,
    out: TableFile = None,
    json: Json = False,
) -> None:
    """Print standard deviations of every channel per section, the track quality index, and shares beyond limits."""
    from trackfg.cli.tables import records, warn_of_doubt
    from trackfg.files.atomic_file import write_whole
    from trackfg.geometry.limits import LimitChoice
    from trackfg.interchange.importing.channels.source_geometry import read_geometry
    from trackfg.report.track_limits import judge
    from trackfg.report.track_statistics import track_statistics

    with working("sections"):
        content = read_geometry(result)
        judgement = None if limits is None else judge(content, LimitChoice(limits, None).table(), line_speed)
        table = track_statistics(content, section_m=section, judgement=judgement)
    warn_of_doubt(content, result)
    if out is not None:
        write_whole(out, table.to_csv(index=False).encode("utf-8"))
    if json:
        print(json_text.dumps({"sections": records(table)}, indent=2))
        return
    names = list(table.columns)
    headings = [name.replace("_", " ") for name in names[:_MOST_COLUMNS]]
    shown = titled(f"Sections of {section:g} m", *numbers(*headings))
    for row in table[names[:_MOST_COLUMNS]].to_numpy().tolist():
        sds = ("" if math.isnan(value) else f"{value:.3g}" for value in row[2:])
        shown.add_row(*(f"{place:.0f}" for place in row[:2]), *sds)
    more = len(names) - _MOST_COLUMNS
    lines = [f"{more} columns more: -o and --json have all"] if more > 0 else []
    show_unless_written(shown, *lines, written=None if out is None else f"statistics: {out}")

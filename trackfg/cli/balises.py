"""``trackfg balises``: balises and posts surveyed by one run or many, and held against their plan."""

from __future__ import annotations

import json as json_text
import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from trackfg.cli.options import Json, TableFile
from trackfg.cli.terminal import numbers, show_unless_written, titled

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from rich.console import RenderableType

    from trackfg.mapping.runs.balise_survey import BaliseSurvey

_STYLES = {"wrong": "bold red", "undecided": "yellow", "surveyed": "cyan"}


def balises(
    runs: Annotated[list[Path], typer.Argument(metavar="OUT", help="Results of runs that passed balises with ids.")],
    planned: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Planned places instead of the recordings' own: id, chainage_m, sd_m; empty where not known.",
        ),
    ] = None,
    out: TableFile = None,
    json: Json = False,
) -> None:
    """Survey balises by all runs together: planned against measured places with sigmas, and which plans are wrong.

    Each run has an offset of its own, so that runs without any known balise help too.
    """
    from trackfg.cli.tables import records
    from trackfg.files.atomic_file import write_whole
    from trackfg.io.balises import read_places
    from trackfg.mapping.runs.balise_survey import surveyed_by_results
    from trackfg.results.result import Result

    places = None if planned is None else read_places(planned)
    survey = surveyed_by_results([Result.read(run) for run in runs], [str(run) for run in runs], places)
    if out is not None:
        write_whole(out, survey.table.to_csv(index=False).encode("utf-8"))
    if json:
        parts = {"balises": survey.table, "misread": survey.misread, "slips": survey.slips}
        print(json_text.dumps({name: records(table) for name, table in parts.items()}, indent=2))
        return
    show_unless_written(*_tables(survey), written=None if out is None else f"survey: {out}")


def _tables(survey: BaliseSurvey) -> Iterator[RenderableType]:
    from rich.text import Text

    figures = numbers("passes", "planned m", "measured m", "difference m", "sigmas", "place m")
    table = titled(f"{len(survey.table)} balises", "id", *figures, "verdict")
    for row in survey.table.to_dict("records"):
        left_out = f" ({int(row['left_out'])} left out)" if row["left_out"] else ""
        pairs = [_pair(row[name], row[f"{name}_sd"]) for name in ("planned_m", "measured_m", "difference_m", "place_m")]
        sigmas = "" if math.isnan(row["sigmas"]) else f"{row['sigmas']:+.1f}"
        cells = (f"{int(row['passes'])}{left_out}", *pairs[:3], sigmas, pairs[3])
        table.add_row(Text(row["id"]), *cells, Text(row["verdict"], style=_STYLES.get(row["verdict"], "")))
    yield table
    if len(survey.misread):
        rows = (
            (row["run"], f"{row['t_s']:.2f}", row["id"], _pair(row["off_m"], row["off_m_sd"]))
            for row in survey.misread.to_dict("records")
        )
        title = "Passages left out: they contradict the others of their balise"
        yield _listed(title, ("run", "time s", "id", "off by m"), rows)
    if len(survey.slips):
        rows = (
            (row["run"], f"{row['from_s']:.2f}", f"{row['to_s']:.2f}", _pair(row["off_m"], row["off_m_sd"]))
            for row in survey.slips.to_dict("records")
        )
        title = "Distances that are wrong: the wheel erred unnoticed"
        yield _listed(title, ("run", "from s", "to s", "too long by m"), rows)


def _listed(title: str, headings: Iterable[str], rows: Iterable[Iterable[str]]) -> RenderableType:
    from rich.text import Text

    table = titled(title, *headings)
    for row in rows:
        table.add_row(*map(Text, row))
    return table


def _pair(value: float, sd: float) -> str:
    """Return a value with its sigma in parentheses; nothing where it is not known."""
    if math.isnan(value):
        return ""
    return f"{value:.3f}" + ("" if math.isnan(sd) else f" ({sd:.3f})")

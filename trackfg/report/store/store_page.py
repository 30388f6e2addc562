"""The first page of a store: running batches, lines coloured by a quantity, and the list of runs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import pandas as pd

from trackfg.errors import counted
from trackfg.report.numbers import length
from trackfg.report.page import Block, Form, FormField, Latest, Page, PageSection, Text, Tile, Tiles
from trackfg.report.store.addresses import STORE, progress_address
from trackfg.report.store.line_colours import aspects, coloured_lines
from trackfg.report.store.run_list import MOST_ROWS, RunChoice, run_table

_FIRST = "twist_mm"
"""What lines are coloured by at first: what makes a vehicle derail."""


@dataclass(frozen=True)
class StoreContent:
    """The content of a page of a store.

    ``runs`` are rows of the catalogue, ``lines`` the sections of each line by name, ``unread`` the number of results
    whose sections are not in them yet. ``progress`` says how far running batches are.
    """

    place: str
    runs: pd.DataFrame
    lines: Mapping[str, pd.DataFrame]
    quantities: tuple[str, ...]
    unread: int
    progress: str
    seen: str


def store_page(content: StoreContent, query: Mapping[str, str]) -> Page:
    """Return the page; ``query`` has the choice of runs (:class:`RunChoice`), and ``colour`` of the lines."""
    choice, shown = RunChoice.of_query(query), aspects(content.quantities)
    asked = query.get("colour", _FIRST)
    aspect = next((each for each in shown if each.name == asked), shown[0])
    chosen = choice.chosen(content.runs)
    colour = FormField("colour", "colour of lines", aspect.name, tuple((each.name, each.label) for each in shown))
    summary: tuple[Block, ...] = (
        _tiles(content.runs),
        Latest(progress_address(content.seen), content.progress),
        Form((colour, *choice.form(content.runs, len(chosen)))),
    )
    lines = {name: table for name, table in content.lines.items() if choice.line in ("", name)}
    sections = (
        PageSection("summary", "Store", summary),
        PageSection("lines", "Lines", (*coloured_lines(lines, aspect), Text(_note(content), "note"))),
        PageSection("runs", "Runs", _runs(chosen, choice)),
    )
    lines_of_all = counted(content.runs["line"].nunique(), "line")
    subtitle = f"{counted(len(content.runs), 'run')} of {lines_of_all}"
    return Page("store", content.place, subtitle, sections, origin=(("all runs", STORE),))


def _tiles(runs: pd.DataFrame) -> Tiles:
    done = runs[runs["status"] == "done"]
    months = sorted(set(runs.loc[runs["start"].notna(), "month"]))
    span = "" if not months else months[0] if len(months) == 1 else f"{months[0]} to {months[-1]}"
    failed = len(runs) - len(done)
    return Tiles(
        (
            Tile("runs with a result", str(len(done)), span),
            Tile("failed runs", str(failed), "each says why" if failed else ""),
            Tile("lines", str(runs["line"].nunique())),
            Tile("measured", length(float(done["distance_m"].sum())), "all runs together"),
        )
    )


def _note(content: StoreContent) -> str:
    if content.unread:
        return f"The results of {content.unread} more runs are being read: reload the page."
    if not content.lines:
        return "No run covers a section of 200 m."
    return (
        "Standard deviations over sections of 200 m, of the newest run over each; growth of runs of at least three "
        "dates, where it is more than two sigmas above zero and 0.1 mm a month or more. A line's name leads to all of "
        "its sections."
    )


def _runs(chosen: pd.DataFrame, choice: RunChoice) -> tuple[Block, ...]:
    if chosen.empty:
        return (Text("No run is as asked for."),)
    first = choice.first_row(len(chosen))
    rows = chosen.iloc[first : first + MOST_ROWS]
    caption = f"{first + 1} to {first + len(rows)} of {len(chosen)}, the newest first"
    return (run_table(rows, caption),)

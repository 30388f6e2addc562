"""The page of a line: its sections in colours and numbers, and its runs."""

from __future__ import annotations

import pandas as pd

from trackfg.report.consistency import named
from trackfg.report.numbers import digits, with_sd
from trackfg.report.page import Block, Page, PageSection, PageTable, TableRow, Text, folded_if_long
from trackfg.report.store.addresses import STORE, section_address
from trackfg.report.store.line_colours import Aspect, aspects, coloured_sections
from trackfg.report.store.run_list import MOST_ROWS, RunChoice, run_table


def line_page(line: str, runs: pd.DataFrame, sections: pd.DataFrame | None, quantities: tuple[str, ...]) -> Page:
    """Return the page; ``runs`` are the catalogue's rows of the line, ``sections`` None where none is known."""
    shown = aspects(quantities)
    blocks: tuple[Block, ...] = (Text("No run covers a section of 200 m."),)
    if sections is not None:
        bar = coloured_sections(line, sections, shown)
        table = _table(line, sections, shown)
        blocks = (*([] if bar is None else [bar]), Text(_NOTE, "note"), *folded_if_long(table, "sections"))
    listed = RunChoice().chosen(runs)
    caption = f"The newest {min(MOST_ROWS, len(listed))} of {len(listed)}"
    parts = (
        PageSection("sections", "Sections of 200 m", blocks),
        PageSection("runs", "Runs", (run_table(listed.head(MOST_ROWS), caption),)),
    )
    return Page("line", f"line {line}", f"{len(listed)} runs", parts, origin=(("all runs", STORE),))


_NOTE = (
    "Standard deviations over the section, with one sigma, of the newest run over it, and their growth over all runs "
    "with one sigma, in mm a month. The sigma of cross-level's holds that of its offset, too. A section's place leads "
    "to all of its runs, laid over each other."
)


def _table(line: str, sections: pd.DataFrame, shown: tuple[Aspect, ...]) -> PageTable:
    headings = ("from km", "to km", *(f"{_short(aspect)}, {aspect.unit}" for aspect in shown))
    rows = tuple(
        TableRow(
            (
                f"{1e-3 * row['from_m']:.3f}",
                f"{1e-3 * row['to_m']:.3f}",
                *(_number(row[aspect.name], row[f"{aspect.name}_sd"]) for aspect in shown),
            ),
            link=section_address(line, row["from_m"]),
        )
        for row in sections.to_dict("records")
    )
    return PageTable(headings, rows, frozenset(range(len(headings))))


def _short(aspect: Aspect) -> str:
    name = named(aspect.quantity).name
    return f"growth of {name}" if aspect.growth else name


def _number(value: float, sd: float) -> str:
    return with_sd(value, sd, "") if sd > 0.0 else digits(value)

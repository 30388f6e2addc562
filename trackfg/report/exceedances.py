"""The section of a page about limits: where the geometry exceeds them, and what could not be judged."""

from __future__ import annotations

import math

import pandas as pd

from trackfg.geometry.exceedances import Judgement
from trackfg.plots.sheet import RED
from trackfg.report.charts import Span
from trackfg.report.numbers import digits, with_sd
from trackfg.report.page import Block, Fold, PageSection, PageTable, TableRow, Text
from trackfg.results.official_places import KM_COLUMN

_MANY = 25
"""Rows of a table that stand open; longer ones are folded."""


def exceedance_spans(judgement: Judgement | None, scale: float) -> tuple[Span, ...]:
    """Return the stretches to shade in the chart of the geometry. ``scale`` brings metres into the unit of its axis."""
    if judgement is None:
        return ()
    found = judgement.found
    return tuple(
        Span(scale * start, scale * end, RED) for start, end in zip(found["from_m"], found["to_m"], strict=True)
    )


def exceedance_section(judgement: Judgement) -> PageSection:
    """Return the section: how many exceedances there are, each of them, and the limits that were not judged."""
    found = judgement.found
    blocks: list[Block] = []
    if found.empty:
        blocks.append(Text("No exceedance of the limits that could be judged.", "good"))
    else:
        counts = ", ".join(f"{number} of {level}" for level, number in found["level"].value_counts().items())
        blocks.append(Text(f"Exceedances: {counts}. They are shaded red in the chart above.", "warning"))
        table = _table(found)
        blocks.append(table if len(found) <= _MANY else Fold(f"All {len(found)} exceedances", (table,)))
    if judgement.not_judged:
        rows = tuple(
            TableRow((quantity, ", ".join(levels), reason))
            for (quantity, reason), levels in judgement.not_judged_levels().items()
        )
        blocks.append(Fold("Limits that were not judged", (PageTable(("limit", "class", "why"), rows),)))
    return PageSection("limits", "Exceedances of limits", tuple(blocks))


def _table(found: pd.DataFrame) -> PageTable:
    rows = tuple(
        TableRow(
            (
                row.get(KM_COLUMN) or f"{1e-3 * row['chainage_m']:.3f}",
                f"{row['from_m']:.2f}",
                f"{row['to_m']:.2f}",
                f"{row['length_m']:.2f}",
                f"{row['parameter'].replace('_', ' ')}, {row['kind']}",
                row["column"],
                _value(row["value_mm"], row["value_mm_sd"]),
                digits(row["limit_mm"]),
                f"{row['level']} ({row['standard']})",
            )
        )
        for row in found.to_dict("records")
    )
    headings = ("km", "from, m", "to, m", "length, m", "quantity", "column", "value, mm", "limit, mm", "class")
    return PageTable(headings, rows, numbers=frozenset((0, 1, 2, 3, 6, 7)))


def _value(value: float, sd: float) -> str:
    return digits(value) if math.isnan(sd) else with_sd(value, sd, "")

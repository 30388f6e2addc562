"""The section of a page about limits: where to send the gang first, and what could not be judged."""

from __future__ import annotations

import math

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from trackfg.geometry.exceedances import Judgement
from trackfg.numerics.arrays import Array
from trackfg.numerics.units import KMH
from trackfg.plots.sheet import RED
from trackfg.report.charts import Span
from trackfg.report.numbers import digits, with_sd
from trackfg.report.page import Block, Fold, PageSection, PageTable, TableRow, Text
from trackfg.results.official_places import KM_COLUMN
from trackfg.results.result import Result

_MANY = 25
"""Rows of a table that stand open; longer ones go on folded."""
_FAMILY = ["standard", "parameter", "column", "kind"]
"""Limits that agree in these are levels of one another."""


def exceedance_spans(judgement: Judgement | None, scale: float) -> tuple[Span, ...]:
    """Return the stretches to shade in the chart of the geometry. ``scale`` brings metres into the unit of its axis."""
    if judgement is None:
        return ()
    found = judgement.found
    return tuple(
        Span(scale * start, scale * end, RED) for start, end in zip(found["from_m"], found["to_m"], strict=True)
    )


def exceedance_section(judgement: Judgement, result: Result) -> PageSection:
    """Return the section: the exceedances by severity, and the limits that were not judged."""
    found = by_severity(judgement.found)
    blocks: list[Block] = []
    if found.empty:
        blocks.append(Text("No exceedance of the limits that could be judged.", "good"))
    else:
        counts = ", ".join(f"{number} of {level}" for level, number in found["level"].value_counts(sort=False).items())
        blocks.append(Text(f"Exceedances: {counts}. They are shaded red in the strips.", "warning"))
        blocks.append(_table(found.head(_MANY), result))
        if len(found) > _MANY:
            blocks.append(Fold(f"{len(found) - _MANY} more", (_table(found.iloc[_MANY:], result),)))
        note = (
            "The severest level first, within it the greatest share of its limit. A place that exceeds several levels "
            "of a limit stands under the severest, whose limit is the largest. Speed is the run's at the peak."
        )
        blocks.append(Text(note, "note"))
    if judgement.not_judged:
        rows = tuple(
            TableRow((quantity, levels, reason)) for (quantity, reason), levels in judgement.not_judged_levels().items()
        )
        blocks.append(Fold("Limits that were not judged", (PageTable(("limit", "class", "why"), rows),)))
    return PageSection("limits", "Exceedances of limits: where to send the gang", tuple(blocks))


def by_severity(found: pd.DataFrame) -> pd.DataFrame:
    """Return exceedances, the severest first, without those that a severer level of the same limit overlaps.

    Of two levels the one with the larger limit is the severer; over all quantities levels are ordered by the median of
    their limit over the least limit of the same family that is exceeded. Within a level the order is that of the peak
    over its limit.
    """
    if found.empty:
        return found
    severest = found[~_under_a_severer_one(found)]
    size = found["limit_mm"] / found.groupby(_FAMILY)["limit_mm"].transform("min")
    rank = size.groupby(found["level"]).median()
    order = pd.DataFrame(
        {"rank": severest["level"].map(rank), "ratio": severest["value_mm"].abs() / severest["limit_mm"]}
    ).sort_values(["rank", "ratio"], ascending=False, kind="stable")
    return severest.loc[order.index].reset_index(drop=True)


def _under_a_severer_one(found: pd.DataFrame) -> NDArray[np.bool_]:
    """Return whether a larger limit of the same family is exceeded within the stretch of each row, bool (n,)."""
    out = np.zeros(len(found), dtype=bool)
    for rows in found.reset_index(drop=True).groupby(_FAMILY).indices.values():
        table = found.iloc[rows]
        start, end, limit = (table[name].to_numpy() for name in ("from_m", "to_m", "limit_mm"))
        for value in np.unique(limit)[1:]:
            above, below = limit == value, limit < value
            out[rows[below]] |= _overlap(start[below], end[below], start[above], end[above])
    return out


def _overlap(start: Array, end: Array, others_start: Array, others_end: Array) -> NDArray[np.bool_]:
    """Return whether each stretch meets any of the others: more of them have begun at its end than ended before it."""
    begun = np.searchsorted(np.sort(others_start), end, side="right")
    ended = np.searchsorted(np.sort(others_end), start, side="left")
    return np.asarray(begun > ended)


def _table(found: pd.DataFrame, result: Result) -> PageTable:
    chainage, speed = (result.geometry[name].to_numpy() for name in ("chainage_m", "speed_mps"))
    rows = tuple(
        TableRow(
            (
                f"{row['level']} ({row['standard']})",
                row.get(KM_COLUMN) or f"{1e-3 * row['chainage_m']:.3f}",
                f"{row['length_m']:.2f}",
                f"{row['parameter'].replace('_', ' ')}, {row['kind']}",
                _value(row["value_mm"], row["value_mm_sd"]),
                digits(row["limit_mm"]),
                f"{100.0 * abs(row['value_mm']) / row['limit_mm']:.0f}",
                digits(float(np.interp(row["chainage_m"], chainage, speed)) / KMH),
                f"{row['from_m']:.2f}",
                f"{row['to_m']:.2f}",
                row["column"],
            )
        )
        for row in found.to_dict("records")
    )
    headings = (
        "class",
        "km",
        "length, m",
        "quantity",
        "peak, mm",
        "limit, mm",
        "% of limit",
        "speed, km/h",
        "from, m",
        "to, m",
        "column",
    )
    return PageTable(headings, rows, numbers=frozenset((1, 2, 4, 5, 6, 7, 8, 9)))


def _value(value: float, sd: float) -> str:
    return digits(value) if math.isnan(sd) else with_sd(value, sd, "")

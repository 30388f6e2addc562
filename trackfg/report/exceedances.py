"""The section of a page about limits: where to send the gang first, and what could not be judged."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd

from trackfg.geometry.exceedances import Judgement
from trackfg.numerics.units import KMH
from trackfg.plots.sheet import RED
from trackfg.report.charts import ChartPlace, Span
from trackfg.report.page import Block, Fold, PageSection, PageTable, TableRow, Text, Tile
from trackfg.report.severity import (
    by_kilometre,
    by_severity,
    counts_text,
    place_text,
    quantity_text,
    unsure_text,
    value_text,
)
from trackfg.report.track_limits import doubt_about
from trackfg.results.result import Result
from trackfg.results.verdict import NOT_TRUSTED

_MANY = 25
"""Rows of a table that stand open; longer ones go on folded."""


def exceedance_spans(judgement: Judgement | None, columns: Sequence[str], scale: float) -> tuple[Span, ...]:
    """Return the stretches to shade in the chart of the geometry, each in the panel of what is exceeded.

    ``columns`` are those of the panels; ``scale`` brings metres into the unit of the axis.
    """
    if judgement is None:
        return ()
    exceedances = judgement.found.drop_duplicates(["column", "from_m", "to_m"])
    stretches = zip(exceedances["column"], exceedances["from_m"], exceedances["to_m"], strict=True)
    return tuple(
        Span(scale * start, scale * end, RED, panel)
        for name, start, end in stretches
        for panel in _panels_of(name, columns)
    )


def _panels_of(judged: str, columns: Sequence[str]) -> Sequence[int | None]:
    """Return the panels that show what was judged; None, for all of them, where none does.

    A quantity of another chord or band, such as ``versine_level_18.8976m_mm``, is shaded where ``versine_level_mm`` is,
    and one of the centre line, such as ``level_d2_mm``, where both rails are.
    """
    stems = [name.removesuffix("_mm") for name in columns]
    judged = judged.removeprefix("profile_")
    shown = [i for i, stem in enumerate(stems) if judged.startswith(f"{stem}_")]
    if shown:
        return [max(shown, key=lambda i: len(stems[i]))]
    quantity = judged.partition("_")[0]
    rails = [i for i, stem in enumerate(stems) if stem in (f"{quantity}_left", f"{quantity}_right")]
    return rails or [None]


def exceedance_places(judgement: Judgement | None) -> list[ChartPlace]:
    """Return the exceedances as places beside the axis, each once, m."""
    if judgement is None:
        return []
    rows = by_severity(judgement.found).to_dict("records")
    return [ChartPlace(row["from_m"], row["to_m"], f"{quantity_text(row)}, {row['level']}", "exceeded") for row in rows]


def exceedance_tile(judgement: Judgement) -> Tile:
    """Return the headline: how many exceedances there are, and of which level the most severe is."""
    exceedances = by_severity(judgement.found)
    severest = "none" if exceedances.empty else f"the severest: {exceedances['level'].iloc[0]}"
    doubted = int((~exceedances["trusted"].astype(bool)).sum())
    return Tile("exceedances", str(len(exceedances)), severest + (f"; {doubted} {NOT_TRUSTED}" if doubted else ""))


def doubt_text(doubt: str) -> Text:
    """Return the warning above what is computed from quantities that are not to be trusted."""
    return Text(f"{doubt[0].upper()}{doubt[1:]}.", "warning")


def exceedance_section(judgement: Judgement, result: Result) -> PageSection:
    """Return the section: the exceedances by severity, and the limits that were not judged."""
    exceedances = by_severity(judgement.found)
    doubt = doubt_about(result)
    blocks: list[Block] = [doubt_text(doubt)] if doubt else []
    if exceedances.empty:
        blocks.append(Text("No exceedance of the limits that could be judged.", "plain" if doubt else "good"))
    else:
        counts = counts_text({str(level): int(n) for level, n in exceedances["level"].value_counts(sort=False).items()})
        warning = f"Exceedances: {counts}. {unsure_text(exceedances)}".rstrip()
        blocks.append(Text(f"{warning} They are shaded red in the strips.", "warning"))
        blocks.append(_kilometres(exceedances))
        blocks.append(_table(exceedances.head(_MANY), result))
        if len(exceedances) > _MANY:
            blocks.append(Fold(f"{len(exceedances) - _MANY} more", (_table(exceedances.iloc[_MANY:], result),)))
        note = (
            "The severest level first, within it the greatest share of its limit; after them those by less than 1.96 "
            "sigma. A place that exceeds several levels of a limit stands under the severest, whose limit is the "
            "largest. Speed is the run's at the peak."
        )
        blocks.append(Text(note, "note"))
    for title, last, grouped in (
        ("Limits that were not judged", "why", judgement.not_judged_levels()),
        ("Limits that were not judged everywhere", "not known, m", judgement.unknown_levels()),
    ):
        if grouped:
            rows = TableRow.plain((quantity, levels, text) for (quantity, text), levels in grouped.items())
            blocks.append(Fold(title, (PageTable(("limit", "class", last), rows),)))
    return PageSection("limits", "Exceedances of limits: where to send the gang", tuple(blocks), "Exceedances")


def _kilometres(exceedances: pd.DataFrame) -> PageTable:
    """Return how many exceedances each kilometre has, by level, and the worst of them."""
    rows = TableRow.plain(
        (
            kilometre.km,
            str(kilometre.count),
            counts_text(kilometre.counts),
            f"{kilometre.length_m:.1f}",
            quantity_text(kilometre.worst),
            place_text(kilometre.worst),
            f"{100.0 * kilometre.share:.0f}",
        )
        for kilometre in by_kilometre(exceedances)
    )
    headings = ("km", "exceedances", "by class", "length, m", "worst", "at km", "% of limit")
    return PageTable(headings, rows, numbers=frozenset((0, 1, 3, 5, 6)), caption="By kilometre")


def _table(exceedances: pd.DataFrame, result: Result) -> PageTable:
    chainage, speed = (result.geometry[name].to_numpy() for name in ("chainage_m", "speed_mps"))
    rows = TableRow.plain(
        (
            place_text(row),
            quantity_text(row),
            value_text(row),
            f"{row['limit_mm']:.2f}",
            f"{100.0 * abs(row['value_mm']) / row['limit_mm']:.0f}",
            f"{row['length_m']:.2f}",
            f"{row['level']} ({row['standard']})",
            f"{float(np.interp(row['chainage_m'], chainage, speed)) / KMH:.1f}",
            f"{row['from_m']:.2f}",
            f"{row['to_m']:.2f}",
        )
        for row in exceedances.to_dict("records")
    )
    headings = (
        "km",
        "quantity",
        "peak, mm",
        "limit, mm",
        "% of limit",
        "length, m",
        "class",
        "speed, km/h",
        "from, m",
        "to, m",
    )
    return PageTable(headings, rows, numbers=frozenset((0, 2, 3, 4, 5, 7, 8, 9)), caption="One by one")

"""The page of a section: all runs over it laid over each other, and what each of them says of it, over time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from trackfg.plots.scales import with_margin
from trackfg.plots.sheet import BAND, BLUE
from trackfg.report.charts import ChartLine, ChartPanel, Strips, whole_range
from trackfg.report.columns import packed, packed_sigma, packed_value
from trackfg.report.consistency import named
from trackfg.report.numbers import with_sd
from trackfg.report.page import Block, Drawing, Page, PageSection, PageTable, TableRow, Text
from trackfg.report.runs.overlay_page import doubt_texts, marked, runs_chart
from trackfg.report.store.addresses import STORE, line_address, run_address

if TYPE_CHECKING:
    from trackfg.mapping.trends.series import Series

_OLDEST, _NEWEST = (158, 197, 229), (11, 47, 92)
"""Colours of the oldest and the newest run, red, green and blue; those between lie on the line between."""
_MOST_NAMED = 4
"""Runs whose names stand beside the chart: more do not fit on a telephone. All are in the table below it."""
_DAY_STEP = 0.01
"""Accuracy of dates in the chart, days."""


@dataclass(frozen=True)
class RunOverSection:
    """A run's name, when it began (None: not known), its geometry over the section, and what of it is not trusted."""

    run: str
    start: datetime | None
    geometry: pd.DataFrame
    doubt: str = ""

    @property
    def label(self) -> str:
        """Return date and name."""
        return self.run if self.start is None else f"{self.start:%Y-%m-%d} {self.run}"


def section_page(
    line: str, ends_m: tuple[float, float], runs: Sequence[RunOverSection], history: Series | None, others: str
) -> Page:
    """Return the page of the section between ``ends_m``; ``runs`` begin with the oldest.

    ``history``: the series of the line's sections. ``others``: the address of the page with the runs that are left out;
    empty where all are shown.
    """
    title = f"km {1e-3 * ends_m[0]:.3f} to {1e-3 * ends_m[1]:.3f}"
    parts = [PageSection("runs", "All runs", _overlay(runs, ends_m))]
    if history is not None:
        parts.append(PageSection("history", "Over time", _history(history, ends_m[0])))
    above = (("all runs", STORE), (f"line {line}", line_address(line)), *([("every run", others)] if others else []))
    return Page("section", f"line {line}, {title}", f"{len(runs)} runs", tuple(parts), origin=above)


def _overlay(runs: Sequence[RunOverSection], ends_m: tuple[float, float]) -> tuple[Block, ...]:
    if not runs:
        return (Text("No run covers this section."),)
    shares = np.linspace(0.0, 1.0, len(runs)) if len(runs) > 1 else np.ones(1)
    doubts = {run.label: run.doubt for run in runs}
    colours = {marked(run.label, doubts): _colour(float(share)) for run, share in zip(runs, shares, strict=True)}
    span = runs[0].label if len(runs) == 1 else f"from {runs[0].label} to {runs[-1].label}"
    note = f"Each run lies at the chainage that its result gives it; the older it is, the fainter: {span}."
    chart = runs_chart(colours, [run.geometry for run in runs], ends_m)
    return (*doubt_texts(doubts), Drawing(replace(chart, legend=len(runs) <= _MOST_NAMED), note=note))


def _colour(share: float) -> str:
    mixed = (round(old + share * (new - old)) for old, new in zip(_OLDEST, _NEWEST, strict=True))
    return "#" + "".join(f"{part:02x}" for part in mixed)


def _history(history: Series, from_m: float) -> tuple[Block, ...]:
    """Return a chart of the section's standard deviations over time, and a table with a row per run."""
    at = int(np.argmin(np.abs(history.chainage_m - from_m)))
    known = np.any([np.isfinite(value[:, at]) for value in history.value.values()], axis=0)
    if abs(history.chainage_m[at] - from_m) > 0.5 * history.step_m or not known.any():
        return (Text("No run covers enough of this section."),)
    rows = tuple(
        TableRow(
            (
                history.runs[i],
                f"{history.dates[i]:%Y-%m-%d %H:%M}",
                *(with_sd(value[i, at], history.sd[name][i, at], "") for name, value in history.value.items()),
            ),
            link=run_address(history.runs[i]),
        )
        for i in np.flatnonzero(known)[::-1]
    )
    headings = ("run", "begin, UTC", *(f"SD of {named(name).name}, mm" for name in history.value))
    table = PageTable(headings, rows, frozenset(range(1, len(headings))), "One sigma behind each value")
    title = "Standard deviations over the section"
    return (*([Drawing(_chart(history, at, known), title)] if known.sum() > 1 else []), table)


def _chart(history: Series, at: int, known: np.ndarray) -> Strips:
    days = history.t_days[known]
    x = packed(days, _DAY_STEP)
    panels = []
    for name, value in history.value.items():
        y, sd = value[known, at], history.sd[name][known, at]
        if np.isfinite(y).any():
            line = ChartLine("runs", BLUE, x, packed_value(y, sd), packed_sigma(sd))
            extent = with_margin(float(np.nanmin(y - BAND * sd)), float(np.nanmax(y + BAND * sd)))
            panels.append(ChartPanel(named(name).name.replace(" ", "\n"), "mm", (line,), extent))
    label = f"days since {history.dates[0]:%Y-%m-%d}"
    return Strips(label, "days", whole_range(days), tuple(panels))

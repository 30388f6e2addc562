"""The page of trends: when limits are reached, where the track drifts and how fast, and where it was worked on."""

from __future__ import annotations

from collections.abc import Hashable, Mapping
from typing import Any

import numpy as np
import pandas as pd

from trackfg.plots.scales import with_margin
from trackfg.plots.sheet import BAND, BLUE
from trackfg.report.charts import ChartLine, ChartPanel, Strips, whole_range
from trackfg.report.columns import packed, packed_sigma, packed_value
from trackfg.report.consistency import named
from trackfg.report.geometry_charts import chainage_axis
from trackfg.report.numbers import NONE, digits, length, with_sd
from trackfg.report.page import (
    Block,
    Code,
    Drawing,
    Facts,
    Page,
    PageSection,
    PageTable,
    TableRow,
    Text,
    Tile,
    Tiles,
    folded_if_long,
)
from trackfg.results.trends import Trends

_DRAWN = 6
"""Trends that are drawn over time, those of the most sigmas: a panel each, as many as a screen shows."""
_DAY, _PLACE_M = 0.01, 1e-3
"""Accuracy of dates and of places in the page, days and m."""
_SD = "_sd"
_MADE = "The trends are those that trackfg map trends wrote. This page was made of them by"

Row = Mapping[Hashable, Any]


def trend_page(found: Trends, title: str, command: str) -> Page:
    """Return the page; ``command`` is what made it. Of ``values``, the rows at places of trends are needed."""
    rate = f"rate_mm_per_{found.per}"
    sigmas = (found.trends[rate] / found.trends[f"{rate}{_SD}"]).abs()
    strongest = found.trends.loc[sigmas.sort_values(ascending=False, kind="stable").index]
    sections = (
        PageSection("summary", "Summary", _summary(found)),
        PageSection("limits", "When limits are reached", _reached(found), "Limits"),
        PageSection("trends", "Trends, the most certain first", _trends(found, strongest), "Trends"),
        *([PageSection("history", "Over time", _histories(strongest, found.values))] if len(strongest) else []),
        PageSection("rates", f"Rates along the line, {found.unit}", _rates(found), "Rates"),
        PageSection("steps", "Steps: work on the track, or damage", _steps(found.steps), "Steps"),
        PageSection("sections", "Sections of 200 m", _sections(found), "Sections"),
        PageSection("made", "How it was made", (Text(_MADE), Code(command)), "Made"),
    )
    runs, dates = found.section_values["run"].nunique(), found.section_values["date"]
    span = f"{dates.min():%Y-%m-%d} to {dates.max():%Y-%m-%d}" if runs else "without a date"
    return Page("trends", title, f"{runs} runs, {span}", sections)


def _summary(trends: Trends) -> tuple[Block, ...]:
    first = min((date for date in trends.reached["reached_on"] if date), default=NONE)
    tiles = Tiles(
        (
            Tile("trends", str(len(trends.trends)), "places where the track drifts"),
            Tile("steps", str(len(trends.steps)), "places where it jumped"),
            Tile("first limit reached", first),
            Tile("looked at", length(float(np.ptp(trends.cells["chainage_m"])))),
        )
    )
    doubts = (Text(doubt, "warning") for doubt in trends.doubts.values())
    if not trends.left_out:
        return (tiles, *doubts)
    left_out = tuple(("; ".join(names), reason) for names, reason in trends.left_out_by_reason())
    return (tiles, *doubts, Text("Left out:", "warning"), Facts(left_out))


def _reached(trends: Trends) -> tuple[Block, ...]:
    if trends.reached.empty:
        return (Text("No trend is held against a limit, or none was given."),)
    order = trends.reached["reached_on"].replace("", "9999").sort_values(kind="stable").index
    rate = f"rate_mm_per_{trends.per}"
    rows = TableRow.plain(
        (
            *_place(row),
            str(row["limit"]),
            digits(row["limit_mm"]),
            digits(row["value_mm"]),
            digits(row[rate]),
            *(row[name] or NONE for name in ("reached_on", "earliest", "latest")),
        )
        for row in trends.reached.loc[order].to_dict("records")
    )
    values = ("limit", "limit, mm", "value, mm", trends.unit, "reached on", "earliest", "latest")
    note = Text("Earliest and latest are the interval of two sigmas; without a latest, the rate may be zero.", "note")
    return (note, *folded_if_long(PageTable((*_PLACE, *values), rows, frozenset({0, 1, 2, 5, 6, 7})), "dates"))


def _trends(trends: Trends, strongest: pd.DataFrame) -> tuple[Block, ...]:
    if strongest.empty:
        return (Text("No trend: the track does not change by more than noise.", "good"),)
    rate = f"rate_mm_per_{trends.per}"
    rows = TableRow.plain(
        (
            *_place(row),
            with_sd(row[rate], row[f"{rate}{_SD}"], ""),
            with_sd(row["value_mm"], row["value_mm_sd"], ""),
            str(row["runs"]),
            row["last_step"] or NONE,
        )
        for row in strongest.to_dict("records")
    )
    headings = (*_PLACE, f"rate, {trends.unit}", "value at the last date, mm", "runs", "last step")
    return folded_if_long(PageTable(headings, rows, frozenset({0, 1, 2, 4, 5, 6})), "trends")


def _steps(steps: pd.DataFrame) -> tuple[Block, ...]:
    if steps.empty:
        return (Text("No step."),)
    rows = TableRow.plain(
        (*_place(row), row["date"], with_sd(row["step_mm"], row["step_mm_sd"], ""), str(row["runs_after"]))
        for row in steps.to_dict("records")
    )
    headings = (*_PLACE, "first run after it", "step, mm", "runs since")
    return folded_if_long(PageTable(headings, rows, frozenset({0, 1, 2, 5, 6})), "steps")


_PLACE = ("from km", "to km", "at km", "quantity")


def _place(row: Row) -> tuple[str, ...]:
    return (*(f"{1e-3 * row[name]:.3f}" for name in ("from_m", "to_m", "at_m")), named(row["quantity"]).name)


def _histories(strongest: pd.DataFrame, values: pd.DataFrame) -> tuple[Block, ...]:
    """Return a chart with a panel per trend: what each run says at its place."""
    first = values["date"].min()
    days = ((values["date"] - first) / pd.Timedelta(days=1)).to_numpy(dtype=np.float64)
    panels = []
    for row in strongest.head(_DRAWN).to_dict("records"):
        at = (values["chainage_m"] == row["at_m"]).to_numpy()
        y, sd = (values[f"{row['quantity']}{end}"].to_numpy(dtype=np.float64)[at] for end in ("", _SD))
        line = ChartLine("runs", BLUE, packed(days[at], _DAY), packed_value(y, sd), packed_sigma(sd))
        panels.append(ChartPanel(f"{named(row['quantity']).name}\nkm {1e-3 * row['at_m']:.3f}", "mm", (line,)))
    chart = Strips(f"days since {first:%Y-%m-%d}", "days", whole_range(days), tuple(panels))
    return (Drawing(chart, note="What each run says at the place of the trend. Bands: 95 % (1.96 sigma)."),)


def _rates(trends: Trends) -> tuple[Block, ...]:
    chainage = trends.cells["chainage_m"].to_numpy(dtype=np.float64)
    unit, scale = chainage_axis(chainage)
    x, panels = packed(scale * chainage, scale * _PLACE_M), []
    for column in trends.cells:
        if str(column).endswith(f"_per_{trends.per}"):
            rate, sd = (trends.cells[f"{column}{end}"].to_numpy(dtype=np.float64) for end in ("", _SD))
            if np.isfinite(rate).any():
                line = ChartLine("rate", BLUE, x, packed_value(rate, sd), packed_sigma(sd))
                extent = with_margin(float(np.nanmin(rate - BAND * sd)), float(np.nanmax(rate + BAND * sd)))
                name = named(str(column).removesuffix(f"_per_{trends.per}")).name.replace(" ", "\n")
                panels.append(ChartPanel(name, "mm", (line,), extent, base=0.0))
    if not panels:
        return (Text("No cell has a rate."),)
    return (Drawing(Strips(f"chainage, {unit}", unit, whole_range(scale * chainage), tuple(panels))),)


def _sections(trends: Trends) -> tuple[Block, ...]:
    quantities = [str(name).removesuffix("_runs") for name in trends.sections if str(name).endswith("_runs")]
    columns = [column for name in quantities for column in (name, f"{name}_per_{trends.per}")]
    rows = TableRow.plain(
        (f"{1e-3 * row['chainage_m']:.3f}", *(with_sd(row[name], row[f"{name}{_SD}"], "") for name in columns))
        for row in trends.sections.dropna(subset=quantities, how="all").to_dict("records")
    )
    words = [text for name in quantities for text in (f"SD of {named(name).name}, mm", f"growth, {trends.unit}")]
    return folded_if_long(PageTable(("from km", *words), rows, frozenset(range(len(words) + 1))), "sections")

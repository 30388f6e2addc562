"""The page of an overlay: all runs over one chainage, the shift of each by its sections, and how well they repeat."""

from __future__ import annotations

from collections.abc import Hashable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from trackfg.plots.geometry_channels import channel_extent
from trackfg.plots.scales import with_margin
from trackfg.plots.sheet import BAND, BLUE
from trackfg.report.charts import PALETTE, ChartLine, ChartPanel, Strips, whole_range
from trackfg.report.columns import packed, packed_sigma, packed_value
from trackfg.report.consistency import named
from trackfg.report.geometry_charts import chainage_axis, channels_of_any
from trackfg.report.numbers import digits, length
from trackfg.report.page import Code, Drawing, Page, PageSection, PageTable, TableRow, Text, Tile, Tiles, folded_if_long
from trackfg.results.verdict import NOT_TRUSTED

if TYPE_CHECKING:
    from trackfg.mapping.runs.run_overlay import RunOverlay

_PLACE_M = 1e-3
"""Accuracy of the chainage in the page, m."""


def overlay_page(overlay: RunOverlay, command: str, doubts: Mapping[str, str]) -> Page:
    """Return the page; ``command`` is what made it, ``doubts`` of each run which quantities are not to be trusted."""
    reference = overlay.geometries[0]["chainage_m"].to_numpy()
    unit, scale = chainage_axis(reference)
    x_range = whole_range(scale * reference)
    colours = {marked(name, doubts): colour for name, colour in _colours(overlay.names).items()}
    chart = runs_chart(colours, overlay.geometries, whole_range(reference), first_wide=True)
    title = ", ".join(overlay.names)
    subtitle = f"{len(overlay.names)} runs over the chainage of {overlay.names[0]}"
    sections = (
        _summary(overlay),
        PageSection("runs", "All runs", (*doubt_texts(doubts), Drawing(chart, note=_NOTE))),
        _shift_section(overlay, unit, scale, x_range),
        _repeatability_section(overlay.repeatability),
        PageSection("made", "How it was made", (Text("This page was made by"), Code(command))),
    )
    return Page("overlay", title, subtitle, sections)


_NOTE = (
    "Each run lies where it was recognised on the first, whose line is the wide one. Click a name to hide it, "
    "double-click to see it alone."
)


def marked(name: str, doubts: Mapping[str, str]) -> str:
    """Return the name of a run as a chart has it: marked where some of its quantities are not to be trusted."""
    return f"{name} (doubted)" if doubts.get(name) else name


def doubt_texts(doubts: Mapping[str, str]) -> list[Text]:
    """Return a warning for each run of which some quantities are not to be trusted."""
    return [Text(f"{name}, {NOT_TRUSTED} in this run: {doubt}.", "warning") for name, doubt in doubts.items() if doubt]


def _colours(names: tuple[str, ...]) -> dict[str, str]:
    others = (PALETTE[i % len(PALETTE)] for i in range(len(names) - 1))
    return dict(zip(names, (BLUE, *others), strict=True))


def _summary(overlay: RunOverlay) -> PageSection:
    shifts = overlay.shifts
    tiles = [Tile("reference", overlay.names[0])]
    for name, table in shifts.groupby("run", sort=False):
        of_run = table["shift_m"]
        on_both = float((table["to_m"] - table["from_m"]).sum())
        remark = f"from {of_run.min():.2f} to {of_run.max():.2f} m, {len(table)} sections, {length(on_both)}"
        tiles.append(Tile(f"shift of {name}, median", f"{of_run.median():.2f} m", remark))
    return PageSection("summary", "Summary", (Tiles(tuple(tiles)),))


def runs_chart(
    colours: Mapping[str, str],
    geometries: Sequence[pd.DataFrame],
    x_range: tuple[float, float],
    *,
    first_wide: bool = False,
) -> Strips:
    """Return a panel per channel of any run, with a line per run that has it; ``x_range`` in m.

    ``colours``: of the runs by name, in the order of their geometries. ``first_wide``: the line of the first run is
    wide, to be seen beside the others.
    """
    unit, scale = chainage_axis(np.array(x_range))
    places = [packed(scale * table["chainage_m"].to_numpy(), scale * _PLACE_M) for table in geometries]
    panels = []
    first = next(iter(colours))
    for channel in channels_of_any(geometries):
        lines, extents = list[ChartLine](), []
        for (name, colour), table, x in zip(colours.items(), geometries, places, strict=True):
            if channel.column in table and table[channel.column].notna().any():
                values = channel.scale * table[channel.column].to_numpy(dtype=np.float64)
                lines.append(ChartLine(name, colour, x, packed_value(values), wide=first_wide and name == first))
                base = 0.0 if channel.deviation else float(np.nanmedian(values))
                both = channel if channel.twin in table else replace(channel, twin=None)
                extents.append(channel_extent(table, both, base))
        low, high = with_margin(min(low for low, _ in extents), max(high for _, high in extents))
        panels.append(ChartPanel(channel.label, channel.unit, tuple(lines), (low, high), share=channel.share))
    shown = scale * x_range[0], scale * x_range[1]
    return Strips(f"chainage, {unit}", unit, shown, tuple(panels), legend=True)


def _shift_section(overlay: RunOverlay, unit: str, scale: float, x_range: tuple[float, float]) -> PageSection:
    colour = _colours(overlay.names)
    lines, reach = [], []
    for name, table in overlay.shifts.groupby("run", sort=False):
        x = packed(scale * 0.5 * (table["from_m"] + table["to_m"]).to_numpy(), scale * _PLACE_M)
        shift, sd = table["shift_m"].to_numpy(), table["shift_m_sd"].to_numpy()
        lines.append(ChartLine(str(name), colour[str(name)], x, packed_value(shift, sd), packed_sigma(sd)))
        reach += [float((shift - BAND * sd).min()), float((shift + BAND * sd).max())]
    panel = ChartPanel("shift", "m", tuple(lines), with_margin(min(reach), max(reach)), base=0.0, share=2.0)
    note = "The run's chainage less the reference's at the same place of the track. Bands: 95 % (1.96 sigma)."
    chart = Strips(f"chainage, {unit}", unit, x_range, (panel,), legend=True)
    rows = folded_if_long(_shift_table(overlay.shifts), "sections")
    return PageSection("shifts", "Shift per section", (Drawing(chart, note=note), *rows))


def _shift_table(shifts: pd.DataFrame) -> PageTable:
    rows = TableRow.plain(
        (
            str(row["run"]),
            f"{row['from_m']:.1f}",
            f"{row['to_m']:.1f}",
            f"{row['shift_m']:.3f}",
            f"{row['shift_m_sd']:.3f}",
        )
        for row in shifts.to_dict("records")
    )
    headings = ("run", "from, m", "to, m", "shift, m", "1 sigma, m")
    return PageTable(headings, rows, numbers=frozenset(range(1, 5)))


def _repeatability_section(table: pd.DataFrame) -> PageSection:
    note = (
        "Standard deviation of run less reference over each section of 200 m; a constant difference does not count and "
        "stands in the last column, as its mean over the sections."
    )
    headings = ("run", "channel", "unit", "sections", "median", "95 % below", "greatest", "mean difference")
    rows = TableRow.plain(map(_cells, table.to_dict("records")))
    page_table = PageTable(headings, rows, numbers=frozenset(range(3, 8)))
    return PageSection("repeatability", "Repeatability", (Text(note, "note"), page_table))


def _cells(row: Mapping[Hashable, Any]) -> Iterator[str]:
    meaning = named(row["channel"])
    yield from (row["run"], meaning.name, meaning.unit, str(row["sections"]))
    for name in ("sd_median", "sd_95", "sd_max", "mean"):
        yield digits(meaning.scale * row[name])

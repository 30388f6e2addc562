"""Draw a :class:`trackfg.plots.sheet.Sheet` as PNG or SVG, with matplotlib and without a display."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.gridspec import GridSpec
from matplotlib.ticker import MaxNLocator

from trackfg.plots.sheet import AMBER, GREY, RED, SPAN_NAME, Panel, Sheet, limit_labels

_TEXT = "#222222"
_STYLE: dict[Any, Any] = {
    "font.family": "DejaVu Sans",
    "font.size": 9.0,
    "axes.edgecolor": GREY,
    "axes.labelcolor": _TEXT,
    "axes.linewidth": 0.8,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.axisbelow": True,
    "axes.formatter.useoffset": False,
    "xtick.color": GREY,
    "ytick.color": GREY,
    "xtick.labelcolor": _TEXT,
    "ytick.labelcolor": _TEXT,
    "grid.color": "#e5e7eb",
    "grid.linewidth": 0.8,
    "lines.linewidth": 1.2,
    "legend.frameon": False,
    "legend.fontsize": 8.0,
    "svg.hashsalt": "trackfg",
}
_STRIPS: dict[Any, Any] = {"font.size": 8.0, "ytick.labelsize": 6.5, "lines.linewidth": 0.7, "text.parse_math": False}


def write(sheet: Sheet, path: Path) -> None:
    """Draw ``sheet`` into ``path`` (``.png`` or ``.svg``); the same sheet gives the same file."""
    with mpl.rc_context(_STYLE):
        figure = _with_map(sheet) if sheet.paths else _strips(sheet)
        metadata = {"Date": None} if path.suffix == ".svg" else {"Software": None}
        figure.savefig(path, dpi=120 if sheet.paths else 180, metadata=metadata)


def _with_map(sheet: Sheet) -> Figure:
    figure = Figure(figsize=(12.0, 6.6), layout="constrained")
    figure.suptitle(sheet.title, x=0.012, ha="left", fontsize=12.5, fontweight="bold")
    grid = figure.add_gridspec(len(sheet.panels), 2, width_ratios=(1.0, 1.15), wspace=0.06)
    _map(figure.add_subplot(grid[:, 0]), sheet)
    for axes, panel in zip(_panels(figure, grid, sheet), sheet.panels, strict=True):
        axes.set_ylabel(panel.label)
        if len(panel.curves) > 1:
            axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3, borderaxespad=0.1, handlelength=1.4)
    return figure


def _strips(sheet: Sheet) -> Figure:
    """Draw on A4 landscape with margins that never change, so that sheets can be laid over each other."""
    with mpl.rc_context(_STRIPS):
        figure = Figure(figsize=(11.69, 8.27))
        figure.text(0.012, 0.985, sheet.title, ha="left", va="top", fontsize=11.0, fontweight="bold")
        figure.text(0.012, 0.010, sheet.footer, ha="left", va="bottom", fontsize=6.5, color=GREY, linespacing=1.4)
        shares = [panel.share for panel in sheet.panels]
        grid = figure.add_gridspec(
            len(shares), 1, height_ratios=shares, left=0.125, right=0.905, top=0.945, bottom=0.095, hspace=0.16
        )
        for axes, panel in zip(_panels(figure, grid, sheet), sheet.panels, strict=True):
            _strip(axes, panel, last=panel is sheet.panels[-1])
        return figure


def _strip(axes: Axes, panel: Panel, *, last: bool) -> None:
    """Draw a strip: labels that can be read without turning the head, few ticks, and what is drawn over the panel."""
    axes.spines["bottom"].set_visible(last)
    axes.tick_params(axis="x", bottom=last)
    _few_ticks(axes, panel)
    names = [panel]
    if panel.over is not None:
        names.append(panel.over)
        right = axes.twinx()
        right.spines["right"].set_visible(True)
        right.spines["bottom"].set_visible(last)
        _draw(right, panel.over)
        _few_ticks(right, panel.over)
    box = axes.get_position()
    middle = (box.y0 + box.y1) / 2.0
    for row, entry in enumerate(names):
        va = "center" if len(names) == 1 else ("bottom", "top")[row]
        text = f"{entry.label}\n" if va == "bottom" else entry.label
        axes.figure.text(0.012, middle, text, ha="left", va=va, color=entry.curves[0].colour)


def _panels(figure: Figure, grid: GridSpec, sheet: Sheet) -> list[Axes]:
    """Draw the panels in the last column of ``grid``, over a common axis."""
    column: list[Axes] = []
    for row, panel in enumerate(sheet.panels):
        axes = figure.add_subplot(grid[row, -1], sharex=column[0] if column else None)
        column.append(axes)
        _panel(axes, panel, sheet)
        axes.tick_params(labelbottom=row == len(sheet.panels) - 1)
    column[-1].set_xlabel(sheet.x_label)
    column[0].set_xlim(*sheet.x_range)
    return column


def _few_ticks(axes: Axes, panel: Panel) -> None:
    axes.yaxis.set_major_locator(MaxNLocator(3 if panel.share <= 1.0 else 6, steps=[1, 2, 5, 10]))
    axes.tick_params(length=2.5)


def _map(axes: Axes, sheet: Sheet) -> None:
    labels: set[str] = set()
    for line in sheet.paths:
        label = line.name if line.name not in labels else None
        labels.add(line.name)
        if line.dots:
            axes.plot(line.east_m, line.north_m, ".", color=line.colour, markersize=3.5, label=label, zorder=4)
        else:
            wide = line.name == SPAN_NAME
            axes.plot(
                line.east_m,
                line.north_m,
                color=line.colour,
                linewidth=6.0 if wide else 1.4,
                alpha=0.75 if wide else 1.0,
                solid_capstyle="butt",
                label=label,
                zorder=2 if wide else 3,
            )
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("east, m")
    axes.set_ylabel("north, m")
    axes.grid(visible=True)
    axes.legend(loc="best")


def _panel(axes: Axes, panel: Panel, sheet: Sheet) -> None:
    for start, end in sheet.spans:
        axes.axvspan(start, end, color=AMBER, alpha=0.25, linewidth=0)
    if panel.base is not None:
        axes.axhline(panel.base, color=GREY, linewidth=0.8, zorder=1.5)
    _draw(axes, panel)
    for limit in panel.limits:
        axes.plot(limit.x, limit.y, color=RED, linewidth=0.9, dashes=(5.0, 2.5), scalex=False, scaley=False)
    for y, label in limit_labels(panel):
        axes.text(1.004, y, label, transform=axes.transAxes, va="center", color=RED, fontsize=6.5)
    for x, text in panel.marks:
        axes.text(x, 0.985, text, transform=axes.get_xaxis_transform(), ha="center", va="top", fontsize=6.5)
    axes.grid(visible=True)


def _draw(axes: Axes, panel: Panel) -> None:
    for curve in panel.curves:
        if curve.half_band is not None:
            low, high = curve.y - curve.half_band, curve.y + curve.half_band
            axes.fill_between(curve.x, low, high, color=curve.colour, alpha=0.25, linewidth=0)
        if curve.dots:
            axes.plot(curve.x, curve.y, ".", color=curve.colour, markersize=3.0, label=curve.name)
        else:
            axes.plot(curve.x, curve.y, color=curve.colour, label=curve.name)
    if panel.log:
        axes.set_yscale("log")
        axes.yaxis.set_major_formatter("{x:g}")
    if panel.y_range is not None:
        axes.set_ylim(panel.y_range)

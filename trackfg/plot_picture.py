"""Draw a :class:`trackfg.plot_sheet.Sheet` as PNG or SVG, with matplotlib and without a display."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from trackfg.plot_sheet import AMBER, GREY, SPAN_NAME, Panel, Sheet

_STYLE: dict[Any, Any] = {
    "font.family": "DejaVu Sans",
    "font.size": 9.0,
    "axes.edgecolor": GREY,
    "axes.labelcolor": "#222222",
    "axes.linewidth": 0.8,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.axisbelow": True,
    "xtick.color": GREY,
    "ytick.color": GREY,
    "xtick.labelcolor": "#222222",
    "ytick.labelcolor": "#222222",
    "grid.color": "#e5e7eb",
    "grid.linewidth": 0.8,
    "legend.frameon": False,
    "legend.fontsize": 8.0,
    "svg.hashsalt": "trackfg",
}


def write(sheet: Sheet, path: Path) -> None:
    """Draw ``sheet`` into ``path`` (``.png`` or ``.svg``); the same sheet gives the same file."""
    with mpl.rc_context(_STYLE):
        figure = Figure(figsize=(12.0, 6.6), layout="constrained")
        figure.suptitle(sheet.title, x=0.012, ha="left", fontsize=12.5, fontweight="bold")
        grid = figure.add_gridspec(len(sheet.panels), 2, width_ratios=(1.0, 1.15), wspace=0.06)
        _map(figure.add_subplot(grid[:, 0]), sheet)
        first: Axes | None = None
        for row, panel in enumerate(sheet.panels):
            axes = figure.add_subplot(grid[row, 1], sharex=first)
            first = first or axes
            _panel(axes, panel, sheet)
            last_row = row == len(sheet.panels) - 1
            axes.tick_params(labelbottom=last_row)
            if last_row:
                axes.set_xlabel("time, s")
        metadata = {"Date": None} if path.suffix == ".svg" else {"Software": None}
        figure.savefig(path, dpi=120, metadata=metadata)


def _map(axes: Axes, sheet: Sheet) -> None:
    seen: set[str] = set()
    for line in sheet.paths:
        label = line.name if line.name not in seen else None
        seen.add(line.name)
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
    for curve in panel.curves:
        if curve.half_band is not None:
            low, high = curve.y - curve.half_band, curve.y + curve.half_band
            axes.fill_between(curve.t_s, low, high, color=curve.colour, alpha=0.25, linewidth=0)
        if curve.dots:
            axes.plot(curve.t_s, curve.y, ".", color=curve.colour, markersize=3.0, label=curve.name)
        else:
            axes.plot(curve.t_s, curve.y, color=curve.colour, linewidth=1.2, label=curve.name)
    if panel.log:
        axes.set_yscale("log")
        axes.yaxis.set_major_formatter("{x:g}")
    axes.set_ylabel(panel.label)
    axes.grid(visible=True)
    axes.margins(x=0)
    if len(panel.curves) > 1:
        axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3, borderaxespad=0.1, handlelength=1.4)

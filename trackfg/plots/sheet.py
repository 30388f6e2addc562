"""A sheet is a picture of a result before anything is drawn: panels of curves, paths on a map, shaded spans."""

from __future__ import annotations

from dataclasses import dataclass
from textwrap import shorten

import numpy as np

from trackfg.numerics.arrays import Array
from trackfg.numerics.spans import Span

BLUE, ORANGE, RED, GREY, AMBER = "#1b5e93", "#c45a00", "#c0392b", "#6b7280", "#f2b134"
SPAN_NAME = "positions withheld"
BAND = 1.96
"""Half-width of a band in sigmas: 95 % of a normal distribution."""

_LABEL_HEIGHT = 0.2
"""Of a text beside a panel, as a share of the panel's height."""

_LABEL_LETTERS = 18
"""Longest name of a limit: what fits the margin beside a panel."""


@dataclass(frozen=True)
class SheetCurve:
    """A line over the common axis, broken where ``y`` is NaN. ``dots``: no line.

    ``half_band`` is the half-width of its band, in the unit of ``y``; ``notes`` say more about each point where a
    picture can be asked.
    """

    name: str
    unit: str
    x: Array
    y: Array
    colour: str
    half_band: Array | None = None
    dots: bool = False
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class SheetLimit:
    """A dashed line over the common axis. An empty ``label``: it has none of its own."""

    label: str
    x: Array
    y: Array


@dataclass(frozen=True)
class Panel:
    """Curves over the common axis.

    ``y_range`` is what is shown (everything if it is absent), ``base`` where a line marks zero, ``marks`` texts at
    places of the common axis, ``share`` the height against that of the other panels. ``over`` is drawn over this
    panel with its own axis at the right.
    """

    label: str
    curves: tuple[SheetCurve, ...]
    log: bool = False
    y_range: tuple[float, float] | None = None
    base: float | None = None
    limits: tuple[SheetLimit, ...] = ()
    marks: tuple[tuple[float, str], ...] = ()
    share: float = 1.0
    over: Panel | None = None


@dataclass(frozen=True)
class Path2d:
    """Points of the map, m."""

    name: str
    east_m: Array
    north_m: Array
    colour: str
    dots: bool = False


@dataclass(frozen=True)
class Sheet:
    """Everything on one picture: panels one above the other over a common axis, beside a map if there are ``paths``.

    ``spans`` are shaded in the panels and drawn in amber on the map.
    """

    title: str
    panels: tuple[Panel, ...]
    x_label: str
    x_range: tuple[float, float]
    paths: tuple[Path2d, ...] = ()
    spans: tuple[Span, ...] = ()
    footer: str = ""


def limit_labels(panel: Panel) -> list[tuple[float, str]]:
    """Return height (0 bottom, 1 top of the panel) and text of each limit with a label, far enough apart to be read.

    With its value, because it may stand away from its line; that of a limit beyond the panel stands at the edge.
    """
    if panel.y_range is None:
        return []
    low, high = panel.y_range
    wanted: list[tuple[float, str]] = []
    for limit in panel.limits:
        ends = limit.y[np.isfinite(limit.y)]
        if limit.label and ends.size:
            y = float(ends[-1])
            away = "" if low <= y <= high else " ↑" if y > high else " ↓"
            name = shorten(limit.label, _LABEL_LETTERS, placeholder="…")
            wanted.append((min(max((y - low) / (high - low), 0.0), 1.0), f"{name} {y:.4g}{away}"))
    placed: list[tuple[float, str]] = []
    for y, label in sorted(wanted, reverse=True):
        placed.append((min(y, placed[-1][0] - _LABEL_HEIGHT / panel.share) if placed else y, label))
    return placed

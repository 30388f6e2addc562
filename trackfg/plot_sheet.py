"""What a picture of a result shows, before anything is drawn: panels of curves, paths on a map, shaded spans."""

from __future__ import annotations

from dataclasses import dataclass

from trackfg.evaluate import Span
from trackfg.frames import Array

BLUE, ORANGE, RED, GREY, AMBER = "#1b5e93", "#c45a00", "#c0392b", "#6b7280", "#f2b134"
SPAN_NAME = "positions withheld"


@dataclass(frozen=True)
class Curve:
    """A line over time; ``half_band`` is the half-width of its band, in the unit of ``y``. ``dots``: no line."""

    name: str
    t_s: Array
    y: Array
    colour: str
    half_band: Array | None = None
    dots: bool = False


@dataclass(frozen=True)
class Panel:
    """Curves over a common clock."""

    label: str
    curves: tuple[Curve, ...]
    log: bool = False


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
    """Everything on one picture. ``spans`` are shaded in the panels and drawn in amber on the map."""

    title: str
    paths: tuple[Path2d, ...]
    panels: tuple[Panel, ...]
    spans: tuple[Span, ...]

"""The charts of a page reach it as JSON that the page's script draws with plotly.

:class:`Strips` are panels of long curves over a common axis, thinned to the pixels of the screen when they are drawn
and again after every zoom. Of a long curve the browser unpacks a view first, and every row when all charts are drawn
or one is zoomed. :class:`Figure` is anything else: a plotly figure as it is.
"""

from __future__ import annotations

import html
import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from trackfg.numerics.arrays import Array
from trackfg.plots.decimation import extremes
from trackfg.plots.sheet import BAND
from trackfg.report.columns import Column, ColumnDifference, packed

TRUTH_COLOUR = "#b87300"
"""Ochre: the colour-blind can distinguish it from the blue of estimates, and its contrast with white paper is 3.8."""
GRID = "#e3e8ed"
"""The colour of lines at ticks."""
VIEW_STRETCHES = 1200
"""More than a chart has columns of pixels."""

ON_MAP = "east %{x:.2f} m<br>north %{y:.2f} m"
"""What the pointer shows of a place on a map."""

_BAR_PX = 30
"""Height of a bar, pixels."""
_SHORT = 4
"""A line of at most this many rows per stretch of the first view is unpacked whole at once."""
PALETTE = (
    "#c45a00",
    "#2f855a",
    "#8e44ad",
    "#c0392b",
    "#0f8b8d",
    "#9a6b00",
    "#d0518f",
    "#5a6b2f",
    "#51607a",
    "#7a4a3a",
    "#3d8bd4",
    "#b5651d",
    "#1f9d55",
    "#6b4bbf",
    "#e0607e",
    "#7f8c1a",
)


@dataclass(frozen=True, eq=False)
class ChartLine:
    """A curve over ``x``, ascending, broken where ``y`` has no value. ``sigma``: its 1-sigma, drawn as a band of 95 %.

    The band lies about the curve, or ``band_about_zero``. ``wide``: drawn below all others, to be seen beside them.
    ``shown``: at first, before the reader chooses in the legend. Lines of one name are one entry of the legend.
    """

    name: str
    colour: str
    x: Column
    y: Column | ColumnDifference
    sigma: Column | None = None
    band_about_zero: bool = False
    wide: bool = False
    shown: bool = True


@dataclass(frozen=True)
class FirstView:
    """The rows of a line that its picture needs while the whole of it is shown."""

    x: Column
    y: Column
    sigma: Column | None

    def columns(self) -> Iterator[Column]:
        """Yield two or three columns."""
        yield from (self.x, self.y)
        if self.sigma is not None:
            yield self.sigma


@dataclass(frozen=True, eq=False)
class ChartLimit:
    """A dashed line over the axis, broken where it is NaN: ``x`` and ``y`` (n,). An empty label: it has none."""

    label: str
    x: Array
    y: Array

    def spec(self) -> dict[str, Any]:
        """Return what the page's script draws."""
        return {"label": self.label, "x": listed(self.x, 6), "y": listed(self.y, 6)}


PlaceKind = Literal["left", "right", "fix", "station", "standstill", "slip", "gap", "other", "exceeded"]
"""What a place along the line is: a curve to the left or right, a fix, a station, an event, or an exceedance."""


@dataclass(frozen=True)
class ChartPlace:
    """A place of the axis, or a stretch, that has a name."""

    start: float
    end: float
    text: str
    kind: PlaceKind


@dataclass(frozen=True)
class PlaceRow:
    """Places beside each other, in a row above the axis."""

    name: str
    places: tuple[ChartPlace, ...]

    def spec(self) -> dict[str, Any]:
        """Return what the page's script draws."""
        return {"name": self.name, "places": [[at.start, at.end, at.text, at.kind] for at in self.places]}


@dataclass(frozen=True)
class OfficialStretch:
    """A stretch begins at ``from_x``; its official place is ``official_m`` at ``x`` and grows by ``rate`` m per unit.

    ``post_km`` is the post that metres count from, None where each 1000 m begin the next kilometre.
    """

    from_x: float
    x: float
    official_m: float
    rate: float
    post_km: int | None


@dataclass(frozen=True)
class OfficialAxis:
    """Official places along an axis; ``plus``: they are written ``12+345``, otherwise ``12.345``."""

    stretches: tuple[OfficialStretch, ...]
    plus: bool

    def spec(self) -> dict[str, Any]:
        """Return what the page's script writes at its ticks."""
        rows = [[s.from_x, s.x, s.official_m, s.rate, s.post_km] for s in self.stretches]
        return {"stretches": rows, "plus": self.plus}


@dataclass(frozen=True)
class ChartPanel:
    """Lines in one unit. ``y_range``: what is shown at first; ``base``: where a line marks zero; ``share``: the height
    against other panels.
    """

    label: str
    unit: str
    lines: tuple[ChartLine, ...]
    y_range: tuple[float, float] | None = None
    base: float | None = None
    share: float = 1.0
    limits: tuple[ChartLimit, ...] = ()


@dataclass(frozen=True)
class Span:
    """A stretch of the axis that is shaded, through all panels or, where one is named by its number, in that one."""

    start: float
    end: float
    colour: str
    panel: int | None = None


@dataclass(frozen=True)
class Strips:
    """Panels from top to bottom over one axis ``x_label`` in ``x_unit``.

    ``places`` stand in rows beside the axis, which stays in sight; ``official`` writes official places at it.
    ``paper_m``: on paper each of so many metres of the axis gets a sheet; None where the chart is printed whole.
    """

    x_label: str
    x_unit: str
    x_range: tuple[float, float]
    panels: tuple[ChartPanel, ...]
    spans: tuple[Span, ...] = ()
    legend: bool = False
    places: tuple[PlaceRow, ...] = ()
    official: OfficialAxis | None = None
    paper_m: float | None = None

    @property
    def alternative(self) -> str:
        """Return in words what is drawn."""
        names = ", ".join(dict.fromkeys(panel.label.replace("\n", " ") for panel in self.panels))
        low, high = self.x_range
        return f"Strips over {self.x_label} from {low:.6g} to {high:.6g}: {names}. The table below has their extremes."

    def extremes(self) -> list[tuple[str, ...]]:
        """Return a row per line, for readers who do not see the chart: panel, line, unit, then the least value and its
        place, the greatest value and its place.
        """
        rows = []
        for panel in self.panels:
            for line in panel.lines:
                y = line.y.numbers
                if not np.isfinite(y).any():
                    continue
                ends = (int(np.nanargmin(y)), int(np.nanargmax(y)))
                values = (text for at in ends for text in (f"{y[at]:.4g}", f"{line.x.numbers[at]:.6g}"))
                rows.append((panel.label.replace("\n", " "), line.name, panel.unit, *values))
        return rows

    @cached_property
    def views(self) -> dict[ChartLine, FirstView | None]:
        """Return the first view of every line, None where that is all of it."""
        return {line: _view(line) for panel in self.panels for line in panel.lines}

    def columns(self) -> Iterator[Column]:
        """Yield every column that is drawn."""
        for line, view in self.views.items():
            yield line.x
            yield from (line.y.first, line.y.second) if isinstance(line.y, ColumnDifference) else (line.y,)
            if line.sigma is not None:
                yield line.sigma
            if view is not None:
                yield from view.columns()

    def spec(self, number: dict[Column, int]) -> dict[str, Any]:
        """Return what the page's script draws; ``number`` says which column of the page is which."""

        def reference(y: Column | ColumnDifference) -> Any:
            return [number[y.first], number[y.second]] if isinstance(y, ColumnDifference) else number[y]

        def data(drawn: ChartLine | FirstView) -> dict[str, Any]:
            sigma = None if drawn.sigma is None else number[drawn.sigma]
            return {"x": number[drawn.x], "y": reference(drawn.y), "sigma": sigma}

        return {
            "kind": "strips",
            "x": {"label": plain(self.x_label), "unit": self.x_unit, "range": list(self.x_range)},
            "official": None if self.official is None else self.official.spec(),
            "places": [row.spec() for row in self.places],
            "paper": self.paper_m,
            "band": BAND,
            "legend": self.legend,
            "spans": [[span.start, span.end, span.colour, span.panel] for span in self.spans],
            "panels": [
                {
                    "label": plain(panel.label).replace("\n", "<br>"),
                    "unit": panel.unit,
                    "range": None if panel.y_range is None else list(panel.y_range),
                    "base": panel.base,
                    "share": panel.share,
                    "limits": [limit.spec() for limit in panel.limits],
                    "lines": [
                        {
                            "name": plain(line.name),
                            "colour": line.colour,
                            "all": data(line),
                            "view": None if (view := self.views[line]) is None else data(view),
                            "aboutZero": line.band_about_zero,
                            "wide": line.wide,
                            "shown": line.shown,
                        }
                        for line in panel.lines
                    ],
                }
                for panel in self.panels
            ],
        }


@dataclass(frozen=True)
class Figure:
    """A plotly figure: its traces, its layout, its height in pixels, and in words what it shows.

    Texts from data go through :func:`plain`, but for ``alternative``, which plotly does not get.
    """

    traces: tuple[dict[str, Any], ...]
    layout: dict[str, Any]
    height: int
    alternative: str

    def columns(self) -> Iterator[Column]:
        """Yield nothing: its numbers are in its traces."""
        yield from ()

    def extremes(self) -> list[tuple[str, ...]]:
        """Return nothing: ``alternative`` says it."""
        return []

    def spec(self, _: dict[Column, int]) -> dict[str, Any]:
        """Return what the page's script draws. It refers to no column of the page."""
        return {"kind": "figure", "traces": list(self.traces), "layout": self.layout, "height": self.height}


Chart = Strips | Figure


def _view(line: ChartLine) -> FirstView | None:
    if len(line.x.numbers) <= _SHORT * VIEW_STRETCHES:
        return None
    y = line.y.numbers
    rows = extremes(y, VIEW_STRETCHES)
    sigma = None if line.sigma is None else packed(line.sigma.numbers[rows], line.sigma.step)
    return FirstView(packed(line.x.numbers[rows], line.x.step), packed(y[rows], line.y.step), sigma)


def bar_figure(bars: Mapping[str, tuple[float, str, str]], x_axis: Mapping[str, Any], alternative: str) -> Figure:
    """Return bars from top to bottom by their names: how long each is, the text beside it, and its colour."""
    trace = {
        "type": "bar",
        "orientation": "h",
        "y": [plain(name) for name in bars],
        "x": [length for length, _, _ in bars.values()],
        "text": [text for _, text, _ in bars.values()],
        "textposition": "outside",
        "cliponaxis": False,
        "marker": {"color": [colour for _, _, colour in bars.values()]},
        "hoverinfo": "skip",
        "width": 0.6,
    }
    layout = {
        "xaxis": {"gridcolor": GRID, **x_axis},
        "yaxis": {"autorange": "reversed", "automargin": True, "ticklabelstandoff": 8},
        "margin": {"l": 90, "r": 50, "t": 10, "b": 46},
    }
    return Figure((trace,), layout, 70 + _BAR_PX * len(bars), alternative)


def labelled_points(name: str, at: Iterable[tuple[str, float, float]], marker: dict[str, Any]) -> dict[str, Any]:
    """Return the trace of points (text, east, north) on a map, m, whose texts stand beside them."""
    texts, east, north = zip(*at, strict=True)
    return {
        "type": "scatter",
        "mode": "markers+text",
        "name": plain(name),
        "x": listed(east, 3),
        "y": listed(north, 3),
        "text": [plain(text) for text in texts],
        "textposition": "bottom right",
        "textfont": {"size": 11},
        "hovertemplate": f"%{{text}}<br>{ON_MAP}<extra>{plain(name)}</extra>",
        "marker": marker,
    }


def whole_range(*axes: Array) -> tuple[float, float]:
    """Return the range from the least to the greatest of some axes; one unit wide where all are at one place."""
    values = np.concatenate(axes)
    low, high = float(values.min()), float(values.max())
    return (low, high) if high > low else (low - 0.5, high + 0.5)


def listed(values: ArrayLike, places: int) -> list[float | None]:
    """Return numbers (n,) rounded for JSON, which has no NaN."""
    return [round(value, places) if math.isfinite(value) else None for value in np.asarray(values).tolist()]


def plain(text: str) -> str:
    """Return a text that plotly shows as it is: it takes tags for markup, links among them."""
    return html.escape(text, quote=False)

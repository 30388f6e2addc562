"""The strip chart: what the geometry table holds, channel by channel over a common chainage.

From top to bottom as track recording cars draw it: level and alignment (of each rail, and the gauge, where lasers saw
the rails), cross-level, twist, versines, gradient, speed, and at the foot curvature with the cant. Bands are 95 % (1.96
sigma). The vertical scales follow what was measured well (:mod:`trackfg.plots.scales`).
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd

from trackfg.errors import BadInputError
from trackfg.numerics.arrays import Array
from trackfg.numerics.chainage.kilometrage import Kilometrage
from trackfg.plots.curve_labels import curves, sense_and_radius
from trackfg.plots.decimation import extremes
from trackfg.plots.draw import drawn
from trackfg.plots.geometry_channels import (
    COMMON,
    CROSS_LEVEL,
    CURVATURE,
    GeometryChannel,
    base_of,
    centre_or_rails,
    channel_extent,
    channel_range,
    channel_values,
    label_of,
    measured_channels,
)
from trackfg.plots.scales import common_zero, with_margin
from trackfg.plots.sheet import BAND, BLUE, ORANGE, Panel, Sheet, SheetCurve, SheetLimit
from trackfg.results.official_places import shown_kilometrage
from trackfg.results.result import Result, expect_result
from trackfg.results.summary import GeometryConventions
from trackfg.results.verdict import Verdict

STRETCHES = 2000
"""More than a sheet has columns of pixels."""

_LONG_M = 2000.0
"""Above this length of chart chainage is in km."""

_MARK_SHARE = 0.075
"""Width of the text at a curve, as a share of the chart's."""

_HEADROOM = 0.2
"""Room for texts above the curves of a panel, as a share of its height."""

_ROUND_M = tuple(digit * 10.0**power for power in range(6) for digit in (1, 2, 5))
"""Steps between official places that are shown, m."""

_SMALL_CURVE = 0.2
"""A curve shorter than this share of its text is not named: it would be unclear which one is meant."""


@dataclass(frozen=True)
class LimitLine:
    """A limit of a geometry column, in the column's unit, over chainage; broken where it is NaN.

    One line: what is limited both ways has two. Lines with the same label are one limit.
    """

    column: str
    label: str
    chainage_m: Array
    value: Array


def plot_geometry(
    result: Result,
    path: str | os.PathLike[str] | None = None,
    *,
    from_m: float | None = None,
    to_m: float | None = None,
    limits: Sequence[LimitLine] = (),
) -> Any:
    """Draw the track geometry of a result over the chainage, with bands of 95 %.

    Parameters
    ----------
    result
        With a geometry.
    path
        The picture, by its suffix: ``.png``, ``.svg`` or, opened without a network, ``.html``; none for a figure.
    from_m, to_m
        Chainages of the chart's ends, m; those of the geometry unless given.
    limits
        Lines to draw; those of columns that the chart does not show are left out.

    Returns
    -------
    pathlib.Path or plotly.graph_objects.Figure
        The picture; without a path a figure, which a notebook shows.

    Raises
    ------
    BadInputError
        For another suffix, and where there is nothing to draw.

    Examples
    --------
    >>> import trackfg
    >>> trackfg.plot_geometry(trackfg.Result.read("out1"), "geometry.png", to_m=100.0).name
    'geometry.png'
    """
    expect_result(result, "plot_geometry")
    return drawn(geometry_sheet(result, from_m, to_m, limits), path)


def geometry_sheet(result: Result, from_m: float | None, to_m: float | None, limits: Sequence[LimitLine]) -> Sheet:
    """Return what :func:`plot_geometry` draws, in the units of its labels and thinned."""
    table = _between(result, from_m, to_m)
    chainage = table["chainage_m"].to_numpy()
    start = float(chainage[0]) if from_m is None else from_m
    end = float(chainage[-1]) if to_m is None else to_m
    unit, x_scale = ("km", 1e-3) if end - start > _LONG_M else ("m", 1.0)
    conventions = result.summary.geometry
    chart = _Chart(table, x_scale, conventions, tuple(limits))
    verdicts = result.summary.verdicts
    channels = measured_channels(result.geometry, (*centre_or_rails(result.geometry), *COMMON), verdicts)
    panels = [chart.panel(channel) for channel in channels]
    panels += [chart.foot(verdicts)] if measured_channels(result.geometry, (CURVATURE,)) else []
    line = shown_kilometrage(result, None)
    if line is not None:
        panels[0] = _under_marks(panels[0], _official_places(line.kilometrage(), start, end, x_scale))
    thinned = len(table) > 2 * STRETCHES
    return Sheet(
        title=f"{result.summary.recording_id}   {_place(start, unit)} to {_place(end, unit)} {unit}",
        panels=tuple(panels),
        x_label=f"chainage, {unit}" + ("; at the top official places" if line is not None else ""),
        x_range=(x_scale * start, x_scale * end),
        footer=_footer(conventions, table, thinned=thinned),
    )


def _between(result: Result, from_m: float | None, to_m: float | None) -> pd.DataFrame:
    table = result.geometry_for("a strip chart")
    low = -np.inf if from_m is None else from_m
    high = np.inf if to_m is None else to_m
    inside = table[table["chainage_m"].between(low, high)]
    if low > high:
        raise BadInputError(f"from {low:g} m to {high:g} m: expected the smaller chainage first")
    if len(inside) < 2:
        first, last = table["chainage_m"].iloc[[0, -1]]
        asked = f"between {low:g} and {high:g} m"
        if from_m is None or to_m is None:
            asked = f"up to {high:g} m" if from_m is None else f"from {low:g} m on"
        raise BadInputError(f"no geometry {asked}: the result covers chainage {first:.2f} to {last:.2f} m")
    return inside


def _place(chainage_m: float, unit: str) -> str:
    return f"{chainage_m / 1000.0:.3f}" if unit == "km" else f"{chainage_m:.2f}".rstrip("0").rstrip(".")


def _official_places(
    kilometrage: Kilometrage, start_m: float, end_m: float, x_scale: float
) -> tuple[tuple[float, str], ...]:
    """Return round official places, no closer than their texts are wide."""
    room = _MARK_SHARE * (end_m - start_m)
    step = next(step for step in _ROUND_M if step >= room or step == _ROUND_M[-1])
    chainages = kilometrage.round_places(start_m, end_m, step)
    places: list[tuple[float, str]] = []
    free_m = start_m + room / 2.0
    for x, text in zip(chainages.tolist(), kilometrage.written(chainages, decimals=0), strict=True):
        if free_m <= x <= end_m - room / 2.0:
            places.append((x_scale * x, text))
            free_m = x + room
    return tuple(places)


def _under_marks(panel: Panel, marks: tuple[tuple[float, str], ...]) -> Panel:
    """Return a panel with marks, and room for them above its curves."""
    if panel.y_range is None:
        return replace(panel, marks=marks)
    low, high = panel.y_range
    return replace(panel, marks=marks, y_range=(low, high + _HEADROOM * (high - low)))


@dataclass(frozen=True)
class _Chart:
    table: pd.DataFrame
    x_scale: float
    conventions: GeometryConventions
    limits: tuple[LimitLine, ...]

    def panel(self, channel: GeometryChannel) -> Panel:
        curve = self._curve(channel, BLUE)
        limits = tuple(
            SheetLimit(line.label, self.x_scale * line.chainage_m, channel.scale * line.value)
            for line in self.limits
            if line.column == channel.column
        )
        base = base_of(channel, self.conventions)
        same_scale = [line.value for line in self.limits if line.column in (channel.column, channel.twin)]
        y_range = channel_range(self.table, channel, base, same_scale)
        label = f"{channel.label}, {channel.unit}"
        return Panel(label, (curve,), y_range=y_range, base=base, limits=limits, share=channel.share)

    def foot(self, verdicts: Sequence[Verdict]) -> Panel:
        """Return the panel of curvature, and over it the cross-level upside down: where cant fits the curve the two
        run together.
        """
        curvature = self._curve(CURVATURE, BLUE)
        curvature = replace(curvature, notes=tuple(sense_and_radius(y / 1000.0) for y in curvature.y))
        cant = replace(self._curve(CROSS_LEVEL, ORANGE), half_band=None)
        low, high = channel_extent(self.table, CROSS_LEVEL, 0.0)
        bend, lean = common_zero(channel_extent(self.table, CURVATURE, 0.0), (-high, -low))
        bend, lean = with_margin(*bend), with_margin(*lean)
        lean_high = lean[1] + _HEADROOM * (lean[1] - lean[0])
        cross_level = label_of(CROSS_LEVEL.label, CROSS_LEVEL.column, verdicts)
        panel = Panel(
            f"{label_of('curvature', CURVATURE.column, verdicts)}, 1/km",
            (curvature,),
            y_range=bend,
            base=0.0,
            share=CURVATURE.share,
            over=Panel(f"{cross_level}, mm\n(right, reversed)", (cant,), y_range=(-lean[0], -lean_high)),
        )
        return _under_marks(panel, self._marks())

    def _curve(self, channel: GeometryChannel, colour: str) -> SheetCurve:
        values, sigmas = channel_values(self.table, channel)
        keep = extremes(values, STRETCHES)
        x = self.x_scale * self.table["chainage_m"].to_numpy()[keep]
        band = BAND * sigmas[keep] if f"{channel.column}_sd" in self.table else None
        return SheetCurve(channel.label.replace("\n", " "), channel.unit, x, values[keep], colour, band)

    def _marks(self) -> tuple[tuple[float, str], ...]:
        """Return the longest curves whose texts have room beside each other."""
        chainage = self.table["chainage_m"].to_numpy()
        room = _MARK_SHARE * (chainage[-1] - chainage[0])
        placed: list[tuple[float, str]] = []
        for start, end, text in curves(chainage, self.table["curvature_1pm"].to_numpy()):
            middle = np.clip((start + end) / 2.0, chainage[0] + room / 2.0, chainage[-1] - room / 2.0)
            if end - start >= _SMALL_CURVE * room and all(abs(middle - other) >= room for other, _ in placed):
                placed.append((float(middle), text))
        return tuple((self.x_scale * middle, text) for middle, text in sorted(placed))


def _footer(conventions: GeometryConventions, table: pd.DataFrame, *, thinned: bool) -> str:
    c = conventions
    lines = [
        f"Left and right facing {c.facing}. Positive: up, to the left, left rail higher, uphill. "
        f"Twist on {c.twist_base}, versines on a chord of {c.chord_m:g} m, "
        f"level and alignment in the band {c.band_m[0]:g}-{c.band_m[1]:g} m,",
        f"curvature over {c.curvature_base_m:g} m, gradient over {c.gradient_base_m:g} m; "
        f"cross-level on {c.cross_level_base_m:g} m. Shaded: 95 % (1.96 sigma). "
        f"1 sigma of the chainage up to {table['chainage_m_sd'].max():.2g} m."
        + (" Thinned to extremes: a shorter range shows every row." if thinned else ""),
    ]
    return "\n".join(lines)

"""Limit tables as lines of the strip chart.

A line can be drawn where the limit speaks of what a panel shows: the largest magnitude of a column, with the chord,
base and band that the column has. Cross-level and the versines of the alignment hold the designed curve too, so their
limits stand on straight track only; the limit of a reversed cross-level stands in curves, on the side of the inner
rail. That of a curve's elevation is not drawn: it lies so far from any track that the panel would show nothing else.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable

import numpy as np

from trackfg.geometry.bands import BANDS
from trackfg.geometry.curves import curve_sense
from trackfg.geometry.limits import Limit, at_line_speed
from trackfg.numerics.arrays import Array
from trackfg.plots.geometry_channels import centre_or_rails
from trackfg.plots.strip_chart import LimitLine
from trackfg.results.result import Result
from trackfg.results.summary import GeometryConventions


def limit_lines(
    result: Result, limits: Iterable[Limit], line_speed_kmh: float | None = None
) -> tuple[list[LimitLine], Counter[str]]:
    """Return what :func:`trackfg.plots.strip_chart.plot_geometry` can draw of ``limits``, and how many it cannot, by
    reason.

    ``line_speed_kmh`` is the speed that the line is limited for, not that of the run. Raises :class:`BadInputError`
    where limits depend on it and it is not given.
    """
    if result.geometry.empty:
        return [], Counter()
    chainage = result.geometry["chainage_m"].to_numpy()
    curvature = result.geometry["curvature_1pm"].to_numpy()
    sense = np.where(np.isnan(curvature), np.nan, curve_sense(chainage, curvature))
    conventions = result.summary.geometry
    lines: list[LimitLine] = []
    left_out: Counter[str] = Counter()
    keys: set[tuple[str, str, float]] = set()
    for limit in at_line_speed(limits, line_speed_kmh):
        reason = _reason_against(limit, result)
        if reason:
            left_out[reason] += 1
            continue
        for column in _columns(limit, result):
            new = (column, limit.level, limit.value_mm) not in keys
            keys.add((column, limit.level, limit.value_mm))
            label = limit.level if new else ""
            for value in _values(limit, sense, conventions):
                lines.append(LimitLine(column, label, *_steps(chainage, value)))
                label = ""
    return lines, left_out


def _reason_against(limit: Limit, result: Result) -> str | None:
    conventions = result.summary.geometry
    if limit.parameter in ("gauge_wide", "gauge_narrow", "gauge_change") and not result.has_rails:
        return "gauge, which the result has not"
    if limit.kind != "peak":
        return f"{limit.kind} over {limit.section_m:g} m"
    if limit.parameter in ("elevation", "warp", "gauge_change", "runoff"):
        return limit.parameter.replace("_", " ")
    if limit.repeats > 1:
        return "repeated deviations"
    if limit.uniformity:
        return f"{limit.parameter}, uniformity"
    if limit.chord_m is not None and limit.chord_m != conventions.chord_m:
        return f"{limit.parameter} on a chord of {limit.chord_m:.4g} m"
    if limit.band is not None:
        band = BANDS[limit.band]
        if (band.shortest_m, band.longest_m) != conventions.band_m:
            return f"{limit.parameter} in the band {limit.band}"
    if limit.base_m is not None and limit.base_m != conventions.twist_base_m:
        return f"twist on {limit.base_m:.4g} m"
    return None


def _columns(limit: Limit, result: Result) -> list[str]:
    """Return the columns of the chart: with rails, the band of level and alignment is drawn of each rail."""
    if limit.parameter in ("gauge_wide", "gauge_narrow"):
        return ["gauge_mm"]
    if limit.parameter == "reverse_cross_level":
        return ["cross_level_mm"]
    if limit.chord_m is not None:
        return [f"versine_{limit.parameter}_mm"]
    if limit.band is not None:
        shown = (channel.column for channel in centre_or_rails(result.geometry))
        return [name for name in shown if name.startswith(f"{limit.parameter}_")]
    return [f"{limit.parameter}_mm"]


def _values(limit: Limit, sense: Array, conventions: GeometryConventions) -> list[Array]:
    """Return the line or lines, row by row, NaN where the limit does not hold."""
    nominal = 1000.0 * conventions.gauge_m
    everywhere = np.full(len(sense), limit.value_mm)
    on = limit.track
    if limit.parameter == "cross_level" or (limit.parameter == "alignment" and limit.chord_m is not None):
        on = "tangent"
    if limit.parameter == "reverse_cross_level":
        return [np.where(np.abs(sense) == 1.0, sense * limit.value_mm, np.nan)]
    if on != "any":
        everywhere[(np.abs(sense) == 1.0) != (on == "curved")] = np.nan
    if limit.parameter == "gauge_wide":
        return [nominal + everywhere]
    if limit.parameter == "gauge_narrow":
        return [nominal - everywhere]
    return [everywhere, -everywhere]


def _steps(chainage: Array, value: Array) -> tuple[Array, Array]:
    """Return a value that is constant for long stretches by the ends of them, NaN between them."""
    absent = np.isnan(value)
    ends = np.flatnonzero((value[1:] != value[:-1]) & ~(absent[1:] & absent[:-1])) + 1
    stretches = np.stack([np.append(0, ends), np.append(ends, len(value)) - 1], axis=1)
    stretches = stretches[np.isfinite(value[stretches[:, 0]])]
    x = np.insert(chainage[stretches], 2, np.nan, axis=1).ravel()
    y = np.insert(value[stretches], 2, np.nan, axis=1).ravel()
    return x, y

"""The geometry of a result over chainage, every row of it, with the truth below where it is known."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
import pandas as pd

from trackfg.geometry.exceedances import Judgement
from trackfg.numerics.arrays import Array
from trackfg.plots.geometry_channels import (
    CENTRE,
    COMMON,
    CURVATURE,
    RAILS,
    GeometryChannel,
    base_of,
    centre_or_rails,
    channel_range,
    channel_values,
    measured_channels,
)
from trackfg.plots.scales import with_margin
from trackfg.plots.sheet import BAND, BLUE
from trackfg.plots.strip_chart import LimitLine
from trackfg.report.charts import (
    TRUTH_COLOUR,
    ChartLimit,
    ChartLine,
    ChartPanel,
    OfficialAxis,
    PlaceRow,
    Strips,
    whole_range,
)
from trackfg.report.columns import ColumnDifference, packed, packed_sigma, packed_value
from trackfg.report.exceedances import exceedance_spans
from trackfg.results.result import Result
from trackfg.results.summary import GeometryConventions
from trackfg.results.verdict import Verdict

LONG_M = 2000.0
"""Above this length chainage is in km."""

_PAPER_M = 1000.0
"""What a sheet of paper shows at first: a kilometre is 250 mm long, a scale of 1:4000."""
_PLACE = 1e-3
"""Accuracy of the chainage in the page, m."""
_ROBUST = 0.998
"""An error axis holds this share of the errors and of the bands: a slow place must not squeeze the rest."""


def channels(table: pd.DataFrame, verdicts: Sequence[Verdict] = ()) -> tuple[GeometryChannel, ...]:
    """Return everything that a geometry table holds, in the order of the chart; what is not to be trusted is so
    labelled.
    """
    return measured_channels(table, (*centre_or_rails(table), *COMMON[:-1], CURVATURE, COMMON[-1]), verdicts)


def channels_of_any(tables: Iterable[pd.DataFrame]) -> tuple[GeometryChannel, ...]:
    """Return what any of some geometry tables is shown by, in the order of the chart."""
    by_column = {channel.column: channel for table in tables for channel in channels(table)}
    order = (*CENTRE, *RAILS, *COMMON[:-1], CURVATURE, COMMON[-1])
    return tuple(by_column[channel.column] for channel in order if channel.column in by_column)


def chainage_axis(chainage_m: Array) -> tuple[str, float]:
    """Return the unit of the axis and what brings metres into it."""
    return ("km", 1e-3) if np.ptp(chainage_m) > LONG_M else ("m", 1.0)


def geometry_strips(
    result: Result,
    errors: pd.DataFrame,
    judgement: Judgement | None = None,
    *,
    limits: Sequence[LimitLine] = (),
    rows: tuple[PlaceRow, ...] = (),
    official: OfficialAxis | None = None,
) -> tuple[Strips, Strips | None]:
    """Return the chart of the geometry, and that of its errors if ``errors`` has any; the two share their data.

    Exceedances of ``judgement`` are shaded, ``limits`` are lines, ``rows`` stand beside the axis, on which
    ``official`` places are written where they are wanted.
    """
    table = result.geometry
    chainage = table["chainage_m"].to_numpy()
    unit, scale = chainage_axis(chainage)
    x = packed(scale * chainage, scale * _PLACE)
    x_range = whole_range(scale * chainage)
    panels, error_panels, columns = [], [], []
    for channel in channels(table, result.summary.verdicts):
        values, sigmas = channel_values(table, channel)
        has_sigma = f"{channel.column}_sd" in table
        y = packed_value(values, sigmas if has_sigma else None)
        sigma = packed_sigma(sigmas) if has_sigma else None
        lines = [ChartLine("estimate", BLUE, x, y, sigma)]
        if channel.column in errors and has_sigma:
            error = channel.scale * errors[channel.column].to_numpy()
            packed_error = packed_value(error, sigmas)
            lines.append(ChartLine("truth", TRUTH_COLOUR, x, ColumnDifference(y, packed_error), wide=True))
            line = ChartLine("error", BLUE, x, packed_error, sigma, band_about_zero=True)
            y_range = error_range(error, sigmas)
            error_panels.append(ChartPanel(channel.label, channel.unit, (line,), y_range, base=0.0, share=0.8))
        channel_limits = tuple(line for line in limits if line.column == channel.column)
        panels.append(_panel(channel, table, result.summary.geometry, tuple(lines), channel_limits, scale))
        columns.append(channel.column)
    label = f"chainage, {unit}"
    with_truth = bool(error_panels)
    chart = Strips(
        label,
        unit,
        x_range,
        tuple(panels),
        exceedance_spans(judgement, columns, scale),
        legend=with_truth,
        places=rows,
        official=official,
        paper_m=_PAPER_M,
    )
    if not with_truth:
        return chart, None
    return chart, Strips(label, unit, x_range, tuple(error_panels), places=rows, official=official)


def _panel(
    channel: GeometryChannel,
    table: pd.DataFrame,
    conventions: GeometryConventions,
    lines: tuple[ChartLine, ...],
    limits: tuple[LimitLine, ...],
    scale: float,
) -> ChartPanel:
    base = base_of(channel, conventions)
    y_range = channel_range(table, channel, base, (line.value for line in limits))
    share = 1.3 if channel.column == CURVATURE.column else channel.share
    drawn = tuple(ChartLimit(line.label, scale * line.chainage_m, channel.scale * line.value) for line in limits)
    return ChartPanel(channel.label, channel.unit, lines, y_range, base, share=share, limits=drawn)


def error_range(error: Array, sigmas: Array) -> tuple[float, float]:
    """Return symmetric about zero, with nearly all errors and bands."""
    size = np.concatenate([np.abs(error[np.isfinite(error)]), BAND * sigmas[np.isfinite(sigmas)]])
    reach = float(np.quantile(size, _ROBUST)) if size.size else 0.0
    reach = reach or 1.0
    return with_margin(-reach, reach)

"""The channels of a geometry table as charts show them: in which order, under which label, unit and scale."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from trackfg.numerics.arrays import Array
from trackfg.numerics.units import KMH
from trackfg.plots.scales import extent, symmetric, with_limits, with_margin
from trackfg.results.summary import GeometryConventions
from trackfg.results.verdict import Verdict
from trackfg.results.widening import trusted


@dataclass(frozen=True)
class GeometryChannel:
    """A column as a panel. ``least``: half of what the axis spans at least; ``deviation``: zero is in the middle.

    ``scale`` brings the column into ``unit``; ``twin``: the column of the other rail, shown on the same scale.
    """

    column: str
    label: str
    unit: str
    least: float
    deviation: bool = False
    scale: float = 1.0
    share: float = 1.0
    twin: str | None = None


CENTRE = (
    GeometryChannel("level_mm", "level", "mm", 1.0, deviation=True),
    GeometryChannel("alignment_mm", "alignment", "mm", 1.0, deviation=True),
)
RAILS = (
    GeometryChannel("level_left_mm", "level\nleft rail", "mm", 1.0, deviation=True, twin="level_right_mm"),
    GeometryChannel("level_right_mm", "level\nright rail", "mm", 1.0, deviation=True, twin="level_left_mm"),
    GeometryChannel("alignment_left_mm", "alignment\nleft rail", "mm", 1.0, deviation=True, twin="alignment_right_mm"),
    GeometryChannel("alignment_right_mm", "alignment\nright rail", "mm", 1.0, deviation=True, twin="alignment_left_mm"),
    GeometryChannel("gauge_mm", "gauge", "mm", 1.0),
)
CROSS_LEVEL = GeometryChannel("cross_level_mm", "cross-level", "mm", 1.0)
COMMON = (
    CROSS_LEVEL,
    GeometryChannel("twist_mm", "twist", "mm", 1.0, deviation=True),
    GeometryChannel("versine_level_mm", "versine\nlevel", "mm", 1.0, deviation=True),
    GeometryChannel("versine_alignment_mm", "versine\nalignment", "mm", 1.0),
    GeometryChannel("gradient_permille", "gradient", "‰", 1.0, share=0.7),
    GeometryChannel("speed_mps", "speed", "km/h", 10.0, scale=1.0 / KMH, share=0.7),
)
CURVATURE = GeometryChannel("curvature_1pm", "curvature", "1/km", 0.1, scale=1000.0, share=1.6)


def centre_or_rails(table: pd.DataFrame) -> tuple[GeometryChannel, ...]:
    """Return level and alignment, each of both rails where it was measured of one, and the gauge where there is one.

    Another system's table may have columns of rails that are empty beside those of the centre line.
    """
    shown: list[GeometryChannel] = []
    for centre in CENTRE:
        rails = [
            channel for channel in RAILS if channel.column.startswith(f"{centre.label}_") and channel.column in table
        ]
        shown += rails if table[[channel.column for channel in rails]].notna().any(axis=None) else [centre]
    return (*shown, *(channel for channel in RAILS if channel.twin is None and channel.column in table))


def measured_channels(
    table: pd.DataFrame, channels: Sequence[GeometryChannel], verdicts: Sequence[Verdict] = ()
) -> tuple[GeometryChannel, ...]:
    """Return those of the channels that the table knows anywhere; what is not to be trusted is so labelled."""
    measured = (channel for channel in channels if channel.column in table and table[channel.column].notna().any())
    return tuple(replace(channel, label=label_of(channel.label, channel.column, verdicts)) for channel in measured)


def label_of(label: str, column: str, verdicts: Sequence[Verdict]) -> str:
    """Return the label of a column's panel, which says where the column is not to be trusted."""
    return label if trusted(verdicts, column) else f"{label}\n(not trusted)"


def base_of(channel: GeometryChannel, conventions: GeometryConventions) -> float:
    """Return where a line marks that nothing deviates, in the channel's unit."""
    return 1000.0 * conventions.gauge_m if channel.column == "gauge_mm" else 0.0


def channel_values(table: pd.DataFrame, channel: GeometryChannel) -> tuple[Array, Array]:
    """Return values and sigmas in the channel's unit; a sigma of zero where the table has none."""
    values = channel.scale * table[channel.column].to_numpy()
    name = f"{channel.column}_sd"
    known = name in table and table[name].notna().any()
    sigmas = channel.scale * table[name].to_numpy() if known else np.zeros(len(values))
    return values, sigmas


def channel_extent(table: pd.DataFrame, channel: GeometryChannel, base: float) -> tuple[float, float]:
    """Return what its axis must show (:func:`trackfg.plots.scales.extent`), for both rails together."""
    low, high = extent(*channel_values(table, channel), base, channel.least)
    if channel.twin:
        other = extent(*channel_values(table, replace(channel, column=channel.twin)), base, channel.least)
        low, high = min(low, other[0]), max(high, other[1])
    return low, high


def channel_range(
    table: pd.DataFrame, channel: GeometryChannel, base: float, limits: Iterable[Array]
) -> tuple[float, float]:
    """Return the axis of a panel: its extent, limits of the column that are near, ``base`` in the middle of deviations,
    and a margin.
    """
    low, high = channel_extent(table, channel, base)
    low, high = with_limits(low, high, base, channel.scale * np.concatenate([[], *limits]))
    if channel.deviation:
        low, high = symmetric(low, high, base)
    return with_margin(low, high)

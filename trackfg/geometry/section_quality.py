"""Quality of a track by sections of 200 m: standard deviations of its channels, their sum, and shares beyond limits.

The track quality index is the sum of the standard deviations of seven channels, as the inspection of Chinese railways
has it: level and alignment of both rails, gauge, cross-level and twist (TB/T 3355). What a table has not does not
count; without the rails, level and alignment of the centre line stand for both rails.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd

from trackfg.geometry.statistics import section_statistics
from trackfg.numerics.arrays import Array
from trackfg.numerics.chainage.chainage_grid import step_of

INDEX_CHANNELS = (
    "level_left_mm",
    "level_right_mm",
    "alignment_left_mm",
    "alignment_right_mm",
    "gauge_mm",
    "cross_level_mm",
    "twist_mm",
)
"""What the track quality index is the sum of."""
_CENTRE = ("level_mm", "alignment_mm")
_LEAST_SHARE = 0.5
"""A section counts for a channel of which it knows this share."""


def index_channels(columns: Sequence[str]) -> tuple[str, ...]:
    """Return the channels of the track quality index among those that a table knows."""
    rails = tuple(name for name in INDEX_CHANNELS if name in columns)
    centre = tuple(name for name in _CENTRE if name in columns and not any(rail.startswith(name[:5]) for rail in rails))
    return (*centre, *rails)


def section_quality(
    geometry: pd.DataFrame,
    channels: Sequence[str],
    *,
    section_m: float = 200.0,
    beyond: Mapping[str, Array] | None = None,
) -> pd.DataFrame:
    """Return one row per section, beginning at whole multiples of ``section_m``.

    Columns ``from_m, to_m``, the index ``tqi`` (mm), the sum of the standard deviations of :func:`index_channels`, NaN
    where one of them is not known, ``sd_CHANNEL`` in the channel's unit for each of ``channels``, and for each name of
    ``beyond`` (n,), which is 1, 0, or NaN where that is not known, ``share_beyond_NAME``, its mean over the section's
    known rows, NaN where there is none, and ``unknown_m_NAME``, the length of the others, m.
    """
    chainage, step = geometry["chainage_m"].to_numpy(dtype=np.float64), step_of(geometry)
    least = _LEAST_SHARE * section_m / step
    columns: dict[str, pd.Series] = {}
    for name in channels:
        table = section_statistics(chainage, geometry[name].to_numpy(), section_m=section_m).set_index("from_m")
        columns[f"sd_{name}"] = table["sd"].where(table["count"] >= least)
    for name, where in (beyond or {}).items():
        table = section_statistics(chainage, where, section_m=section_m).set_index("from_m")
        unknown = section_statistics(chainage, np.isnan(where), section_m=section_m).set_index("from_m")
        columns[f"share_beyond_{name}"] = table["mean"]
        columns[f"unknown_m_{name}"] = step * unknown["mean"] * unknown["count"]
    out = pd.DataFrame(columns).sort_index()
    index = [f"sd_{name}" for name in index_channels(channels)]
    out.insert(0, "to_m", out.index.to_numpy() + section_m)
    out.insert(1, "tqi", out[index].sum(axis=1, skipna=False) if index else np.nan)
    return out.rename_axis("from_m").reset_index()

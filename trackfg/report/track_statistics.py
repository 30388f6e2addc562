"""Statistics of a result's geometry by sections: standard deviations, the track quality index, shares beyond limits."""

from __future__ import annotations

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from trackfg.geometry.exceedances import Judgement
from trackfg.geometry.section_quality import section_quality
from trackfg.geometry.versine_bands import with_long_bands
from trackfg.numerics.arrays import Array
from trackfg.report.track_limits import without_holes
from trackfg.results.columns import CHANNELS
from trackfg.results.result import Result


def track_statistics(result: Result, *, section_m: float = 200.0, judgement: Judgement | None = None) -> pd.DataFrame:
    """Return one row per section with the columns of :func:`~trackfg.geometry.section_quality.section_quality`.

    Channels are all that the geometry knows; of a smoothed run also level and alignment in the bands D2 and D3. Of
    ``judgement`` there is a share of what is known for each column and level that has a peak beyond it, and the length
    that is not; of what is computed from two places the limit is named in place of the column, such as
    ``warp_over_18.9_m``.
    Raises :class:`BadInputError` for a result without geometry.
    """
    geometry, meaning = result.geometry_for("statistics"), result.summary.geometry
    if result.summary.solver is not None:  # the versines of another system may be of a band alone
        geometry = with_long_bands(geometry, meaning.step_m, meaning.chord_m)
    channels = [name for name in CHANNELS if name in geometry and geometry[name].notna().any()]
    beyond = {}
    if judgement is not None:
        geometry = without_holes(geometry, meaning.step_m)
        beyond = _beyond(geometry["chainage_m"].to_numpy(), judgement)
    return section_quality(geometry, channels, section_m=section_m, beyond=beyond)


def _beyond(chainage: Array, judgement: Judgement) -> dict[str, Array]:
    """Return for each column or computed quantity and level with a peak beyond its limit where it is beyond (n,).

    It is 1 there, 0 elsewhere, and NaN where that is not known.
    """
    unknown = _by_name(judgement.unknown)
    out: dict[str, Array] = {}
    for name, stretches in _by_name(judgement.found).items():
        missing = _inside(chainage, unknown[name]) if name in unknown else np.zeros(len(chainage), dtype=bool)
        out[name] = np.where(_inside(chainage, stretches), 1.0, np.where(missing, np.nan, 0.0))
    return out


def _by_name(stretches: pd.DataFrame) -> dict[str, pd.DataFrame]:
    """Return the stretches of peaks for each column or computed quantity and level."""
    peaks = stretches[stretches["kind"] == "peak"]
    computed = peaks["parameter"].isin(_COMPUTED) & (peaks["column"] != "twist_mm")
    peaks = peaks.assign(column=peaks["column"].where(~computed, peaks["quantity"]))
    return {
        f"{column}_{level}".replace(" ", "_"): table
        for (column, level), table in peaks.groupby(["column", "level"], sort=True)
    }


def _inside(chainage: Array, stretches: pd.DataFrame) -> NDArray[np.bool_]:
    """Return which places lie in one of the stretches, ends included, (n,)."""
    first, stop = (np.searchsorted(chainage, stretches[name].to_numpy() + side) for name, side in _ENDS)
    steps = np.bincount(first, minlength=len(chainage) + 1) - np.bincount(stop, minlength=len(chainage) + 1)
    out: NDArray[np.bool_] = np.cumsum(steps)[:-1] > 0
    return out


_COMPUTED = ("twist", "warp", "gauge_change")
"""Parameters of limits that compare a column at two places, where it is not the twist of the table."""
_ENDS = (("from_m", -1e-6), ("to_m", 1e-6))
"""The ends of a stretch, and what puts their own rows inside."""

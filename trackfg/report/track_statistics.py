"""Statistics of a result's geometry by sections: standard deviations, the track quality index, shares beyond limits."""

from __future__ import annotations

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from trackfg.geometry.exceedances import Judgement
from trackfg.geometry.section_quality import section_quality
from trackfg.geometry.versine_bands import with_long_bands
from trackfg.numerics.arrays import Array
from trackfg.results.columns import CHANNELS
from trackfg.results.result import Result


def track_statistics(result: Result, *, section_m: float = 200.0, judgement: Judgement | None = None) -> pd.DataFrame:
    """Return one row per section with the columns of :func:`~trackfg.geometry.section_quality.section_quality`.

    Channels are all that the geometry knows; of a smoothed run also level and alignment in the bands D2 and D3. Of
    ``judgement`` there is a share for each column and level that has a peak beyond it; of what is computed from two
    places the limit is named in place of the column, such as ``warp_over_18.9_m``.
    Raises :class:`BadInputError` for a result without geometry.
    """
    geometry, meaning = result.geometry_for("statistics"), result.summary.geometry
    if result.summary.solver is not None:  # the versines of another system may be of a band alone
        geometry = with_long_bands(geometry, meaning.step_m, meaning.chord_m)
    channels = [name for name in CHANNELS if name in geometry and geometry[name].notna().any()]
    beyond = {} if judgement is None else _beyond(geometry["chainage_m"].to_numpy(), judgement)
    return section_quality(geometry, channels, section_m=section_m, beyond=beyond)


def _beyond(chainage: Array, judgement: Judgement) -> dict[str, NDArray[np.bool_]]:
    """Return for each column or computed quantity and level with a peak beyond its limit where it is beyond, (n,)."""
    found = judgement.found[judgement.found["kind"] == "peak"]
    computed = found["parameter"].isin(_COMPUTED) & (found["column"] != "twist_mm")
    found = found.assign(column=found["column"].where(~computed, found["quantity"]))
    out: dict[str, NDArray[np.bool_]] = {}
    for (column, level), table in found.groupby(["column", "level"], sort=True):
        first, stop = (np.searchsorted(chainage, table[name].to_numpy() + side) for name, side in _ENDS)
        steps = np.bincount(first, minlength=len(chainage) + 1) - np.bincount(stop, minlength=len(chainage) + 1)
        out[f"{column}_{level}".replace(" ", "_")] = np.cumsum(steps)[:-1] > 0
    return out


_COMPUTED = ("twist", "warp", "gauge_change")
"""Parameters of limits that compare a column at two places, where it is not the twist of the table."""
_ENDS = (("from_m", -1e-6), ("to_m", 1e-6))
"""The ends of an exceedance, and what puts their own rows inside."""

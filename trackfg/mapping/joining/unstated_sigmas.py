"""Sigmas of a geometry that another system measured, which has none: a share of how rough each channel is."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd

from trackfg.geometry.moving_average import remove_baseline
from trackfg.numerics.chainage.chainage_grid import step_of
from trackfg.numerics.robust import robust_sd

_SHARE = 0.1
"""Sigma of a channel without one, as a share of its short waves. Recording cars repeat channels worse than that, which
comparisons find out; among runs without sigmas only that these are alike counts."""
_LEAST = float(np.finfo(np.float64).tiny) ** 0.25
"""Sigma of a channel without short waves, in its unit: above 0, and so is its fourth power."""
_BASELINE_M = 25.0
"""Window of the moving average that short waves are free of, m: the longest wavelength of D1."""


def with_unstated_sigmas(geometry: pd.DataFrame, columns: Sequence[str]) -> pd.DataFrame:
    """Return the table, with a sigma in each of these columns that has values and no sigma anywhere."""
    step = step_of(geometry)
    window = 2.0 * step * round(_BASELINE_M / (2.0 * step))
    sigmas = {}
    for name in columns:
        value, sd = geometry[name].to_numpy(), geometry[f"{name}_sd"].to_numpy()
        if np.isfinite(value).any() and not np.isfinite(sd).any():
            short = remove_baseline(value, step, (window,))
            short = short[np.isfinite(short)]
            rough = robust_sd(short) if short.size else 0.0
            sigmas[f"{name}_sd"] = np.where(np.isfinite(value), max(_SHARE * rough, _LEAST), np.nan)
    return geometry.assign(**sigmas)

"""The offset of a curvature that is no design's: what it reads on straights."""

from __future__ import annotations

import numpy as np

from trackfg.geometry.moving_average import moving_average
from trackfg.numerics.arrays import Array
from trackfg.numerics.robust import robust_sd

_MEAN_OVER_M = 50.0
"""Length over which the curvature is averaged first, m: twice the longest wavelength of D1."""
_WITHIN = 2.0
"""Robust sigmas of the straights' spread within which values count as straight."""


def straight_offset(curvature_1pm: Array, step_m: float) -> float:
    """Return the curvature that straights read, 1/m, of a profile (n,): the mode of its means over 50 m.

    The mode is the half-sample mode (Bickel and Fruehwirth, Computational Statistics and Data Analysis 50, 2006),
    refined by the mean about it. Curves have many values each, straights all the same one. 0 where nothing is known.
    """
    window = 2.0 * step_m * round(_MEAN_OVER_M / (2.0 * step_m))
    values = moving_average(curvature_1pm, step_m, window)
    values = np.sort(values[np.isfinite(values)])
    if not values.size:
        return 0.0
    half = values
    while half.size > 3:
        count = (half.size + 1) // 2
        first = int(np.argmin(half[count - 1 :] - half[: half.size - count + 1]))
        half = half[first : first + count]
    mode = float(half.mean())
    # The spread of the straights: that of the values nearer to the mode than half of them are.
    near = values[np.abs(values - mode) <= np.median(np.abs(values - mode))]
    about = np.abs(values - mode) <= _WITHIN * max(robust_sd(near - mode), np.finfo(np.float64).tiny)
    return float(values[about].mean()) if about.any() else mode

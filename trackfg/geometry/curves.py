"""A track is curved where its curvature, averaged over 50 m, exceeds a least one.

Irregularities of the alignment bend the track by as much as a wide curve does; over 50 m they do not.
"""

from __future__ import annotations

import numpy as np
import pandas as pd

from trackfg.numerics.arrays import Array

CURVED_FROM_1PM = 1.0 / 5000.0
"""Track that is straighter, 1/m, is judged as tangent: a radius of 5000 m. Chosen here; limits of a railway may set
another one."""
_MEAN_OVER_M = 50.0
"""Length over which the curvature is averaged, m: twice the longest wavelength of D1."""


def mean_curvature(chainage_m: Array, curvature_1pm: Array) -> Array:
    """Return the curvature averaged over 50 m, 1/m, on a uniform grid; NaN does not count. Shape (n,)."""
    if len(chainage_m) < 2:
        return curvature_1pm
    rows = 2 * round(_MEAN_OVER_M / 2.0 / (chainage_m[1] - chainage_m[0])) + 1
    return pd.Series(curvature_1pm).rolling(rows, center=True, min_periods=1).mean().to_numpy(dtype=np.float64)


def curve_sense(chainage_m: Array, curvature_1pm: Array, from_1pm: float = CURVED_FROM_1PM) -> Array:
    """Return 1 in a curve to the left, -1 to the right, 0 on straight track. Shape (n,), on a uniform grid.

    A curve is where the curvature averaged over 50 m is above ``from_1pm``. Near places where it was measured this also
    says something of one where it was not (NaN); far from them it is 0.
    """
    mean = mean_curvature(chainage_m, curvature_1pm)
    return np.asarray(np.where(np.abs(mean) > from_1pm, np.sign(mean), 0.0))

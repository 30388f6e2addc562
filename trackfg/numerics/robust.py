"""Standard deviations come from the data alone: one that outliers do not change, and the jackknife's."""

from __future__ import annotations

import numpy as np

from trackfg.numerics.arrays import Array

SD_PER_MAD = 1.4826
"""Standard deviation of a normal variable over its median absolute deviation, 1/Phi^-1(3/4), to four digits (Hampel,
Journal of the American Statistical Association 69, 1974)."""


def robust_sd(errors: Array) -> float:
    """Return the standard deviation of errors about zero, from their median magnitude.

    ``errors``: any shape, at least one and none NaN; the result has their unit.
    """
    return SD_PER_MAD * float(np.median(np.abs(errors)))


def jackknife_sd(others: Array, value: float) -> float:
    """Return the standard deviation of an estimate about ``value`` from its leave-one-out values (n,), in their unit
    (Efron, "The jackknife, the bootstrap and other resampling plans", 1982, ch. 3).
    """
    return float(np.sqrt((others.size - 1) / others.size * np.sum((others - value) ** 2)))

"""Chi-square tests of mean squares, with fewer degrees of freedom where neighbours are correlated; and Student's
distribution, where few residuals determine a sigma.
"""

from __future__ import annotations

import numpy as np
from scipy.special import chdtrc, ndtr, stdtrit

from trackfg.numerics.arrays import Array


def exceeds_chance(mean_square: Array | float, degrees: Array | float, probability: float) -> np.ndarray:
    """Return whether mean squares of variables of variance 1 are larger than by chance of that ``probability``."""
    return np.asarray(chdtrc(degrees, mean_square * degrees) < probability)


def independent_number(number: float, correlation: float) -> float:
    """Return as how many independent values so many of an AR(1) process count, whose neighbours have ``correlation``.

    It is at least 1.
    """
    return max(1.0, number * (1.0 - correlation) / (1.0 + correlation))


def widening_of_few(degrees: int) -> float:
    """Return the factor on a sigma that was estimated with so many ``degrees`` of freedom, at least one, by which an
    error beyond three of it is as unlikely as of a normal variable.
    """
    return -float(stdtrit(degrees, ndtr(-3.0))) / 3.0

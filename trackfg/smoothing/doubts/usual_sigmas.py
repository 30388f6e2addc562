"""Errors that no residual shows are held against the usual sigma of a column of the geometry.

That is the sigma whose inverse square is the mean one, ``sqrt(n / sum(1 / sigma^2))``: errors of one size have the mean
square of ``error / sigma``, and holes, where sigmas are hundreds of times as large, hardly count.

What a filter takes off the waves of a column y is to second order a multiple of y'' (:class:`WaveSums`).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from trackfg.numerics.arrays import Array
from trackfg.results.verdict import Quantity

LEAST_WIDENING = 1.2
"""Factors below this are none: sigmas of the geometry, which are drawn, and the level of such errors are not known
better."""

COLUMNS: dict[Quantity, str] = {
    "twist": "twist_mm",
    "level": "versine_level_mm",
    "alignment": "versine_alignment_mm",
}
"""The columns of a geometry table whose sigmas do not allow for errors of short waves."""


def inverse_squares(sd: Array) -> tuple[float, float]:
    """Return the number of sigmas (n,) that are finite, and the sum of ``1 / sigma^2``; NaN stands for none."""
    return float(np.count_nonzero(np.isfinite(sd))), float(np.nansum(sd**-2.0))


def usual_sigma(number: float, inverse_square_sum: float) -> float:
    """Return the usual one of sigmas, in their unit, by what :func:`inverse_squares` returns of one or more."""
    return math.sqrt(number / inverse_square_sum)


class WaveSums(NamedTuple):
    """The sums of a column y: number and sum of squares of ``y''`` (times a power of the speed for some filters), and
    of the sigmas what :func:`inverse_squares` returns.
    """

    bends: float
    squared_bends: float
    sigmas: float
    inverse_square_sum: float

    @classmethod
    def of(cls, bends: Array, sd: Array) -> WaveSums:
        """Return the sums of second derivatives (m,) and sigmas (n,), NaN where there are none."""
        return cls(float(np.count_nonzero(np.isfinite(bends))), float(np.nansum(bends**2)), *inverse_squares(sd))

    @property
    def is_empty(self) -> bool:
        """Return whether there is no second derivative, or no sigma."""
        return not (self.bends and self.sigmas)

    @property
    def rms(self) -> float:
        """The root mean square of the second derivatives."""
        return math.sqrt(self.squared_bends / self.bends)

    def widening(self, error: float) -> float:
        """Return the factor of a sigma that allows for this ``error`` besides, in the unit of y."""
        return math.hypot(1.0, error / usual_sigma(self.sigmas, self.inverse_square_sum))

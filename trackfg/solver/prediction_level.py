"""The level of leave-one-out errors says whether sigmas of positions, and of what predicts them, are right."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trackfg.numerics.arrays import Array
from trackfg.numerics.chi_square import exceeds_chance, independent_number
from trackfg.numerics.robust import robust_sd

_GROSS_SIGMAS = 4.0
"""A prediction this far off, in the scale of the others, is a gross error of its own: 6e-5 of a normal distribution."""

_CHANCE = 1e-3
"""Probability that predictions are as far off by chance, below which they are not: one run in a thousand."""


class Level(NamedTuple):
    """The level is how large errors are in their sigmas, without gross ones, over ``number`` predictions.

    ``far``: whether that is more than chance.
    """

    ratio: float
    number: int
    far: bool


def level(sigmas: Array) -> Level:
    """Return the level of errors over their sigmas, (m, d) in order of time.

    Gross errors, far beyond the median, do not count: where most are large, none is gross. Errors that last are as good
    as fewer, by the correlation of neighbours.
    """
    size = np.sqrt(np.mean(sigmas**2, axis=1))
    scale = robust_sd(sigmas) if sigmas.size else 1.0
    used = sigmas[size <= _GROSS_SIGMAS * max(scale, 1.0)]
    if len(used) < 2:
        return Level(1.0, len(used), far=False)
    square = float(np.mean(used**2))
    correlation = float(np.clip(np.mean(used[1:] * used[:-1]) / square, 0.0, 0.99))
    degrees = independent_number(used.size, correlation)
    return Level(square**0.5, len(used), far=bool(exceeds_chance(square, degrees, _CHANCE)))

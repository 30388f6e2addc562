"""Standard normal numbers that are the same each time, of which the first are drawn once.

A stream draws the errors of its profiles with each piece of its tables, from the same seed: it then copies what a
generator takes ten times as long to draw.
"""

from __future__ import annotations

import math
from copy import deepcopy
from functools import cache

import numpy as np

from trackfg.numerics.arrays import Array

_SEED = 0

_KEPT = 2**19
"""Numbers that are kept, 4 MB: a piece of a stream's tables takes some 0.2 million at 100 km/h."""


class NormalDraws:
    """The numbers of ``np.random.default_rng(0).standard_normal``, in the same order, from the first one on."""

    def __init__(self) -> None:
        self._drawn = 0
        self._later: np.random.Generator | None = None

    def standard_normal(self, size: tuple[int, ...]) -> Array:
        """Return the next numbers, which the caller may write over."""
        kept, count = _kept()[0][self._drawn :], math.prod(size)
        self._drawn += count
        if count <= len(kept):
            return kept[:count].reshape(size).copy()
        out = np.empty(count)
        out[: len(kept)] = kept
        self._later = self._later or deepcopy(_kept()[1])
        self._later.standard_normal(out=out[len(kept) :])
        return out.reshape(size)


@cache
def _kept() -> tuple[Array, np.random.Generator]:
    """Return the first numbers, and the generator of those after them, of which each user draws from a copy."""
    rng = np.random.default_rng(_SEED)
    return rng.standard_normal(_KEPT), rng

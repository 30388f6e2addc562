"""Fewer points, the same picture: a curve keeps what the eye can see of it.

A line of many rows is drawn into few columns of pixels; of what falls into one column only the extremes can be seen,
and whether the line is broken there.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from trackfg.numerics.arrays import Array


def extremes(values: Array, stretches: int) -> NDArray[np.intp]:
    """Return indices, sorted, of what a curve needs to look the same in ``stretches`` columns of pixels.

    Of each of that many equal stretches: the least and the greatest value, the first and the last NaN with the values
    before and after, so that no peak is lost and no gap is closed; and both ends. Short curves are kept whole.
    """
    n = len(values)
    if n <= 2 * stretches:
        return np.arange(n)
    first = np.linspace(0, n, stretches + 1).astype(int)[:-1]
    stretch = np.searchsorted(first, np.arange(n), side="right")
    order = np.lexsort((values, stretch))  # NaN comes last in its stretch
    gap = np.isnan(values)
    numbers = np.add.reduceat((~gap).astype(int), first)
    some = numbers > 0
    gaps = np.flatnonzero(gap)
    ends = np.diff(stretch[gaps], prepend=-1, append=-1) != 0
    first_gap, last_gap = gaps[ends[:-1]], gaps[ends[1:]]
    keep = [[0, n - 1], order[first[some]], order[(first + numbers - 1)[some]]]
    keep += [first_gap - 1, first_gap, last_gap, last_gap + 1]
    kept: NDArray[np.intp] = np.unique(np.clip(np.concatenate(keep), 0, n - 1))
    return kept

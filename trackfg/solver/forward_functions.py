"""Linear functions of the states of a chain, estimated on the way forward.

Where the rows of all factors are eliminated to ``R x = d + e``, and ``R' Y = C``, functions C'x have the estimate
``Y'd`` and the covariance ``Y'Y``. Elimination and Y both go forward from keyframe to keyframe, so that conditionals of
a few keyframes at a time are enough: those of an hour with lasers are 0.15 GB.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from trackfg.factors.linear import LinearFactors
from trackfg.factors.states import KEYFRAME_DIM
from trackfg.numerics.arrays import Array
from trackfg.solver.covariance import Functions
from trackfg.solver.elimination import eliminated_blocks


def estimated(factors: Sequence[LinearFactors], keyframes: int, functions: Functions) -> tuple[Array, Array]:
    """Return the estimates (m,) and the covariance (m, m) of functions by the factors of a chain of keyframes."""
    count, at = len(functions.keyframe), functions.keyframe
    estimate, covariance = np.zeros(count), np.zeros((count, count))

    def add(y: Array, d: Array) -> None:
        some = slice(0, y.shape[1])
        estimate[some] += y.T @ d
        covariance[some, some] += y.T @ y

    begin, carried = 0, np.zeros((0, 0))
    for block in eliminated_blocks(factors, keyframes):
        end = begin + len(block.R)
        columns = np.searchsorted(at, end)
        right = np.zeros((len(block.R), KEYFRAME_DIM, columns))
        functions.add_to(right, begin)
        window = np.zeros((block.parents(-1), columns))
        window[: len(carried), : carried.shape[1]] = carried
        y, carried = block.forward_substituted(right, window)
        add(y.reshape(block.d.size, columns), block.d.ravel())
        begin = end
    of_shared = carried[KEYFRAME_DIM : block.size]
    of_shared[: functions.by_shared.shape[1]] += functions.by_shared.T
    add(block.shared_inverse.T @ of_shared, block.d_shared)
    return estimate, covariance

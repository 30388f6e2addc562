"""Sums of the rows of a matrix: weighted ones of a few rows each, which are a product with a sparse matrix, and running
ones.
"""

from __future__ import annotations

import numpy as np

from trackfg.numerics.arrays import Array
from trackfg.numerics.kernels import compiled_kernels, kernel_argument


def add_weighted_rows(rows: Array, index: np.ndarray, weights: Array, out: Array) -> None:
    """Add to ``out`` (m, s), in C order, ``sum_c weights[:, c] rows[index[:, c]]``, of rows (r, s).

    ``index`` and ``weights`` (m, c). A row whose weight is 0 is not read.
    """
    if compiled_kernels():
        from trackfg.numerics import compiled

        compiled.add_weighted_rows(
            kernel_argument(rows), np.ascontiguousarray(index, dtype=np.int64), kernel_argument(weights), out
        )
        return
    for row, weight in zip(index.T, weights.T, strict=True):
        used = np.flatnonzero(weight)
        out[used] += weight[used, None] * rows[row[used]]


def add_up_rows(rows: Array) -> Array:
    """Return the running sums of rows (m, s), in C order, in their place."""
    if compiled_kernels():
        from trackfg.numerics import compiled

        compiled.add_up_rows(rows)
        return rows
    return np.cumsum(rows, axis=0, out=rows)

"""Sums of the rows of a matrix: weighted ones of a few rows each, which are a product with a sparse matrix, and running
ones.
"""

from __future__ import annotations

import numpy as np

from trackfg.numerics.arrays import Array
from trackfg.numerics.kernels import compiled_kernels, kernel_argument

_IN_A_BLOCK = 64
"""Rows that are added up in steps of all blocks at once: ``np.cumsum`` takes four times as long."""


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
    from scipy.sparse import csr_array  # late: compiled kernels work without

    used = weights != 0.0
    begins = np.append(0, np.cumsum(np.count_nonzero(used, axis=1)))
    out += csr_array((weights[used], index[used], begins), shape=(len(out), len(rows))) @ rows


def add_up_rows(rows: Array) -> Array:
    """Return the running sums of rows (m, s), in C order, in their place."""
    if compiled_kernels():
        from trackfg.numerics import compiled

        compiled.add_up_rows(rows)
        return rows
    whole = len(rows) // _IN_A_BLOCK * _IN_A_BLOCK
    blocks = rows[:whole].reshape(-1, _IN_A_BLOCK, rows.shape[1])
    for i in range(1, _IN_A_BLOCK):
        blocks[:, i] += blocks[:, i - 1]
    blocks[1:] += np.cumsum(blocks[:-1, -1], axis=0)[:, None]
    rest = rows[max(whole - 1, 0) :]
    np.cumsum(rest, axis=0, out=rest)
    return rows

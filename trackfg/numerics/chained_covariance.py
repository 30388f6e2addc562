"""The covariance of functions along a chain is kept by blocks, each tied to the next one by the state between them.

The functions f_a of block a and those of later blocks have errors in common through the state y_a at the end of the
block alone:

    Cov(f_a, f_b) = E_a C_{a+1} ... C_{b-1} F_b,    a < b,

with E_a the regression of f_a on y_a, C_a that of y_{a-1} on y_a, and F_b the covariance of y_{b-1} with f_b. The
matrix grows with the square of the number of functions, its blocks in proportion to it. ("Sequentially semiseparable":
Chandrasekaran et al., "Some fast algorithms for sequentially semiseparable representations", 2005.)
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from trackfg.numerics.key_figures import Outlined

if TYPE_CHECKING:
    from trackfg.numerics.arrays import Array


class Block(NamedTuple):
    """These are m functions that follow each other, between a state of dimension r and one of dimension s.

    ``rows`` (m,): which functions. ``own`` (m, m): their covariance. ``by_end`` (m, s): their regression on the state
    at the end. ``start_by_end`` (r, s): regression of the state at the start on that at the end. ``with_start`` (r, m):
    covariance of the state at the start with the functions.
    """

    rows: np.ndarray
    own: Array
    by_end: Array
    start_by_end: Array
    with_start: Array


@dataclass(frozen=True, repr=False)
class ChainedCovariance(Outlined):
    """Joint covariance of functions, by blocks that have each of them once. Raises ``ValueError`` for other shapes."""

    blocks: tuple[Block, ...]

    def __post_init__(self) -> None:
        at_end = None
        for block in self.blocks:
            (m,), (r, s) = block.rows.shape, block.start_by_end.shape
            shapes = [part.shape for part in (block.own, block.by_end, block.with_start)]
            if shapes != [(m, m), (m, s), (r, m)] or at_end not in (None, r):
                raise ValueError(f"covariance of {m} functions: blocks {shapes} after a state of {at_end} do not fit")
            at_end = s
        if not np.array_equal(np.sort(self._rows), np.arange(self.size)):
            raise ValueError("covariance: expected each function once")

    @classmethod
    def of(cls, matrix: Array) -> ChainedCovariance:
        """Return a covariance (m, m) that is given as a matrix: one block."""
        nothing = np.zeros((0, len(matrix)))
        return cls((Block(np.arange(len(matrix)), matrix, nothing.T, np.zeros((0, 0)), nothing),))

    @property
    def _rows(self) -> np.ndarray:
        return np.concatenate([np.zeros(0, dtype=np.int64), *(block.rows for block in self.blocks)])

    @property
    def size(self) -> int:
        """The number of functions."""
        return sum(len(block.rows) for block in self.blocks)

    @property
    def matrix(self) -> Array:
        """The whole covariance, which takes memory with the square of its size."""
        return self.part(np.arange(self.size))

    def part(self, rows: np.ndarray) -> Array:
        """Return the covariance of some functions (m,), none of them twice, with each other: (m, m)."""
        wanted = np.full(self.size, -1)
        wanted[rows] = np.arange(len(rows))
        out = np.empty((len(rows), len(rows)))
        earlier, by_start = np.zeros(0, dtype=np.int64), np.zeros((0, 0))
        for block in self.blocks:
            at = wanted[block.rows]
            inside = np.flatnonzero(at >= 0)
            block_at = at[inside]
            out[np.ix_(block_at, block_at)] = block.own[np.ix_(inside, inside)]
            by_end = block.by_end[inside]
            if len(earlier):
                across = by_start @ block.with_start[:, inside]
                out[np.ix_(earlier, block_at)], out[np.ix_(block_at, earlier)] = across, across.T
                by_end = np.concatenate([by_start @ block.start_by_end, by_end])
            earlier, by_start = np.concatenate([earlier, block_at]), by_end
            if len(earlier) == len(rows):
                break
        return out

    def scaled(self, factor: Array) -> ChainedCovariance:
        """Return the covariance of the functions, each times its factor (m,)."""
        scaled = []
        for block in self.blocks:
            block_factor = factor[block.rows]
            scaled.append(
                block._replace(
                    own=block_factor[:, None] * block.own * block_factor,
                    by_end=block_factor[:, None] * block.by_end,
                    with_start=block.with_start * block_factor,
                )
            )
        return ChainedCovariance(tuple(scaled))

    def renumbered(self, number: np.ndarray) -> ChainedCovariance:
        """Return the same with function i as function ``number[i]``."""
        return ChainedCovariance(tuple(block._replace(rows=number[block.rows]) for block in self.blocks))

"""Channel statistics of an IMU: how often a value is repeated by chance, and how far values go.

They are learnt from ``BLOCK_ROWS`` rows at a time. Where the values of a channel are multiples of q and its noise is
white with sigma s, a sample equals the one before with a probability of at most

    p = P(|n| < q/2) = erf(q / (sqrt(8) s)),   n ~ N(0, s^2).

Here q is the smallest distance of two values met so far, and s the smallest noise: of the declared one, which a sensor
may stay below, and of what any block shows. Where equal values were met more often in any block, p is their share: at
rest, of a sensor whose steps are coarser than its noise, or of one whose rows a logger repeats. So a stream that begins
in motion knows what a rest will look like, and one that has rested does not forget it.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import erf
from typing import NamedTuple

import numpy as np

from trackfg.numerics.arrays import Array

BLOCK_ROWS = 200
"""Rows of a block: a second of a usual IMU."""
_BELOW_DECLARED = 4.0
"""A sensor's noise may be so many times smaller than declared."""
SAME = 5e-11
"""Values nearer than this, in any unit of an angular rate or acceleration, are equal: rounding in the sensor's axes."""


class BlockStatistics(NamedTuple):
    """Statistics after each of b blocks, all (b, 6): see :class:`ChannelStatistics`."""

    centre: Array
    furthest: Array
    finest: Array
    noise: Array
    repeated: Array


@dataclass
class ChannelStatistics:
    """Statistics of six channels. ``white`` (6,): declared densities of their noise, in their units per sqrt(Hz).

    ``rows``: the first ``filled`` ones are the block that is being collected. ``interval_s``: mean of the first block,
    None until then. ``chance``: probability that two samples in a row are equal. ``centre``: medians of the newest
    block. ``furthest``: how far from its centre each channel has been in any block. ``finest``, ``noise``,
    ``repeated``: q, s and the share of equal values.
    """

    white: Array
    rows: Array = field(default_factory=lambda: np.empty((BLOCK_ROWS, 7)))
    filled: int = 0
    interval_s: float | None = None
    chance: list[float] = field(default_factory=lambda: [1.0] * 6)
    centre: Array = field(default_factory=lambda: np.zeros(6))
    furthest: Array = field(default_factory=lambda: np.zeros(6))
    finest: Array = field(default_factory=lambda: np.full(6, np.inf))
    noise: Array = field(default_factory=lambda: np.full(6, np.inf))
    repeated: Array = field(default_factory=lambda: np.zeros(6))

    @property
    def room(self) -> int:
        """The number of rows that complete the block."""
        return BLOCK_ROWS - self.filled

    def learn(self, rows: Array) -> None:
        """Learn from measurements (n, 7) in order: times, s, and channels."""
        while len(rows):
            part = rows[: self.room]
            self.rows[self.filled : self.filled + len(part)] = part
            self.filled += len(part)
            rows = rows[len(part) :]
            if self.filled == BLOCK_ROWS:
                if self.interval_s is None:
                    self.interval_s = float(self.rows[-1, 0] - self.rows[0, 0]) / (BLOCK_ROWS - 1)
                    self.noise = self.white / (_BELOW_DECLARED * np.sqrt(self.interval_s))
                self.become(self.after(self.rows[None, :, 1:]), 0)
                self.filled = 0

    def after(self, blocks: Array) -> BlockStatistics:
        """Return what the statistics are after each of these further blocks, (b, BLOCK_ROWS, 6)."""
        ordered = np.sort(np.swapaxes(blocks, 1, 2))
        steps, apart = blocks[:, 1:] - blocks[:, :-1], np.diff(ordered)
        apart[apart <= SAME] = np.inf
        centre = ordered[:, :, BLOCK_ROWS // 2]
        furthest = np.maximum(centre - ordered[:, :, 0], ordered[:, :, -1] - centre)
        noise = np.sqrt(0.5 * np.sum(steps * steps, axis=1) / steps.shape[1])
        repeated = np.count_nonzero(steps == 0.0, axis=1) / steps.shape[1]
        return BlockStatistics(
            centre,
            _running(np.maximum, self.furthest, furthest),
            _running(np.minimum, self.finest, apart.min(axis=2)),
            _running(np.minimum, self.noise, noise),
            _running(np.maximum, self.repeated, repeated),
        )

    def become(self, after: BlockStatistics, block: int) -> None:
        """Become what the statistics are after one of the blocks."""
        self.centre, self.furthest, self.finest, self.noise, self.repeated = (part[block] for part in after)
        each = zip(self.repeated.tolist(), self.finest.tolist(), self.noise.tolist(), strict=True)
        self.chance = [max(share, erf(q / (np.sqrt(8.0) * s)) if s > 0.0 else 1.0) for share, q, s in each]


def _running(extreme: np.ufunc, initial: Array, of_blocks: Array) -> Array:
    """Return the extreme of the ``initial`` one (6,) and of all blocks up to each, (b, 6)."""
    return np.asarray(extreme(initial, extreme.accumulate(of_blocks)))

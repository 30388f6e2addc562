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

import numpy as np

from trackfg.numerics.arrays import Array

BLOCK_ROWS = 200
"""Rows of a block: a second of a usual IMU."""
_BELOW_DECLARED = 4.0
"""A sensor's noise may be so many times smaller than declared."""
SAME = 5e-11
"""Values nearer than this, in any unit of an angular rate or acceleration, are equal: rounding in the sensor's axes."""


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
                self._learn_block(self.rows[:, 0], self.rows[:, 1:])
                self.filled = 0

    def _learn_block(self, t: Array, x: Array) -> None:
        if self.interval_s is None:
            self.interval_s = float(t[-1] - t[0]) / (BLOCK_ROWS - 1)
            self.noise = self.white / (_BELOW_DECLARED * np.sqrt(self.interval_s))
        ordered = np.sort(x.T)
        steps, apart = x[1:] - x[:-1], ordered[:, 1:] - ordered[:, :-1]
        apart[apart <= SAME] = np.inf
        self.repeated = np.maximum(self.repeated, np.count_nonzero(steps == 0.0, axis=0) / len(steps))
        self.finest = np.minimum(self.finest, apart.min(axis=1))
        self.noise = np.minimum(self.noise, np.sqrt(0.5 * np.einsum("ij,ij->j", steps, steps) / len(steps)))
        each = zip(self.repeated.tolist(), self.finest.tolist(), self.noise.tolist(), strict=True)
        self.chance = [max(share, erf(q / (np.sqrt(8.0) * s)) if s > 0.0 else 1.0) for share, q, s in each]
        self.centre = ordered[:, BLOCK_ROWS // 2]
        self.furthest = np.maximum(self.furthest, np.abs(ordered[:, [0, -1]].T - self.centre).max(axis=0))

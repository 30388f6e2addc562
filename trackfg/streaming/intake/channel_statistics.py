"""What the six channels of a stream's IMU usually show: how often a value comes twice by chance, how far values go.

Learnt from ``BLOCK_ROWS`` rows at a time. Where the values of a channel are multiples of q and its noise is white with
sigma s, a sample equals the one before with a probability of at most

    p = P(|n| < q/2) = erf(q / (sqrt(8) s)),   n ~ N(0, s^2).

Here q is the smallest distance of two values met so far, and s the smallest noise: of the declared one, which a sensor
may stay below, and of what any block shows. Where equal values were met more often in any block, p is their share: at
rest, of a sensor whose steps are coarser than its noise, or of one whose rows a logger repeats. So a stream that begins
in motion knows what a rest will look like, and one that has rested does not forget it.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import erf
from typing import Any

import numpy as np

from trackfg.numerics.arrays import Array
from trackfg.streaming.checkpoint.json_numbers import finite_or, finite_or_none

BLOCK_ROWS = 200
_BELOW_DECLARED = 4.0
"""A sensor's noise may be so many times smaller than declared."""
SAME = 5e-11
"""In any unit of an angular rate or acceleration: values nearer than this are one, rounded in the sensor's axes."""


class ChannelStatistics:
    """``white`` (6,): the declared densities of the channels' noise, in their units per sqrt(Hz)."""

    def __init__(self, white: Array) -> None:
        self._white = white
        self._rows = np.empty((BLOCK_ROWS, 7))
        self._filled = 0
        self._finest = np.full(6, np.inf)
        self._noise = np.full(6, np.inf)
        self._repeated = np.zeros(6)
        self.interval_s: float | None = None
        """Mean of the first block; None until then."""
        self.chance: list[float] = [1.0] * 6
        """Of each channel, that two samples in a row are equal."""
        self.centre = np.zeros(6)
        """Medians of the newest block."""
        self.furthest = np.zeros(6)
        """How far from its centre each channel has been in any block."""

    @property
    def room(self) -> int:
        """Rows that are missing to the next block."""
        return BLOCK_ROWS - self._filled

    def learn(self, rows: Array) -> None:
        """From rows (n, 7) in order, which are measurements: times, s, and channels."""
        while len(rows):
            some = rows[: self.room]
            self._rows[self._filled : self._filled + len(some)] = some
            self._filled += len(some)
            rows = rows[len(some) :]
            if self._filled == BLOCK_ROWS:
                self._learn_block(self._rows[:, 0], self._rows[:, 1:])
                self._filled = 0

    def _learn_block(self, t: Array, x: Array) -> None:
        if self.interval_s is None:
            self.interval_s = float(t[-1] - t[0]) / (BLOCK_ROWS - 1)
            self._noise = self._white / (_BELOW_DECLARED * np.sqrt(self.interval_s))
        ordered = np.sort(x.T)
        steps, apart = x[1:] - x[:-1], ordered[:, 1:] - ordered[:, :-1]
        apart[apart <= SAME] = np.inf
        self._repeated = np.maximum(self._repeated, np.count_nonzero(steps == 0.0, axis=0) / len(steps))
        self._finest = np.minimum(self._finest, apart.min(axis=1))
        self._noise = np.minimum(self._noise, np.sqrt(0.5 * np.einsum("ij,ij->j", steps, steps) / len(steps)))
        each = zip(self._repeated.tolist(), self._finest.tolist(), self._noise.tolist(), strict=True)
        self.chance = [max(share, erf(q / (np.sqrt(8.0) * s)) if s > 0.0 else 1.0) for share, q, s in each]
        self.centre = ordered[:, BLOCK_ROWS // 2]
        self.furthest = np.maximum(self.furthest, np.abs(ordered[:, [0, -1]].T - self.centre).max(axis=0))

    def state(self) -> dict[str, Any]:
        """All of it, as JSON values."""
        return {
            "rows": self._rows[: self._filled].tolist(),
            "finest": [finite_or_none(q) for q in self._finest],
            "noise": [finite_or_none(s) for s in self._noise],
            "repeated": self._repeated.tolist(),
            "interval_s": self.interval_s,
            "chance": self.chance,
            "centre": self.centre.tolist(),
            "furthest": self.furthest.tolist(),
        }

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on from a :meth:`state`."""
        self._filled = len(state["rows"])
        self._rows[: self._filled] = np.array(state["rows"], dtype=np.float64).reshape(-1, 7)
        self._finest, self._noise = (
            np.array([finite_or(np.inf, x) for x in state[name]]) for name in ("finest", "noise")
        )
        self._repeated = np.array(state["repeated"])
        self.interval_s, self.chance = state["interval_s"], list(state["chance"])
        self.centre, self.furthest = np.array(state["centre"]), np.array(state["furthest"])

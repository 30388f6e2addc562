"""Rows that repeat samples of a slow inertial sensor are left out of a stream, as they are of a recording.

:mod:`trackfg.checks.inertial.repeated_rows` says what such rows are. A stream learns for how many rows a sample stays
from the runs of equal rows that are over, block by block: the rows of the first block pass. How long the newest run
will last it does not know. So a sample that stays is taken for a new one when it has stayed for twice as long as usual,
and each time as long again.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from trackfg.checks.inertial.repeated_rows import usual_rows
from trackfg.numerics.arrays import Array

_RUNS = 32
"""So many runs are a block: three seconds of a sensor of 10 samples a second."""


@dataclass
class RepeatedRows:
    """The newest row's six values ``before``, the number of rows ``since`` they have been there, the ``lengths`` of the
    runs of a block so far, and for how many rows a sample ``usual``-ly stays by the last whole block.
    """

    before: Array = field(default_factory=lambda: np.full(6, np.nan))
    since: int = 0
    lengths: np.ndarray = field(default_factory=lambda: np.empty(0, dtype=np.int64))
    usual: int = 1

    def take(self, rows: Array) -> tuple[Array, Array]:
        """Take the next rows (n, 7), in order: return those that are samples, and the times of others (m,), s."""
        if not len(rows):
            return rows, np.empty(0)
        fresh = self._fresh(rows[:, 1:])
        if self.usual == self.since == 1 and fresh.all() and (self.lengths == 1).all():  # as nearly always
            self.lengths = np.ones((len(self.lengths) + len(rows)) % _RUNS, dtype=np.int64)
            self.before = rows[-1, 1:].copy()
            return rows, np.empty(0)
        starts, since = np.flatnonzero(fresh), self.since
        ends = np.concatenate([[since + starts[0]], np.diff(starts)]) if len(starts) else np.empty(0, dtype=np.int64)
        over = ends[1:] if not since else ends  # before the first row there is no run
        usual = np.full(len(starts) + 1, self.usual)
        lengths = np.concatenate([self.lengths, over])
        for end in range(_RUNS, len(lengths) + 1, _RUNS):
            usual[end - len(self.lengths) + len(starts) - len(over) :] = usual_rows(lengths[end - _RUNS : end])
        self.before, self.usual = rows[-1, 1:].copy(), int(usual[-1])
        self.lengths = lengths[len(lengths) // _RUNS * _RUNS :].copy()
        run = np.cumsum(fresh)
        place = np.arange(len(rows)) - np.append(-since, starts)[run]
        self.since = int(place[-1]) + 1
        usual = usual[run]
        repeats = ~fresh & (usual > 1) & ((place < 2 * usual) | (place % usual != 0))
        return rows[~repeats], rows[repeats, 0]

    def _fresh(self, channels: Array) -> np.ndarray:
        """Return which rows (n, 6) are not those before them, (n,): by their first channel nearly all."""
        first = np.append(self.before[:1], channels[:, 0])
        fresh = first[1:] != first[:-1]
        rest = np.flatnonzero(~fresh)
        if len(rest):
            fresh[rest] = (channels[rest] != np.concatenate([self.before[None], channels])[rest]).any(axis=1)
        return np.asarray(fresh)

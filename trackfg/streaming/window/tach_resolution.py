"""What a tach's readings are rounded to, learnt from the first rows in which the wheel turns.

A stream begins at rest, where a count says nothing of its steps. Until they show, the description tells them, or a
coarse step is assumed: a reading that is believed too much would hold on to where in a step the wheel stood.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trackfg.numerics.arrays import Array
from trackfg.recording.description import Tach
from trackfg.sensors.tach import read_resolution

_ENOUGH_M = 20.0
_MOST_ROWS = 20_000
_ASSUMED_STEP_M = 0.05
_AT_PULSES = 0.2
"""Rounding, in steps, that rows at times of their own do not reach."""


@dataclass
class TachResolution:
    """``quantum``: the distance of one count, m, and ``rounding_sd``, m, of a reading. ``rows`` (n, 2): times and
    distances as recorded since the wheel began to turn, while ``learning``; at rest the last one.
    """

    quantum: float
    rounding_sd: float
    rows: Array
    learning: bool = True

    @classmethod
    def of(cls, tach: Tach) -> TachResolution:
        """Before there are rows."""
        step = _ASSUMED_STEP_M
        if tach.kind == "pulses" and tach.pulses_per_rev and tach.wheel_diameter_m:
            step = np.pi * tach.wheel_diameter_m / tach.pulses_per_rev
        return cls(step, step / float(np.sqrt(12.0)), np.zeros((0, 2)))

    @property
    def at_pulses(self) -> bool:
        """Whether rows are the pulses' own times, as far as is known."""
        return self.rounding_sd < _AT_PULSES * self.quantum

    @property
    def has_turned(self) -> bool:
        """Whether the wheel has."""
        return not self.learning or len(self.rows) > 1

    def learn(self, rows: Array) -> None:
        """From the next rows; those that are known may be among them."""
        if not self.learning:
            return
        new = rows if not len(self.rows) else rows[rows[:, 0] > self.rows[-1, 0]]
        every = np.concatenate([self.rows, new])
        moved = np.flatnonzero(np.diff(every[:, 1]))
        if not moved.size:
            self.rows = every[-1:]
            return
        self.rows = every[moved[0] :]
        self.quantum, self.rounding_sd = read_resolution(*self.rows.T)
        rolled = float(np.abs(np.diff(self.rows[:, 1])).sum())
        if rolled > _ENOUGH_M or len(self.rows) > _MOST_ROWS:
            self.learning, self.rows = False, self.rows[:0]

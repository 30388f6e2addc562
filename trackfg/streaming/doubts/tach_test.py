"""A stream tests whether most distances of its tach have no weight, by :mod:`trackfg.smoothing.weightless_sensors`.

Such a tach contradicts all other sensors, by its unit or its sense, and the stream goes on without it.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from trackfg.factors.factor_type import FactorType
from trackfg.factors.family import family_of
from trackfg.numerics.arrays import Array
from trackfg.results.events import Event
from trackfg.smoothing.weightless_sensors import TachRows
from trackfg.streaming.doubts.reporting import event_of
from trackfg.streaming.window.window import Window

_MOST = 600
"""So many of the newest distances are kept: ten minutes of keyframes once a second, as of a receiver's positions."""


@dataclass
class TachTest:
    """The test keeps the newest distances, up to ``until_s``: whether each is ``weightless`` (m,), and how many times
    as far as it says the vehicle ``moved`` (m,).
    """

    until_s: float = -np.inf
    weightless: Array = field(default_factory=lambda: np.zeros(0))
    moved: Array = field(default_factory=lambda: np.zeros(0))

    def put(self, window: Window) -> None:
        """Take the distances of a window that are newer than those so far."""
        family = family_of(window.families, FactorType.TACH_DISTANCE)
        if family is None or not len(family):
            return
        rows = TachRows.of(family, window.states)
        new = window.t[rows.last_keyframe] > self.until_s
        self.weightless = np.concatenate([self.weightless, rows.weightless[new]])[-_MOST:]
        self.moved = np.concatenate([self.moved, rows.moved[new]])[-_MOST:]
        self.until_s = float(window.t[-1])

    def events(self, until_s: float, *, placed: bool) -> tuple[Event, ...]:
        """Return an event where most distances have no weight, unless something else has ``placed`` the vehicle and the
        tach's sense is right.
        """
        contradiction = TachRows(np.zeros(0), self.weightless, self.moved).contradiction
        doubts = () if contradiction is None else contradiction.doubts(instead=placed)
        return tuple(event_of(doubt, until_s) for doubt in doubts)

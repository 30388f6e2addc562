"""Passes: stretches of a run between two changes of direction."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trackfg.numerics.arrays import Array
from trackfg.numerics.spans import true_runs

_MOVED_M = 0.05
"""Keyframes closer than this say nothing about the direction of travel."""


@dataclass(frozen=True)
class Pass:
    """A pass goes from keyframe ``first`` to keyframe ``last``; distance grows (``sense`` 1) or falls (-1)."""

    first: int
    last: int
    sense: int

    def rows(self, keyframe_times: Array, t: Array) -> slice:
        """Return which of the sorted times ``t`` lie in it."""
        ends = keyframe_times[[self.first, self.last]] + [-1e-9, 1e-9]
        return slice(*np.searchsorted(t, ends).tolist())


def passes(distance: Array, least_m: float = _MOVED_M) -> list[Pass]:
    """Return all passes in order, from the distance at the keyframes, m (n,). A rest belongs to the pass before it.

    Steps up to ``least_m`` are rest.
    """
    steps = np.diff(distance)
    moving = np.flatnonzero(np.abs(steps) > least_m)
    if moving.size == 0:
        return []
    latest = np.clip(np.searchsorted(moving, np.arange(len(steps)), side="right") - 1, 0, None)
    rising = steps[moving[latest]] > 0
    traversals = [Pass(int(a), int(b), sense) for sense in (1, -1) for a, b in true_runs(rising == (sense > 0))]
    return sorted(traversals, key=lambda traversal: traversal.first)


def only_falls(distance: Array) -> bool:
    """Return whether a wheel's count or distance (n,) falls and never rises."""
    steps = np.diff(distance)
    return bool((steps <= 0.0).all() and (steps < 0.0).any())

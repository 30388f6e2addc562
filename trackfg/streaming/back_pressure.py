"""Back-pressure makes keyframes sparser when rows come faster than they can be handled; all rows are used all the same.

A source that does not wait until its rows are taken is a queue. A batch that was there at once, holds T seconds of the
stream and takes B seconds to handle makes it longer by ``B - T``; where the stream had to wait for rows, it is empty.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trackfg.results.events import Event

_BEHIND_S = 2.0
"""Keyframes get sparser when the queue has grown by so much, s."""
_CAUGHT_UP_S = 10.0
"""They get denser again when the queue has been shorter than a tenth of that for so long, s."""
_SPARSEST = 8.0
"""Keyframes are at most so many times further apart than the settings say."""
_WAITED = 0.3
"""A wait longer than this part of a batch's own time was for rows, not for their reading: the queue is empty."""


@dataclass
class BackPressure:
    """The queue of a stream, and what it makes of the keyframes.

    ``factor``: how many times further apart keyframes are than the settings say. ``behind_s``: length of the queue.

    ``at_change_s``: what that was when the factor was settled; ``short_s``: for how long it has been short.
    """

    factor: float = 1.0
    behind_s: float = 0.0
    at_change_s: float = 0.0
    short_s: float = 0.0
    until_s: float | None = None

    def record(self, waited_s: float, busy_s: float, until_s: float) -> Event | None:
        """Record a handled batch, with rows complete up to ``until_s``; return the event if keyframes change."""
        if not np.isfinite(until_s):
            return None  # no row is complete yet
        span = 0.0 if self.until_s is None else max(until_s - self.until_s, 0.0)
        self.until_s = until_s
        queued = self.behind_s + waited_s + busy_s - span
        self.behind_s = 0.0 if waited_s > _WAITED * span else max(queued, 0.0)
        self.short_s = self.short_s + span if self.behind_s < 0.1 * _BEHIND_S else 0.0
        self.at_change_s = min(self.at_change_s, self.behind_s)
        if self.behind_s > self.at_change_s + _BEHIND_S and self.factor < _SPARSEST:
            why = self._changed(2.0 * self.factor, f"rows are {self.behind_s:.1f} s ahead")
            return Event("sparser", t_s=until_s, detail=why)
        if self.short_s > _CAUGHT_UP_S and self.factor > 1.0:
            why = self._changed(0.5 * self.factor, "rows are handled as they come")
            return Event("denser", t_s=until_s, detail=why)
        return None

    def _changed(self, factor: float, why: str) -> str:
        self.factor, self.at_change_s, self.short_s = factor, self.behind_s, 0.0
        apart = "as the settings say" if factor == 1.0 else f"{factor:g} times further apart than the settings say"
        return f"{why}: keyframes are {apart}"

"""A stream tests whether a sensor that is declared rigid leans in curves (:mod:`trackfg.smoothing.leaning_body`).

Of the cells along the way (:mod:`trackfg.streaming.doubts.track_cells`) only those are kept of which it is not known
yet whether they are in a circle, and those of a circle that is not over.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from trackfg.numerics.arrays import Array
from trackfg.results.events import Event, doubt_event
from trackfg.smoothing.leaning_body import FEWEST_CELLS, HINT, NEIGHBOURS, OF_TRACK, circle_sums, circles, lean_of, pull


@dataclass
class LeanTest:
    """The test keeps sums over the circles that are over.

    ``cells`` (c, 4): heading and roll, rad, the variance of roll, and the speed, m/s; circles that begin before the
    ``first`` of these have been judged; ``sums`` (5,) are those of :func:`~trackfg.smoothing.leaning_body.circle_sums`.
    """

    cells: Array = field(default_factory=lambda: np.zeros((0, 4)))
    first: int = 0
    sums: Array = field(default_factory=lambda: np.zeros(5))

    def put(self, cells: Array) -> None:
        """Take the next cells (c, 4)."""
        self.cells = np.concatenate([self.cells, cells])
        heading, roll, _, speed = self.cells.T
        known = len(self.cells) - NEIGHBOURS - 1
        new = [circle for circle in circles(heading) if circle.start >= self.first]
        over = [circle for circle in new if circle.stop <= known]
        self.sums += circle_sums(pull(speed, heading), roll, over)
        # A circle that has just begun is none yet.
        decided = max(known - FEWEST_CELLS + 2, self.first)
        self.first = min([decided, *(circle.start for circle in new[len(over) :])])
        kept = max(self.first - NEIGHBOURS - 1, 0)
        self.cells, self.first = self.cells[kept:].copy(), self.first - kept

    def events(self, until_s: float) -> tuple[Event, ...]:
        """Return an event if the vehicle leans beyond chance, known at the end of a stream."""
        lean = lean_of(self.sums)
        if not lean.is_sure:
            return ()
        return (doubt_event(("roll", *OF_TRACK), lean.in_words(), HINT, t_s=until_s),)

"""A stream tests whether its mean roll on straights is zero, as :mod:`trackfg.smoothing.straights` does of a run.

Of the cells along the way (:mod:`trackfg.streaming.doubts.track_cells`) only those are kept of which it is not known
yet whether they are on a straight.

The variance V of a cell's roll falls with time, and the errors of all cells are fully correlated. The mean
has the weights ``1 / V``, so that its variance is ``n / sum(1 / V)`` at most (Cauchy and Schwarz).
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from trackfg.numerics.arrays import Array
from trackfg.results.events import Event, doubt_event
from trackfg.smoothing.leaning_body import ALIKE_CELLS
from trackfg.smoothing.passage import STEP_M
from trackfg.smoothing.straights import (
    MARGIN,
    SHORTEST_M,
    in_words,
    straight,
    straightest,
)

_SIGMAS = 3.3
"""Of the mean roll, within which it is chance, at the probability of 1e-3 as of other doubts of a stream."""


@dataclass
class RollTest:
    """The test keeps sums over the cells on straights.

    ``fastest_mps``: the vehicle's highest speed; ``cells`` (c, 4): heading, roll, rad, the variance of roll, and the
    highest speed so far; ``sums`` (5,): the number of cells on straights, and the sums of their weights, of the squares
    of these, and of roll and its square, weighted.
    """

    fastest_mps: float = 0.0
    cells: Array = field(default_factory=lambda: np.zeros((0, 4)))
    sums: Array = field(default_factory=lambda: np.zeros(5))

    def put(self, cells: Array) -> None:
        """Take the next cells (c, 4)."""
        if not len(cells):
            return
        heading, roll, variance, speed = cells.T
        fastest = np.maximum.accumulate(np.maximum(np.abs(speed), self.fastest_mps))
        self.fastest_mps = float(fastest[-1])
        self.cells = np.concatenate([self.cells, np.column_stack([heading, roll, variance, fastest])])
        if len(self.cells) > 2 * MARGIN:
            inner = slice(MARGIN, len(self.cells) - MARGIN)
            on_straight = straight(self.cells[:, 0], straightest(self.cells[:, 3]))
            _, roll, variance, _ = self.cells[inner][on_straight[inner]].T
            weight = 1.0 / variance
            self.sums += [len(roll), weight.sum(), weight @ weight, weight @ roll, weight @ roll**2]
            self.cells = self.cells[-2 * MARGIN :].copy()

    def events(self, until_s: float) -> tuple[Event, ...]:
        """Return an event if the sigmas do not explain the mean roll on straights, known at the end of a stream.

        What the track's own irregularities leave of the mean is no tilt.
        """
        number, weights, of_weights, roll, squares = self.sums
        if number * STEP_M < SHORTEST_M:
            return ()
        mean = roll / weights
        of_track = (squares / weights - mean**2) * ALIKE_CELLS * of_weights / weights**2
        if mean**2 < _SIGMAS**2 * (number / weights + of_track):
            return ()
        advice = "declare mount_rpy_deg or mount_roll_sd_deg of [imu], or smooth the recording"
        return (doubt_event(("roll", "cross_level"), in_words(mean), advice, t_s=until_s),)

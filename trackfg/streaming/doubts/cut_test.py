"""A stream tests whether a body on springs may have cut curves by more than the sigma of its chainage.

The way that is cut is counted since the last fix that was tested, as :mod:`trackfg.smoothing.doubts.cut_doubts` does.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
import pandas as pd

from trackfg.numerics.arrays import Array
from trackfg.results.events import Event
from trackfg.smoothing.doubts.cut_doubts import CELLS, LEAST_SD_M, cut_per_cell, doubt_of_cut
from trackfg.smoothing.doubts.usual_sigmas import LEAST_WIDENING
from trackfg.streaming.doubts.reporting import event_of


@dataclass
class CutTest:
    """The test keeps the way that may be cut, and sums of it over the sigmas.

    ``heading`` (c,): that of the newest cells, rad; ``cut_m``: the way that may be cut since the last of ``fixes``,
    and the ``most_m`` that was; ``rows`` and ``squares``: of the trajectory, and the sum of squares of the cut over the
    sigma. ``sharp``: the vehicle turns more sharply than any on bogies.
    """

    heading: Array = field(default_factory=lambda: np.zeros(0))
    cut_m: float = 0.0
    most_m: float = 0.0
    fixes: float = 0.0
    rows: int = 0
    squares: float = 0.0
    sharp: bool = False

    def put(self, cells: Array, smoothed: pd.DataFrame, fixes: float) -> None:
        """Take the next cells (c, 4), the rows that they are of, and how many fixes were tested so far."""
        heading = np.concatenate([self.heading, np.unwrap(cells[:, 0])])
        cuts = cut_per_cell(heading)
        if cuts is None:
            self.sharp = True
        else:
            self.cut_m += float(np.sum(cuts))
        self.heading = heading[-2 * CELLS :]
        if fixes > self.fixes:
            self.cut_m, self.fixes = 0.0, fixes
        self.most_m = max(self.most_m, self.cut_m)
        sd = smoothed["chainage_m_sd"].to_numpy()
        sd = sd[sd > LEAST_SD_M]
        self.rows += len(sd)
        self.squares += float(np.sum((self.cut_m / sd) ** 2))

    def events(self, until_s: float) -> tuple[Event, ...]:
        """Return an event where the chainage may be off by more than its sigma."""
        factor = math.sqrt(1.0 + self.squares / max(self.rows, 1))
        if self.sharp or factor < LEAST_WIDENING:
            return ()
        return (event_of(doubt_of_cut(factor, self.most_m), until_s),)

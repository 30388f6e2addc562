"""A stream tests whether its mean roll on straights is zero, as :mod:`trackfg.smoothing.straights` does of a run.

The smoothed rows are laid on a grid along the way. Only those cells are kept of which it is not known yet whether they
are on a straight.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pandas as pd

from trackfg.numerics.arrays import Array
from trackfg.results.columns import TRAJECTORY_COLUMNS
from trackfg.results.events import DOUBT, Event
from trackfg.smoothing.passage import STEP_M
from trackfg.smoothing.straights import (
    MARGIN,
    NOTICED_RAD,
    SHORTEST_M,
    in_words,
    straight,
    straightest,
    unexplained_roll,
)

_SIGMAS = 3.3
"""Of the mean roll, within which it is chance, at the probability of 1e-3 as of other doubts of a stream."""

_COLUMNS = [TRAJECTORY_COLUMNS.index(name) for name in ("t_s", "speed_mps", "yaw_rad", "roll_rad", "roll_rad_sd")]
"""Where in a row of the trajectory these are."""


@dataclass
class RollTest:
    """Sums over the cells on straights.

    ``way_m``: how far the vehicle has travelled, ``newest`` (0 or 1, 5) the row there, ``fastest_mps`` its highest
    speed; ``cells`` (c, 4): heading, roll, rad, the variance of roll, and the highest speed so far; ``sums`` (3,): the
    number of cells on straights, and the sums of roll and variance.
    """

    way_m: float = 0.0
    newest: Array = field(default_factory=lambda: np.zeros((0, len(_COLUMNS))))
    fastest_mps: float = 0.0
    cells: Array = field(default_factory=lambda: np.zeros((0, 4)))
    sums: Array = field(default_factory=lambda: np.zeros(3))

    def put(self, smoothed: pd.DataFrame) -> None:
        """Take the next smoothed rows, whose columns are those of a trajectory."""
        if not len(smoothed):
            return
        rows = np.concatenate([self.newest, smoothed.to_numpy(dtype=np.float64)[:, _COLUMNS]])
        rows[:, 2] = np.unwrap(rows[:, 2])
        t, speed, heading, roll, sd = rows.T
        steps = 0.5 * np.abs(speed[1:] + speed[:-1]) * np.diff(t)
        way = self.way_m + np.concatenate([[0.0], np.cumsum(steps)])
        grid = STEP_M * np.arange(np.floor(way[0] / STEP_M) + 1.0, np.floor(way[-1] / STEP_M) + 1.0)
        fastest = np.maximum.accumulate(np.maximum(np.abs(speed), self.fastest_mps))
        new = np.column_stack([np.interp(grid, way, of) for of in (heading, roll, sd**2, fastest)])
        self.way_m, self.newest, self.fastest_mps = float(way[-1]), rows[-1:].copy(), float(fastest[-1])
        self.cells = np.concatenate([self.cells, new])
        if len(self.cells) > 2 * MARGIN:
            inner = slice(MARGIN, len(self.cells) - MARGIN)
            on_straight = straight(self.cells[:, 0], straightest(self.cells[:, 3]))
            cells = self.cells[inner][on_straight[inner]]
            self.sums += [len(cells), *cells[:, 1:3].sum(axis=0)]
            self.cells = self.cells[-2 * MARGIN :].copy()

    def events(self, until_s: float) -> tuple[Event, ...]:
        """Return an event if the sigmas do not explain the mean roll on straights, known at the end of a stream."""
        number, roll, variance = self.sums
        if number * STEP_M < SHORTEST_M:
            return ()
        mean, square = roll / number, variance / number
        if mean**2 < _SIGMAS**2 * square or unexplained_roll(mean, square) < NOTICED_RAD:
            return ()
        advice = "declare mount_rpy_deg or mount_roll_sd_deg of [imu], or smooth the recording"
        return (Event(DOUBT, t_s=until_s, detail=f"roll, cross_level: {in_words(mean)}: {advice}"),)

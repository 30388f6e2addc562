"""Track cells are the smoothed rows of a stream on a grid along the way, as those of a run in
:mod:`trackfg.smoothing.passage`: curvature is one of way, not of time.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pandas as pd

from trackfg.numerics.arrays import Array
from trackfg.results.columns import TRAJECTORY_COLUMNS
from trackfg.smoothing.passage import STEP_M

_COLUMNS = [TRAJECTORY_COLUMNS.index(name) for name in ("t_s", "speed_mps", "yaw_rad", "roll_rad", "roll_rad_sd")]
"""Columns of a trajectory that cells are made of."""


@dataclass
class TrackCells:
    """The grid is continued from ``way_m``, the way so far, where ``newest`` (0 or 1, 5) is the row."""

    way_m: float = 0.0
    newest: Array = field(default_factory=lambda: np.zeros((0, len(_COLUMNS))))

    def put(self, smoothed: pd.DataFrame) -> Array:
        """Take the next smoothed rows, whose columns are those of a trajectory, and return the cells that they reach,
        (c, 4): heading and roll, rad, the variance of roll, and the speed, m/s.
        """
        if not len(smoothed):
            return np.zeros((0, 4))
        rows = np.concatenate([self.newest, smoothed.to_numpy(dtype=np.float64)[:, _COLUMNS]])
        rows[:, 2] = np.unwrap(rows[:, 2])
        t, speed, heading, roll, sd = rows.T
        steps = 0.5 * np.abs(speed[1:] + speed[:-1]) * np.diff(t)
        way = self.way_m + np.concatenate([[0.0], np.cumsum(steps)])
        grid = STEP_M * np.arange(np.floor(way[0] / STEP_M) + 1.0, np.floor(way[-1] / STEP_M) + 1.0)
        self.way_m, self.newest = float(way[-1]), rows[-1:].copy()
        return np.column_stack([np.interp(grid, way, of) for of in (heading, roll, sd**2, speed)])

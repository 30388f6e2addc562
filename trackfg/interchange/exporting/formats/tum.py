"""TUM trajectories, as tools of research compare them: ``t x y z qx qy qz qw``, s, m, body to navigation."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from trackfg.interchange.exporting.located_tables import quaternions_of
from trackfg.interchange.exporting.result_format import ExportOptions, ResultFormat
from trackfg.results.result import Result


class Tum(ResultFormat):
    """One row per instant, in east, north, up; times count from the recording's zero."""

    key = "tum"
    suffix = ".tum"
    title = "TUM trajectory: t x y z qx qy qz qw"
    takes = frozenset[str]()
    needs_trajectory = True

    def write(self, result: Result, path: Path, options: ExportOptions) -> None:
        """Write the trajectory."""
        track = result.trajectory
        rows = np.column_stack([track[["t_s", "east_m", "north_m", "up_m"]].to_numpy(), quaternions_of(track)])
        np.savetxt(path, rows, fmt="%.9f")

"""TUM trajectories, as tools of research compare them: ``t x y z qx qy qz qw``, s, m, body to navigation."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from trackfg.interchange.exporting.result_format import ExportOptions, ResultFormat
from trackfg.results.result import Result


class Tum(ResultFormat):
    """One row per instant, in east, north, up; times count from the recording's zero."""

    key = "tum"
    suffix = ".tum"
    title = "TUM trajectory: t x y z qx qy qz qw"
    needs_trajectory = True

    def write(self, result: Result, path: Path, options: ExportOptions) -> None:
        """Write the trajectory."""
        track = result.trajectory
        angles = track[["roll_rad", "pitch_rad", "yaw_rad"]].to_numpy()
        quaternions = Rotation.from_euler("xyz", angles).as_quat()
        rows = np.column_stack([track[["t_s", "east_m", "north_m", "up_m"]].to_numpy(), quaternions])
        np.savetxt(path, rows, fmt="%.9f")

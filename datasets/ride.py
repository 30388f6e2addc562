"""A vehicle on a line: pose, body rates and truth.

The vehicle is a rigid body whose reference point follows the track's centre line, x axis along the tangent, so its
velocity in body axes is ``(v, 0, 0)`` exactly and, with ``phi, theta, psi`` = roll, pitch, yaw and a prime for d/ds,

    omega = v ( phi' - psi' sin theta,
                theta' cos phi + psi' cos theta sin phi,
                -theta' sin phi + psi' cos theta cos phi ),
    R_nb^T dv_n/dt = ( dv/dt, v omega_z, -v omega_y ).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np

from trackfg import frames
from trackfg.datasets.line import Line
from trackfg.datasets.motion import Motion
from trackfg.frames import Array


@dataclass(frozen=True)
class Ride:
    """``motion`` along ``line``. Times may have any shape (...).

    Chainage is ``chainage_origin_m + direction s``. The origin of ENU is where the vehicle is at t = 0.
    """

    line: Line
    motion: Motion
    chainage_origin_m: float = 0.0
    direction: Literal[1, -1] = 1

    def rpy(self, t: Array) -> Array:
        """Roll, pitch, yaw, rad. Shape (..., 3)."""
        return self.line.rpy(self.motion.distance(t))

    def rotation(self, t: Array) -> Array:
        """``R_nb``. Shape (..., 3, 3)."""
        return frames.matrix_from_rpy(*np.moveaxis(self.rpy(t), -1, 0))

    def body_rate(self, t: Array) -> Array:
        """Angular rate relative to the navigation frame, in body axes, rad/s. Shape (..., 3)."""
        s = self.motion.distance(t)
        roll, pitch, _ = np.moveaxis(self.line.rpy(s), -1, 0)
        d_roll, d_pitch, d_yaw = np.moveaxis(self.line.rpy_slopes(s), -1, 0)
        per_metre = np.stack(
            [
                d_roll - d_yaw * np.sin(pitch),
                d_pitch * np.cos(roll) + d_yaw * np.cos(pitch) * np.sin(roll),
                -d_pitch * np.sin(roll) + d_yaw * np.cos(pitch) * np.cos(roll),
            ],
            axis=-1,
        )
        return np.asarray(per_metre * self.motion.speed(t)[..., None])

    def position(self, t: Array) -> Array:
        """East, north, up of the reference point, m. Shape (..., 3)."""
        return np.asarray(self.line.position(self.motion.distance(t)) - self._start)

    def chainage(self, s: Array) -> Array:
        """Chainage of the place ``s``, m."""
        return self.chainage_origin_m + self.direction * s

    @cached_property
    def _start(self) -> Array:
        return self.line.position(self.motion.distance(0.0))

    def kinks_s(self) -> Array:
        """Every time at which a derivative of the pose jumps: phases of the motion, kinks of the line. Sorted."""
        passed, _ = self.motion.times_at(self.line.knots)
        return np.unique(np.concatenate([self.motion.breaks_s, passed]))

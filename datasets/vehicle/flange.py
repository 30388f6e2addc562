"""Flange contact in sharp curves: short knocks to the side that a vehicle gets from the outer rail.

In every metre of track there is the same chance of a knock wherever the designed radius is sharp enough. A knock is a
bump of the body's lateral place, towards the inside of the curve, and of its roll, away from it,

    b(x) = cos^4(pi x),  |x| < 1/2,  x = (s - s_i) / length,

three times continuously differentiable. It belongs to the place ``s_i`` and not to the time: every passage meets it,
the slower the more gently, and a vehicle that stands meets nothing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trackfg.datasets.line.line import Line
from trackfg.datasets.line.track import SimulatedTrack
from trackfg.datasets.vehicle.body_motion import BodyMotion, through
from trackfg.datasets.vehicle.motion import DrivenMotion
from trackfg.datasets.vehicle.vehicle import Vehicle
from trackfg.numerics.arrays import Array


@dataclass(frozen=True)
class Flanging:
    """``vehicle`` with knocks wherever the radius is below ``radius_m``: one in every ``spacing_m``, at random in it.

    Each is ``length_m`` long; its height, m, and roll, rad, are those given times a factor from 0.5 to 1.5. ``seed``
    settles places and factors.
    """

    vehicle: Vehicle
    seed: int
    radius_m: float = 400.0
    spacing_m: float = 20.0
    length_m: float = 1.0
    lateral_m: float = 0.5e-3
    roll_rad: float = 0.3e-3

    @property
    def rigid(self) -> bool:
        """Return whether the vehicle itself is rigid."""
        return self.vehicle.rigid

    def body_motion(self, track: SimulatedTrack, motion: DrivenMotion, edges: Array) -> BodyMotion:
        """Return the vehicle's own motion, and the knocks."""
        values = self.vehicle.body_motion(track, motion, edges).at(edges)
        knocks = self._knocks(track.line, motion.distance(edges))
        values[:, 0] += self.lateral_m * knocks
        values[:, 2] += self.roll_rad * knocks
        return through(edges, values)

    def _knocks(self, line: Line, s: Array) -> Array:
        """Return factor and bump at ``s``, positive to the left. Shape (n,)."""
        cells = int(np.ceil(line.length_m / self.spacing_m))
        place, size = np.random.default_rng(self.seed).random((cells, 2)).T
        centre = self.spacing_m * np.arange(cells) + 0.5 * self.length_m + place * (self.spacing_m - self.length_m)
        curvature = line.curvature(np.minimum(centre, line.length_m))
        height = np.where(np.abs(curvature) > 1.0 / self.radius_m, np.sign(curvature) * (0.5 + size), 0.0)
        cell = np.clip((s // self.spacing_m).astype(int), 0, cells - 1)
        x = (s - centre[cell]) / self.length_m
        return np.asarray(np.where(np.abs(x) < 0.5, height[cell] * np.cos(np.pi * x) ** 4, 0.0))

"""The context of a run: what its tables are made from besides the solution.

Batch and stream make the same tables from it. It holds no factors: a stretch of a stream has a context, too, although
its factors have been marginalised.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trackfg.config import GeometryConfig
from trackfg.graph.inputs import World
from trackfg.numerics.arrays import Array
from trackfg.numerics.key_figures import Outlined
from trackfg.recording.description import Track
from trackfg.results.summary import GeometryConventions
from trackfg.sensors.imu_intervals import Intervals
from trackfg.sensors.imu_noise.white_noise import WhiteNoise


@dataclass(frozen=True, repr=False)
class RunContext(Outlined):
    """The keyframes of a run or of a stretch of it, its inertial record, and what the columns of its tables mean."""

    t: Array
    """Keyframe times, s, shape (n,)."""
    edges: np.ndarray
    """The keyframes as indices into ``inertial.edges``, shape (n,)."""
    inertial: Intervals
    world: World
    lever_arm: Array
    """The IMU's position in the vehicle, m, shape (3,)."""
    noise: WhiteNoise
    """White noise of the inertial samples as assumed in the graph, from each keyframe to the next."""
    mount_roll_sd: float
    """Uncertainty of the mounting's roll, rad."""
    direction: int
    """+1 where chainage grows as the vehicle moves forwards, -1 where it falls."""
    conventions: GeometryConventions

    @property
    def bridged(self) -> np.ndarray:
        """Return whether the inertial record was bridged from each keyframe to the next, (n - 1,)."""
        return np.asarray(self.inertial.bridged[self.edges[:-1]])


def geometry_conventions(config: GeometryConfig, track: Track) -> GeometryConventions:
    """Return what the geometry's columns mean under these settings on this track."""
    return GeometryConventions(
        gauge_m=track.gauge_m, cross_level_base_m=track.cross_level_base_m, **config.model_dump()
    )

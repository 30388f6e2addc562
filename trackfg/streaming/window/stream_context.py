"""What stays as it is along a stream."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trackfg.config import SmoothConfig
from trackfg.factors.states import Kind, States
from trackfg.graph.build import Problem
from trackfg.graph.inputs import World, assumed_noise
from trackfg.numerics.arrays import Array
from trackfg.recording.description import RecordingDescription
from trackfg.sensors.imu_intervals import Intervals

_NOTHING = np.zeros((0, 2))


@dataclass(frozen=True)
class Setting:
    """``clock_origin``, s: see :class:`trackfg.graph.build.Problem`."""

    description: RecordingDescription
    config: SmoothConfig
    world: World
    clock_origin: float

    @property
    def lever_arm(self) -> Array:
        """The IMU's position in the vehicle, m, shape (3,)."""
        return np.array(self.description.imu.lever_arm_m)

    def problem_of(self, t: Array, states: States, data: Intervals) -> Problem:
        """Keyframes on edges of the inertial ``data``, without factors: what tables are made from."""
        return Problem(
            t=t,
            measured=(),
            families=(),
            initial=states,
            world=self.world,
            lever_arm=self.lever_arm,
            rests=_NOTHING,
            gaps=_NOTHING,
            wheel=None,
            inertial=data,
            noise=assumed_noise(self.description, self.config),
            edges=np.searchsorted(data.edges, t - 1e-9),
            mount_roll_sd=float(np.radians(self.description.imu.mount_roll_sd_deg)),
            clock_origin=self.clock_origin,
            response=np.zeros((len(t), 6, Kind.IMU.dim)),
        )

"""The stream context holds what is constant along a stream."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from trackfg.config import SmoothConfig
from trackfg.graph.inputs import World, declared_noise, hole_noise
from trackfg.graph.run_context import RunContext, geometry_conventions
from trackfg.numerics.arrays import Array
from trackfg.recording.description import RecordingDescription
from trackfg.results.summary import GeometryConventions
from trackfg.sensors.imu_intervals import Intervals
from trackfg.sensors.imu_noise.noise_floor import noise_seen
from trackfg.sensors.imu_noise.white_noise import WhiteNoise
from trackfg.streaming.window.interval_factors import MotionFactors, TachFactors
from trackfg.streaming.window.records.noise_record import NoiseRecord


@dataclass(frozen=True, eq=False)
class StreamContext:
    """The description, settings and world of a stream; ``clock_origin``, s, as in
    :class:`trackfg.graph.build.Problem`.
    """

    description: RecordingDescription
    config: SmoothConfig
    world: World
    clock_origin: float

    @cached_property
    def lever_arm(self) -> Array:
        """The IMU's position in the vehicle, m, shape (3,)."""
        return np.array(self.description.imu.lever_arm_m)

    @cached_property
    def conventions(self) -> GeometryConventions:
        """The conventions of the geometry's columns."""
        return geometry_conventions(self.config.geometry, self.description.track)

    @cached_property
    def motion_factors(self) -> MotionFactors:
        """The families of the motion over an interval, without its numbers."""
        return MotionFactors.of(self.description, self.config)

    @cached_property
    def tach_factors(self) -> TachFactors:
        """The families of the wheel over an interval, without its numbers."""
        return TachFactors.of(self.config)

    def noise_of(self, t: Array, data: Intervals, noise: NoiseRecord) -> WhiteNoise:
        """Return the noise of the inertial ``data`` between keyframes at ``t`` (n,), with the recorded levels."""
        levels = noise.at(t[:-1])
        assumed = noise_seen(data, t, *declared_noise(self.description, self.config), noise.shown)
        seen = WhiteNoise(assumed.gyro * levels[:, :1], assumed.accel * levels[:, 1:])
        return seen.over_holes(data.bridged_from(t[:-1]), *hole_noise(self.config))

    def run_of(self, t: Array, data: Intervals, noise: WhiteNoise) -> RunContext:
        """Return the context of keyframes at ``t`` (n,), on edges of the inertial ``data`` with this noise."""
        return RunContext(
            t=t,
            edges=data.edges_at(t),
            inertial=data,
            world=self.world,
            lever_arm=self.lever_arm,
            noise=noise,
            mount_roll_sd=float(np.radians(self.description.imu.mount_roll_sd_deg)),
            direction=self.description.track.direction,
            conventions=self.conventions,
        )

"""Place and attitude of an IMU in the vehicle, and what its body does on springs, that are not declared."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from trackfg.datasets.effects.samples import Samples, described
from trackfg.datasets.line.irregularities import IrregularityModel
from trackfg.datasets.scenario import Effect, Scenario
from trackfg.datasets.vehicle.ride import Ride
from trackfg.datasets.vehicle.suspension import Suspension
from trackfg.datasets.vehicle.vehicle import CarBody
from trackfg.numerics import rotations
from trackfg.recording.model import Recording

_OF_LEVEL = 0.78
"""Alignment and cross-level of worn track over its level, by their standard deviations in the band D1."""


@dataclass(frozen=True)
class LeverArm(Effect):
    """An IMU ``magnitude`` metres from the reference point of a car body that does not lean: forward and, a fifth of
    that, up. For the oracle: the lever arm is declared.
    """

    def planned(self, plan: Scenario) -> Scenario:
        """See :class:`~trackfg.datasets.scenario.Effect`."""
        arm = self.magnitude / np.hypot(1.0, 0.2)
        imu = replace(plan.imu, lever_arm_m=(float(arm), 0.0, float(0.2 * arm)))
        return replace(plan, imu=imu, vehicle=CarBody(Suspension(roll_coefficient=0.0)))

    def recorded(self, recording: Recording, ride: Ride, rng: np.random.Generator) -> Recording:
        """See :class:`~trackfg.datasets.scenario.Effect`."""
        return recording if self.for_oracle else described(recording, lever_arm_m=(0.0, 0.0, 0.0))


@dataclass(frozen=True)
class Tilt(Effect):
    """An IMU turned in roll, pitch and yaw by ``magnitude`` degrees each, signs drawn. For the oracle: not turned."""

    def recorded(self, recording: Recording, ride: Ride, rng: np.random.Generator) -> Recording:
        """See :class:`~trackfg.datasets.scenario.Effect`."""
        R_vs = rotations.matrix_from_rpy(*np.radians(self.magnitude * rng.choice([-1.0, 1.0], 3)))
        if self.for_oracle:
            return recording
        return Samples.of(recording).turned(R_vs).into(recording)


@dataclass(frozen=True)
class SpringRoll(Effect):
    """A car body that leans outwards by ``magnitude`` (a share) of the cant deficiency; it may be declared rigid."""

    declared_rigid: bool = False

    def planned(self, plan: Scenario) -> Scenario:
        """See :class:`~trackfg.datasets.scenario.Effect`."""
        return replace(plan, vehicle=CarBody(Suspension(roll_coefficient=self.magnitude)))

    def recorded(self, recording: Recording, ride: Ride, rng: np.random.Generator) -> Recording:
        """See :class:`~trackfg.datasets.scenario.Effect`."""
        return described(recording, rigid=True) if self.declared_rigid and not self.for_oracle else recording


@dataclass(frozen=True)
class RoughTrack(Effect):
    """A car body on its springs over track whose level has a standard deviation of ``magnitude`` mm in the band D1."""

    def planned(self, plan: Scenario) -> Scenario:
        """See :class:`~trackfg.datasets.scenario.Effect`."""
        level = 1e-3 * self.magnitude
        across = _OF_LEVEL * level
        track = IrregularityModel("high", level_d1_sd_m=level, alignment_d1_sd_m=across, cross_level_d1_sd_m=across)
        return replace(plan, irregularities=track, vehicle=CarBody())

"""Runs that are hard to estimate: parked for hours, creeping along, with loops on a turning Earth."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from trackfg.datasets.line.line_design import LineDesign
from trackfg.datasets.scenario import Effect, Scenario
from trackfg.datasets.vehicle.driving import Service, Wandering
from trackfg.datasets.vehicle.motion import Limits
from trackfg.datasets.vehicle.ride import Ride
from trackfg.recording.model import Recording


@dataclass(frozen=True)
class LongRest(Effect):
    """A service that stands for ``magnitude`` hours before it goes, and, as it goes 2 km only, at the end."""

    def planned(self, plan: Scenario) -> Scenario:
        """See :class:`~trackfg.datasets.scenario.Effect`. Raises ``TypeError`` for another driver."""
        if not isinstance(plan.driver, Service):
            raise TypeError(f"{plan.driver}: expected a service for a long rest")
        return replace(plan, length_m=2000.0, driver=replace(plan.driver, start_rest_s=3600.0 * self.magnitude))


@dataclass(frozen=True)
class Creeping(Effect):
    """A vehicle that creeps along at 0.2 to 1 times ``magnitude`` m/s after a rest of half a minute."""

    def planned(self, plan: Scenario) -> Scenario:
        """See :class:`~trackfg.datasets.scenario.Effect`."""
        driver = Wandering(
            limits=Limits(acceleration_mps2=0.2, jerk_mps3=0.2),
            speed_mps=(0.2 * self.magnitude, self.magnitude),
            hold_s=(10.0, 60.0),
            start_rest_s=30.0,
            start_m=30.0,
        )
        return replace(plan, driver=driver)


@dataclass(frozen=True)
class TurningEarth(Effect):
    """A line with loops at ``magnitude`` degrees of latitude, whose heading is not declared; the latitude may be.

    For the oracle: both are declared.
    """

    latitude_declared: bool = True

    def planned(self, plan: Scenario) -> Scenario:
        """See :class:`~trackfg.datasets.scenario.Effect`."""
        line = plan.line
        if isinstance(line, LineDesign):
            line = replace(line, circle_m=(400.0, 1200.0), straight_m=(100.0, 300.0), max_turn_rad=4.0)
        return replace(plan, latitude_deg=self.magnitude, line=line)

    def recorded(self, recording: Recording, ride: Ride, rng: np.random.Generator) -> Recording:
        """See :class:`~trackfg.datasets.scenario.Effect`."""
        if self.for_oracle:
            return recording
        unknown = {"heading_deg": None} | ({} if self.latitude_declared else {"latitude_deg": None})
        track = recording.description.track.model_copy(update=unknown)
        return replace(recording, description=recording.description.model_copy(update={"track": track}))

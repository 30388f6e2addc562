"""A tachometer on a further axle: a wheel with a scale, a clock and slips of its own."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from trackfg.datasets.sensors.further_sensor import Measured
from trackfg.datasets.sensors.odometer import TachModel, measured_wheel
from trackfg.datasets.vehicle.adhesion import AdhesionModel
from trackfg.datasets.vehicle.ride import Ride
from trackfg.recording.description import FurtherTach


@dataclass(frozen=True)
class FurtherAxle:
    """A tach, and where its wheel finds little adhesion: at places of its own, drawn independently of other axles'."""

    tach: TachModel = field(default_factory=TachModel)
    adhesion: AdhesionModel | None = None
    key: ClassVar[str] = "further_tach"

    def measured(self, ride: Ride, duration_s: float, rng: np.random.Generator | None) -> Measured:
        """See :class:`~trackfg.datasets.sensors.further_sensor.FurtherSensor`."""
        wheel = measured_wheel(ride, self.tach, self.adhesion, duration_s, rng)
        return Measured(wheel.table, FurtherTach(**vars(wheel.description)), wheel.scale)

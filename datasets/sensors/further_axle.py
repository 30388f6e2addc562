"""A tachometer on a further axle: a wheel with a scale, a clock and slips of its own."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from trackfg.datasets.sensors import odometer
from trackfg.datasets.sensors.further_sensor import Measured
from trackfg.datasets.sensors.odometer import TachModel
from trackfg.datasets.vehicle.adhesion import AdhesionModel, draw_slip
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
        if rng is None:
            part = FurtherTach(**vars(odometer.ideal_description(self.tach)))
            return Measured(odometer.ideal_table(ride, self.tach, duration_s), part, 1.0)
        scale_rng, slip_rng, pulse_rng = rng.spawn(3)
        scale = odometer.draw_scale(self.tach, scale_rng)
        slip = None if self.adhesion is None else draw_slip(ride, self.adhesion, duration_s, slip_rng)
        table = odometer.pulse_table(ride, self.tach, scale, duration_s, pulse_rng, slip)
        return Measured(table, FurtherTach(**vars(odometer.pulse_description(self.tach))), scale)

"""The speeds over ground of a satellite receiver: the length of a velocity that is wrong in both horizontal components.

    z = |u(t - delay) + n|,

where u is the antenna's horizontal velocity and n white noise in each component. Near rest the length is too large on
average (Rice's distribution).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from trackfg.datasets import tables
from trackfg.datasets.sensors.further_sensor import Measured
from trackfg.datasets.vehicle.ride import Ride
from trackfg.recording.description import RECEIVER_SPEED_SD_MPS, Vector3
from trackfg.recording.model import GNSS_SPEED_TABLE


@dataclass(frozen=True)
class ReceiverSpeeds:
    """A receiver with its antenna at ``antenna_m`` (body axes, from the reference point), whose speeds are ``delay_s``
    old, since it filters them.
    """

    rate_hz: float = 1.0
    sd_mps: float = RECEIVER_SPEED_SD_MPS
    antenna_m: Vector3 = (0.0, 0.0, 0.0)
    delay_s: float = 0.0
    key: ClassVar[str] = GNSS_SPEED_TABLE

    def measured(self, ride: Ride, duration_s: float, rng: np.random.Generator | None) -> Measured:
        """Return the canonical table."""
        stamps = tables.clock(duration_s, self.rate_hz)
        t = np.maximum(stamps - self.delay_s, 0.0)
        swing = np.cross(ride.body_rate(t), np.array(self.antenna_m))
        velocity = ride.velocity(t) + np.einsum("nij,nj->ni", ride.rotation(t), swing)
        noise = 0.0 if rng is None else self.sd_mps * rng.standard_normal((len(t), 2))
        speed = np.linalg.norm(velocity[:, :2] + noise, axis=1)
        table = tables.gnss_speeds(stamps, speed, self.sd_mps)[GNSS_SPEED_TABLE]
        return Measured(table, tables.gnss_speed_description(), 1.0)

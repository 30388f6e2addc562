"""A sensor of the speed over ground: a Doppler radar, or an optical sensor under the vehicle.

It measures the velocity of its own place along the axis in which it looks, times its scale, with white noise; it falls
silent below a lowest speed, and now and then where the ground gives no echo.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from trackfg.datasets import tables
from trackfg.datasets.sensors.further_sensor import Measured
from trackfg.datasets.vehicle.random_spans import random_spans
from trackfg.datasets.vehicle.ride import Ride
from trackfg.recording.description import Speed, Vector3
from trackfg.recording.model import SPEED_COLUMNS


@dataclass(frozen=True)
class SpeedModel:
    """A sensor at ``place_m`` (body axes, from the reference point) that measures the speed but not the direction.

    ``scale_sd`` is the spread of its true scale, ``yaw_sd_deg`` that of the direction in which it looks, ``sd_mps`` the
    noise of a row. Silences last ``dropout_s`` (range).
    """

    rate_hz: float = 10.0
    sd_mps: float = 0.05
    scale_sd: float = 5e-3
    yaw_sd_deg: float = 0.5
    lowest_mps: float = 0.5
    place_m: Vector3 = (0.0, 0.0, 0.0)
    dropouts_per_hour: float = 0.0
    dropout_s: tuple[float, float] = (1.0, 10.0)
    key: ClassVar[str] = "speed"

    def measured(self, ride: Ride, duration_s: float, rng: np.random.Generator | None) -> Measured:
        """Return the canonical table, without rows where the sensor is silent, and the scale along the track."""
        t = tables.clock(duration_s, self.rate_hz)
        scale, yaw, heard = 1.0, 0.0, np.ones(len(t), dtype=bool)
        noise = np.zeros(len(t))
        if rng is not None:
            mounting_rng, noise_rng, dropout_rng = rng.spawn(3)
            scale += self.scale_sd * float(mounting_rng.standard_normal())
            yaw = float(np.radians(self.yaw_sd_deg) * mounting_rng.standard_normal())
            noise = self.sd_mps * noise_rng.standard_normal(len(t))
            for start, end in random_spans(self.dropouts_per_hour / 3600.0, self.dropout_s, duration_s, dropout_rng):
                heard &= (t < start) | (t >= end)
        body = np.einsum("nji,nj->ni", ride.rotation(t), ride.velocity(t))
        body = body + np.cross(ride.body_rate(t), np.array(self.place_m))
        axis_speed = body @ np.array([np.cos(yaw), np.sin(yaw), 0.0])
        measured = np.abs(axis_speed / scale + noise)
        heard &= measured >= self.lowest_mps
        table = tables.table(SPEED_COLUMNS, t[heard], measured[heard])
        time, speed = SPEED_COLUMNS
        part = Speed(
            file="speed.parquet",
            time=time,
            column=speed,
            sd_mps=self.sd_mps,
            scale_sd=self.scale_sd,
            yaw_sd_deg=self.yaw_sd_deg,
            lowest_mps=self.lowest_mps,
            lever_arm_m=self.place_m,
        )
        return Measured(table, part, scale / float(np.cos(yaw)))

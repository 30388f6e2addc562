"""Further sensors are those of a scenario besides its IMU, its first tach, its positions and its lasers."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np
import pandas as pd

from trackfg.datasets.vehicle.ride import Ride
from trackfg.recording.description import Table


class Measured(NamedTuple):
    """The canonical ``table`` of one sensor, its ``part`` of the description, and the true ``scale``: true distance or
    speed over the measured one.
    """

    table: pd.DataFrame
    part: Table
    scale: float


class FurtherSensor(Protocol):
    """A simulated sensor; ``key`` is the part or the list of ``recording.toml`` that it is in."""

    @property
    def key(self) -> str:
        """The key of its format (:class:`trackfg.io.formats.sensor_format.SensorFormat`)."""

    def measured(self, ride: Ride, duration_s: float, rng: np.random.Generator | None) -> Measured:
        """Return what it records of a ride until ``duration_s``; exact with no ``rng``."""

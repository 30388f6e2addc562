"""A stream tests whether its accelerometer is later than its gyro, as
:mod:`trackfg.sensors.imu_filters.accelerometer_clock` finds it.

It cannot move samples that it has used, as a batch does before there is a graph: it says what they spoil.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pandas as pd

from trackfg.numerics.arrays import Array
from trackfg.results.events import DOUBT, Event
from trackfg.sensors.averages import Motion
from trackfg.sensors.imu_filters.accelerometer_clock import (
    BLOCK_S,
    ENOUGH_S,
    SIGNALS,
    STARTS_S,
    STEP_S,
    Forces,
    clock_near_start,
)
from trackfg.sensors.imu_intervals import Intervals, means_between


@dataclass
class AccelerometerTest:
    """``products`` (starts, b, 5, 5): the sums of the first blocks in motion, with samples moved by each of
    :data:`~trackfg.sensors.imu_filters.accelerometer_clock.STARTS_S`.
    """

    products: Array = field(default_factory=lambda: np.zeros((len(STARTS_S), 0, SIGNALS, SIGNALS)))

    def put(self, samples: Intervals, smoothed: pd.DataFrame) -> None:
        """Take the next samples, and the rows of the trajectory that they led to."""
        edges = np.arange(samples.edges[0], samples.edges[-1], STEP_S) if len(smoothed) else np.zeros(0)
        if len(edges) * STEP_S < 0.5 * BLOCK_S or self.products.shape[1] >= ENOUGH_S / BLOCK_S:
            return
        middle = 0.5 * (edges[1:] + edges[:-1])
        gyro, accel = (means_between(edges[:-1], edges[1:], samples.edges, of) for of in (samples.gyro, samples.accel))
        speed = np.interp(middle, smoothed["t_s"].to_numpy(), smoothed["speed_mps"].to_numpy())
        measured = ~samples.bridged[np.searchsorted(samples.edges, middle) - 1]
        forces = Forces.of(Motion(middle, STEP_S, gyro, accel, speed, measured))
        new = forces.products_of_starts()
        self.products = np.concatenate([self.products, new[:, new[0, :, 0, 0] > 0.0]], axis=1)

    def events(self, until_s: float) -> tuple[Event, ...]:
        """Return an event where the accelerometer is surely late or early."""
        clock = clock_near_start(self.products)
        if clock is None or not clock.is_sure:
            return ()
        detail = f"level, alignment: {clock.sentence}: do not trust them, or give both sensors the same filter"
        return (Event(DOUBT, t_s=until_s, detail=detail),)

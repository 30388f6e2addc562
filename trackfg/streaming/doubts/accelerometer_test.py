"""A stream tests whether its accelerometer is later than its gyro, as
:mod:`trackfg.sensors.imu_filters.accelerometer_clock` finds it.

It cannot move samples that it has used, as a batch does before there is a graph: it says what they spoil. A force that
is late by d is off by d da/dt, and the speed by d a while the vehicle accelerates with a.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pandas as pd

from trackfg.numerics.arrays import Array
from trackfg.numerics.float_table import columns_of
from trackfg.results.events import Event, doubt_event
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
from trackfg.streaming.doubts.sigma_test import LEAST_RATIO


@dataclass
class AccelerometerTest:
    """The test keeps sums over blocks of samples in motion.

    ``products`` (starts, b, 5, 5): the sums of the first blocks in motion, with samples moved by each of
    :data:`~trackfg.sensors.imu_filters.accelerometer_clock.STARTS_S`. ``rows``: how many rows of the trajectory have
    come; ``accelerations``: the sum of their squared accelerations over the variances of the speed, 1/s^2.
    """

    products: Array = field(default_factory=lambda: np.zeros((len(STARTS_S), 0, SIGNALS, SIGNALS)))
    rows: int = 0
    accelerations: float = 0.0

    def put(self, samples: Intervals, smoothed: pd.DataFrame) -> None:
        """Take the next samples, and the rows of the trajectory that they led to."""
        columns = columns_of(smoothed)
        if len(smoothed) > 1:
            t, speed, sd = (columns[name] for name in ("t_s", "speed_mps", "speed_mps_sd"))
            self.rows += len(t)
            self.accelerations += float(np.sum((np.gradient(speed, t) / sd) ** 2))
        edges = np.arange(samples.edges[0], samples.edges[-1], STEP_S) if len(smoothed) else np.zeros(0)
        if len(edges) * STEP_S < 0.5 * BLOCK_S or self.products.shape[1] >= ENOUGH_S / BLOCK_S:
            return
        middle = 0.5 * (edges[1:] + edges[:-1])
        gyro, accel = (means_between(edges[:-1], edges[1:], samples.edges, of) for of in (samples.gyro, samples.accel))
        speed = np.interp(middle, columns["t_s"], columns["speed_mps"])
        measured = ~samples.bridged[np.searchsorted(samples.edges, middle) - 1]
        forces = Forces.of(Motion(middle, STEP_S, gyro, accel, speed, measured))
        new = forces.products_of_starts()
        self.products = np.concatenate([self.products, new[:, new[0, :, 0, 0] > 0.0]], axis=1)

    def events(self, until_s: float) -> tuple[Event, ...]:
        """Return an event where the accelerometer is surely late or early."""
        clock = clock_near_start(self.products)
        if clock is None or not clock.is_sure:
            return ()
        wrong_speed = 1.0 + clock.offset_s**2 * self.accelerations / self.rows > LEAST_RATIO**2
        quantities = ("level", "alignment", "speed") if wrong_speed else ("level", "alignment")
        advice = "do not trust them, or give both sensors the same filter"
        return (doubt_event(quantities, clock.sentence, advice, t_s=until_s),)

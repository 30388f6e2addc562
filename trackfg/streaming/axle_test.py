"""A stream tests whether its sensor is on a frame of two axles, as :mod:`trackfg.smoothing.doubts.axle_doubts` does."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from trackfg.numerics.arrays import Array
from trackfg.results.events import DOUBT, Event
from trackfg.sensors.imu_filters.axles import SIGNALS, STEP_S, axles, means, products
from trackfg.sensors.imu_intervals import Intervals
from trackfg.smoothing.doubts.axle_doubts import Bends
from trackfg.streaming.bandwidth_test import advice
from trackfg.streaming.tables.smoothed_tables import Tables

_WAY_M = 500.0
"""Means are made into products once they are of so long a way, m: the ends of a way are left out."""

_MOST = round(200.0 / STEP_S)
"""So many means are kept at most: of 200 s, in which a slow vehicle hardly moves."""

_ENOUGH = 100
"""So many blocks suffice, 10 km: axles do not change."""


@dataclass
class AxleTest:
    """The ``products`` (b, 7, 7) of the first blocks, the ``means`` (n, 5) that are not among them yet, and how the
    geometry ``bends``.
    """

    products: Array = field(default_factory=lambda: np.zeros((0, SIGNALS, SIGNALS)))
    means: Array = field(default_factory=lambda: np.zeros((0, 5)))
    bends: Bends | None = None

    def put(self, samples: Intervals, led_to: Tables, step_m: float) -> None:
        """Take the next samples, and the tables that they led to."""
        smoothed, geometry = led_to.trajectory, led_to.geometry
        if len(geometry):
            bends = Bends.of(geometry, step_m)
            self.bends = bends if self.bends is None else self.bends + bends
        if len(smoothed) and len(self.products) < _ENOUGH:
            new = means(samples, smoothed["t_s"].to_numpy(), smoothed["speed_mps"].to_numpy())
            self.means = np.concatenate([self.means, new])
            if np.sum(self.means[:, 0]) * STEP_S > _WAY_M or len(self.means) > _MOST:
                self.products = np.concatenate([self.products, products(self.means)])
                self.means = self.means[:0]

    def events(self, until_s: float) -> tuple[Event, ...]:
        """Return an event for each quantity whose short waves the frame misses."""
        frame = None if self.bends is None else axles(self.products)
        if frame is None or self.bends is None:
            return ()
        return tuple(
            Event(DOUBT, t_s=until_s, detail=f"{', '.join(doubt.quantities)}: {doubt.reason}: {advice(doubt)}")
            for doubt in self.bends.doubts(frame)
        )

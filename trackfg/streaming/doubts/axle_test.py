"""A stream tests whether its sensor is on a frame of two axles, or moves otherwise than the track does, as
:mod:`trackfg.smoothing.doubts.axle_doubts` does.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from trackfg.numerics.arrays import Array
from trackfg.results.events import Event, doubt_event
from trackfg.sensors.imu_filters.axles import MEANS, STEP_S, TrackSums, axles, means, own_motion, track_sums
from trackfg.sensors.imu_intervals import Intervals
from trackfg.sensors.imu_noise.noise_at_rest import NoiseAtRest
from trackfg.sensors.imu_noise.noise_floor import noise_seen
from trackfg.smoothing.doubts.axle_doubts import Bends, own_in_words
from trackfg.smoothing.leaning_body import HINT, OF_TRACK
from trackfg.streaming.doubts.reporting import event_of
from trackfg.streaming.tables.smoothed_tables import Tables

_WAY_M = 500.0
"""Means are made into products once they are of so long a way, m: the ends of a way are left out."""

_MOST = round(200.0 / STEP_S)
"""So many means are kept at most: of 200 s, in which a slow vehicle hardly moves."""

_ENOUGH = 100
"""So many blocks suffice, 10 km: axles do not change."""


@dataclass
class AxleTest:
    """The ``sums`` of the first blocks, the ``means`` (n, 7) that are not among them yet, and how the geometry
    ``bends``.
    """

    sums: TrackSums = field(default_factory=TrackSums)
    means: Array = field(default_factory=lambda: np.zeros((0, MEANS)))
    bends: Bends | None = None

    def put(
        self, samples: Intervals, declared: tuple[float, float], at_rest: NoiseAtRest, led_to: Tables, step_m: float
    ) -> None:
        """Take the next samples, the densities of noise that are ``declared`` of gyro and accelerometer, what rests
        show of it, and the tables that the samples led to.
        """
        smoothed, geometry = led_to.trajectory, led_to.geometry
        if len(geometry):
            bends = Bends.of(geometry, step_m)
            self.bends = bends if self.bends is None else self.bends + bends
        if len(smoothed) > 1 and len(self.sums) < _ENOUGH:
            t = smoothed["t_s"].to_numpy()
            new = means(samples, noise_seen(samples, t, *declared, at_rest), t, smoothed["speed_mps"].to_numpy())
            self.means = np.concatenate([self.means, new])
            if np.sum(np.abs(self.means[:, 0])) * STEP_S > _WAY_M or len(self.means) > _MOST:
                self.sums += track_sums(self.means)
                self.means = self.means[:0]

    def events(self, until_s: float) -> tuple[Event, ...]:
        """Return an event for each quantity whose short waves the frame misses, and one where it does not follow the
        track.
        """
        if self.bends is None:
            return ()
        frame, share = axles(self.sums), own_motion(self.sums)
        of_motion = () if share is None else (doubt_event(OF_TRACK, own_in_words(share), HINT, t_s=until_s),)
        doubts = () if frame is None else self.bends.doubts(frame)
        return (*of_motion, *(event_of(doubt, until_s) for doubt in doubts))

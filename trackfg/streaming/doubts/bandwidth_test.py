"""A stream tests whether its sensor is too slow for the waves of the track, as
:mod:`trackfg.smoothing.doubts.bandwidth_doubts` does of a run.
"""

from __future__ import annotations

from dataclasses import dataclass

import pandas as pd

from trackfg.numerics.arrays import Array
from trackfg.results.events import Event
from trackfg.sensors.imu_filters.bandwidth import Bandwidths, RestSpectra
from trackfg.sensors.imu_intervals import Intervals
from trackfg.smoothing.doubts.bandwidth_doubts import ShortWaves
from trackfg.streaming.doubts.reporting import event_of


@dataclass
class BandwidthTest:
    """The ``spectra`` of rests and the ``waves`` of the geometry, of all that has come."""

    spectra: RestSpectra | None = None
    waves: ShortWaves | None = None

    def put(self, samples: Intervals, rests: Array, geometry: pd.DataFrame, step_m: float) -> None:
        """Take the next samples, the ``rests`` (r, 2), s, among them, and the geometry that they led to."""
        if len(samples):
            spectra = RestSpectra.of(samples, rests)
            if self.spectra is None:
                self.spectra = spectra
            elif spectra.lines.any() and len(spectra.edges) == len(self.spectra.edges):  # else of another rate
                self.spectra += spectra
        if len(geometry):
            waves = ShortWaves.of(geometry, step_m)
            self.waves = waves if self.waves is None else self.waves + waves

    @property
    def bandwidths(self) -> Bandwidths:
        """The bandwidths that the rests show so far."""
        return Bandwidths(None, None) if self.spectra is None else self.spectra.bandwidths

    def events(self, until_s: float) -> tuple[Event, ...]:
        """Return an event for each quantity whose short waves are missing."""
        if self.waves is None:
            return ()
        return tuple(event_of(doubt, until_s) for doubt in self.waves.doubts(self.bandwidths))

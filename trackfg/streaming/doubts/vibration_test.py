"""A stream tests whether its sensor vibrates by more than the track's sigmas, as
:mod:`trackfg.smoothing.doubts.vibration_doubts` does of a run: of the newest blocks of samples.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pandas as pd

from trackfg.numerics.arrays import Array
from trackfg.numerics.float_table import columns_of
from trackfg.results.events import Event
from trackfg.results.summary import GeometryConventions
from trackfg.sensors.imu_intervals import Intervals
from trackfg.sensors.short_vibration import Blocks
from trackfg.smoothing.doubts.usual_sigmas import COLUMNS, inverse_squares, usual_sigma
from trackfg.smoothing.doubts.vibration_doubts import doubts_of_vibration
from trackfg.streaming.doubts.reporting import event_of

_MOST_BLOCKS = 5000
"""Blocks that are kept, of 1.28 s each: two hours say how a sensor vibrates."""


@dataclass
class VibrationTest:
    """The test has the newest ``blocks`` of samples, and ``sums`` (3, 2): those of
    :func:`~trackfg.smoothing.doubts.usual_sigmas.inverse_squares`, 1/mm^2, of each of
    :data:`~trackfg.smoothing.doubts.usual_sigmas.COLUMNS`.
    """

    blocks: Blocks = field(default_factory=lambda: Blocks(np.zeros(0), np.zeros(0), np.zeros((0, 3))))
    sums: Array = field(default_factory=lambda: np.zeros((len(COLUMNS), 2)))

    def put(
        self, samples: Intervals, smoothed: pd.DataFrame, geometry: pd.DataFrame, bandwidth_hz: float | None = None
    ) -> None:
        """Take the next samples, of a sensor of such a bandwidth, and the rows of trajectory and geometry that they led
        to.
        """
        if len(smoothed):
            motion = columns_of(smoothed)
            new = Blocks.of(samples, motion["t_s"], motion["speed_mps"], bandwidth_hz)
            joined = (np.concatenate(both)[-_MOST_BLOCKS:] for both in zip(self.blocks, new, strict=True))
            self.blocks = Blocks(*joined)
        of_track = columns_of(geometry)
        for i, column in enumerate(COLUMNS.values()):
            self.sums[i] += inverse_squares(of_track[f"{column}_sd"])

    def events(self, until_s: float, conventions: GeometryConventions) -> tuple[Event, ...]:
        """Return an event for each quantity of the track that vibration hides, known at the end of a stream."""
        usual = {
            name: usual_sigma(number, inverse)
            for name, (number, inverse) in zip(COLUMNS, self.sums.tolist(), strict=True)
            if number
        }
        return tuple(event_of(doubt, until_s) for doubt in doubts_of_vibration(self.blocks, usual, conventions))

"""Arrays that grow at their ends: with room to spare, so that they are copied now and then and not with every batch.

What they were before stays as it was: whoever holds it may go on using it.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from trackfg.sensors.imu_intervals import Intervals
from trackfg.streaming.checkpoint.snapshot import MADE_AGAIN

_LEAST = 64


@dataclass
class Growing:
    """``rows`` (n, ...), the first of an array with ``room`` for more, once some have been put after them."""

    rows: np.ndarray
    room: np.ndarray | None = field(default=None, metadata=MADE_AGAIN)

    def append(self, rows: np.ndarray) -> None:
        """Put rows after them."""
        begin, end = len(self.rows), len(self.rows) + len(rows)
        if self.room is None or end > len(self.room):
            self.room = np.empty((max(2 * end, _LEAST), *self.rows.shape[1:]), self.rows.dtype)
            self.room[:begin] = self.rows
        self.room[begin:end] = rows
        self.rows = self.room[:end]


@dataclass
class GrowingIntervals:
    """The arrays of :class:`~trackfg.sensors.imu_intervals.Intervals`."""

    edges: Growing
    gyro: Growing
    accel: Growing
    bridged: Growing

    @classmethod
    def of(cls, data: Intervals) -> GrowingIntervals:
        """Of intervals that are there."""
        return cls(*(Growing(part) for part in (data.edges, data.gyro, data.accel, data.bridged)))

    @property
    def intervals(self) -> Intervals:
        """All of them."""
        return Intervals(self.edges.rows, self.gyro.rows, self.accel.rows, self.bridged.rows)

    def append(self, later: Intervals) -> None:
        """Put intervals after them, which begin where these end."""
        self.edges.append(later.edges[1:])
        self.gyro.append(later.gyro)
        self.accel.append(later.accel)
        self.bridged.append(later.bridged)

"""A growable array has spare capacity at its end, so that it is copied now and then and not with every batch.

An array that was read before an append stays as it was.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from trackfg.sensors.imu_intervals import Intervals
from trackfg.streaming.checkpoint.snapshot import DERIVED

_LEAST = 64
"""The smallest capacity, rows."""


@dataclass
class GrowableArray:
    """The first ``rows`` (n, ...) of an array with ``room`` for more, which is made by the first append."""

    rows: np.ndarray
    room: np.ndarray | None = field(default=None, metadata=DERIVED)

    def append(self, rows: np.ndarray) -> None:
        """Append rows."""
        begin, end = len(self.rows), len(self.rows) + len(rows)
        if self.room is None or end > len(self.room):
            self.room = np.empty((max(2 * end, _LEAST), *self.rows.shape[1:]), self.rows.dtype)
            self.room[:begin] = self.rows
        self.room[begin:end] = rows
        self.rows = self.room[:end]


@dataclass
class GrowableIntervals:
    """Inertial intervals whose arrays grow; fields as in :class:`~trackfg.sensors.imu_intervals.Intervals`."""

    edges: GrowableArray
    gyro: GrowableArray
    accel: GrowableArray
    bridged: GrowableArray
    _whole: Intervals | None = field(default=None, init=False, metadata=DERIVED)

    @classmethod
    def of(cls, data: Intervals) -> GrowableIntervals:
        """Return growable arrays that hold these intervals."""
        return cls(*(GrowableArray(part) for part in (data.edges, data.gyro, data.accel, data.bridged)))

    @property
    def intervals(self) -> Intervals:
        """All intervals so far."""
        if self._whole is None:  # asked for many times a keyframe
            self._whole = Intervals(self.edges.rows, self.gyro.rows, self.accel.rows, self.bridged.rows)
        return self._whole

    def append(self, later: Intervals) -> None:
        """Append intervals that begin where these end."""
        self._whole = None
        self.edges.append(later.edges[1:])
        self.gyro.append(later.gyro)
        self.accel.append(later.accel)
        self.bridged.append(later.bridged)

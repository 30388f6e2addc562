"""Arrays that grow at their ends: with room to spare, so that they are copied now and then and not with every batch.

What they were before stays as it was: whoever holds it may go on using it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trackfg.inertial import Intervals

_LEAST = 64


@dataclass
class Growing:
    """The first ``count`` rows of a ``buffer``."""

    buffer: np.ndarray
    count: int

    @classmethod
    def of(cls, rows: np.ndarray) -> Growing:
        """Of rows that are there."""
        return cls(rows, len(rows))

    @property
    def rows(self) -> np.ndarray:
        """All of them, shape (count, ...)."""
        return self.buffer[: self.count]

    def append(self, rows: np.ndarray) -> None:
        """Put rows after them."""
        count = self.count + len(rows)
        if count > len(self.buffer):
            buffer = np.zeros((max(2 * count, _LEAST), *self.buffer.shape[1:]), self.buffer.dtype)
            buffer[: self.count] = self.rows
            self.buffer = buffer
        self.buffer[self.count : count] = rows
        self.count = count


@dataclass
class GrowingIntervals:
    """The arrays of :class:`~trackfg.inertial.Intervals`."""

    edges: Growing
    gyro: Growing
    accel: Growing
    bridged: Growing

    @classmethod
    def of(cls, data: Intervals) -> GrowingIntervals:
        """Of intervals that are there."""
        return cls(*(Growing.of(part) for part in (data.edges, data.gyro, data.accel, data.bridged)))

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

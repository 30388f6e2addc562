"""The first rows of the IMU have to come at a rate that a sensor has: else their times are in another unit.

In a smaller unit than declared each row looks like a jump of the clock, and hardly any is used; in a larger one an hour
is a second.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from trackfg.checks.columns import interval_finding
from trackfg.checks.limits import CheckLimits
from trackfg.errors import BadInputError
from trackfg.numerics.arrays import Array
from trackfg.numerics.robust import median
from trackfg.recording.description import Imu

FIRST_ROWS = 1000
"""So many rows are judged: more than a logger sends in one packet (1 kHz for a second)."""
_FEWEST_ROWS = 50
"""Of a stream that ends before, fewer rows say nothing."""


@dataclass
class IntervalCheck:
    """Keeps the times of the IMU's first rows until they are enough: ``waiting``; None once they have been judged."""

    limits: CheckLimits
    waiting: list[Array] | None = field(default_factory=list)

    def take(self, t: Array, imu: Imu, *, canonical: bool) -> None:
        """Take the times of the next rows (n,), s, in any order; ``canonical``: none but s can be declared.

        Raises :class:`~trackfg.errors.BadInputError` where they are further apart, or closer, than those of any sensor.
        """
        if self.waiting is None or not len(t):
            return
        self.waiting.append(t.copy())
        if sum(map(len, self.waiting)) >= FIRST_ROWS:
            self.finish(imu, canonical=canonical)

    def finish(self, imu: Imu, *, canonical: bool) -> None:
        """Judge what there is at the end of a stream, likewise."""
        t = np.concatenate([np.empty(0), *(self.waiting or ())])[:FIRST_ROWS]
        self.waiting = None
        times = np.unique(t[np.isfinite(t)])
        if len(t) < _FEWEST_ROWS or len(times) < 2:
            return
        # Rows of a packet may be microseconds apart, and a jump of the clock makes the mean interval long.
        usual_s, mean_s = median(np.diff(times)), float(times[-1] - times[0]) / (len(t) - 1)
        low_s, high_s = self.limits.imu_interval_s
        if low_s <= mean_s and min(usual_s, mean_s) <= high_s:
            return
        unit = None if canonical else imu.time_unit
        finding = interval_finding(min(usual_s, mean_s), "imu", imu.time, self.limits, unit)
        if finding is not None:
            raise BadInputError(f"the first {len(t)} rows of the stream: {finding}")

"""The first rows of the IMU have to come at a rate that a sensor has: else their times are in another unit.

In a smaller unit than declared each row looks like a jump of the clock, and hardly any is used; in a larger one an hour
is a second. Rows that a logger stamps by the packet are an event: of equal stamps a stream uses one row
(:mod:`trackfg.checks.inertial.packet_stamps` spreads them over a whole record).
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
from trackfg.results.events import Event, doubt_event

FIRST_ROWS = 1000
"""So many rows are judged: more than a logger sends in one packet (1 kHz for a second)."""
_SHORT = 2e-4
"""Steps within packets are shorter than this share of the time of all rows: a fifth of a thousandth."""
_FEWEST_ROWS = 50
"""Of a stream that ends before, fewer rows say nothing."""


@dataclass
class IntervalCheck:
    """Keeps the IMU's first rows until they are enough: ``waiting``; None once they have been judged."""

    limits: CheckLimits
    waiting: list[Array] | None = field(default_factory=list)

    def take(self, rows: Array, imu: Imu, *, canonical: bool) -> Event | None:
        """Take the next rows (n, 7), in any order; ``canonical``: no other unit than s can be declared.

        Return an event where they are stamped by the packet. Raises :class:`~trackfg.errors.BadInputError` where they
        are further apart, or closer, than those of any sensor.
        """
        if self.waiting is None or not len(rows):
            return None
        self.waiting.append(rows.copy())
        enough = sum(map(len, self.waiting)) >= FIRST_ROWS
        return self.finish(imu, canonical=canonical) if enough else None

    def finish(self, imu: Imu, *, canonical: bool) -> Event | None:
        """Judge what there is at the end of a stream, likewise."""
        rows = np.concatenate([np.empty((0, 7)), *(self.waiting or ())])[:FIRST_ROWS]
        self.waiting = None
        self._judge_interval(rows[:, 0], imu, canonical=canonical)
        return self._judge_packets(rows[np.isfinite(rows).all(axis=1)])

    def _judge_interval(self, t: Array, imu: Imu, *, canonical: bool) -> None:
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

    @staticmethod
    def _judge_packets(rows: Array) -> Event | None:
        rows = rows[np.argsort(rows[:, 0], kind="stable")]
        if (
            len(rows) < _FEWEST_ROWS
            or np.count_nonzero(np.diff(rows[:, 0]) < _SHORT * np.ptp(rows[:, 0])) < _FEWEST_ROWS
        ):
            return None
        # Late: it loads SciPy, which takes as long as many rows.
        from trackfg.checks.inertial.packet_stamps import spread_evenly

        even = spread_evenly(rows[:, 0], list(rows[:, 1:].T))
        if even is None:
            return None
        used = ", of which one is used" if even.equal else ""
        reason = f"samples come in packets of {even.rows} with one time each{used}"
        advice = "let the logger stamp each sample, or smooth the recording, which spreads them"
        first_s, last_s = rows[[0, -1], 0].tolist()
        return doubt_event(("all quantities",), reason, advice, table="imu", t_s=first_s, until_s=last_s)

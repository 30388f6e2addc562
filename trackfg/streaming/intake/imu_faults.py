"""Rows of the IMU that are numbers and yet no measurements: the smoother does without them, and sees a gap.

``stuck-channel``
    A channel shows one value again and again (:mod:`trackfg.streaming.intake.stuck_value`), more often than it does by
    chance (:mod:`trackfg.streaming.intake.channel_statistics`): it is stuck, or cut off at the end of its range. Rows
    between two at the end of the range are left out with them: alone they would be too small on average.
``impossible-value``
    Beyond what the sensors of rail vehicles show at all; or far beyond what this stream has shown, and beyond what a
    vehicle does, for less than ``_BELIEVED_S``: a sensor that is hit, or a value that was garbled on its way.

A row goes as a whole. One sample that equals the one before makes rows wait, from it on, until more of them come or
others: a stream in which nothing repeats is not delayed. How rows are grouped on their way makes no difference.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from trackfg.checks.limits import CheckLimits
from trackfg.numerics.arrays import Array
from trackfg.recording import canonical
from trackfg.recording.description import Imu
from trackfg.streaming.events import LossReport
from trackfg.streaming.intake.channel_statistics import ChannelStatistics
from trackfg.streaming.intake.stuck_value import StuckValue
from trackfg.units import to_si

_PATIENCE_S = 0.2
"""So long a channel that is cut off may stay below the end of its range."""
_FAR = 10.0
"""Times as far as ever before."""
_BELIEVED_S = 0.5
_DIGITS = 11
"""Of values turned back to the sensor's axes, after the point: rounding there must not tell equal ones apart."""


class ImuFaults:
    """``canonical``: rows are in SI and body axes, and are judged in the sensor's axes all the same."""

    def __init__(self, imu: Imu, *, is_canonical: bool) -> None:
        limits = CheckLimits()
        R, units = canonical.imu_rotation(imu), np.ones(6)
        if not is_canonical:
            units = np.repeat([to_si("angular rate", imu.gyro_unit), to_si("acceleration", imu.accel_unit)], 3)
        self._R = R if is_canonical and not np.array_equal(R, np.eye(3)) else None
        self._names = np.array([*imu.gyro, *imu.accel])
        self._possible = np.repeat([limits.possible_rate_radps, limits.possible_force_mps2], 3) / units
        self._usual = np.repeat([limits.usual_rate_radps, limits.usual_force_mps2], 3) / units
        self._habits = ChannelStatistics(np.repeat([imu.noise.gyro_white, imu.noise.accel_white], 3) / units)
        self._plateaus = [StuckValue() for _ in range(6)]
        self._before = np.full(6, np.nan)
        self._count = 0
        self._held = np.empty((0, 7))
        self._held_rows = np.empty(0, dtype=np.int64)
        self._far = 0
        self._centre, self._limit = np.zeros(6), self._possible

    def passed(self, rows: Array, report: LossReport) -> Array:
        """Of the next rows (n, 7), in order, and of those that waited, the measurements that are known to be such."""
        out = []
        while rows.shape[0]:
            count = max(self._habits.room - len(self._held), 1)
            sensed = self._in_sensor_axes(rows[:count])
            wild = np.abs(sensed[:, 1:] - self._centre) > self._limit
            if self._far or wild.any():
                count = 1 if self._far else max(int(wild.any(axis=1).argmax()), 1)
                sensed, wild = sensed[:count], wild[:count]
            some, rows = rows[:count], rows[count:]
            if wild.any():
                self._lose_wild(sensed, wild, report)
            else:
                self._far = max(self._far - 1, 0)
                out.append(self._judged(some, sensed, report))
        return out[0] if len(out) == 1 else np.concatenate([np.empty((0, 7)), *out])

    def finish(self) -> Array:
        """The stream is over: rows that still wait were not found to be wrong."""
        rest, self._held, self._held_rows = self._held, self._held[:0], self._held_rows[:0]
        return rest

    @property
    def waiting_since_s(self) -> float:
        """Time of the first row that waits, s."""
        return float(self._held[0, 0]) if len(self._held) else np.inf

    def _in_sensor_axes(self, rows: Array) -> Array:
        if self._R is None:
            return rows
        values = np.round(np.hstack([rows[:, 1:4] @ self._R, rows[:, 4:] @ self._R]), _DIGITS)
        return np.column_stack([rows[:, 0], values])

    def _lose_wild(self, rows: Array, wild: np.ndarray, report: LossReport) -> None:
        report.lose("impossible-value", "imu", rows[:, 0], self._names[wild.any(axis=0)].tolist())
        self._far += 1
        interval = self._habits.interval_s
        if interval is not None and self._far * interval > _BELIEVED_S:
            furthest = np.abs(rows[0, 1:] - self._centre)
            self._habits.furthest = np.maximum(self._habits.furthest, np.minimum(furthest, self._possible))
            self._far = 0
            self._set_limits()

    def _set_limits(self) -> None:
        if self._habits.interval_s is not None:
            self._centre = self._habits.centre
            self._limit = np.clip(_FAR * self._habits.furthest, self._usual, self._possible)

    def _judged(self, rows: Array, sensed: Array, report: LossReport) -> Array:
        values = sensed[:, 1:]
        same = np.empty(values.shape, dtype=bool)
        np.equal(values[1:], values[:-1], out=same[1:])
        np.equal(values[0], self._before, out=same[0])
        before, self._before = self._before, values[-1].copy()
        begin = self._count
        self._count += len(rows)
        if all(one.level is None for one in self._plateaus) and not same.any():
            self._learn(sensed)
            return rows
        every = np.concatenate([self._held, rows])
        numbers = np.concatenate([self._held_rows, np.arange(begin, self._count)])
        wrong = np.zeros((len(every), 6), dtype=bool)
        interval = self._habits.interval_s
        patience = 0 if interval is None else round(_PATIENCE_S / interval)
        for c, (plateau, chance) in enumerate(zip(self._plateaus, self._habits.chance, strict=True)):
            if plateau.level is None and not same[:, c].any():
                continue
            series = values[:, c].tolist()
            for first, end in plateau.take(series, begin, float(before[c]), chance, patience):
                wrong[(numbers >= first) & (numbers < end), c] = True
        lost = wrong.any(axis=1)
        if lost.any():
            report.lose("stuck-channel", "imu", every[lost, 0], self._names[wrong.any(axis=0)].tolist())
        held = ~lost & (numbers >= min(one.held_from for one in self._plateaus))
        passed = ~lost & ~held
        self._held, self._held_rows = every[held], numbers[held]
        out = every[passed]
        if len(out):
            self._learn(self._in_sensor_axes(out))
        return out

    def _learn(self, sensed: Array) -> None:
        completes = len(sensed) >= self._habits.room
        self._habits.learn(sensed)
        if completes:
            self._set_limits()

    def state(self) -> dict[str, Any]:
        """What carries over to the next batch, as JSON values."""
        return {
            "habits": self._habits.state(),
            "plateaus": [one.state() for one in self._plateaus],
            "before": None if np.isnan(self._before).any() else self._before.tolist(),
            "count": self._count,
            "held": self._held.tolist(),
            "held_rows": self._held_rows.tolist(),
            "far": self._far,
        }

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on from a :meth:`state`."""
        self._habits.restore(state["habits"])
        self._plateaus = [StuckValue(**one) for one in state["plateaus"]]
        self._before = np.full(6, np.nan) if state["before"] is None else np.array(state["before"])
        self._count, self._far = state["count"], state["far"]
        self._held = np.array(state["held"], dtype=np.float64).reshape(-1, 7)
        self._held_rows = np.array(state["held_rows"], dtype=np.int64)
        self._set_limits()

"""The IMU is the clock of a stream: which of its rows move the clock on, and which stamps are nonsense.

A row that is at most ``hold_s`` ahead of the newest one moves the clock on. One that is further ahead, or more than
``back_s`` behind what was released, puts the clock in doubt: it is set aside, and so are the next, until

* either the old clock goes on for ``hold_s``: then the rows that were set aside are refused (``clock-jump``, or
  ``late`` where they are less than ``back_s`` behind);
* or they have gone on among themselves, but for single wrong stamps, for ``hold_s`` (``settle_s`` where they are more
  than ``ahead_s`` ahead, or behind): then they are the clock, and none of them is lost.

A clock set back by a little comes to where it was before ``settle_s`` is over. Rows that are behind may also be rows
sent again, or sent late to fill a hole. They are a clock that was set back if times come again that there have been
rows of, with other values, and if they go on for ``back_s``, or until they are not too late any more. One that is set
back by less than ``hold_s`` is never too late, as rows in disorder are not: a row that comes behind the newest one and
beside another puts the clock in doubt as well, and it is settled if the next ones go on so, up to the newest one and
beyond. (Fewer than ``_FEWEST_AGAIN`` rows are sorted in.)

A clock that went forward left a ``gap``, and is believed, up to ``longest_gap_s``. One that went further was set, and
one that was set back (``clock-restart``) cannot be believed either: times on the stream must grow, so from there on
they are the sensor's times plus a shift, by which the first row after comes one sampling interval after the last row
before. That is right where a running logger's clock was corrected; where a device was off for a time, nobody knows for
how long.

A wrong stamp therefore costs itself and nothing else, whatever it says, and the first row of all is no exception.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from trackfg.numerics.arrays import Array
from trackfg.numerics.spans import median_interval
from trackfg.streaming.checkpoint.json_numbers import finite_or, finite_or_none
from trackfg.streaming.events import LossReport, StreamEvent

_AT_ONCE = 256
_MOST_DOUBTFUL = 100_000
_RIVAL_ROWS = 10
_FEWEST_AGAIN = 5
_NEIGHBOURS = 3.5
"""Rows so many sampling intervals apart, or less, follow each other."""
_BESIDE = 0.75
"""A row so few sampling intervals from another does not fill a hole."""


@dataclass(frozen=True)
class ClockLimits:
    """What is waited for and believed, s.

    ``hold_s``: how late a row of any table may be against the newest of the IMU; ``back_s``: how much further behind a
    row of the IMU is merely late; ``ahead_s``: a longer gap must prove itself; ``settle_s``: by so long a succession;
    ``step_s``: between rows that belong together; ``gap_s``: a longer gap of the IMU is an event; ``longest_gap_s``: a
    longer one was none.
    """

    hold_s: float = 0.2
    back_s: float = 1.0
    ahead_s: float = 60.0
    settle_s: float = 5.0
    step_s: float = 1.0
    gap_s: float = 0.5
    longest_gap_s: float = 600.0


class ImuClock:
    """Places the IMU's rows on the clock of the stream."""

    def __init__(self, limits: ClockLimits) -> None:
        self._limits = limits
        self._doubtful: list[Array] = []
        self._rival: list[Array] = []
        self._doubted_at_s = -np.inf
        self._heard = np.empty((0, 2))
        self.newest_s = -np.inf
        """On the stream's clock; minus infinity before the first rows have proved themselves."""
        self.shift_s = 0.0
        """What is added to the sensor's time."""
        self.set_s = np.inf
        """The sensor's time, as it was before, when the shift changed last."""

    @property
    def in_doubt(self) -> bool:
        """Whether the clock may be about to change, or has not begun."""
        return bool(self._doubtful) or bool(np.isneginf(self.newest_s))

    def in_doubt_since(self, passed_s: float) -> bool:
        """Whether it may have been set back, but to no earlier than ``passed_s``."""
        return bool(self._doubtful) and bool(passed_s < self._doubtful[0][0, 0] + self.shift_s <= self.newest_s)

    def placed(self, rows: Array, passed_s: float, report: LossReport) -> Array:
        """The rows that belong to the clock, on the stream's time. All up to ``passed_s`` was released before."""
        kept = [rows[:0]]
        while rows.shape[0]:
            if self._doubtful and self._comes_up_again(rows[0], passed_s):
                kept.append(self._settled(report))
            count = self._leading(rows[:_AT_ONCE], passed_s)
            if count:
                kept.append(self._accepted(rows[:count]))
            else:
                kept.append(self._doubt(rows[:1], passed_s, report))
                count = 1
            rows = rows[count:]
            if self._doubtful and self.newest_s > self._doubted_at_s:
                kept.append(self._reviewed(passed_s, report))
        return np.concatenate(kept)

    def finished(self, passed_s: float, report: LossReport) -> Array:
        """Nothing more will come: rows in doubt that more than one stamp speaks for, if they lie within reach."""
        self._refuse_rival(report)
        if not self._doubtful:
            return np.empty((0, 1))
        if self.in_doubt_since(passed_s):
            rows = np.concatenate(self._doubtful)
            sound, _ = self._within_reach(rows, passed_s)
            self._doubtful = list(rows[~sound, None, :])
            if self._doubtful:
                self._refuse(report)
            return self._accepted(rows[sound])
        t = np.concatenate(self._doubtful)[:, 0] + self.shift_s
        beginning = np.isneginf(self.newest_s)
        if beginning or (t.size > 1 and self.newest_s < t.min() <= self.newest_s + self._limits.ahead_s):
            return self._settled(report)
        self._refuse(report)
        return np.empty((0, 1))

    def _leading(self, rows: Array, passed_s: float) -> int:
        """How many rows from the first on move the clock on, or fill a hole behind it."""
        sound, behind = self._within_reach(rows, passed_s)
        if behind[0]:
            behind[0] = self._is_beside(rows[:1])
        return _how_many_lead(sound & ~behind)  # those behind are looked at when all before them have been heard

    def _within_reach(self, rows: Array, passed_s: float) -> tuple[np.ndarray, np.ndarray]:
        """Which rows are neither too late nor too far ahead, and which are behind the newest one before them."""
        t = rows[:, 0] + self.shift_s
        before = np.maximum.accumulate(np.concatenate([[self.newest_s], t]))[:-1]
        return (t > passed_s) & (t <= before + self._limits.hold_s), t < before

    def _accepted(self, rows: Array) -> Array:
        out = np.array(rows)
        out[:, 0] += self.shift_s
        self.newest_s = max(self.newest_s, float(out[:, 0].max()))
        heard = np.concatenate([self._heard, _marks(out)])
        if (np.diff(heard[:, 0]) < 0.0).any():
            heard = heard[np.argsort(heard[:, 0], kind="stable")]
        kept_s = self._limits.settle_s + self._limits.back_s
        self._heard = heard[np.searchsorted(heard[:, 0], self.newest_s - kept_s) :]
        return out

    def _doubt(self, row: Array, passed_s: float, report: LossReport) -> Array:
        """Set one row aside, and take the rows set aside for the clock if this one settles it."""
        if len(self._doubtful) >= _MOST_DOUBTFUL:
            self._refuse(report)
        if not self._doubtful:
            self._doubted_at_s = self.newest_s
        if not self._doubtful or self._continues(self._doubtful, row):
            self._doubtful.append(row)
            self._refuse_rival(report)
        else:
            self._rivals(row, report)
        return self._settled(report) if self._settles() else row[:0]

    def _rivals(self, row: Array, report: LossReport) -> None:
        """One wrong stamp must not end a succession, and a succession that began with one must end."""
        if not self._continues(self._rival, row):
            self._refuse_rival(report)
        self._rival.append(row)
        if len(self._rival) > min(len(self._doubtful), _RIVAL_ROWS):
            self._doubtful, self._rival = self._rival, self._doubtful
            self._refuse_rival(report)

    def _continues(self, rows: list[Array], row: Array) -> bool:
        newest = max((float(other[0, 0]) for other in rows[-2:]), default=np.inf)
        return bool(abs(row[0, 0] - newest) <= self._limits.step_s)

    def _settles(self) -> bool:
        first, last = self._doubtful[0][0, 0], self._doubtful[-1][0, 0]
        ahead = first + self.shift_s - self.newest_s
        gone_on = last - first
        if np.isneginf(self.newest_s) or 0.0 < ahead <= self._limits.ahead_s:
            return bool(gone_on >= self._limits.hold_s)
        if gone_on >= self._limits.settle_s:
            return True
        return bool(ahead <= 0.0 and gone_on >= self._limits.back_s and self._is_heard_again())

    def _comes_up_again(self, row: Array, passed_s: float) -> bool:
        """Whether this row, which is not too late, follows those set aside, which are, and none came between; or it is
        the newest, and they are behind.
        """
        first, last = self._doubtful[0][0, 0], self._doubtful[-1][0, 0]
        reached = passed_s if first + self.shift_s <= passed_s else self.newest_s
        if self.newest_s > self._doubted_at_s or not first + self.shift_s <= reached < row[0] + self.shift_s:
            return False
        return bool(0.0 < row[0] - last <= self._neighbour_s and self._is_heard_again())

    def _is_heard_again(self) -> bool:
        """Whether the rows set aside follow each other and are of times that others were of, with other values."""
        rows = np.concatenate(self._doubtful)
        steps = np.diff(rows[:, 0])
        if len(rows) < _FEWEST_AGAIN or np.mean((steps > 0.0) & (steps <= self._neighbour_s)) < 0.9:
            return False
        near, same = self._beside(rows[rows[:, 0] + self.shift_s <= self.newest_s])
        return bool(np.mean(near <= self._neighbour_s) > 0.5 > np.mean(same))

    def _is_beside(self, row: Array) -> bool:
        """Whether there has been another row where this one is."""
        (near,), (same,) = self._beside(row)
        return bool(near <= _BESIDE * self._interval_s and not same)

    def _beside(self, rows: Array) -> tuple[Array, np.ndarray]:
        """How far in time each row is from the nearest one heard, s, and whether that is the same row."""
        heard, marks = self._heard, _marks(rows)
        marks[:, 0] += self.shift_s
        if len(heard) < 2:
            return np.full(len(rows), np.inf), np.zeros(len(rows), dtype=bool)
        after = np.clip(np.searchsorted(heard[:, 0], marks[:, 0]), 1, len(heard) - 1)
        both = np.stack([heard[after - 1], heard[after]])
        near = np.abs(both[:, :, 0] - marks[:, 0]).min(axis=0)
        return near, (both == marks).all(axis=2).any(axis=0)

    @property
    def _neighbour_s(self) -> float:
        return _NEIGHBOURS * self._interval_s

    @property
    def _interval_s(self) -> float:
        return median_interval(self._heard[:, 0]) if len(self._heard) > 1 else 0.0

    def _settled(self, report: LossReport) -> Array:
        rows = np.concatenate(self._doubtful)
        self._doubtful = []
        self._refuse_rival(report)
        first, before = float(rows[:, 0].min()) + self.shift_s, self.newest_s
        if np.isneginf(before) or 0.0 < first - before <= self._limits.longest_gap_s:
            if first - before > self._limits.gap_s and np.isfinite(before):
                detail = f"no rows for {first - before:.3f} s"
                report.note(StreamEvent("gap", "imu", before, first, 0, detail))
            return self._accepted(rows)
        interval = median_interval(np.unique(rows[:, 0]))
        self.set_s = before - self.shift_s
        self.shift_s += before + interval - first
        went = f"{'forward' if first > before else 'back'} by {abs(first - before):.3f} s"
        detail = f"the clock went {went}; from here times are the sensor's plus {self.shift_s:.6f} s"
        report.note(StreamEvent("clock-restart", "imu", before, before + interval, 0, detail))
        return self._accepted(rows)

    def _reviewed(self, passed_s: float, report: LossReport) -> Array:
        """The old clock has moved on: rows set aside that it has caught up with; all others go when it has gone on."""
        rows = np.concatenate(self._doubtful)
        rows = rows[np.argsort(rows[:, 0], kind="stable")]
        count = _how_many_lead(self._within_reach(rows, passed_s)[0])
        kept = self._accepted(rows[:count]) if count else rows[:0]
        self._doubtful = list(rows[count:, None, :])
        if not self._doubtful:
            self._refuse_rival(report)
        elif self.newest_s > self._doubted_at_s + self._limits.hold_s:
            self._refuse(report)
        return kept

    def _refuse(self, report: LossReport) -> None:
        t = np.concatenate(self._doubtful)[:, 0] + self.shift_s
        late = (t <= self.newest_s) & (t > self.newest_s - self._limits.hold_s - self._limits.back_s)
        report.lose("late", "imu", t[late])
        report.lose("clock-jump", "imu", t[~late])
        self._doubtful = []
        self._refuse_rival(report)

    def _refuse_rival(self, report: LossReport) -> None:
        if self._rival:
            report.lose("clock-jump", "imu", np.concatenate(self._rival)[:, 0] + self.shift_s)
            self._rival = []

    def state(self) -> dict[str, Any]:
        """All of it, as JSON values."""
        return {
            "doubtful": [row[0].tolist() for row in self._doubtful],
            "rival": [row[0].tolist() for row in self._rival],
            "doubted_at_s": finite_or_none(self._doubted_at_s),
            "heard": self._heard.tolist(),
            "newest_s": finite_or_none(self.newest_s),
            "shift_s": self.shift_s,
            "set_s": finite_or_none(self.set_s),
        }

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on from a :meth:`state`."""
        self._doubtful = [np.array([row], dtype=np.float64) for row in state["doubtful"]]
        self._rival = [np.array([row], dtype=np.float64) for row in state["rival"]]
        self._doubted_at_s = finite_or(-np.inf, state["doubted_at_s"])
        self._heard = np.array(state["heard"], dtype=np.float64).reshape(-1, 2)
        self.newest_s = finite_or(-np.inf, state["newest_s"])
        self.shift_s = state["shift_s"]
        self.set_s = finite_or(np.inf, state["set_s"])


def _how_many_lead(sound: np.ndarray) -> int:
    """How many from the first on."""
    return sound.size if sound.all() else int(np.argmin(sound))


def _marks(rows: Array) -> Array:
    """What tells rows from others: their times and the sums of all else."""
    return np.column_stack([rows[:, 0], rows[:, 1:].sum(axis=1)])

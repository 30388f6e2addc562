"""The IMU is the clock of a stream: this stage decides which of its rows move it on, and which stamps are wrong.

A row that is at most ``hold_s`` ahead of the newest one moves the clock on. A row further ahead, or more than
``back_s`` behind what was released, puts the clock in doubt. It is quarantined, and so are the next ones, until

* the old clock goes on for ``hold_s``: the quarantined rows are refused (``clock-jump``, or ``late`` where they are
  less than ``back_s`` behind);
* or they go on among themselves, except for single wrong stamps, for ``hold_s`` (``settle_s`` where they are more than
  ``ahead_s`` ahead, or behind): then they are the clock, and none of them is lost.

A clock that was set back by a little reaches its old time before ``settle_s`` is over. Rows that are behind may also
have been sent again, or sent late to fill a hole. They are a clock that was set back if their times had other rows
before, and if they go on for ``back_s`` or until they are no longer too late. If it was set back by less than
``hold_s``, its rows are never too late. So a row that comes behind the newest one and beside another puts the clock in
doubt as well, and the doubt is settled if the next rows go on so, up to the newest one and beyond. (Fewer than
``_FEWEST_AGAIN`` rows are sorted in.)

A clock that went forward left a ``gap``, up to ``longest_gap_s``. One that went further, or back, was set
(``clock-restart``). Times on the stream must grow, so from there on they are the sensor's times plus a shift that puts
the first row after it one sampling interval behind the last row before. That is right where the clock of a running
logger was corrected; for how long a device was off, its clock does not show. Where rows are known to be missing
(``missed_s``), a clock that is ahead by no more than ``longest_missed_s`` left a gap.

A wrong stamp therefore costs itself and nothing else, whatever its value, and the first row of all is no exception.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from trackfg.numerics.arrays import Array
from trackfg.numerics.spans import median_interval
from trackfg.results.events import Event
from trackfg.streaming.events import LossReport

_AT_ONCE = 256
"""Rows that are looked at together; a later row's state depends on those before."""
_MOST_QUARANTINED = 100_000
"""More rows are refused, so that a stream of wrong stamps does not fill the memory."""
_RIVAL_ROWS = 10
"""Rivals that replace the quarantined rows: those had begun with a wrong stamp."""
_FEWEST_AGAIN = 5
"""Fewer rows at times that come again are sorted in."""
_NEIGHBOURS = 3.5
"""Rows so many sampling intervals apart, or less, follow each other."""
_BESIDE = 0.75
"""A row so few sampling intervals from another does not fill a hole."""


@dataclass(frozen=True)
class ClockLimits:
    """Limits of waiting, and of the jumps that are accepted, s.

    ``hold_s``: how late a row of any table may be against the newest of the IMU; ``back_s``: how much further behind a
    row of the IMU is merely late; ``ahead_s``: a longer gap must prove itself; ``settle_s``: by so long a succession;
    ``step_s``: between rows that belong together; ``gap_s``: a longer gap of the IMU is an event; ``longest_gap_s``: a
    longer one was none. ``longest_missed_s``: the same where rows are known to be missing.
    """

    hold_s: float = 0.2
    back_s: float = 1.0
    ahead_s: float = 60.0
    settle_s: float = 5.0
    step_s: float = 1.0
    gap_s: float = 0.5
    longest_gap_s: float = 600.0
    longest_missed_s: float = 7.0 * 86_400.0


@dataclass
class ImuClock:
    """Places the IMU's rows on the clock of the stream.

    ``quarantined``: rows whose times are too far ahead or behind, in the order of arrival; ``rivals``: later rows that
    do not follow these. ``doubted_at_s``: the newest time when the first was quarantined. ``recent``
    (h, 2): times and checksums of the newest rows. ``newest_s``: on the stream's clock, minus infinity before the first
    rows have proved themselves. ``shift_s``: what is added to the sensor's time; ``set_s``: the sensor's time, as it
    was before, when that changed last; ``missed_s``: the newest time when rows began to be missing. ``decidable_rows``:
    the times of fewer quarantined rows cannot have come again.
    """

    limits: ClockLimits
    quarantined: list[Array] = field(default_factory=list)
    rivals: list[Array] = field(default_factory=list)
    doubted_at_s: float = -np.inf
    recent: Array = field(default_factory=lambda: np.empty((0, 2)))
    newest_s: float = -np.inf
    shift_s: float = 0.0
    set_s: float = np.inf
    missed_s: float = np.nan
    decidable_rows: int = 0

    @property
    def in_doubt(self) -> bool:
        """Return whether the clock may be about to change, or has not begun."""
        return bool(self.quarantined) or bool(np.isneginf(self.newest_s))

    def in_doubt_since(self, passed_s: float) -> bool:
        """Return whether the clock may have been set back, but to no earlier than ``passed_s``."""
        return bool(self.quarantined) and bool(passed_s < self.quarantined[0][0, 0] + self.shift_s <= self.newest_s)

    def placed(self, rows: Array, passed_s: float, report: LossReport) -> Array:
        """Return the rows of the clock, on the stream's time. All up to ``passed_s`` was released before."""
        kept = [rows[:0]]
        while rows.shape[0]:
            if self.quarantined and self._comes_up_again(rows[0], passed_s):
                kept.append(self._settle(report))
            count = self._leading(rows[:_AT_ONCE], passed_s)
            if count:
                kept.append(self._accept(rows[:count]))
            else:
                kept.append(self._quarantine(rows[:1], passed_s, report))
                count = 1
            rows = rows[count:]
            if self.quarantined and self.newest_s > self.doubted_at_s:
                kept.append(self._review(passed_s, report))
        return np.concatenate(kept)

    def finished(self, passed_s: float, report: LossReport) -> Array:
        """Return the quarantined rows that are within reach and have more than one stamp: no more rows come."""
        self._refuse_rivals(report)
        if not self.quarantined:
            return np.empty((0, 1))
        if self.in_doubt_since(passed_s):
            rows = np.concatenate(self.quarantined)
            sound, _ = self._within_reach(rows, passed_s)
            self.quarantined = list(rows[~sound, None, :])
            if self.quarantined:
                self._refuse(report)
            return self._accept(rows[sound])
        t = np.concatenate(self.quarantined)[:, 0] + self.shift_s
        beginning = np.isneginf(self.newest_s)
        if beginning or (t.size > 1 and self.newest_s < t.min() <= self.newest_s + self.limits.ahead_s):
            return self._settle(report)
        self._refuse(report)
        return np.empty((0, 1))

    def _leading(self, rows: Array, passed_s: float) -> int:
        """Return how many rows from the first on move the clock on, or fill a hole behind it."""
        sound, behind = self._within_reach(rows, passed_s)
        if behind[0]:
            behind[0] = self._is_beside(rows[:1])
        return _how_many_lead(sound & ~behind)  # those behind are judged once all before them are placed

    def _within_reach(self, rows: Array, passed_s: float) -> tuple[np.ndarray, np.ndarray]:
        """Return which rows are neither too late nor too far ahead, and which are behind the newest one before them."""
        t = rows[:, 0] + self.shift_s
        newest = np.maximum.accumulate(np.concatenate([[self.newest_s], t]))[:-1]
        return (t > passed_s) & (t <= newest + self.limits.hold_s), t < newest

    def _accept(self, rows: Array) -> Array:
        out = np.array(rows)
        out[:, 0] += self.shift_s
        self.decidable_rows = 0
        self.newest_s = max(self.newest_s, float(out[:, 0].max()))
        recent = np.concatenate([self.recent, _marks(out)])
        if (np.diff(recent[:, 0]) < 0.0).any():
            recent = recent[np.argsort(recent[:, 0], kind="stable")]
        kept_s = self.limits.settle_s + self.limits.back_s
        self.recent = recent[np.searchsorted(recent[:, 0], self.newest_s - kept_s) :]
        return out

    def _quarantine(self, row: Array, passed_s: float, report: LossReport) -> Array:
        """Quarantine one row; return all quarantined rows as the clock if this one settles it."""
        if len(self.quarantined) >= _MOST_QUARANTINED:
            self._refuse(report)
        if not self.quarantined:
            self.doubted_at_s, self.decidable_rows = self.newest_s, 0
        if not self.quarantined or self._continues(self.quarantined, row):
            self.quarantined.append(row)
            self._refuse_rivals(report)
        else:
            self._add_rival(row, report)
        return self._settle(report) if self._settles() else row[:0]

    def _add_rival(self, row: Array, report: LossReport) -> None:
        """Add a row that does not follow the quarantined ones; where rivals become more, they replace these."""
        if not self._continues(self.rivals, row):
            self._refuse_rivals(report)
        self.rivals.append(row)
        if len(self.rivals) > min(len(self.quarantined), _RIVAL_ROWS):
            self.quarantined, self.rivals, self.decidable_rows = self.rivals, self.quarantined, 0
            self._refuse_rivals(report)

    def _continues(self, rows: list[Array], row: Array) -> bool:
        """Return whether a row belongs to ``rows``, of which the last ones may be late by the hold time."""
        newest = max((float(other[0, 0]) for other in rows[-2:]), default=np.inf)
        return bool(abs(row[0, 0] - newest) <= self.limits.step_s + self.limits.hold_s)

    def _settles(self) -> bool:
        first, last = self.quarantined[0][0, 0], self.quarantined[-1][0, 0]
        ahead = first + self.shift_s - self.newest_s
        gone_on = last - first
        if np.isneginf(self.newest_s) or 0.0 < ahead <= self.limits.ahead_s:
            return bool(gone_on >= self.limits.hold_s)
        if gone_on >= self.limits.settle_s:
            return True
        return bool(ahead <= 0.0 and gone_on >= self.limits.back_s and self._times_come_again())

    def _comes_up_again(self, row: Array, passed_s: float) -> bool:
        """Return whether the quarantined rows directly precede this row on the new clock: it was set back by less than
        the hold time.
        """
        first, last = self.quarantined[0][0, 0], self.quarantined[-1][0, 0]
        reached = passed_s if first + self.shift_s <= passed_s else self.newest_s
        if self.newest_s > self.doubted_at_s or not first + self.shift_s <= reached < row[0] + self.shift_s:
            return False
        return bool(0.0 < row[0] - last <= self._neighbour_s and self._times_come_again())

    def _times_come_again(self) -> bool:
        """Return whether the quarantined rows follow each other at times that had other rows before.

        Of those that are behind, more than half must have been near other rows, and less than half be these rows
        themselves. So many as are wanting to that must follow at least before it is looked at again.
        """
        if len(self.quarantined) < max(_FEWEST_AGAIN, self.decidable_rows):
            return False
        rows = np.concatenate(self.quarantined)
        near, same = self._beside(rows[rows[:, 0] + self.shift_s <= self.newest_s])
        apart, again = near.size - np.count_nonzero(near <= self._neighbour_s), np.count_nonzero(same)
        wanting = int(2 * max(apart, again) - near.size)
        if wanting >= 0:
            self.decidable_rows = len(rows) + wanting + 1
            return False
        steps = np.diff(rows[:, 0])
        return bool(np.mean((steps > 0.0) & (steps <= self._neighbour_s)) >= 0.9)

    def _is_beside(self, row: Array) -> bool:
        """Return whether another row was near the time of this one."""
        (near,), (same,) = self._beside(row)
        return bool(not same and near <= _BESIDE * self._interval_s)

    def _beside(self, rows: Array) -> tuple[Array, np.ndarray]:
        """Return how far in time each row is from the nearest recent one, s, and whether that is the same row."""
        recent, marks = self.recent, _marks(rows)
        marks[:, 0] += self.shift_s
        if len(recent) < 2:
            return np.full(len(rows), np.inf), np.zeros(len(rows), dtype=bool)
        upper = np.clip(np.searchsorted(recent[:, 0], marks[:, 0]), 1, len(recent) - 1)
        both = np.stack([recent[upper - 1], recent[upper]])
        near = np.abs(both[:, :, 0] - marks[:, 0]).min(axis=0)
        return near, (both == marks).all(axis=2).any(axis=0)

    @property
    def _neighbour_s(self) -> float:
        return _NEIGHBOURS * self._interval_s

    @property
    def _interval_s(self) -> float:
        """The sampling interval, s, 0 while it is not known: between newer rows others may be on their way."""
        complete = self.recent[: np.searchsorted(self.recent[:, 0], self.newest_s - self.limits.hold_s), 0]
        return median_interval(complete) if len(complete) > 1 else 0.0

    def _settle(self, report: LossReport) -> Array:
        rows = np.concatenate(self.quarantined)
        self.quarantined = []
        self._refuse_rivals(report)
        first, newest_s = float(rows[:, 0].min()) + self.shift_s, self.newest_s
        limits = self.limits
        longest_s = limits.longest_missed_s if newest_s == self.missed_s else limits.longest_gap_s
        if np.isneginf(newest_s) or 0.0 < first - newest_s <= longest_s:
            if first - newest_s > self.limits.gap_s and np.isfinite(newest_s):
                detail = f"no rows for {first - newest_s:.3f} s"
                report.note(Event("gap", "imu", newest_s, first, 0, detail))
            return self._accept(rows)
        interval = median_interval(np.unique(rows[:, 0]))
        self.set_s = newest_s - self.shift_s
        self.shift_s += newest_s + interval - first
        went = f"{'forward' if first > newest_s else 'back'} by {abs(first - newest_s):.3f} s"
        detail = f"the clock went {went}; from here times are the sensor's plus {self.shift_s:.6f} s"
        report.note(Event("clock-restart", "imu", newest_s, newest_s + interval, 0, detail))
        return self._accept(rows)

    def _review(self, passed_s: float, report: LossReport) -> Array:
        """Return quarantined rows that the old clock has caught up with; the others are refused when it has gone on."""
        rows = np.concatenate(self.quarantined)
        rows = rows[np.argsort(rows[:, 0], kind="stable")]
        count = _how_many_lead(self._within_reach(rows, passed_s)[0])
        kept = self._accept(rows[:count]) if count else rows[:0]
        self.quarantined = list(rows[count:, None, :])
        if not self.quarantined:
            self._refuse_rivals(report)
        elif self.newest_s > self.doubted_at_s + self.limits.hold_s:
            self._refuse(report)
        return kept

    def _refuse(self, report: LossReport) -> None:
        t = np.concatenate(self.quarantined)[:, 0] + self.shift_s
        late = (t <= self.newest_s) & (t > self.newest_s - self.limits.hold_s - self.limits.back_s)
        report.lose("late", "imu", t[late])
        report.lose("clock-jump", "imu", t[~late])
        self.quarantined = []
        self._refuse_rivals(report)

    def _refuse_rivals(self, report: LossReport) -> None:
        if self.rivals:
            report.lose("clock-jump", "imu", np.concatenate(self.rivals)[:, 0] + self.shift_s)
            self.rivals = []


def _how_many_lead(sound: np.ndarray) -> int:
    """Return how many from the first on are sound."""
    return sound.size if sound.all() else int(np.argmin(sound))


def _marks(rows: Array) -> Array:
    """Return times and checksums of rows (n, 2): a row that comes again has both."""
    return np.column_stack([rows[:, 0], rows[:, 1:].sum(axis=1)])

"""The reorder buffer puts rows that arrive in disorder into the order of time, up to a watermark.

Each table comes nearly in order, with disorder and delay of its own. The IMU is the clock: what is up to

    watermark = newest time of the IMU - hold

is complete and is released, sorted; rows that come later than that are ``late``. A quiet table holds nothing up. Of
rows of one table with one time the first to arrive stays. Which rows of the IMU are the clock, and which stamps are
wrong, :mod:`trackfg.streaming.intake.imu_clock` decides. Rows of other tables are placed by it:

* later than the watermark and at most ``settle_s`` ahead of the IMU: they wait for the watermark;
* further ahead, or while the IMU's clock is in doubt: they are held, and placed when the IMU has come near; or refused
  (``clock-jump``) when it has moved on by ``settle_s`` and they still do not fit;
* behind: late, or ``clock-jump`` if by more than ``ahead_s``. But where the IMU's clock was set, and a row comes nearer
  to it with the same shift, the table's clock was set too, and is shifted alike from that row on. Where it was set by
  so little that rows fit either way, that is the first row that goes back, or, of a table that has fewer rows than it
  would take to go back, the first of a later time than the IMU's was.

Nothing is lost silently: rows in = rows out + rows waiting or held + rows in the report.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from trackfg.checks.columns import LARGEST
from trackfg.numerics.arrays import Array
from trackfg.numerics.spans import median_interval
from trackfg.results.events import Event
from trackfg.streaming.events import LossReport
from trackfg.streaming.intake.imu_clock import ClockLimits, ImuClock
from trackfg.streaming.rows import RowTables

MOST_WAITING = 500_000
"""Rows of one table; more are refused, so that a stream without an IMU does not fill the memory."""


@dataclass
class ReorderBuffer:
    """The buffer. Batches are tables by name, raw or canonical, the first column the time in s on one clock.

    ``waiting``: by table, rows that wait for the watermark; ``held``: rows that cannot be placed yet, and since which
    time of the IMU; ``shift_s``, ``newest_s``, ``step_s``: what is added to the table's times, the newest of them as
    the sensor sent it, and their interval. Everything up to ``watermark_s`` has been released.
    """

    limits: ClockLimits
    clock: ImuClock
    waiting: dict[str, SortedRows]
    held: dict[str, tuple[Array, float]]
    shift_s: dict[str, float]
    newest_s: dict[str, float]
    step_s: dict[str, float]
    watermark_s: float = -np.inf

    @classmethod
    def of(cls, tables: Iterable[str], limits: ClockLimits | None = None) -> ReorderBuffer:
        """Return an empty buffer of these tables."""
        limits, names = limits or ClockLimits(), tuple(tables)
        waiting = {name: SortedRows() for name in names}
        shift, newest, step = (dict.fromkeys(names, value) for value in (0.0, -np.inf, np.inf))
        return cls(limits, ImuClock(limits), waiting, {}, shift, newest, step)

    def push(self, batch: RowTables, report: LossReport) -> dict[str, Array]:
        """Take a batch in; return the rows that are complete now, by table, sorted, none twice."""
        new = {name: _finite(name, batch[name], report) for name in self.waiting if name in batch}
        if "imu" in new:
            self._wait("imu", self.clock.placed(new.pop("imu"), self.watermark_s, report), report)
        for name in self.waiting:
            if name in new or name in self.held:
                self._place(name, new.get(name), report)
        if self._fits_either_way:  # rows that are held for it would become too late
            return {}
        return self._released(max(self.watermark_s, self.clock.newest_s - self.limits.hold_s), report)

    @property
    def _fits_either_way(self) -> bool:
        """Return whether the clocks may have been set back by so little that no row is too late on either."""
        return self.clock.in_doubt_since(self.watermark_s)

    def finish(self, report: LossReport) -> dict[str, Array]:
        """Return all that is left at the end of the stream."""
        self._wait("imu", self.clock.finished(self.watermark_s, report), report)
        for name in list(self.held):
            self._place(name, None, report, last=True)
        return self._released(np.inf, report)

    def _place(self, name: str, rows: Array | None, report: LossReport, *, last: bool = False) -> None:
        """Let rows wait, refuse them or hold them, together with those that are held."""
        held, since = self.held.pop(name, (None, self.clock.newest_s))
        rows = np.concatenate([part for part in (held, rows) if part is not None])
        if last or not self._fits_either_way:
            rows = self._fitting(name, rows, report)
        if rows.shape[0] == 0:
            return
        if not last and self.clock.in_doubt:
            self._hold(name, rows, since, report)
            return
        t = rows[:, 0] + self.shift_s[name]
        behind = t <= self.watermark_s
        late = behind & (t > self.watermark_s - self.limits.ahead_s)
        report.lose("late", name, t[late], imu_s=self.clock.newest_s)
        report.lose("clock-jump", name, t[behind & ~late], imu_s=self.clock.newest_s)
        if last or self.clock.newest_s > since + self.limits.settle_s:
            report.lose("clock-jump", name, t[~behind], imu_s=since)
        elif not behind.all():
            self._hold(name, rows[~behind], since, report)

    def _fitting(self, name: str, rows: Array, report: LossReport) -> Array:
        """Let rows wait that fit; return the rest."""
        shift_s, other = self.shift_s[name], self.clock.shift_s
        turned = self._is_turned(name, rows[:, 0], shift_s, other)
        if not turned.any():
            return self._fits(name, rows, shift_s, report)
        first = int(np.argmax(turned))  # and all that came after it
        rest = self._fits(name, rows[:first], shift_s, report)
        self.shift_s[name], self.newest_s[name] = other, -np.inf
        t = float(rows[first, 0]) + other
        detail = f"as the IMU's; from here times are the sensor's plus {other:.6f} s"
        report.note(Event("clock-restart", name, t, t, 0, detail))
        return np.concatenate([rest, self._fits(name, rows[first:], other, report)])

    def _is_turned(self, name: str, t: Array, shift_s: float, other: float) -> np.ndarray:
        """Return which rows, at sensor's times ``t``, may be the first of a clock that was set as the IMU's was."""
        if shift_s == other:
            return np.zeros(t.size, dtype=bool)
        off, fits, would_fit = t - self.clock.newest_s, self._is_due(t + shift_s), self._is_due(t + other)
        turned: np.ndarray = would_fit & ~fits & (np.abs(off + other) < np.abs(off + shift_s))
        if 0.0 < other - shift_s <= self.limits.back_s:
            set_s, step_s = self.clock.set_s, self.step_s[name]
            newest = np.maximum.accumulate(np.concatenate([[self.newest_s[name]], t]))[:-1]
            goes_back, too_few = (t < newest) & (t <= set_s + step_s), (t > set_s) & (step_s > other - shift_s)
            turned |= would_fit & fits & (goes_back | too_few)
        return turned

    def _is_due(self, t: Array) -> np.ndarray:
        due: np.ndarray = (t > self.watermark_s) & (t <= self.clock.newest_s + self.limits.settle_s)
        return due

    def _fits(self, name: str, rows: Array, shift_s: float, report: LossReport) -> Array:
        t = rows[:, 0] + shift_s
        fits = self._is_due(t)
        self._wait(name, np.column_stack([t[fits], rows[fits, 1:]]), report)
        stamps = np.concatenate([[self.newest_s[name]], rows[fits, 0]])
        self.newest_s[name] = float(stamps.max())
        if len(stamps) > 1 and np.isfinite(stamps[0]):
            self.step_s[name] = median_interval(stamps)
        return np.asarray(rows[~fits])

    def _hold(self, name: str, rows: Array, since: float, report: LossReport) -> None:
        report.lose("buffer-full", name, rows[MOST_WAITING:, 0])
        self.held[name] = (rows[:MOST_WAITING], since)

    def _wait(self, name: str, rows: Array, report: LossReport) -> None:
        room = max(MOST_WAITING - len(self.waiting[name]), 0)
        report.lose("buffer-full", name, rows[room:, 0])
        self.waiting[name].add(rows[:room])

    def _released(self, watermark_s: float, report: LossReport) -> dict[str, Array]:
        self.watermark_s = watermark_s
        out = {}
        for name, waiting in self.waiting.items():
            ready, doubled = waiting.released(watermark_s)
            report.lose("duplicate", name, doubled)
            if ready is not None:
                out[name] = ready
        return out


@dataclass
class SortedRows:
    """The rows of one table that wait for the watermark, sorted by time, none twice: the first to arrive stays.

    ``new`` are rows that have not been sorted in.
    """

    rows: Array | None = None
    new: list[Array] = field(default_factory=list)

    def __len__(self) -> int:
        return sum(len(rows) for rows in self._all())

    def add(self, rows: Array) -> None:
        """Take rows in, in any order."""
        if rows.shape[0]:
            self.new.append(rows)

    def released(self, until_s: float) -> tuple[Array | None, Array]:
        """Return the rows up to ``until_s``, or None; and the times of rows that were there already."""
        doubled = self._sort() if self.new else np.empty(0)
        if self.rows is None:
            return None, doubled
        count = int(np.searchsorted(self.rows[:, 0], until_s, side="right"))
        if count == 0:
            return None, doubled
        ready, rest = self.rows[:count], self.rows[count:]
        self.rows = rest if rest.shape[0] else None
        return ready, doubled

    def _sort(self) -> Array:
        rows = np.concatenate(self._all())
        self.new = []
        steps = np.diff(rows[:, 0])
        if (steps > 0.0).all():
            self.rows = rows
            return np.empty(0)
        rows = rows[np.argsort(rows[:, 0], kind="stable")]
        again = np.concatenate([[False], np.diff(rows[:, 0]) == 0.0])
        self.rows = rows[~again]
        return np.asarray(rows[again, 0])

    def _all(self) -> list[Array]:
        return self.new if self.rows is None else [self.rows, *self.new]


def _finite(name: str, rows: Array, report: LossReport) -> Array:
    sound = (np.abs(rows) <= LARGEST).all(axis=1)
    if sound.all():
        return rows
    report.lose("not-finite", name, rows[~sound, 0])
    return rows[sound]

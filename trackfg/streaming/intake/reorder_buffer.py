"""Rows in the order in which they arrive, to rows in the order of time: a buffer with a watermark.

Each table comes nearly in order, with disorder and delay of its own. The IMU is the clock: what is up to

    watermark = newest time of the IMU - hold

is complete and is released, sorted; rows that come later than that are ``late``. A quiet table holds nothing up. Of
rows of one table with one time the first to arrive stays. Which rows of the IMU are the clock, and which stamps are
nonsense, :mod:`trackfg.streaming.intake.imu_clock` decides. Rows of other tables are placed by it:

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

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from trackfg.checks.columns import LARGEST
from trackfg.numerics.arrays import Array
from trackfg.numerics.spans import median_interval
from trackfg.streaming.checkpoint.json_numbers import finite_or, finite_or_none
from trackfg.streaming.events import LossReport, StreamEvent
from trackfg.streaming.intake.imu_clock import ClockLimits, ImuClock
from trackfg.streaming.intake.waiting_rows import SortedRows
from trackfg.streaming.rows import RowTables

MOST_WAITING = 500_000
"""Rows of one table; more are refused, so that a stream without an IMU does not fill the memory."""


class ReorderBuffer:
    """The buffer. Batches are tables by name, raw or canonical, the first column the time in s on one clock."""

    def __init__(self, tables: Iterable[str], limits: ClockLimits | None = None) -> None:
        self._limits = limits or ClockLimits()
        self._clock = ImuClock(self._limits)
        self._waiting = {name: SortedRows() for name in tables}
        self._held: dict[str, tuple[Array, float]] = {}
        self._shift_s = dict.fromkeys(self._waiting, 0.0)
        self._newest_s = dict.fromkeys(self._waiting, -np.inf)
        self._step_s = dict.fromkeys(self._waiting, np.inf)
        self.watermark_s = -np.inf
        """Everything up to here has been released."""

    def push(self, batch: RowTables, report: LossReport) -> dict[str, Array]:
        """Take a batch in; the rows that are complete now, by table, sorted, none twice."""
        new = {name: _finite(name, batch[name], report) for name in self._waiting if name in batch}
        if "imu" in new:
            self._wait("imu", self._clock.placed(new.pop("imu"), self.watermark_s, report), report)
        for name in self._waiting:
            if name in new or name in self._held:
                self._place(name, new.get(name), report)
        if self._fits_either_way:  # rows that are held for it would become too late
            return {}
        return self._released(max(self.watermark_s, self._clock.newest_s - self._limits.hold_s), report)

    @property
    def _fits_either_way(self) -> bool:
        """Whether the clocks may have been set back by so little that no row is too late on either."""
        return self._clock.in_doubt_since(self.watermark_s)

    def finish(self, report: LossReport) -> dict[str, Array]:
        """The stream is over: all that is left."""
        self._wait("imu", self._clock.finished(self.watermark_s, report), report)
        for name in list(self._held):
            self._place(name, None, report, last=True)
        return self._released(np.inf, report)

    def _place(self, name: str, rows: Array | None, report: LossReport, *, last: bool = False) -> None:
        """Let rows wait, refuse them or hold them, together with those that are held."""
        held, since = self._held.pop(name, (None, self._clock.newest_s))
        rows = np.concatenate([part for part in (held, rows) if part is not None])
        if last or not self._fits_either_way:
            rows = self._fitting(name, rows, report)
        if rows.shape[0] == 0:
            return
        if not last and self._clock.in_doubt:
            self._hold(name, rows, since, report)
            return
        t = rows[:, 0] + self._shift_s[name]
        behind = t <= self.watermark_s
        late = behind & (t > self.watermark_s - self._limits.ahead_s)
        report.lose("late", name, t[late])
        report.lose("clock-jump", name, t[behind & ~late])
        if last or self._clock.newest_s > since + self._limits.settle_s:
            report.lose("clock-jump", name, t[~behind])
        elif not behind.all():
            self._hold(name, rows[~behind], since, report)

    def _fitting(self, name: str, rows: Array, report: LossReport) -> Array:
        """Rows that fit go to the waiting ones; the rest comes back."""
        own, other = self._shift_s[name], self._clock.shift_s
        turned = self._is_turned(name, rows[:, 0], own, other)
        if not turned.any():
            return self._fits(name, rows, own, report)
        first = int(np.argmax(turned))  # and all that came after it
        rest = self._fits(name, rows[:first], own, report)
        self._shift_s[name], self._newest_s[name] = other, -np.inf
        t = float(rows[first, 0]) + other
        detail = f"as the IMU's; from here times are the sensor's plus {other:.6f} s"
        report.note(StreamEvent("clock-restart", name, t, t, 0, detail))
        return np.concatenate([rest, self._fits(name, rows[first:], other, report)])

    def _is_turned(self, name: str, t: Array, own: float, other: float) -> np.ndarray:
        """Which rows, of sensor's times ``t``, may be the first of a clock that was set as the IMU's was."""
        if own == other:
            return np.zeros(t.size, dtype=bool)
        off, fits, would_fit = t - self._clock.newest_s, self._is_due(t + own), self._is_due(t + other)
        turned: np.ndarray = would_fit & ~fits & (np.abs(off + other) < np.abs(off + own))
        if 0.0 < other - own <= self._limits.back_s:
            set_s, step_s = self._clock.set_s, self._step_s[name]
            before = np.maximum.accumulate(np.concatenate([[self._newest_s[name]], t]))[:-1]
            goes_back, too_few = (t < before) & (t <= set_s + step_s), (t > set_s) & (step_s > other - own)
            turned |= would_fit & fits & (goes_back | too_few)
        return turned

    def _is_due(self, t: Array) -> np.ndarray:
        due: np.ndarray = (t > self.watermark_s) & (t <= self._clock.newest_s + self._limits.settle_s)
        return due

    def _fits(self, name: str, rows: Array, shift_s: float, report: LossReport) -> Array:
        t = rows[:, 0] + shift_s
        fits = self._is_due(t)
        self._wait(name, np.column_stack([t[fits], rows[fits, 1:]]), report)
        stamps = np.concatenate([[self._newest_s[name]], rows[fits, 0]])
        self._newest_s[name] = float(stamps.max())
        if len(stamps) > 1 and np.isfinite(stamps[0]):
            self._step_s[name] = median_interval(stamps)
        return np.asarray(rows[~fits])

    def _hold(self, name: str, rows: Array, since: float, report: LossReport) -> None:
        report.lose("buffer-full", name, rows[MOST_WAITING:, 0])
        self._held[name] = (rows[:MOST_WAITING], since)

    def _wait(self, name: str, rows: Array, report: LossReport) -> None:
        room = max(MOST_WAITING - len(self._waiting[name]), 0)
        report.lose("buffer-full", name, rows[room:, 0])
        self._waiting[name].add(rows[:room])

    def _released(self, watermark_s: float, report: LossReport) -> dict[str, Array]:
        self.watermark_s = watermark_s
        out = {}
        for name, waiting in self._waiting.items():
            ready, doubled = waiting.released(watermark_s)
            report.lose("duplicate", name, doubled)
            if ready is not None:
                out[name] = ready
        return out

    def state(self) -> dict[str, Any]:
        """All of it, as JSON values."""
        return {
            "clock": self._clock.state(),
            "watermark_s": finite_or_none(self.watermark_s),
            "waiting": {name: waiting.to_list() for name, waiting in self._waiting.items()},
            "held": {name: [rows.tolist(), finite_or_none(since)] for name, (rows, since) in self._held.items()},
            "shift_s": self._shift_s,
            "newest_s": {name: finite_or_none(t) for name, t in self._newest_s.items()},
            "step_s": {name: finite_or_none(step) for name, step in self._step_s.items()},
        }

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on from a :meth:`state`."""
        self._clock.restore(state["clock"])
        self.watermark_s = finite_or(-np.inf, state["watermark_s"])
        for name, rows in state["waiting"].items():
            self._waiting[name] = SortedRows(np.array(rows, dtype=np.float64) if rows else None)
        self._held = {
            name: (np.array(rows, dtype=np.float64), finite_or(-np.inf, since))
            for name, (rows, since) in state["held"].items()
        }
        self._shift_s = dict(state["shift_s"])
        self._newest_s = {name: finite_or(-np.inf, t) for name, t in state["newest_s"].items()}
        self._step_s = {name: finite_or(np.inf, step) for name, step in state["step_s"].items()}


def _finite(name: str, rows: Array, report: LossReport) -> Array:
    sound = (np.abs(rows) <= LARGEST).all(axis=1)
    if sound.all():
        return rows
    report.lose("not-finite", name, rows[~sound, 0])
    return rows[sound]

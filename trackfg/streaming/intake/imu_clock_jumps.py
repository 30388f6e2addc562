"""The IMU's clock alone was set ahead, or rows of it are missing: the tach shows which, once the vehicle accelerates.

Without a tach, speeds over ground show it, and the way between positions, where these are good to centimetres.

Where all clocks were set, :mod:`trackfg.streaming.intake.clock_jumps` finds it out at once. Where the IMU's alone was,
its stamps have a hole like that of missing rows, and the rows of all other tables are late from then on. As in a batch
(:mod:`trackfg.checks.clock_change`) the offset between the accelerations that IMU and tach show is compared on either
side of the hole: over a gap it stays the same, and it changes by as much as the clock was set. The rows that follow
are looked at every ``LOOK_S``, until they show it, there are ``SIDE_S`` of them, or another hole comes.

For that, rows are averaged over cells of ``CELL_S``, some seconds of them at a time. How they are grouped in batches
makes no difference.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import pandas as pd

from trackfg.checks.clock_change import LEAST_S, SIDE_S, offset_before, was_set
from trackfg.checks.diagnosis_clock import ClockOffset
from trackfg.numerics.arrays import Array
from trackfg.numerics.integrals import trapezoid_integral
from trackfg.numerics.spans import median_interval
from trackfg.recording.description import RecordingDescription
from trackfg.recording.model import IMU_COLUMNS, TACH_COLUMNS
from trackfg.results.events import Event, doubt_event
from trackfg.streaming.growable_array import GrowableArray
from trackfg.streaming.rows import Rows, described_tables, moved_earlier, no_rows

CELL_S = 0.05
"""Length of a cell, s: an eighth of the shortest average of accelerations that are compared."""
LOOK_S = 30.0
"""Time between looks at the rows after a hole, s: three stretches of accelerations that are independent of each
other."""
_TOGETHER_S = 5.0
"""Rows of so long are averaged together, s: batches of a live feed are a fiftieth of it."""
_NEWEST = 10
"""The sampling interval is that of so many samples."""
_MARGIN_S = 4.0
"""Rows of the other table so much before those of the IMU are used, s."""
_SOURCES = {
    "tach": "the tachometer",
    "gnss_speed": "the receiver's speeds",
    "speed/1": "the speed sensor",
    "gnss": "the receiver's positions",
}
"""Tables whose clock the IMU's is compared with, and what they are called; the first that there is."""
_QUANTITIES = (
    *("chainage", "position", "speed", "roll", "pitch"),
    *("cross_level", "twist", "level", "alignment", "gradient", "curvature"),
)
"""All that follow from the motion over time."""
_ADVICE = "set its stamps back from there on, or smooth the recording, which sets them back"


class Hole(NamedTuple):
    """A hole in the stamps of the IMU after ``begin_s``, s, on its clock before it: ``by_s`` is missing, or its clock
    was set by that. ``before``: the offset of the clocks before; ``look_s``: the time of the next look.
    """

    begin_s: float
    by_s: float
    before: ClockOffset
    look_s: float


@dataclass
class ImuClockJumps:
    """Keeps averages of the last minutes. Times of the IMU are less ``ahead_s``, by which its clock was set in all.

    ``source``: the table that they are compared with, and ``other`` its first row in each cell. ``waiting``: rows of
    both that wait for more; ``samples``: means of the IMU since the last hole, as rows of the table; ``cell``: the rows
    of the cell that is not complete; ``newest``: the times of the newest samples, as they came. ``hole``: the one that
    is looked into.
    """

    source: str
    other: GrowableArray
    waiting: list[tuple[Array, Array]] = field(default_factory=list)
    samples: GrowableArray = field(default_factory=lambda: GrowableArray(no_rows("imu")))
    cell: Array = field(default_factory=lambda: no_rows("imu"))
    newest: Array = field(default_factory=lambda: np.empty(0))
    hole: Hole | None = None
    ahead_s: float = 0.0

    @classmethod
    def of(cls, description: RecordingDescription) -> ImuClockJumps | None:
        """Return the stage before the first row; None where no table has a clock that it can compare."""
        source = next((name for name in _SOURCES if name in described_tables(description)), None)
        return None if source is None else cls(source, GrowableArray(no_rows(source)))

    def take(self, rows: Rows, *, last: bool = False) -> tuple[Event, ...]:
        """Take the next rows; return an event for each jump that they show. ``last``: no others come."""
        self.waiting.append((rows.imu, rows.tables().get(self.source, self.other.rows[:0])))
        since_s = self.newest[-1] if len(self.newest) else -np.inf
        if not last and not (len(rows.imu) and rows.imu[-1, 0] > since_s + _TOGETHER_S):
            return ()
        imu, other = map(np.concatenate, zip(*self.waiting, strict=True))
        self.waiting = []
        return tuple(self._compare(imu, other, last=last))

    def _compare(self, imu: Array, other: Array, *, last: bool) -> list[Event]:
        """Compare the tables where a hole comes and where it is time to."""
        self._keep_other(other)
        events: list[Event] = []
        t = imu[:, 0]
        steps = np.diff(t, prepend=self.newest[-1:] if len(self.newest) else t[:1])
        first = 0
        for i in np.flatnonzero(steps > LEAST_S).tolist():
            events += self._extend(imu[first:i])
            events += self._begin_after(float(steps[i]))
            first = i
        events += self._extend(imu[first:])
        if last:
            events += self._look(np.inf)
        self._forget()
        return events

    def _keep_other(self, rows: Array) -> None:
        if len(rows):
            newest = float(_cell(self.other.rows[-1, 0])) if len(self.other.rows) else -np.inf
            self.other.append(rows[np.diff(_cell(rows[:, 0]), prepend=newest) != 0.0])

    def _extend(self, rows: Array) -> list[Event]:
        """Take samples that follow each other; look into the hole before them where it is time to."""
        if not len(rows):
            return []
        self.newest = np.concatenate([self.newest, rows[:, 0]])[-_NEWEST:]
        rows = np.concatenate([self.cell, moved_earlier(rows, self.ahead_s)])
        first = np.flatnonzero(np.diff(_cell(rows[:, 0]), prepend=-np.inf))
        if len(first) > 1:
            sums = np.add.reduceat(rows[: first[-1]], first[:-1], axis=0)
            self.samples.append(sums / np.diff(first)[:, None])
        self.cell = rows[first[-1] :].copy()
        events: list[Event] = []
        while self.hole is not None and self.cell[0, 0] >= self.hole.look_s:
            events += self._look(self.hole.look_s)
        return events

    def _begin_after(self, step_s: float) -> list[Event]:
        """Begin anew after the newest sample, which a hole follows: the next one is ``step_s`` later."""
        by_s = step_s - (median_interval(self.newest) if len(self.newest) > 1 else 0.0)
        if by_s <= LEAST_S:
            return []
        events = self._look(np.inf)
        begin_s = float(self.newest[-1]) - self.ahead_s
        offset = offset_before(*self._tables(begin_s - SIDE_S, begin_s))
        self.hole = None if offset is None else Hole(begin_s, by_s, offset, begin_s + step_s + LOOK_S)
        self.samples, self.cell = GrowableArray(no_rows("imu")), no_rows("imu")
        return events

    def _look(self, until_s: float) -> list[Event]:
        """Look whether the rows up to ``until_s``, s, show that the clock was set over the hole."""
        if self.hole is None:
            return []
        hole, until_s = self.hole, min(until_s, float(self.newest[-1]) - self.ahead_s)
        is_jump = was_set(*self._tables(hole.begin_s, until_s), hole.before, hole.by_s)
        is_last = until_s >= hole.begin_s + hole.by_s + SIDE_S
        self.hole = None if is_jump or is_last else hole._replace(look_s=hole.look_s + LOOK_S)
        if not is_jump:
            return []
        begin_s, until_s = hole.begin_s + self.ahead_s, until_s + self.ahead_s
        self.ahead_s += hole.by_s
        self.samples.rows[:, 0] -= hole.by_s
        self.cell[:, 0] -= hole.by_s
        reason = f"the IMU's clock jumped ahead by {hole.by_s:.2f} s against that of {_SOURCES[self.source]}"
        return [doubt_event(_QUANTITIES, reason, _ADVICE, table="imu", t_s=begin_s, until_s=until_s)]

    def _tables(self, begin_s: float, until_s: float) -> tuple[pd.DataFrame, pd.DataFrame]:
        """Return the rows of the IMU between two times, s, and what the other table makes those of a tach."""
        samples, other = self.samples.rows, self.other.rows
        samples = samples[(samples[:, 0] > begin_s) & (_cell(samples[:, 0]) < _cell(np.array(until_s)))]
        other = other[(other[:, 0] > begin_s - _MARGIN_S) & (other[:, 0] <= until_s)]
        way = np.column_stack([other[:, 0], _distance(self.source, other)])
        return pd.DataFrame(samples, columns=list(IMU_COLUMNS)), pd.DataFrame(way, columns=list(TACH_COLUMNS))

    def _forget(self) -> None:
        """Drop what is older than needed, now and then."""
        now_s = float(self.newest[-1]) - self.ahead_s if len(self.newest) else -np.inf
        since_s = now_s - SIDE_S if self.hole is None else self.hole.begin_s
        self.samples = _since(self.samples, since_s)
        self.other = _since(self.other, since_s - _MARGIN_S)


def _distance(source: str, rows: Array) -> Array:
    """Return the way up to each of the rows of a table, m."""
    if source == "tach":
        return np.asarray(rows[:, 1])
    if source == "gnss":
        return np.cumsum(np.hypot(*np.diff(rows[:, 1:3], axis=0, prepend=rows[:1, 1:3]).T))
    return trapezoid_integral(rows[:, 0], rows[:, 1])


def _cell(t: Array) -> Array:
    """Return the number of the cell in which times are."""
    return np.asarray(np.floor(t / CELL_S))


def _since(table: GrowableArray, since_s: float) -> GrowableArray:
    """Return a table without rows before ``since_s``, s, once there is as much of these as is kept."""
    rows = table.rows
    if not len(rows) or rows[0, 0] > since_s - SIDE_S:
        return table
    return GrowableArray(rows[np.searchsorted(rows[:, 0], since_s) :])

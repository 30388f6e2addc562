"""Clock jumps are taken out of the stream's times: clocks that were set while the vehicle went on.

Where the stamps of all tables jump ahead together, either nothing was recorded for a time, or the clocks were set. The
tach's count c shows. With the speeds v before and after, in m of the count a second, and Dt between the readings on
either side of a jump by L, it has grown by

    dc = v Dt          rows are missing: the vehicle went on for as long as the stamps say (a gap)
    dc = v (Dt - L)    none are: the clocks were set

With the mean of both speeds the second holds to ``FREE_S`` of rolling and the scatter of the count, whatever the
wheel's scale. A count between both is a gap: the vehicle may have braked. At rest, or without a count, the two cannot
be distinguished, and at rest it hardly matters.

A clock that went back, or too far ahead for a gap, was set, or a device was off for an unknown time
(:mod:`trackfg.streaming.intake.imu_clock`): its ``clock-restart`` is a break in the motion. There the same is tested
with L = 0, because times are contiguous already; if the vehicle stood before and after, the test is whether the count
is the same and gravity has the same direction.

Where a clock was set, times of the stream go on one sampling interval after the last row before, and nothing breaks.
All tables must have jumped: where one has rows within the jump, time went on. So it did where rows are known to be
missing (``missed_s``), whatever the count says. Rows after a jump wait for the next
``LOOK_S`` of rows, however these are grouped in batches; a gap mostly shows at once.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from trackfg.numerics.arrays import Array
from trackfg.numerics.spans import median_interval
from trackfg.recording.description import RecordingDescription
from trackfg.results.events import Event
from trackfg.sensors.imu_intervals import hole_s
from trackfg.streaming.rows import Rows, joined_tables

LOOK_S = 1.0
"""The speeds are means over so much of the count before and after a jump, s."""
FREE_S = 0.1
"""A recorder that is interrupted while its clock is set may miss so much, s."""
_APART_S = 0.2
"""The clock of a table may be so far from the IMU's, s."""
_SHARE = 0.3
"""The same as a share of the jump, where that is less."""
_SIGMAS = 4.0
"""Agreement, in sigmas of the scatter."""
_FASTER_MPS2 = 3.0
"""No rail vehicle changes its speed faster, m/s^2, so that a faster one is a gap."""
_LEAST_ROWS = 3
"""Rows on either side of a jump that make a line and its scatter."""
_TILT = 1e-3
"""Change of the direction of gravity, rad, beyond which a vehicle at rest was moved to other track."""
_FIRST_SAMPLES = 10
"""The sampling interval is the median over so many samples."""
_MOST_KEPT = 100
"""Older resets and shifts are forgotten: events concern the last minutes."""

_SAME_S = 1e-6
"""Times that are nearer are the same, s: a sum of shifts is rounded."""

_INTERRUPTIONS = ("gap", "clock-restart")
"""Kinds of events of the IMU that wait until a jump is explained."""


class Jump(NamedTuple):
    """A jump from the last row of the IMU before to the first one after, s; by how much the clock went ahead, s; and
    whether it restarted.
    """

    begin_s: float
    end_s: float
    by_s: float
    restart: bool = False

    @property
    def middle_s(self) -> float:
        """Rows up to this time are before the jump, s."""
        return 0.5 * (self.begin_s + self.end_s)

    def is_of(self, event: Event) -> bool:
        """Return whether this is the event of the jump."""
        return event.t_s is not None and abs(event.t_s - self.begin_s) < _SAME_S


@dataclass
class ClockJumps:
    """Takes jumps of clocks out of the times of sound, sorted rows; events get the times of the stream, too.

    ``counts``: whether the tach is a counter, which can show a jump. ``interval_s``: sampling interval of the IMU, None
    until it is known. ``waiting``: rows after a jump that more rows must explain; ``recent``: rows before one.
    ``looked_s``: jumps up to here have been explained. ``interruptions``: events that wait for that; ``resets``: those
    of the tach. ``shifts``: since when on the sensors' clock which sum was taken off; ``shift_s``: the newest sum.
    ``missed_s``: the newest time of the IMU, on the sensors' clock, when rows began to be missing.
    """

    counts: bool
    interval_s: float | None = None
    waiting: dict[str, Array] = field(default_factory=dict)
    recent: dict[str, list[Array]] = field(default_factory=lambda: {"imu": [], "tach": []})
    last_s: dict[str, float] = field(default_factory=dict)
    looked_s: float = -np.inf
    interruptions: list[Event] = field(default_factory=list)
    resets: list[Event] = field(default_factory=list)
    shifts: list[tuple[float, float]] = field(default_factory=list)
    shift_s: float = 0.0
    missed_s: float = np.nan

    @classmethod
    def of(cls, description: RecordingDescription) -> ClockJumps:
        """Return the stage before the first row."""
        return cls(description.tach is not None and not description.tach.integrates_speed)

    def without_jumps(
        self, rows: Rows, events: Iterable[Event], *, last: bool = False
    ) -> tuple[Rows, tuple[Event, ...]]:
        """Return the rows that are explained, with times of the stream, and events. ``last``: no others come."""
        events_now = [event for event in map(self._on_stream_clock, events) if not self._must_wait(event)]
        if self.interval_s is None and self.counts:
            self._learn(rows.imu)
        if not self.waiting and not self.interruptions and not self._has_hole(rows.imu[:, 0] - self.shift_s):
            tables = self._shifted(rows)
            self._remember(tables)
            return (rows if self.shift_s == 0.0 else self._rows(rows, tables, rows.until_s)), tuple(events_now)
        tables = self._shifted(rows)
        if self.waiting:
            tables = joined_tables([self.waiting, tables])
            self.waiting = {}
        parts, until_s = [], rows.until_s
        while (jump := self._next(tables["imu"][:, 0])) is not None:
            was_set = self._clock_was_set(jump, tables, until_s - self.shift_s, last=last)
            earlier, tables = _split(tables, jump.middle_s)
            self._remember(earlier)
            parts.append(earlier)
            if was_set is None:
                self.waiting, until_s = tables, jump.begin_s + self.shift_s
                break
            self.looked_s = jump.end_s - jump.by_s if was_set else jump.end_s
            events_now += self._explained(jump, was_set=was_set)
            if was_set and jump.by_s:
                self._shift_times(jump)
                tables = {name: _earlier(table, jump.by_s) for name, table in tables.items()}
        else:
            self._remember(tables)
            parts.append(tables)
            reached = np.inf if last else self.last_s.get("imu", -np.inf)
            events_now += [event for event in self.interruptions if _end(event) <= reached]
            self.interruptions = [event for event in self.interruptions if _end(event) > reached]
        return self._rows(rows, joined_tables(parts), until_s), tuple(events_now)

    def _rows(self, rows: Rows, tables: Mapping[str, Array], until_s: float) -> Rows:
        return Rows.of(tables, until_s - self.shift_s, rows.gnss_origin)

    def _shifted(self, rows: Rows) -> dict[str, Array]:
        tables = rows.tables()
        return {name: _earlier(table, self.shift_s) for name, table in tables.items()} if self.shift_s else tables

    def _on_stream_clock(self, event: Event) -> Event:
        """Return an event of an earlier stage with times of the stream."""
        if not self.shifts:
            return event
        if event.kind == "clock-restart":
            event = replace(event, detail=f"{event.detail}, less {self.shift_s:.6f} s")
        return replace(event, t_s=self._stream_time(event.t_s), until_s=self._stream_time(event.until_s))

    def _stream_time(self, t: float | None) -> float | None:
        return None if t is None else t - next((total for since, total in self.shifts[::-1] if t > since), 0.0)

    def _must_wait(self, event: Event) -> bool:
        """Return whether an event waits until a jump is explained."""
        if event.kind == "tach-reset":
            self.resets = [*self.resets, event][-_MOST_KEPT:]
        if not self.counts or event.kind not in _INTERRUPTIONS or event.table != "imu":
            return False
        self.interruptions.append(event)
        return True

    def _remember(self, tables: Mapping[str, Array]) -> None:
        """Keep rows before a jump that may come."""
        for name, table in tables.items():
            if len(table):
                self.last_s[name] = float(table[-1, 0])
        if not self.counts:
            return
        for name, recent in self.recent.items():
            if len(tables[name]):
                recent.append(tables[name])
            while len(recent) > 1 and recent[0][-1, 0] < self.last_s[name] - 2.0 * LOOK_S:
                del recent[0]

    def _learn(self, imu: Array) -> None:
        """Learn the sampling interval from the first rows: a jump between these cannot be recognised."""
        t = np.concatenate([*self.recent["imu"], imu])[:_FIRST_SAMPLES, 0]
        if t.size == _FIRST_SAMPLES:
            self.interval_s, self.looked_s = median_interval(t), float(t[-1])

    def _has_hole(self, imu: Array) -> bool:
        if self.interval_s is None or not imu.size:
            return False
        longest = (imu[1:] - imu[:-1]).max(initial=imu[0] - self.last_s.get("imu", imu[0]))
        return bool(longest > self._hole_s)

    @property
    def _hole_s(self) -> float:
        """The distance of samples that makes a hole, s."""
        return float(hole_s(np.asarray(self.interval_s or 0.0)))

    def _next(self, imu: Array) -> Jump | None:
        """Return the first jump that the rows reach and that has not been explained."""
        if self.interval_s is None or not imu.size:
            return None
        jumps = [
            Jump(float(event.t_s or 0.0), _end(event), 0.0, restart=True)
            for event in self.interruptions
            if event.kind == "clock-restart" and self.looked_s < _end(event) <= imu[-1] + 0.5 * self.interval_s
        ]
        t = np.concatenate([[self.last_s.get("imu", imu[0])], imu])
        holes = np.flatnonzero((t[1:] - t[:-1] > self._hole_s) & (t[1:] > self.looked_s))
        for begin, end in zip(t[holes[:1]].tolist(), t[holes[:1] + 1].tolist(), strict=True):
            jumps.append(Jump(begin, end, end - begin - self.interval_s))
        return min(jumps, default=None)

    def _clock_was_set(self, jump: Jump, tables: Mapping[str, Array], until_s: float, *, last: bool) -> bool | None:
        """Return whether the clock was set; None while more rows are needed."""
        is_missed = abs(jump.begin_s + self.shift_s - self.missed_s) < _SAME_S
        if not self.counts or is_missed or not self._all_jump(jump, tables):
            return False
        tach = np.concatenate([*self.recent["tach"], tables["tach"]])
        until = jump.end_s + LOOK_S
        tach = tach[(tach[:, 0] > jump.begin_s - LOOK_S) & (tach[:, 0] <= until)]
        first = int(np.searchsorted(tach[:, 0], jump.middle_s, side="right"))
        earlier, later = tach[:first], tach[first:]
        if len(earlier) < _LEAST_ROWS or not _goes_on(earlier, jump.begin_s):
            return False
        if not jump.restart and _is_gap(earlier, later[:1], jump):
            return False
        if not last and until_s < until:
            return None
        if len(later) < _LEAST_ROWS or not _goes_on(later[::-1], jump.end_s):
            return False
        if any(_end(event) >= earlier[0, 0] and (event.t_s or 0.0) <= later[-1, 0] for event in self.resets):
            return False
        if jump.restart and not np.ptp(tach[:, 1]):
            return self._stands_as_it_did(jump, tables)
        return _rolled_on(earlier, later, jump)

    def _all_jump(self, jump: Jump, tables: Mapping[str, Array]) -> bool:
        """Return whether no table has rows within the jump, and all stay in order without it."""
        apart = min(_APART_S, _SHARE * jump.by_s)
        for name, table in tables.items():
            if name == "imu" or not len(table):
                continue
            t = table[:, 0]
            if not jump.restart and ((t > jump.begin_s + apart) & (t < jump.end_s - apart)).any():
                return False
            i = int(np.searchsorted(t, jump.middle_s, side="right"))
            newest = t[i - 1] if i else self.last_s.get(name, -np.inf)
            if i < len(t) and t[i] - jump.by_s <= newest:
                return False
        return True

    def _stands_as_it_did(self, jump: Jump, tables: Mapping[str, Array]) -> bool:
        imu = np.concatenate([*self.recent["imu"], tables["imu"]])
        t = imu[:, 0]
        earlier = imu[(t > jump.begin_s - LOOK_S) & (t <= jump.middle_s), 4:7]
        later = imu[(t > jump.middle_s) & (t <= jump.end_s + LOOK_S), 4:7]
        if min(len(earlier), len(later)) < _LEAST_ROWS:
            return False
        noise = np.sqrt(earlier.var(axis=0) / len(earlier) + later.var(axis=0) / len(later))
        turned = np.abs(later.mean(axis=0) - earlier.mean(axis=0))
        return bool((turned <= _TILT * np.linalg.norm(earlier.mean(axis=0)) + _SIGMAS * noise).all())

    def _explained(self, jump: Jump, *, was_set: bool) -> list[Event]:
        """Return the events that waited for this jump; where a clock was set, ``clock-set`` replaces its own."""
        due = [event for event in self.interruptions if _end(event) <= jump.end_s + _SAME_S]
        self.interruptions = [event for event in self.interruptions if _end(event) > jump.end_s + _SAME_S]
        if not was_set:
            return due
        assert self.interval_s is not None
        of_it = [event for event in due if jump.is_of(event)]
        jumped = f"the clocks went forward by {jump.by_s:.3f} s; as much is taken off all times from here on"
        if jump.restart:
            jumped = of_it[0].detail
        detail = f"{jumped}. The count went on as if no time had passed"
        next_s = jump.begin_s + self.interval_s
        return [
            *(event for event in due if event not in of_it),
            Event("clock-set", "imu", jump.begin_s, next_s, 0, detail),
        ]

    def _shift_times(self, jump: Jump) -> None:
        since = jump.middle_s + self.shift_s
        self.shift_s += jump.by_s
        self.shifts = [*self.shifts, (since, self.shift_s)][-_MOST_KEPT:]


def _goes_on(rows: Array, until: float) -> bool:
    """Return whether rows come as often as before up to a time."""
    return bool(abs(until - rows[-1, 0]) <= 3.0 * np.abs(np.diff(rows[:, 0])).max() + _APART_S)


def _line(rows: Array) -> tuple[float, float, float]:
    """Return rate, middle time and scatter of the straight line through counts (n, 2)."""
    t, count = rows.T - rows.mean(axis=0)[:, None]
    rate = float(t @ count / (t @ t))
    return rate, float(rows[:, 0].mean()), float(np.std(count - rate * t))


def _is_gap(earlier: Array, first: Array, jump: Jump) -> bool:
    """Return whether the first reading after has gone on by half the jump or more; True at rest, where it cannot."""
    rate = _line(earlier)[0]
    if rate == 0.0:
        return True
    seconds, counted = (first - earlier[-1:]).T
    return bool((counted / rate > seconds - 0.5 * jump.by_s).any())


def _rolled_on(earlier: Array, later: Array, jump: Jump) -> bool:
    """Return whether the count went on as if no time had passed, and could not have done so in that time."""
    (slow, t0, scatter), (fast, t1, scatter1) = _line(earlier), _line(later)
    speed = 0.5 * (slow + fast)
    if slow * fast <= 0.0 or abs(fast - slow) > _FASTER_MPS2 * (t1 - t0 - jump.by_s):
        return False
    free = FREE_S if jump.restart else min(FREE_S, _SHARE * jump.by_s)
    allowed = free * abs(speed) + _SIGMAS * max(scatter, scatter1)
    if not jump.restart and abs(speed) * jump.by_s < 2.0 * allowed:
        return False
    seconds, counted = later[0] - earlier[-1]
    return bool(abs(counted - speed * (seconds - jump.by_s)) <= allowed)


def _split(tables: Mapping[str, Array], at_s: float) -> tuple[dict[str, Array], dict[str, Array]]:
    first = {name: int(np.searchsorted(table[:, 0], at_s, side="right")) for name, table in tables.items()}
    return (
        {name: table[: first[name]] for name, table in tables.items()},
        {name: table[first[name] :] for name, table in tables.items()},
    )


def _earlier(table: Array, by_s: float) -> Array:
    return np.column_stack([table[:, 0] - by_s, table[:, 1:]]) if len(table) else table


def _end(event: Event) -> float:
    return -np.inf if event.until_s is None else event.until_s

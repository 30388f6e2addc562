"""Clock jumps are taken out of the stream's times: clocks that were set while the vehicle went on.

Where the stamps of all tables jump ahead together, either nothing was recorded for a time, or the clocks were set: the
tach's count shows which (:mod:`trackfg.streaming.intake.jump_evidence`). All tables must have jumped: where one has
rows within the jump, time went on. So it did where rows are known to be missing (``missed_s``), whatever the count
says. Rows after a jump wait for the next ``LOOK_S`` of rows, however these are grouped in batches; a gap mostly shows
at once.

A clock that went back, or too far ahead for a gap, was set, or a device was off for an unknown time
(:mod:`trackfg.streaming.intake.imu_clock`): its ``clock-restart`` is a break in the motion, for which the same is
tested. Where a clock was set, times of the stream go on one sampling interval after the last row before, and nothing
breaks.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from trackfg.numerics.arrays import Array
from trackfg.recording.description import RecordingDescription
from trackfg.results.events import Event
from trackfg.sensors.imu_intervals import hole_s
from trackfg.sensors.sampling_rate import FIRST_SAMPLES, first_interval
from trackfg.streaming.intake.jump_evidence import (
    LOOK_S,
    CountAround,
    Jump,
    end_of,
    stands_as_it_did,
)
from trackfg.streaming.rows import SAME_S, Rows, joined_tables, moved_earlier

_MOST_KEPT = 100
"""Older resets and shifts are forgotten: events concern the last minutes."""

_INTERRUPTIONS = ("gap", "clock-restart")
"""Kinds of events of the IMU that wait until a jump is explained."""


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
                tables = {name: moved_earlier(table, jump.by_s) for name, table in tables.items()}
        else:
            self._remember(tables)
            parts.append(tables)
            reached = np.inf if last else self.last_s.get("imu", -np.inf)
            events_now += [event for event in self.interruptions if end_of(event) <= reached]
            self.interruptions = [event for event in self.interruptions if end_of(event) > reached]
        return self._rows(rows, joined_tables(parts), until_s), tuple(events_now)

    def _rows(self, rows: Rows, tables: Mapping[str, Array], until_s: float) -> Rows:
        return Rows.of(tables, until_s - self.shift_s, rows.gnss_origin)

    def _shifted(self, rows: Rows) -> dict[str, Array]:
        tables = rows.tables()
        return {name: moved_earlier(table, self.shift_s) for name, table in tables.items()} if self.shift_s else tables

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
        t = np.concatenate([*self.recent["imu"], imu])[:FIRST_SAMPLES, 0]
        if (interval_s := first_interval(t)) is not None:
            self.interval_s, self.looked_s = interval_s, float(t[-1])

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
            Jump(float(event.t_s or 0.0), end_of(event), 0.0, restart=True)
            for event in self.interruptions
            if event.kind == "clock-restart" and self.looked_s < end_of(event) <= imu[-1] + 0.5 * self.interval_s
        ]
        t = np.concatenate([[self.last_s.get("imu", imu[0])], imu])
        holes = np.flatnonzero((t[1:] - t[:-1] > self._hole_s) & (t[1:] > self.looked_s))
        for begin, end in zip(t[holes[:1]].tolist(), t[holes[:1] + 1].tolist(), strict=True):
            jumps.append(Jump(begin, end, end - begin - self.interval_s))
        return min(jumps, default=None)

    def _clock_was_set(self, jump: Jump, tables: Mapping[str, Array], until_s: float, *, last: bool) -> bool | None:
        """Return whether the clock was set; None while more rows are needed."""
        is_missed = abs(jump.begin_s + self.shift_s - self.missed_s) < SAME_S
        if not self.counts or is_missed or not jump.is_of_all(tables, self.last_s):
            return False
        count = CountAround.of(jump, np.concatenate([*self.recent["tach"], tables["tach"]]))
        if not count.reaches_jump or (not jump.restart and count.shows_gap):
            return False
        if not last and until_s < jump.end_s + LOOK_S:
            return None
        if not count.leaves_jump or count.is_reset(self.resets):
            return False
        if jump.restart and count.stands:
            return stands_as_it_did(jump, np.concatenate([*self.recent["imu"], tables["imu"]]))
        return count.rolled_on

    def _explained(self, jump: Jump, *, was_set: bool) -> list[Event]:
        """Return the events that waited for this jump; where a clock was set, ``clock-set`` replaces its own."""
        due = [event for event in self.interruptions if end_of(event) <= jump.end_s + SAME_S]
        self.interruptions = [event for event in self.interruptions if end_of(event) > jump.end_s + SAME_S]
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


def _split(tables: Mapping[str, Array], at_s: float) -> tuple[dict[str, Array], dict[str, Array]]:
    first = {name: int(np.searchsorted(table[:, 0], at_s, side="right")) for name, table in tables.items()}
    return (
        {name: table[: first[name]] for name, table in tables.items()},
        {name: table[first[name] :] for name, table in tables.items()},
    )

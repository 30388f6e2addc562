"""Stream events: what happened on a stream, and the report of rows that were not passed on.

Every row that is not passed on is counted in exactly one event. Rows of one kind and table that come in short
succession are one event: it closes when ``QUIET_PUSHES`` batches have passed without another, or after
``LONGEST_PUSHES``. Batches are counted, not seconds, so that the same batches give the same events. Of rows that could
not even be read the first is an event at once, and those of the same fault that follow it are another.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import pandas as pd

from trackfg.numerics.arrays import Array
from trackfg.results.events import Event, events_frame

QUIET_PUSHES, LONGEST_PUSHES = 10, 100
"""Batches: at ten a second an event is out a second after its last row, and within ten seconds of its first."""

CHANCE_OF_DOUBT = 1e-3
"""Probability of residuals by chance below which a stream doubts its sigmas; it looks for doubts again and again."""

LOSS_KINDS = {
    "not-finite": "NaN, infinite or above 1e12",
    "duplicate": "the time of another row of the table again",
    "late": "came after the stream had passed their time; a longer hold keeps them",
    "clock-jump": "times that neither fit the clock nor made a new one",
    "buffer-full": "more rows than are kept waiting for the IMU",
    "bad-sigma": "a sigma that is zero, negative or below 1e-9 m",
    "position-range": "no such position on the Earth",
    "tach-jump": "the tach runs faster than 170 m/s, or backwards although it is declared unsigned",
    "speed-jump": "a speed over ground above 170 m/s, or below zero although it has no sign",
    "silent": "below the lowest speed that the sensor measures",
    "stuck-channel": "shows one value again and again: stuck, or at the end of its range",
    "contradicted": "speeds that the receiver's positions, or the tach, contradict, as those in another unit",
    "held": "the values of a row before again: the table is written faster than the sensor measures",
    "impossible-value": "beyond what the sensor of a rail vehicle shows, or far beyond all before",
    "interpolated": "all six channels lie on straight lines: holes were filled by interpolation",
}
"""Kinds of events that count rows which were not passed on, and what each means."""


_BREAKS = (("clock-restart", "imu"), ("tach-reset", "tach"))


def event_table(events: Iterable[Event]) -> pd.DataFrame:
    """Return a table of one row per event, columns as :class:`~trackfg.results.events.Event`, but ``input`` for
    ``table``; NaN for what is not known.
    """
    return events_frame(events).rename(columns={"table": "input"})


def motion_breaks(events: Iterable[Event]) -> dict[str, Array]:
    """Return spans (b, 2), s, over which the motion is unknown, by table: a device that was off while its clock was set
    back (``imu``), a counter that began again and did not count (``tach``).
    """
    spans: dict[str, list[tuple[float, float]]] = {}
    for event in events:
        if (event.kind, event.table) in _BREAKS and event.t_s is not None and event.until_s is not None:
            spans.setdefault(event.table, []).append((event.t_s, event.until_s))
    return {table: np.array(rows) for table, rows in spans.items()}


@dataclass(frozen=True)
class UnreadableRows(Event):
    """Rows that could not be read, and why: ``fault`` is what they have in common, ``first`` says what is wrong with
    the first, and ``last`` is the place of the last.
    """

    fault: str = ""
    first: str = ""
    last: str = ""

    @classmethod
    def of(cls, kind: str, rows: int, fault: str, first: str, last: str) -> UnreadableRows:
        """Return the event, with its sentence."""
        detail = f"{first} ({rows} such, the last is {last})" if rows > 1 else first
        return cls(kind, rows=rows, detail=detail, fault=fault, first=first, last=last)

    def joined(self, later: UnreadableRows) -> UnreadableRows:
        """Return the event of these rows and later ones."""
        return self.of(self.kind, self.rows + later.rows, self.fault, self.first, later.last)


@dataclass
class _Open:
    event: Event
    pushes: int = 0
    quiet: int = 0
    columns: tuple[str, ...] = ()
    ahead_s: tuple[float, float] | None = None
    """The least and the most that rows were ahead of the IMU, s; behind it, negative."""

    def ends(self) -> bool:
        """Count a batch; return whether no more rows are added."""
        self.pushes += 1
        self.quiet += 1
        return self.quiet > QUIET_PUSHES or self.pushes >= LONGEST_PUSHES


@dataclass
class _Unreadable(_Open):
    rows: UnreadableRows | None = None
    """Those after the first, which were reported at once."""


@dataclass
class LossReport:
    """Collects rows that are not passed on, and other events, in the order in which they began.

    ``open``: events that may grow, by kind and table; ``unreadable``: by kind and fault; ``ready``: events that are
    complete.
    """

    open: dict[tuple[str, str], _Open] = field(default_factory=dict)
    unreadable: dict[tuple[str, str], _Unreadable] = field(default_factory=dict)
    ready: list[Event] = field(default_factory=list)

    def lose(self, kind: str, table: str, t: Array, columns: Sequence[str] = (), *, imu_s: float = np.nan) -> None:
        """Report rows at times ``t`` (NaN allowed) that are not passed on, because of ``columns`` if any are given, or
        of how far they are from the newest time of the IMU when they came, ``imu_s``.
        """
        if t.size == 0:
            return
        finite = t[np.isfinite(t)]
        first, last = (float(finite.min()), float(finite.max())) if finite.size else (None, None)
        now = Event(kind, table, first, last, int(t.size), LOSS_KINDS[kind])
        entry = self.open.setdefault((kind, table), _Open(Event(kind, table)))
        entry.columns = tuple(dict.fromkeys([*entry.columns, *columns]))
        entry.event, entry.quiet = _joined(entry.event, now, entry.columns), 0
        if first is not None and last is not None and np.isfinite(imu_s):
            least, most = entry.ahead_s or (np.inf, -np.inf)
            entry.ahead_s = min(least, first - imu_s), max(most, last - imu_s)
            entry.event = replace(entry.event, detail=f"{LOSS_KINDS[kind]}: {_off(*entry.ahead_s)}")

    def note(self, event: Event) -> None:
        """Report an event that is complete, or rows that could not be read."""
        if not isinstance(event, UnreadableRows):
            self.ready.append(event)
            return
        entry = self.unreadable.get(key := (event.kind, event.fault))
        if entry is None:
            self.ready.append(event)
            self.unreadable[key] = _Unreadable(Event(event.kind))
        else:
            entry.rows, entry.quiet = event if entry.rows is None else entry.rows.joined(event), 0

    def end_of_push(self) -> tuple[Event, ...]:
        """Return the events that are complete after a batch."""
        for key, entry in list(self.open.items()):
            if entry.ends():
                self.ready.append(self.open.pop(key).event)
        for key, again in list(self.unreadable.items()):
            if again.ends():
                self.ready += _rest(self.unreadable.pop(key))
        return self._drained()

    def end_of_stream(self) -> tuple[Event, ...]:
        """Return the events that are left."""
        self.ready += [entry.event for entry in self.open.values()]
        self.ready += [event for again in self.unreadable.values() for event in _rest(again)]
        self.open.clear()
        self.unreadable.clear()
        return self._drained()

    def _drained(self) -> tuple[Event, ...]:
        ready, self.ready = tuple(self.ready), []
        return ready


def _off(least: float, most: float) -> str:
    """Return how far ahead of the IMU rows were, in words: ``least`` to ``most``, s, negative behind it.

    Rows ahead have been held since the first of them came, so ``least`` is the nearest.
    """
    if least > 0.0:
        return f"{least:.1f} s or more ahead of the IMU's"
    if most > 0.0:
        return f"up to {-least:.1f} s behind the IMU's and {most:.1f} s ahead"
    return f"up to {-least:.1f} s behind the IMU's"


def _rest(again: _Unreadable) -> list[Event]:
    return [] if again.rows is None else [again.rows]


def _joined(a: Event, b: Event, columns: Sequence[str]) -> Event:
    first = [t for t in (a.t_s, b.t_s) if t is not None]
    last = [t for t in (a.until_s, b.until_s) if t is not None]
    detail = f"{', '.join(columns)}: {b.detail}" if columns else b.detail
    return Event(a.kind, a.table, min(first, default=None), max(last, default=None), a.rows + b.rows, detail)

"""Stream events: what happened on a stream, and the report of rows that were not passed on.

Every row that is not passed on is counted in exactly one event. Rows of one kind and table that come in short
succession are one event: it closes when ``QUIET_PUSHES`` batches have passed without another, or after
``LONGEST_PUSHES``. Batches are counted, not seconds, so that the same batches give the same events.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import astuple, dataclass, field

import numpy as np
import pandas as pd

from trackfg.errors import printable
from trackfg.numerics.arrays import Array

QUIET_PUSHES = 10
LONGEST_PUSHES = 100

LOSS_KINDS = {
    "not-finite": "NaN, infinite or above 1e12",
    "duplicate": "the time of another row of the table again",
    "late": "came after the stream had passed their time; a longer hold keeps them",
    "clock-jump": "times that neither fit the clock nor made a new one",
    "buffer-full": "more rows than are kept waiting for the IMU",
    "bad-sigma": "a sigma that is zero or negative",
    "position-range": "no such position on the Earth",
    "tach-jump": "the tach runs faster than 170 m/s, or backwards although it is declared unsigned",
    "stuck-channel": "shows one value again and again: stuck, or at the end of its range",
    "impossible-value": "beyond what the sensor of a rail vehicle shows, or far beyond all before",
}
"""Kinds of events that count rows which were not passed on, and what each means."""


_BREAKS = (("clock-restart", "imu"), ("tach-reset", "tach"))


@dataclass(frozen=True)
class StreamEvent:
    """One fact about a stretch of a stream.

    ``t_s`` and ``until_s`` are the first and the last time that it concerns, on the stream's clock, None where no
    time could be read. ``rows`` counts rows (or lines) that were not passed on because of it. Where the estimator knows
    them, the chainage (m) at the first time, and the distance (m) that a slip added or a slide hid; with 1-sigma.
    """

    kind: str
    table: str = ""
    t_s: float | None = None
    until_s: float | None = None
    rows: int = 0
    detail: str = ""
    chainage_m: float | None = None
    chainage_m_sd: float | None = None
    distance_removed_m: float | None = None
    distance_removed_m_sd: float | None = None

    def __post_init__(self) -> None:
        """Escape control characters: names come from the input, and must not reach a terminal as they are."""
        for name in ("kind", "table", "detail"):
            text = getattr(self, name)
            if not text.isprintable():
                object.__setattr__(self, name, printable(text))

    def __str__(self) -> str:
        where = f"{self.table}: " if self.table else ""
        when = "" if self.t_s is None else f" at t = {self.t_s:.3f} s"
        if self.t_s is not None and self.until_s is not None and self.until_s > self.t_s:
            when = f" from t = {self.t_s:.3f} to {self.until_s:.3f} s"
        count = "" if self.rows == 0 else f", {self.rows} row{'s' if self.rows > 1 else ''}"
        place = "" if self.chainage_m is None else f" at {self.chainage_m:.1f} m"
        removed = "" if self.distance_removed_m is None else f", {self.distance_removed_m:+.2f} m"
        return f"{where}{self.kind}{when}{place}{removed}{count}" + (f": {self.detail}" if self.detail else "")


EVENT_TYPES = {
    "kind": "str",
    "input": "str",
    "t_s": "float64",
    "until_s": "float64",
    "rows": "int64",
    "detail": "str",
    "chainage_m": "float64",
    "chainage_m_sd": "float64",
    "distance_removed_m": "float64",
    "distance_removed_m_sd": "float64",
}
"""Columns of a table of events: the fields of an event, but ``input`` for ``table``."""


def event_table(events: Iterable[StreamEvent]) -> pd.DataFrame:
    """Return a table of one row per event, NaN for what is not known."""
    return pd.DataFrame([astuple(event) for event in events], columns=list(EVENT_TYPES)).astype(EVENT_TYPES)


def motion_breaks(events: Iterable[StreamEvent]) -> dict[str, Array]:
    """Return spans (b, 2), s, over which the motion is unknown, by table: a device that was off while its clock was set
    back (``imu``), a counter that began again and did not count (``tach``).
    """
    spans: dict[str, list[tuple[float, float]]] = {}
    for event in events:
        if (event.kind, event.table) in _BREAKS and event.t_s is not None and event.until_s is not None:
            spans.setdefault(event.table, []).append((event.t_s, event.until_s))
    return {table: np.array(rows) for table, rows in spans.items()}


@dataclass
class _Open:
    event: StreamEvent
    pushes: int = 0
    quiet: int = 0
    columns: tuple[str, ...] = ()


@dataclass
class LossReport:
    """Collects rows that are not passed on, and other events, in the order in which they began.

    ``open``: events that may grow, by kind and table; ``ready``: events that are complete.
    """

    open: dict[tuple[str, str], _Open] = field(default_factory=dict)
    ready: list[StreamEvent] = field(default_factory=list)

    def lose(self, kind: str, table: str, t: Array, columns: Sequence[str] = ()) -> None:
        """Report rows at times ``t`` (NaN allowed) that are not passed on, because of ``columns`` if any are given."""
        if t.size == 0:
            return
        known = t[np.isfinite(t)]
        first, last = (float(known.min()), float(known.max())) if known.size else (None, None)
        now = StreamEvent(kind, table, first, last, int(t.size), LOSS_KINDS[kind])
        entry = self.open.setdefault((kind, table), _Open(StreamEvent(kind, table)))
        entry.columns = tuple(dict.fromkeys([*entry.columns, *columns]))
        entry.event, entry.quiet = _joined(entry.event, now, entry.columns), 0

    def note(self, event: StreamEvent) -> None:
        """Report an event that is complete."""
        self.ready.append(event)

    def end_of_push(self) -> tuple[StreamEvent, ...]:
        """Return the events that are complete after a batch."""
        for key, entry in list(self.open.items()):
            entry.pushes += 1
            entry.quiet += 1
            if entry.quiet > QUIET_PUSHES or entry.pushes >= LONGEST_PUSHES:
                self.ready.append(self.open.pop(key).event)
        return self._drained()

    def end_of_stream(self) -> tuple[StreamEvent, ...]:
        """Return the events that are left."""
        self.ready += [entry.event for entry in self.open.values()]
        self.open.clear()
        return self._drained()

    def _drained(self) -> tuple[StreamEvent, ...]:
        ready, self.ready = tuple(self.ready), []
        return ready


def _joined(a: StreamEvent, b: StreamEvent, columns: Sequence[str]) -> StreamEvent:
    first = [t for t in (a.t_s, b.t_s) if t is not None]
    last = [t for t in (a.until_s, b.until_s) if t is not None]
    detail = f"{', '.join(columns)}: {b.detail}" if columns else b.detail
    return StreamEvent(a.kind, a.table, min(first, default=None), max(last, default=None), a.rows + b.rows, detail)

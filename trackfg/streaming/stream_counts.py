"""The counts of a stream say how many rows came, were used and were lost, and what happened to them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field

from trackfg.results.events import DOUBT, Event
from trackfg.streaming.doubts.reporting import subject_of
from trackfg.streaming.events import UnreadableRows
from trackfg.streaming.intake.imu_clock import ClockLimits

_MANY_UNREADABLE = 0.01
"""A larger share of the input is a fault of the sender, not of a line here and there."""
_NO_LOSS = ("duplicate", "held", "silent")
"""Kinds of events that leave out what was passed on before, or what measures nothing."""


@dataclass
class StreamCounts:
    """Rows taken from the source and passed on to the smoother, keyframes estimated, events by kind.

    ``by_table``: rows taken; ``left_out``: rows of each table that were not passed on, by kind of event;
    ``unreadable``: lines or messages that were no row; ``broken``: where the source ended too early, if it did. All of
    these are since the last start. ``doubts``: the newest sentences on quantities whose sigmas are too small, by their
    subjects.
    """

    rows_in: int = 0
    rows_used: int = 0
    keyframes: int = 0
    events: Counter[str] = field(default_factory=Counter)
    doubts: dict[str, str] = field(default_factory=dict)
    by_table: Counter[str] = field(default_factory=Counter)
    left_out: dict[str, Counter[str]] = field(default_factory=dict)
    unreadable: int = 0
    first_unreadable: str = ""
    broken: str = ""

    def count(self, events: Iterable[Event]) -> None:
        """Count events, and the rows that were lost by them."""
        for event in events:
            self.events[event.kind] += 1
            if event.kind == DOUBT:
                self.doubts[subject_of(event)] = event.detail
            if event.kind == "broken-input":
                self.broken = event.detail
            if event.rows and event.table:
                self.left_out.setdefault(event.table, Counter())[event.kind] += event.rows
            elif event.rows:
                self.unreadable += event.rows
                first = event.first if isinstance(event, UnreadableRows) else event.detail
                self.first_unreadable = self.first_unreadable or first

    def losses(self) -> list[str]:
        """Return a sentence for each table that lost more than half of its rows, and others if many were no rows at all
        or the source is cut off. A row, or a value, that came again is no loss.
        """
        sentences = [self.broken] if self.broken else []
        if self.unreadable > _MANY_UNREADABLE * (came := self.unreadable + self.rows_in):
            sentences.append(f"{self.unreadable} of {came} rows could not be read; the first: {self.first_unreadable}")
        for table, kinds in self.left_out.items():
            lost = Counter({kind: number for kind, number in kinds.items() if kind not in _NO_LOSS})
            if 2 * lost.total() > (came := self.by_table[table]) > 0:
                why = ", ".join(f"{number} {kind}" for kind, number in lost.most_common())
                hint = "the table events says what was expected"
                main = lost.most_common(1)[0][0]
                if main == "late":
                    hint = f"a row may come {ClockLimits().hold_s:g} s after the IMU's of its time, not later"
                elif main == "clock-jump" and table != "imu":
                    where = "the table events says how far their times are from the IMU's"
                    hint = f"{where}: correct its time_offset_s, or its time_unit"
                sentences.append(f"{table}: {lost.total()} of {came} rows were left out ({why}). Hint: {hint}")
        return sentences

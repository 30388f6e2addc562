"""A stream from its source to its sink.

source -> intake -> fixed-lag smoother -> sink
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

from trackfg.streaming.fixed_lag import Estimates, FixedLagSmoother
from trackfg.streaming.intake import Intake
from trackfg.streaming.sinks import Sink
from trackfg.streaming.sources import Source
from trackfg.streaming.stream_events import StreamEvent, event_table


@dataclass
class StreamCounts:
    """Rows taken from the source and passed on to the smoother, keyframes estimated, events by kind."""

    rows_in: int = 0
    rows_used: int = 0
    keyframes: int = 0
    events: Counter[str] = field(default_factory=Counter)


def run_stream(source: Source, smoother: FixedLagSmoother, sink: Sink) -> StreamCounts:
    """Everything that the source gives, until it ends. Raises what source, smoother and sink raise."""
    intake, counts = Intake.of(source), StreamCounts()

    def put(estimates: Estimates, events: tuple[StreamEvent, ...]) -> None:
        events += estimates.events
        sink.write("events", event_table(events))
        sink.write("filtered", estimates.filtered)
        sink.write("smoothed", estimates.smoothed)
        sink.write("geometry", estimates.geometry)
        counts.keyframes += len(estimates.filtered)
        counts.events.update(event.kind for event in events)

    for batch in source:
        rows, events = intake.push(batch)
        put(smoother.put(rows), events)
    rows, events = intake.finish()
    put(smoother.put(rows), events)
    put(smoother.finish(), ())
    sink.close()
    counts.rows_in, counts.rows_used = intake.rows_in, intake.rows_out
    return counts

"""A stream runs from its source to its sink.

source -> intake -> fixed-lag smoother -> sink

With checkpoints, a stream that was killed goes on from the last one, and all that it writes is, to the last bit, what
it would have written::

    saved = checkpoints.read()
    source = RecordingSource(recording, position=saved.position)
    stream = Stream.of(source, FixedLagSmoother(source.description), saved)
    stream.run(ParquetParts(folder, state=saved.sink), checkpoints)
"""

from __future__ import annotations

import contextlib
import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from trackfg.checks.limits import CheckLimits
from trackfg.errors import OutputError
from trackfg.numerics.blas_threads import one_thread
from trackfg.results.events import Event
from trackfg.streaming.back_pressure import BackPressure
from trackfg.streaming.checkpoint.checkpoint import Checkpoint, Checkpoints
from trackfg.streaming.estimates import NO_ESTIMATES, Estimates
from trackfg.streaming.events import event_table
from trackfg.streaming.fixed_lag import FixedLagSmoother
from trackfg.streaming.intake.intake import Intake
from trackfg.streaming.sinks.sink import Sink
from trackfg.streaming.sources.source import Source
from trackfg.streaming.stream_counts import StreamCounts


@dataclass(frozen=True)
class StreamStep:
    """The outcome of a batch of rows: estimates, and all events.

    ``delay_s``: from the newest row to the estimate for its time, s: rows wait for those of other tables, then for the
    next keyframe, then for the computer. None without a new estimate. ``done``: share of the source that is read; None
    where its length is not known.
    """

    estimates: Estimates
    events: tuple[Event, ...]
    delay_s: float | None
    done: float | None


@dataclass
class Stream:
    """The stages between a source and a sink, and counts of what has come through."""

    source: Source
    smoother: FixedLagSmoother
    intake: Intake
    counts: StreamCounts = field(default_factory=StreamCounts)
    clock: Callable[[], float] = time.monotonic

    @classmethod
    def of(
        cls,
        source: Source,
        smoother: FixedLagSmoother,
        saved: Checkpoint | None = None,
        *,
        checks: CheckLimits | None = None,
        from_now: bool = False,
    ) -> Stream:
        """Return a stream from the beginning, or from a checkpoint: source at its position, smoother made as then.

        ``checks``: limits of values that the intake drops rows by, other than the defaults. ``from_now``: rows since
        the checkpoint are missing, since the source is a live feed.
        Raises :class:`~trackfg.errors.BadInputError` where source and smoother are others than those of the checkpoint.
        """
        stream = cls(source, smoother, Intake.of(source, checks=checks))
        if saved is None:
            return stream
        saved.refuse_others(stream.settings)
        stream.counts.keyframes, stream.counts.events = saved.keyframes, Counter(saved.events)
        if saved.intake is None or saved.smoother is None:
            return stream
        stream.intake.restore(saved.intake)
        smoother.restore(saved.smoother)
        if from_now:
            stream.intake.miss_rows()
        return stream

    @property
    def settings(self) -> dict[str, str]:
        """Digests by name; a stream with the same ones can go on from a checkpoint of this one."""
        source = {"source": type(self.source).__name__, "recording": self.source.first_rows}
        return {**self.smoother.settings, **source}

    @one_thread()
    def run(
        self,
        sink: Sink,
        checkpoints: Checkpoints | None = None,
        watch: Callable[[StreamStep], None] = lambda step: None,
    ) -> StreamCounts:
        """Run until the source ends. Raises what source, smoother and sink raise; the sink is closed in any case.

        ``watch`` is called with what each batch led to, once that is written.
        """
        try:
            return self._run(sink, checkpoints, watch)
        except BaseException:
            with contextlib.suppress(OutputError):  # what came before is raised
                sink.close()
            raise

    def _run(self, sink: Sink, checkpoints: Checkpoints | None, watch: Callable[[StreamStep], None]) -> StreamCounts:
        pace, done = BackPressure(self.smoother.keyframe_spacing), self.clock()
        for batch in self.source:
            start_s = self.clock()
            self.counts.by_table.update({table: len(rows) for table, rows in batch.tables.items()})
            rows, events = self.intake.push(batch)
            estimates = self.smoother.put(rows)
            events = self._write(sink, estimates, events)
            waited, done = start_s - done, self.clock()
            if self.source.live and (change := pace.record(waited, done - start_s, rows.until_s)) is not None:
                self.smoother.keyframe_spacing = pace.factor
                events += self._write(sink, NO_ESTIMATES, (change,))
            watch(self._step(estimates, events, batch.position, done - start_s + pace.behind_s))
            if checkpoints is not None and checkpoints.due(rows.until_s):
                checkpoints.write(self._checkpoint(batch.position, rows.until_s, sink))
        rows, events = self.intake.finish()
        estimates = self.smoother.put(rows)
        watch(self._step(estimates, self._write(sink, estimates, events), self.source.length, 0.0))
        estimates = self.smoother.finish()
        watch(self._step(estimates, self._write(sink, estimates, ()), self.source.length, 0.0))
        written = sink.checkpoint()
        sink.close()
        if checkpoints is not None:
            checkpoints.write(Checkpoint(self.settings, written, finished=True))
        return self.counts

    def _step(
        self, estimates: Estimates, events: tuple[Event, ...], position: int | None, waited_s: float
    ) -> StreamStep:
        length, delay = self.source.length, None
        if len(estimates.filtered):
            newest = self.intake.reorder_buffer.clock.newest_s
            delay = max(newest - float(estimates.filtered["t_s"].iloc[-1]), 0.0) + waited_s
        done = None if position is None or not length else min(position / length, 1.0)
        return StreamStep(estimates, events, delay, done)

    def _checkpoint(self, position: int, until_s: float, sink: Sink) -> Checkpoint:
        return Checkpoint(
            self.settings,
            sink.checkpoint(),
            position,
            self.intake.state(),
            self.smoother.state(),
            until_s,
            self.counts.keyframes,
            self.counts.events,
        )

    def _write(self, sink: Sink, estimates: Estimates, events: tuple[Event, ...]) -> tuple[Event, ...]:
        """Write and count; return all events."""
        events += estimates.events
        write_estimates(sink, estimates, events)
        self.counts.rows_in, self.counts.rows_used = self.intake.rows_in, self.intake.rows_out
        self.counts.keyframes += len(estimates.filtered)
        self.counts.count(events)
        return events


def write_estimates(sink: Sink, estimates: Estimates, events: Sequence[Event]) -> None:
    """Write rows of all tables; ``events`` are those of the estimates and all others."""
    if events:  # a table of none costs as much as one of some
        sink.write("events", event_table(events))
    sink.write("filtered", estimates.filtered)
    sink.write("smoothed", estimates.smoothed)
    sink.write("geometry", estimates.geometry)


def run_stream(source: Source, smoother: FixedLagSmoother, sink: Sink) -> StreamCounts:
    """Run a stream from its beginning to its end."""
    return Stream.of(source, smoother).run(sink)

"""From batches as a source gives them to sound, canonical rows in the order of time, and what became of the others.

    stamps -> arrival -> channels of the IMU -> conversion -> row checks -> clock steps

Everything that carries over from one batch to the next is in :meth:`Intake.state`: an intake restored from it and given
the batches that followed gives the same rows and events, bit by bit, as one that was never interrupted.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from trackfg.numerics.arrays import Array
from trackfg.recording.description import RecordingDescription
from trackfg.streaming.events import LossReport, StreamEvent, motion_breaks
from trackfg.streaming.intake.clock_jumps import ClockJumps
from trackfg.streaming.intake.conversion import Conversion
from trackfg.streaming.intake.imu_clock import ClockLimits
from trackfg.streaming.intake.imu_faults import ImuFaults
from trackfg.streaming.intake.reorder_buffer import ReorderBuffer
from trackfg.streaming.intake.row_checks import RowChecks
from trackfg.streaming.intake.timestamps import Timestamps
from trackfg.streaming.rows import Rows, described_tables, joined_tables
from trackfg.streaming.sources.source import Batch, Source


class Intake:
    """What stands between a source and the estimator. ``canonical``: the batches' rows are so already."""

    def __init__(
        self,
        description: RecordingDescription,
        *,
        canonical: bool = False,
        limits: ClockLimits | None = None,
        gnss_origin: Array | None = None,
    ) -> None:
        self._arrival = ReorderBuffer(described_tables(description), limits)
        self._stamps = None if canonical else Timestamps(description)
        self._conversion = None if canonical else Conversion(description)
        self._channels = ImuFaults(description.imu, is_canonical=canonical)
        self._checks = RowChecks(description)
        self._steps = ClockJumps(description)
        self._report = LossReport()
        self._gnss_origin = gnss_origin
        self.rows_in = 0
        self.rows_out = 0

    @classmethod
    def of(cls, source: Source, limits: ClockLimits | None = None) -> Intake:
        """For the batches of ``source``."""
        return cls(source.description, canonical=source.canonical, limits=limits, gnss_origin=source.gnss_origin)

    def push(self, batch: Batch) -> tuple[Rows, tuple[StreamEvent, ...]]:
        """The rows that are complete now, and what is to be said of others."""
        self.rows_in += sum(rows.shape[0] for rows in batch.tables.values())
        for event in batch.events:
            self._report.note(event)
        tables = batch.tables if self._stamps is None else self._stamps.on_common_clock(batch.tables)
        rows = self._sound(self._arrival.push(tables, self._report))
        return self._passed(rows, self._report.end_of_push())

    def finish(self) -> tuple[Rows, tuple[StreamEvent, ...]]:
        """The stream is over: the rest."""
        tables: dict[str, Array] = {}
        if self._stamps is not None:
            tables = self._arrival.push(self._stamps.on_common_clock({}, last=True), self._report)
        rest = self._arrival.finish(self._report)
        rows = self._sound(joined_tables([tables, rest]), last=True)
        return self._passed(rows, self._report.end_of_stream(), last=True)

    def _passed(
        self, rows: Rows, events: tuple[StreamEvent, ...], *, last: bool = False
    ) -> tuple[Rows, tuple[StreamEvent, ...]]:
        rows, events = self._steps.passed(rows, events, last=last)
        self.rows_out += len(rows)
        return replace(rows, breaks=motion_breaks(events)), events

    def _sound(self, tables: Mapping[str, Array], *, last: bool = False) -> Rows:
        if "imu" in tables:
            tables = {**tables, "imu": self._channels.passed(tables["imu"], self._report)}
        if last and len(rest := self._channels.finish()):
            tables = {**tables, "imu": np.concatenate([part for part in (tables.get("imu"), rest) if part is not None])}
        until_s = self._arrival.watermark_s
        if (since_s := self._channels.waiting_since_s) <= until_s:
            until_s = float(np.nextafter(since_s, -np.inf))
        if self._conversion is not None:
            tables = self._conversion.converted(tables, self._report)
            self._gnss_origin = self._conversion.gnss_origin
        return Rows.of(self._checks.sound(tables, self._report), until_s, self._gnss_origin)

    def state(self) -> dict[str, Any]:
        """Everything that carries over, as JSON values."""
        return {
            "arrival": self._arrival.state(),
            "stamps": None if self._stamps is None else self._stamps.state(),
            "conversion": None if self._conversion is None else self._conversion.state(),
            "channels": self._channels.state(),
            "checks": self._checks.state(),
            "steps": self._steps.state(),
            "report": self._report.state(),
            "rows_in": self.rows_in,
            "rows_out": self.rows_out,
        }

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on from the :meth:`state` of an intake made with the same arguments."""
        self._arrival.restore(state["arrival"])
        if self._stamps is not None and self._conversion is not None:
            self._stamps.restore(state["stamps"])
            self._conversion.restore(state["conversion"])
            self._gnss_origin = self._conversion.gnss_origin
        self._channels.restore(state["channels"])
        self._checks.restore(state["checks"])
        self._steps.restore(state["steps"])
        self._report = LossReport.restored(state["report"])
        self.rows_in, self.rows_out = state["rows_in"], state["rows_out"]

"""The intake turns batches as a source gives them into sound, canonical rows in the order of time, and events.

    timestamps -> interval check -> reorder buffer -> repeated and interpolated rows and faults of the IMU -> conversion
        -> gravity, row checks, held rows, rates, speeds -> clock jumps -> jumps of the IMU's clock alone

:meth:`Intake.state` is everything that carries over from one batch to the next: an intake restored from it and given
the batches that followed gives the same rows and events, bit by bit, as one that was never interrupted.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from trackfg.checks.inertial.imu_faults import ImuFaultDetector
from trackfg.checks.inertial.interpolated_rows import InterpolatedRows
from trackfg.checks.limits import CheckLimits
from trackfg.numerics.arrays import Array
from trackfg.recording.description import RecordingDescription
from trackfg.results.events import Event
from trackfg.streaming.checkpoint.snapshot import Snapshot, dump, load_attributes
from trackfg.streaming.events import LossReport, motion_breaks
from trackfg.streaming.intake.clock_jumps import ClockJumps
from trackfg.streaming.intake.conversion import Conversion
from trackfg.streaming.intake.gravity_check import GravityCheck
from trackfg.streaming.intake.held_rows import HeldRows
from trackfg.streaming.intake.imu_clock import ClockLimits
from trackfg.streaming.intake.imu_clock_jumps import ImuClockJumps
from trackfg.streaming.intake.interval_check import IntervalCheck
from trackfg.streaming.intake.rate_check import RateCheck
from trackfg.streaming.intake.reorder_buffer import ReorderBuffer
from trackfg.streaming.intake.repeated_rows import RepeatedRows
from trackfg.streaming.intake.row_checks import RowChecks
from trackfg.streaming.intake.speed_check import SpeedCheck
from trackfg.streaming.intake.timestamps import Timestamps
from trackfg.streaming.rows import Rows, described_tables, joined_tables
from trackfg.streaming.sources.source import Batch, Source


@dataclass
class Intake:
    """The stages between a source and the estimator. Where the source's rows are canonical, four are left out.

    ``rows_in`` and ``rows_out`` count rows; what is lost is in the ``report``.
    """

    description: RecordingDescription
    reorder_buffer: ReorderBuffer
    timestamps: Timestamps | None
    interval_check: IntervalCheck
    conversion: Conversion | None
    gravity_check: GravityCheck | None
    rate_check: RateCheck | None
    speed_check: SpeedCheck
    repeated: RepeatedRows
    interpolated: InterpolatedRows
    imu_faults: ImuFaultDetector
    row_checks: RowChecks
    held_rows: HeldRows
    clock_jumps: ClockJumps
    imu_clock_jumps: ImuClockJumps | None
    gnss_origin: Array | None
    report: LossReport = field(default_factory=LossReport)
    rows_in: int = 0
    rows_out: int = 0

    @classmethod
    def begin(
        cls,
        description: RecordingDescription,
        *,
        canonical: bool = False,
        limits: ClockLimits | None = None,
        checks: CheckLimits | None = None,
        gnss_origin: Array | None = None,
    ) -> Intake:
        """Return an intake before the first row; ``canonical``: rows come in canonical form."""
        checks = checks or CheckLimits()
        return cls(
            description=description,
            reorder_buffer=ReorderBuffer.of(described_tables(description), limits),
            timestamps=None if canonical else Timestamps.of(description),
            interval_check=IntervalCheck(checks),
            conversion=None if canonical else Conversion(description),
            gravity_check=None if canonical else GravityCheck(checks),
            rate_check=None if canonical else RateCheck(checks),
            speed_check=SpeedCheck(checks),
            repeated=RepeatedRows(),
            interpolated=InterpolatedRows.of(description.imu, is_canonical=canonical),
            imu_faults=ImuFaultDetector.of(description.imu, checks, is_canonical=canonical),
            row_checks=RowChecks.of(description, checks),
            held_rows=HeldRows(),
            clock_jumps=ClockJumps.of(description),
            imu_clock_jumps=ImuClockJumps.of(description),
            gnss_origin=gnss_origin,
        )

    @classmethod
    def of(cls, source: Source, limits: ClockLimits | None = None, checks: CheckLimits | None = None) -> Intake:
        """Return an intake for the batches of ``source``."""
        return cls.begin(
            source.description,
            canonical=source.canonical,
            limits=limits,
            checks=checks,
            gnss_origin=source.gnss_origin,
        )

    def push(self, batch: Batch) -> tuple[Rows, tuple[Event, ...]]:
        """Return the rows that are complete after a batch, and the events.

        Raises :class:`~trackfg.errors.BadInputError` where the IMU's first rows come at a rate that no sensor has, or
        do not show gravity where the description says.
        """
        self.rows_in += sum(rows.shape[0] for rows in batch.tables.values())
        for event in batch.events:
            self.report.note(event)
        tables = batch.tables if self.timestamps is None else self.timestamps.on_common_clock(batch.tables)
        self._check_interval(tables.get("imu"))
        rows = self._sound(self.reorder_buffer.push(tables, self.report))
        return self._explained(rows, self.report.end_of_push())

    def miss_rows(self) -> None:
        """Take rows to be missing from the newest one on: a jump of the clocks ahead is then a gap, not a set clock."""
        self.reorder_buffer.clock.missed_s = self.clock_jumps.missed_s = self.reorder_buffer.clock.newest_s

    def finish(self) -> tuple[Rows, tuple[Event, ...]]:
        """Return the rest at the end of the stream."""
        tables: dict[str, Array] = {}
        if self.timestamps is not None:
            tables = self.timestamps.on_common_clock({}, last=True)
            self._check_interval(tables.get("imu"))
            tables = self.reorder_buffer.push(tables, self.report)
        self._check_interval(None, last=True)
        rest = self.reorder_buffer.finish(self.report)
        rows = self._sound(joined_tables([tables, rest]), last=True)
        return self._explained(rows, self.report.end_of_stream(), last=True)

    def _check_interval(self, rows: Array | None, *, last: bool = False) -> None:
        imu, canonical, event = self.description.imu, self.timestamps is None, None
        if rows is not None:
            event = self.interval_check.take(rows, imu, canonical=canonical)
        if last:
            event = self.interval_check.finish(imu, canonical=canonical)
        if event is not None:
            self.report.note(event)

    def _explained(
        self, rows: Rows, events: tuple[Event, ...], *, last: bool = False
    ) -> tuple[Rows, tuple[Event, ...]]:
        rows, events = self.clock_jumps.without_jumps(rows, events, last=last)
        if self.imu_clock_jumps is not None:
            events += self.imu_clock_jumps.take(rows, last=last)
        self.rows_out += len(rows)
        return replace(rows, breaks=motion_breaks(events)), events

    def _sound(self, tables: Mapping[str, Array], *, last: bool = False) -> Rows:
        imu: list[Array] = []
        if "imu" in tables:
            samples, repeated = self.repeated.take(tables["imu"])
            self.report.lose("held", "imu", repeated)
            imu = [self._measurements(*self.interpolated.take(samples))]
        if last:
            imu += [self._measurements(self.interpolated.finish(), np.empty(0)), self.imu_faults.finish()]
        if any(map(len, imu)) or "imu" in tables:
            tables = {**tables, "imu": np.concatenate(imu) if len(imu) > 1 else imu[0]}
        until_s = self.reorder_buffer.watermark_s
        since_s = min(self.interpolated.waiting_since_s, self.imu_faults.waiting_since_s)
        if since_s <= until_s:
            until_s = float(np.nextafter(since_s, -np.inf))
        if self.conversion is not None:
            tables = self.conversion.converted(tables, self.report)
            self.gnss_origin = self.conversion.gnss_origin
        if self.gravity_check is not None and "imu" in tables:
            self.gravity_check.take(tables["imu"], self.description.imu)
        tables = self.held_rows.without(self.row_checks.sound(tables, self.report), self.report)
        if self.rate_check is not None and "imu" in tables:
            event = self.rate_check.take(tables["imu"], tables.get("tach"), self.description.imu)
            if event is not None:
                self.report.note(event)
        tables = self.speed_check.sound(tables, self.description.gnss_speed, self.report)
        return Rows.of(tables, until_s, self.gnss_origin)

    def _measurements(self, rows: Array, interpolated: Array) -> Array:
        """Return which rows (n, 7) are measurements, and report the others; ``interpolated``: times of those that have
        been left out, s.
        """
        self.report.lose("interpolated", "imu", interpolated)
        measurements, faults = self.imu_faults.take(rows)
        for fault in faults:
            self.report.lose(fault.code, "imu", fault.t, fault.columns)
        return measurements

    def state(self) -> Snapshot:
        """Return everything that carries over."""
        return dump(self, (self.description,))

    def restore(self, state: Snapshot) -> None:
        """Go on from the :meth:`state` of an intake made with the same arguments. Raises
        :class:`~trackfg.errors.BadInputError` where it does not fit.
        """
        vars(self).update(load_attributes(Intake, state, (self.description,)))

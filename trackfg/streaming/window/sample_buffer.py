"""The sample buffer holds the rows of a stream that are still needed, and makes recordings of stretches of them.

Inertial samples become intervals edge to edge as they come (:mod:`trackfg.sensors.imu_intervals`); the newest one waits
until the next sample bounds its interval. How rows were grouped on their way makes no difference.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cache

import numpy as np
import pandas as pd

from trackfg.graph.further_sensors import BEFORE_S
from trackfg.graph.inputs import RATE_WINDOW_S
from trackfg.graph.keyframes import TOO_CLOSE
from trackfg.numerics.arrays import Array
from trackfg.recording.description import RecordingDescription
from trackfg.recording.model import LASER_COLUMNS, Recording
from trackfg.sensors.displacement import RailView, rail_views
from trackfg.sensors.imu_intervals import SAME_S, Intervals, laid_out, means_around
from trackfg.sensors.sampling_rate import RateFollower, first_interval
from trackfg.streaming.growable_array import GrowableArray, GrowableIntervals
from trackfg.streaming.rows import NO_SAMPLES, Rows, canonical_columns, no_rows

AFTER_S = 0.3
"""A keyframe needs rows this much younger than itself, s: its rates are means over 0.5 s of the wheel."""
_POSITIONS = ("fixes", "gnss")
_OTHERS_AFTER_S = 0.3
"""Time after an interval, s, up to which rows of further sensors are at hand when it is completed."""
_AT_REST_S = 0.5
"""How much of the lasers' rows is kept at either end of a long rest, s."""


@dataclass
class SampleBuffer:
    """All rows that are still needed. ``rate`` has the sampling interval; None until enough samples are there."""

    description: RecordingDescription
    gnss_origin: Array | None = None
    rate: RateFollower | None = None
    laid: GrowableIntervals | None = None
    """The intervals, edge to edge, with holes interpolated; None until the sampling interval is known."""
    waiting: Array = field(default_factory=lambda: no_rows("imu"))
    """Samples that are not intervals yet, as rows of the recording's columns."""
    samples: GrowableArray = field(default_factory=lambda: GrowableArray(no_rows("imu")))
    """Samples that are intervals."""
    tach: Array = field(default_factory=lambda: no_rows("tach"))
    positions: dict[str, Array] = field(default_factory=lambda: {name: no_rows(name) for name in _POSITIONS})
    """Rows of fixes and GNSS, by table."""
    others: dict[str, Array] = field(default_factory=dict)
    """Rows of further sensors, by table."""
    lasers: dict[str, Array] = field(default_factory=dict)
    """Rows by the name of the laser."""
    breaks: dict[str, Array] = field(default_factory=lambda: {name: np.zeros((0, 2)) for name in ("imu", "tach")})
    """Spans (b, 2), s, over which the motion is unknown, by table."""

    @property
    def is_empty(self) -> bool:
        """Return whether there are too few inertial samples to make intervals of."""
        return self.laid is None

    @property
    def inertial(self) -> Intervals:
        """The inertial record as far as it is laid out. Raises ``ValueError`` where the buffer :attr:`is_empty`."""
        if self.laid is None:
            raise ValueError("no inertial intervals yet")
        return self.laid.intervals

    @property
    def uncounted(self) -> Array:
        """Spans in which the tach did not count, s, shape (u, 2): its own breaks, and those of the whole device."""
        return np.concatenate([self.breaks["tach"], self.breaks["imu"]])

    def put(self, rows: Rows) -> None:
        """Append the next rows."""
        self.gnss_origin = rows.gnss_origin if self.gnss_origin is None else self.gnss_origin
        for name, spans in rows.breaks.items():
            self.breaks[name] = np.concatenate([self.breaks[name], spans])
        if len(rows.tach):
            self.tach = np.concatenate([self.tach, rows.tach])
        for name, table in (("fixes", rows.fixes), ("gnss", rows.gnss)):
            if len(table):
                self.positions[name] = np.concatenate([self.positions[name], table])
        for name, table in rows.others.items():
            self.others[name] = np.concatenate([self.others[name], table]) if name in self.others else table
        for name, table in rows.lasers.items():
            self.lasers[name] = np.concatenate([self.lasers[name], table]) if name in self.lasers else table
        if len(rows.imu):
            self.waiting = np.concatenate([self.waiting, rows.imu])
            self._lay_out()

    def end(self) -> None:
        """Take the last sample for as long as the others: no more rows come."""
        if self.laid is not None and self.rate is not None and len(self.waiting):
            rows = self.waiting
            self.laid.append(laid_out(rows[:, 0], rows[:, 1:4], rows[:, 4:], self.rate.usual_s, self.until))
            self.samples.append(rows)
            self.waiting = rows[:0]

    @property
    def until(self) -> float:
        """The end of the inertial record, s; minus infinity before it begins."""
        return -np.inf if self.laid is None else float(self.laid.edges.rows[-1])

    def _lay_out(self) -> None:
        """Make intervals of the samples that wait, except the last: the next sample ends its interval."""
        rows = self.waiting
        if self.rate is None:
            if (interval_s := first_interval(rows[:, 0])) is None:
                return
            self.rate = RateFollower(interval_s)
        if len(rows) < 2:
            return
        first = 0
        for count, usual_s in self.rate.pieces(np.diff(rows[:, 0])):
            if count:
                self._append(rows[first : first + count + 1], usual_s)
                first += count
        self.samples.append(rows[:-1])
        self.waiting = rows[-1:]

    def _append(self, rows: Array, usual_s: float) -> None:
        """Append the intervals of samples (n, 7), about every ``usual_s`` s, but for that of the last one."""
        new = laid_out(rows[:, 0], rows[:, 1:4], rows[:, 4:], usual_s, None if self.laid is None else self.until)
        new = new.take(slice(0, len(new) - 1))
        if self.laid is None:
            self.laid = GrowableIntervals.of(new)
        else:
            self.laid.append(new)

    def intervals(self, begin: float, end: float) -> Intervals:
        """Return the inertial intervals that lie between two times, s."""
        data = self.inertial
        low, high = data.edges_at(begin), data.edges.searchsorted(end + SAME_S, side="right") - 1
        return data.take(slice(int(low), int(high)))

    def keyframe_after(self, last: float, spacing_s: float) -> float | None:
        """Return the time of the next keyframe, s, on an edge of the inertial record; None while that ends before it.

        It is ``spacing_s`` after the ``last`` one (s), or the first at or after a position, or at the edge of a hole,
        that comes about then: so a position belongs to the interval that ends with its keyframe.
        """
        due = last + spacing_s
        for table in self.positions.values():
            if not len(table):
                continue
            times = table[:, 0]
            soon = min(last + (1.0 + TOO_CLOSE) * (due - last), due + AFTER_S)
            measured = times[(times > last + SAME_S) & (times < soon)]
            if measured.size:
                due = float(measured[0])
        due = min([due, *self.hole_edges(last, due)[:1]])
        edges = self.inertial.edges
        at = int(self.inertial.edges_at(due))
        return float(edges[at]) if at < len(edges) else None

    def hole_edges(self, begin: float, until: float) -> Array:
        """Return the edges in (begin, until] at which a hole or a break of the inertial record begins or ends, s."""
        data = self.inertial
        edges = data.edges
        low, high = edges.searchsorted([begin, until], side="right").tolist()
        bridged = data.bridged[max(low - 1, 0) : high]
        if not (len(self.breaks["imu"]) or bridged.any()):
            return np.zeros(0)
        holes = edges[max(low - 1, 0) + 1 + np.flatnonzero(np.diff(bridged))]
        following = np.searchsorted(edges, self.breaks["imu"][:, 1], side="right")
        ends = np.concatenate([holes, edges[following[following < len(edges)]], edges[np.maximum(following - 1, 0)]])
        return np.sort(ends[(ends > begin + 1e-6) & (ends <= until)])

    def has_break(self, begin: float, until: float) -> bool:
        """Return whether the first sample after a break lies between two edges of the inertial record."""
        ends = self.breaks["imu"][:, 1]
        return len(ends) > 0 and bool(((ends >= begin) & (ends < until)).any())

    def other_rows_between(self, begin: float, end: float) -> Recording:
        """Return a recording of the fixes and GNSS after ``begin`` and up to ``end``, s, and of further sensors.

        Of these there are rows from just before and after as well.
        """
        since, until = begin + SAME_S, end + SAME_S
        fixes, gnss = (self._frame(name, self.positions[name], since, until) for name in _POSITIONS)
        return Recording(
            self.description,
            NO_SAMPLES,
            None,
            fixes if self.description.fixes is not None else None,
            gnss if self.description.gnss is not None else None,
            gnss_origin=self.gnss_origin,
            others=self._others_between(begin, end),
        )

    def _others_between(self, begin: float, end: float) -> dict[str, pd.DataFrame]:
        tables = {
            name: self._frame(name, rows, begin - BEFORE_S, end + _OTHERS_AFTER_S) for name, rows in self.others.items()
        }
        return {name: table for name, table in tables.items() if table is not None}

    def recording(self, begin: float, end: float) -> Recording:
        """Return the rows from one time to another, s, as a recording."""
        imu = pd.DataFrame(_between(self.samples.rows, begin, end), columns=_columns("imu"))
        tach = None
        if self.description.tach is not None:
            tach = pd.DataFrame(_between(self.tach, begin, end), columns=_columns("tach"))
        return replace(self.other_rows_between(begin - 2.0 * SAME_S, end), imu=imu, tach=tach)

    def first_speed(self, since: float) -> float | None:
        """Return when the first row from ``since`` (s) on was measured that determines the speed."""
        tables = (self.tach, self.positions["gnss"], *self.others.values())
        return min((float(table[i, 0]) for table in tables if (i := _first(table, since)) < len(table)), default=None)

    def measures_speed(self, begin: float, end: float) -> bool:
        """Return whether a table that determines the speed has two rows between two times, s."""
        return any(
            len(_between(table, begin, end)) > 1 for table in (self.tach, self.positions["gnss"], *self.others.values())
        )

    def rail_views(self) -> list[RailView]:
        """Return what the lasers saw of the rails; nothing until all of them have rows."""
        lasers = {name: pd.DataFrame(rows, columns=list(LASER_COLUMNS)) for name, rows in self.lasers.items()}
        if not all(len(lasers.get(laser.name, ())) > 1 for laser in self.description.laser):
            return []
        return rail_views(Recording(self.description, NO_SAMPLES, lasers=lasers))

    def mean_rate(self, t: float) -> Array:
        """Return the gyro's mean rate around a time, rad/s, shape (1, 3): beside a hole, the bridged one."""
        edges = self.inertial.edges
        lower, upper = int(edges.searchsorted(t)) - 1, int(edges.searchsorted(t, side="right"))
        begin = min(t - 2.0 * RATE_WINDOW_S, float(edges[max(lower, 0)]))
        end = max(t + 2.0 * RATE_WINDOW_S, float(edges[min(upper, len(edges) - 1)]))
        data = self.intervals(begin, end)
        return means_around(np.array([t]), RATE_WINDOW_S, data.edges, data.gyro)

    def forget(self, before: float, newer: float) -> None:
        """Drop intervals and rows of the tach and lasers that end before ``before``, s, and samples, positions and rows
        of further sensors before ``newer``, s.
        """
        if self.is_empty:
            return
        data, samples = self.inertial, self.samples.rows
        first = max(int(np.searchsorted(data.edges, before, side="right")) - 1, 0)
        self.laid = GrowableIntervals.of(data.take(slice(first, len(data))))
        self.samples = GrowableArray(samples[np.searchsorted(samples[:, 0], newer) :])
        self.tach = self.tach[max(int(np.searchsorted(self.tach[:, 0], before)) - 1, 0) :]
        self.positions = {name: table[table[:, 0] >= newer] for name, table in self.positions.items()}
        self.others = {name: table[table[:, 0] >= newer] for name, table in self.others.items()}
        self.lasers = {name: table[table[:, 0] >= before] for name, table in self.lasers.items()}
        self.breaks = {name: spans[spans[:, 1] >= before] for name, spans in self.breaks.items()}

    def collapse_rests(self, rests: Array) -> None:
        """Make each rest (r, 2), s, between edges of the inertial record, one long interval."""
        for begin, end in rests[::-1]:
            data = self.inertial
            i, j = data.edges_at([begin, end]).tolist()
            share = data.durations[i:j, None] / (data.edges[j] - data.edges[i])
            gyro, accel = (np.sum(samples[i:j] * share, axis=0) for samples in (data.gyro, data.accel))
            merged = Intervals(
                np.delete(data.edges, slice(i + 1, j)),
                np.concatenate([data.gyro[:i], gyro[None], data.gyro[j:]]),
                np.concatenate([data.accel[:i], accel[None], data.accel[j:]]),
                np.concatenate([data.bridged[:i], data.bridged[i:j].all(keepdims=True), data.bridged[j:]]),
            )
            self.laid = GrowableIntervals.of(merged)
            self.tach = self.tach[(self.tach[:, 0] <= begin) | (self.tach[:, 0] >= end)]
            for name, rows in self.lasers.items():
                self.lasers[name] = rows[(rows[:, 0] <= begin + _AT_REST_S) | (rows[:, 0] >= end - _AT_REST_S)]

    @staticmethod
    def _frame(name: str, table: Array, begin: float, end: float) -> pd.DataFrame | None:
        rows = _between(table, begin, end) if len(table) else table
        return pd.DataFrame(rows, columns=_columns(name)) if len(rows) else None


@cache
def _columns(table: str) -> pd.Index:
    """Return the columns of a table, which pandas takes longer to make than to use."""
    return pd.Index(canonical_columns(table))


def _first(table: Array, since: float) -> int:
    return int(np.searchsorted(table[:, 0], since))


def _between(table: Array, begin: float, end: float) -> Array:
    return table[slice(*table[:, 0].searchsorted([begin, end]).tolist())]

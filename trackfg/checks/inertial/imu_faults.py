"""IMU faults are rows that are numbers and yet no measurements; the smoother does without them, and sees a gap.

Batch and stream share this detector. It takes rows in order, a few at a time or all at once.

``stuck-channel``
    A channel shows one value again and again (:mod:`trackfg.checks.inertial.stuck_value`), more often than it does by
    chance (:mod:`trackfg.checks.inertial.channel_statistics`): it is stuck, or cut off at the end of its range. Rows
    between two at the end of the range are dropped with them: alone they would be too small on average.
``interpolated``
    Rows lie on straight lines (:mod:`trackfg.checks.inertial.interpolated_rows`, of which a stream asks itself).
``impossible-value``
    A value is beyond what the sensors of rail vehicles show at all; or far beyond what this recording has shown, and
    beyond what a vehicle does, for less than ``_BELIEVED_S``: a sensor that is hit, or a value garbled on its way.

A row goes as a whole. One sample that equals the one before makes rows wait, from it on, until more of them come or
others: rows of which none repeats are not delayed. How rows are grouped makes no difference.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from trackfg.checks.inertial.channel_statistics import BLOCK_ROWS, ChannelStatistics
from trackfg.checks.inertial.interpolated_rows import interpolated_times
from trackfg.checks.inertial.stuck_value import StuckValue
from trackfg.checks.limits import CheckLimits
from trackfg.numerics.arrays import Array
from trackfg.numerics.units import to_si
from trackfg.recording import canonical
from trackfg.recording.description import Imu
from trackfg.recording.findings import Finding
from trackfg.recording.model import IMU_COLUMNS, Recording

_PATIENCE_S = 0.2
"""A channel that is cut off may stay below the end of its range for so long, s."""
_FAR = 10.0
"""A value so many times further from its centre than any before is far beyond."""
_BELIEVED_S = 0.5
"""Values that are far beyond for longer are accepted, s: something has changed."""
_MOST_BLOCKS = 64
"""So many blocks of rows are judged at once, while none holds anything odd: their values stay in the cache."""
_ROWS_AT_A_TIME = 1 << 17
"""Rows of a record that are laid side by side at once, 7 MB."""
_DIGITS = 11
"""Digits after the point of values turned back to the sensor's axes: rounding must not make equal ones differ."""


class ImuFault(NamedTuple):
    """Rows with the times ``t`` (n,), s, that are no measurements, because of these columns of the sensor."""

    code: str
    t: Array
    columns: tuple[str, ...]


@dataclass
class ImuFaultDetector:
    """The detector separates measurements from faults. ``R``, where rows are in body axes: these are judged in the
    sensor's.

    ``possible``, ``usual`` (6,): limits in the rows' units. ``plateaus``: one per channel; ``before``: the newest row's
    values; ``count``: rows so far; ``held``: rows that may be of a plateau, ``held_rows`` their numbers; ``far``: rows
    in succession that are far beyond; ``centre``, ``limit`` (6,): a value further than the limit from the centre is.
    """

    columns: tuple[str, ...]
    R: Array | None
    possible: Array
    usual: Array
    statistics: ChannelStatistics
    limit: Array
    centre: Array = field(default_factory=lambda: np.zeros(6))
    plateaus: list[StuckValue] = field(default_factory=lambda: [StuckValue() for _ in range(6)])
    before: Array = field(default_factory=lambda: np.full(6, np.nan))
    count: int = 0
    held: Array = field(default_factory=lambda: np.empty((0, 7)))
    held_rows: np.ndarray = field(default_factory=lambda: np.empty(0, dtype=np.int64))
    far: int = 0

    @classmethod
    def of(cls, imu: Imu, limits: CheckLimits, *, is_canonical: bool) -> ImuFaultDetector:
        """Return the detector before the first row; ``is_canonical``: rows are in SI and body axes."""
        R, units = canonical.imu_rotation(imu), np.ones(6)
        if not is_canonical:
            units = np.repeat([to_si("angular rate", imu.gyro_unit), to_si("acceleration", imu.accel_unit)], 3)
        possible = np.repeat([limits.possible_rate_radps, limits.possible_force_mps2], 3) / units
        return cls(
            columns=(*imu.gyro, *imu.accel),
            R=R if is_canonical and not np.array_equal(R, np.eye(3)) else None,
            possible=possible,
            usual=np.repeat([limits.usual_rate_radps, limits.usual_force_mps2], 3) / units,
            statistics=ChannelStatistics(np.repeat([imu.noise.gyro_white, imu.noise.accel_white], 3) / units),
            limit=possible,
        )

    def take(self, rows: Array) -> tuple[Array, list[ImuFault]]:
        """Take the next rows (n, 7), in order; return the measurements that are known to be such, and the faults."""
        measurements, faults = self.taken(rows)
        return measurements[1] if len(measurements) == 2 else np.concatenate(measurements), faults

    def taken(self, rows: Array) -> tuple[list[Array], list[ImuFault]]:
        """Do as :meth:`take`, and leave the measurements in parts, the first of which is empty."""
        measurements, faults = [np.empty((0, 7))], list[ImuFault]()
        blocks = 1
        while rows.shape[0]:
            plain = self._take_plain_blocks(rows[: blocks * BLOCK_ROWS])
            if plain:
                measurements.append(rows[: plain * BLOCK_ROWS])
                rows = rows[plain * BLOCK_ROWS :]
                blocks = min(2 * blocks, _MOST_BLOCKS)
                continue
            blocks = 1
            count = max(self.statistics.room - len(self.held), 1)
            sensed = self.in_sensor_axes(rows[:count])
            wild = np.abs(sensed[:, 1:] - self.centre) > self.limit
            odd = np.asarray(wild.any(axis=1))
            if self.far or odd.any():
                count = self._until_accepted(sensed, odd)
                sensed, wild, odd = sensed[:count], wild[:count], odd[:count]
            part, rows = rows[:count], rows[count:]
            if odd.any():
                faults.append(self._fault("impossible-value", part[odd, 0], wild[odd]))
                part, sensed = part[~odd], sensed[~odd]
            if len(part):
                measurements.append(self._judge(part, sensed, faults))
        return measurements, faults

    def _take_plain_blocks(self, rows: Array) -> int:
        """Take the first whole blocks of rows in which nothing is odd, and return how many: the usual ones, quickly."""
        statistics = self.statistics
        if len(rows) < BLOCK_ROWS or statistics.filled or statistics.interval_s is None or self.far or self._suspects:
            return 0
        values = self.in_sensor_axes(rows[: len(rows) // BLOCK_ROWS * BLOCK_ROWS])[:, 1:]
        count = _blocks_before(self._same(values))
        blocks = values[: count * BLOCK_ROWS].reshape(count, BLOCK_ROWS, 6)
        if count:
            block_statistics = statistics.after(blocks)
            centre = np.concatenate([self.centre[None], block_statistics.centre[:-1]])
            limit = np.concatenate([self.limit[None], self._limits(block_statistics.furthest[:-1])])
            count = _blocks_before((np.abs(blocks - centre[:, None]) > limit[:, None]).reshape(-1, 6))
        if count:
            statistics.become(block_statistics, count - 1)
            self._set_limits()
            self.before = blocks[count - 1, -1].copy()
            self.count += count * BLOCK_ROWS
        return count

    def finish(self) -> Array:
        """Return the rows that wait, at the end: they were not found to be faults."""
        rest, self.held, self.held_rows = self.held, self.held[:0], self.held_rows[:0]
        return rest

    @property
    def waiting_since_s(self) -> float:
        """Time of the first row that waits, s; infinite where none does."""
        return float(self.held[0, 0]) if len(self.held) else np.inf

    def in_sensor_axes(self, rows: Array) -> Array:
        """Return rows (n, 7) as the sensor has them, so that equal values are equal."""
        if self.R is None:
            return rows
        values = np.round(np.hstack([rows[:, 1:4] @ self.R, rows[:, 4:] @ self.R]), _DIGITS)
        return np.column_stack([rows[:, 0], values])

    def _fault(self, code: str, t: Array, bad: np.ndarray) -> ImuFault:
        """Return the fault of rows at ``t`` with ``bad`` (m, 6) values: columns in the order in which they went bad."""
        in_order = np.argsort(bad.argmax(axis=0), kind="stable")
        return ImuFault(code, t, tuple(self.columns[c] for c in in_order if bad[:, c].any()))

    def _until_accepted(self, sensed: Array, odd: np.ndarray) -> int:
        """Count in :attr:`far` the ``odd`` ones of rows (n,), which are far beyond; each other row takes one back.

        Return the number of rows up to the one with which values that are far beyond are accepted, or of all.
        """
        total = self.far + np.cumsum(np.where(odd, 1, -1))
        far = total - np.minimum(np.minimum.accumulate(total), 0)
        accepted = odd & (far * (self.statistics.interval_s or 0.0) > _BELIEVED_S)
        if not accepted.any():
            self.far = int(far[-1])
            return len(odd)
        last = int(accepted.argmax())
        furthest = np.abs(sensed[last, 1:] - self.centre)
        self.statistics.furthest = np.maximum(self.statistics.furthest, np.minimum(furthest, self.possible))
        self.far = 0
        self._set_limits()
        return last + 1

    def _set_limits(self) -> None:
        if self.statistics.interval_s is not None:
            self.centre, self.limit = self.statistics.centre, self._limits(self.statistics.furthest)

    def _limits(self, furthest: Array) -> Array:
        """Return how far from its centre a value may be, from how far any has been so far."""
        return np.clip(_FAR * furthest, self.usual, self.possible)

    @property
    def _suspects(self) -> bool:
        """Return whether a channel shows a value that it has shown before."""
        return any(plateau.level is not None for plateau in self.plateaus)

    def _same(self, values: Array) -> np.ndarray:
        """Return where values (n, 6) are those of the row before."""
        same = np.empty(values.shape, dtype=bool)
        np.equal(values[1:], values[:-1], out=same[1:])
        np.equal(values[0], self.before, out=same[0])
        return same

    def _judge(self, rows: Array, sensed: Array, faults: list[ImuFault]) -> Array:
        values = sensed[:, 1:]
        same = self._same(values)
        previous, self.before = self.before, values[-1].copy()
        begin = self.count
        self.count += len(rows)
        if not self._suspects and not same.any():
            self._learn(sensed)
            return rows
        every = np.concatenate([self.held, rows])
        numbers = np.concatenate([self.held_rows, np.arange(begin, self.count)])
        wrong = np.zeros((len(every), 6), dtype=bool)
        interval = self.statistics.interval_s
        patience = 0 if interval is None else round(_PATIENCE_S / interval)
        for c, (plateau, chance) in enumerate(zip(self.plateaus, self.statistics.chance, strict=True)):
            if plateau.level is None and not same[:, c].any():
                continue
            series = values[:, c].tolist()
            for first, end in plateau.take(series, begin, float(previous[c]), chance, patience):
                wrong[(numbers >= first) & (numbers < end), c] = True
        lost = wrong.any(axis=1)
        if lost.any():
            faults.append(self._fault("stuck-channel", every[lost, 0], wrong))
        waits = ~lost & (numbers >= min(plateau.held_from for plateau in self.plateaus))
        passes = ~lost & ~waits
        self.held, self.held_rows = every[waits], numbers[waits]
        out = every[passes]
        if len(out):
            self._learn(self.in_sensor_axes(out))
        return out

    def _learn(self, sensed: Array) -> None:
        completes = len(sensed) >= self.statistics.room
        self.statistics.learn(sensed)
        if completes:
            self._set_limits()


def _blocks_before(odd: np.ndarray) -> int:
    """Return how many blocks come before the first with anything odd. ``odd``: of values (n, 6) of whole blocks."""
    first = odd.any(axis=1).argmax() if odd.any() else len(odd)
    return int(first) // BLOCK_ROWS


def without_imu_faults(recording: Recording, limits: CheckLimits) -> Recording:
    """Return the recording without the rows of its IMU that are no measurements, and with a finding of each kind.

    A recording without faults is returned as it is.
    """
    imu = recording.description.imu
    faults = _faults(recording, limits)
    if not faults:
        return recording
    sound = ~np.isin(recording.imu["t_s"], np.concatenate([fault.t for fault in faults]))
    by_code = {code: [fault for fault in faults if fault.code == code] for code in _MEANINGS}
    return replace(
        recording,
        imu=recording.imu[sound].reset_index(drop=True),
        findings=(*recording.findings, *(_finding(imu, code, same) for code, same in by_code.items() if same)),
    )


def _faults(recording: Recording, limits: CheckLimits) -> list[ImuFault]:
    """Return the faults of a whole record."""
    imu, faults = recording.description.imu, list[ImuFault]()
    interpolated = interpolated_times(imu, _in_parts(recording))
    detector = ImuFaultDetector.of(imu, limits, is_canonical=True)
    for rows in _in_parts(recording):
        faults += detector.taken(rows[~np.isin(rows[:, 0], interpolated)] if interpolated.size else rows)[1]
    return [*faults, ImuFault("interpolated", interpolated, detector.columns)] if interpolated.size else faults


def _in_parts(recording: Recording) -> Iterator[Array]:
    """Yield the rows (n, 7) of the IMU some at a time: all of them side by side would be a copy of the record.

    In memory they lie column by column, as the detectors read them.
    """
    columns = [recording.imu[name].to_numpy() for name in IMU_COLUMNS]
    for begin in range(0, len(recording.imu), _ROWS_AT_A_TIME):
        yield np.array([column[begin : begin + _ROWS_AT_A_TIME] for column in columns]).T


_RANGE = "check the sensor's range and its wiring; sigmas are larger there"
_MEANINGS = {
    "stuck-channel": ("show one value again and again: stuck, or at the end of the range", _RANGE),
    "impossible-value": (
        "show values beyond what the sensor of a rail vehicle shows, or far beyond all before",
        _RANGE,
    ),
    "interpolated": (
        "lie on straight lines: holes were filled by interpolation",
        "leave holes in the file: they are bridged all the same, and check sees them",
    ),
}
"""What the columns of a fault do, and a hint, by its code."""


def _finding(imu: Imu, code: str, faults: list[ImuFault]) -> Finding:
    """Return the finding that rows with faults of one code were dropped."""
    columns = ", ".join(dict.fromkeys(name for fault in faults for name in fault.columns))
    count, first = sum(len(fault.t) for fault in faults), min(float(fault.t[0]) for fault in faults)
    meaning, hint = _MEANINGS[code]
    message = f"{count} row{'s' if count > 1 else ''} not used, and bridged: {columns} {meaning}"
    return Finding("warning", "imu-rows-dropped", message, file=imu.file, time_s=first, hint=hint)

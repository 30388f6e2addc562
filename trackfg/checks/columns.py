"""Faults of a single column that make its table unusable: each function takes an array and returns findings.

``place`` says where the array comes from. Rows in findings count from 1. :func:`memory_faults` are those of all tables
of a recording in memory.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from trackfg.checks.limits import CheckLimits
from trackfg.numerics.arrays import Array
from trackfg.numerics.chainage.passes import only_falls
from trackfg.numerics.spans import median_interval
from trackfg.numerics.units import known_units, to_si
from trackfg.recording.description import Imu, RecordingDescription
from trackfg.recording.findings import Finding, Level
from trackfg.recording.model import (
    FIX_COLUMNS,
    GNSS_COLUMNS,
    GNSS_SPEED_COLUMNS,
    IMU_COLUMNS,
    LASER_COLUMNS,
    SPEED_COLUMNS,
    TACH_COLUMNS,
    Recording,
)

LARGEST = 1e12
"""In any unit that a column may have; times are in s here."""
_FASTEST_S = 2e-4
"""No unit is proposed in which rows would be closer together, s: of two that fit, the slower rate is a sensor's."""
_HOUR_S = 3600.0
"""By what clocks are set to summer time, s."""
SMALLEST_SIGMA = 1e-9
"""No place is known to a nanometre, and no speed to one in a second. The square of its reciprocal, a weight, is far
from any limit of a number."""

_IN_MEMORY = {
    "imu": IMU_COLUMNS,
    "tach": TACH_COLUMNS,
    "fixes": FIX_COLUMNS,
    "gnss": GNSS_COLUMNS,
    "gnss_speed": GNSS_SPEED_COLUMNS,
    "speed": SPEED_COLUMNS,
    "laser": LASER_COLUMNS,
}
"""The columns of each kind of table in memory; the time is the first."""

FEWEST_ROWS = {"imu": 10, "tach": 2, "further_tach": 2, "laser": 4}
"""Fewer rows of these tables say nothing, by kind: no distance, nothing between places. Of others one row does."""

_SIGMA_UNITS = {"m": "m", "mps": "m/s"}
"""Units of sigmas in memory, by the end of the column's name."""


@dataclass(frozen=True)
class ColumnPlace:
    """The file and the name of a column, and the time of each row (n,), s, for the message; None if not known.

    Without a ``column`` it is the whole row.
    """

    file: str
    column: str | None
    t: Array | None = None

    def at_row(
        self, row: int, code: str, message: str, expected: str | None, hint: str | None, level: Level = "error"
    ) -> Finding:
        """Return a finding in the row of that index."""
        time = float(self.t[row]) if self.t is not None and np.isfinite(self.t[row]) else None
        finding = Finding(level, code, message, file=self.file, column=self.column, expected=expected, hint=hint)
        return replace(finding, row=row + 1, time_s=time)

    def at_first(
        self, wrong: NDArray[np.bool_], code: str, message: str, expected: str, hint: str, level: Level = "error"
    ) -> list[Finding]:
        """Return a finding in the first row marked in ``wrong``, with the number of such rows; none if no row is."""
        count = int(np.count_nonzero(wrong))
        if count > 1:
            message += f" ({count} such rows)"
        return [self.at_row(int(np.argmax(wrong)), code, message, expected, hint, level)] if count else []

    def at_first_value(
        self, values: Array, wrong: NDArray[np.bool_], code: str, message: str, expected: str, hint: str
    ) -> list[Finding]:
        """Return an error likewise, whose message begins with the value in that row."""
        if not wrong.any():
            return []
        return self.at_first(wrong, code, f"{values[np.argmax(wrong)]:.9g}: {message}", expected, hint)


def not_finite(values: Array, place: ColumnPlace) -> list[Finding]:
    """Return a finding each for empty cells or NaN, and for infinities or numbers that no quantity here can have."""
    magnitude = np.abs(values)
    if (magnitude <= LARGEST).all():
        return []
    empty = np.isnan(values)
    hint = "remove the row, or write the value"
    return [
        *place.at_first(empty, "nan", "empty or NaN", "a finite number", hint),
        *place.at_first(magnitude > LARGEST, "infinite", f"infinite, or above {LARGEST:g}", "a finite number", hint),
    ]


def interval_finding(
    interval_s: float, file: str, column: str, limits: CheckLimits, unit: str | None = None
) -> Finding | None:
    """Return an error where the IMU's rows have a median interval (s) that no sensor has; None where it is possible.

    ``unit`` is the declared one of the times, None where they are in s and cannot be declared otherwise.
    """
    low, high = limits.imu_interval_s
    if low <= interval_s <= high or not interval_s > 0.0:
        return None
    raw = interval_s / to_si("time", unit or "s")
    hint = "check the column of the times" if unit is None else "check the time column and imu.time_unit"
    other = next((name for name in known_units("time") if _FASTEST_S <= raw * to_si("time", name) <= high), None)
    if other is not None:
        factor = to_si("time", other)
        what = f"multiply the times by {factor:g}" if unit is None else f'set imu.time_unit = "{other}"'
        hint = f"the times look like {other}: {what}, and the sensor has {1.0 / (raw * factor):.4g} rows a second"
    message = f"rows are {interval_s:.4g} s apart (median), {1.0 / interval_s:.4g} a second"
    return Finding(
        "error", "time-unit", message, file=file, column=column, expected=f"{low:g} to {high:g} s", hint=hint
    )


def times_of_another_unit(t: Array, place: ColumnPlace, unit: str) -> list[Finding]:
    """Return an error where all times (n,), s, are beyond what can be: those since 1970 in a smaller unit than
    ``unit``, the declared one.
    """
    if not t.size or not (np.abs(t) > LARGEST).all():
        return []
    message, expected = f"{t[0]:.4g} s in the first row, as declared ({unit})", f"times below {LARGEST:g} s"
    hint = 'set time_unit of this table: "ms", "us" or "ns"'
    return [Finding("error", "time-unit", message, file=place.file, column=place.column, expected=expected, hint=hint)]


def not_increasing(t: Array, place: ColumnPlace) -> list[Finding]:
    """Return errors for times (n,), s, that repeat or fall from one row to the next."""
    steps = np.diff(t, prepend=-np.inf)
    if (steps > 0).all():
        return []
    expected = "times that grow from row to row"
    place = replace(place, t=t)
    hint = "remove the repeated rows, or give the time more digits"
    repeated = place.at_first(steps == 0, "time-repeated", "the time of the row before again", expected, hint)
    falls = steps < 0
    message = f"earlier than the row before, by {-steps[np.argmax(falls)]:.6g} s"
    hint = (
        "where a clock was set back, as at the end of summer time, add as much to the times of all later rows; else "
        "sort the rows by time"
    )
    return [*repeated, *place.at_first(falls, "time-falls", message, expected, hint)]


def gaps(t: Array, place: ColumnPlace, warning_s: float, error_s: float | None) -> list[Finding]:
    """Return a finding for the longest time without rows, where it is beyond the limits; ``t`` (n,), s."""
    if t.size < 2:
        return []
    steps = np.diff(t)
    longest = int(np.argmax(steps))
    gap = float(steps[longest])
    interval = float(np.median(steps))
    limit = max(warning_s, 3.0 * interval)
    if gap <= limit:
        return []
    is_error = error_s is not None and gap > error_s
    limit = error_s if is_error and error_s is not None else limit
    count = int(np.count_nonzero(steps > limit))
    more = f"; {count} gaps above {limit:.3g} s" if count > 1 else ""
    message, expected = f"no rows for {gap:.4g} s before this one{more}", f"at most {limit:.3g} s"
    hint = "recover the missing rows, or cut the recording in two here (docs/recording.md)" if is_error else None
    if is_error and abs(gap - _HOUR_S) < max(1.0, 3.0 * interval):
        hint = f"{hint}. A gap of an hour is where local times go over to summer time: import them with their time_zone"
    level: Level = "error" if is_error else "warning"
    return [replace(place, t=t).at_row(longest + 1, "gap", message, expected, hint, level)]


def unusable_sigmas(sd: Array, place: ColumnPlace, unit: str = "m") -> list[Finding]:
    """Return an error each for sigmas (n,) that are zero or negative, and that are too small for any place or speed."""
    hint = f"write the 1-sigma error in {unit}"
    tiny, expected = (sd > 0) & (sd < SMALLEST_SIGMA), f"{SMALLEST_SIGMA:g} {unit} or more"
    of_nothing = f"a sigma that no {'place' if unit == 'm' else 'speed'} has"
    return [
        *place.at_first_value(sd, sd <= 0, "bad-sigma", "a sigma that is zero or negative", "a number above 0", hint),
        *place.at_first_value(sd, tiny, "bad-sigma", of_nothing, expected, hint),
    ]


def falling(distance: Array, place: ColumnPlace) -> list[Finding]:
    """Return an error where a cumulative count or distance (n,) falls although the tach is declared unsigned."""
    hint = (
        "set tach.signed = true if the vehicle rolled back; a counter that wraps must be unwrapped first, as trackfg "
        "import does, with wraps_at in the mapping where it finds no modulus"
    )
    if only_falls(distance):
        hint = (
            "it never rises: negate it if it counts in the other sense, or set tach.signed = true, with which trackfg "
            "smooth finds its sense by the accelerometer"
        )
    expected = "a value that never falls, as tach.signed = false"
    back = np.diff(distance, prepend=-np.inf) < 0
    return place.at_first_value(distance, back, "tach-backwards", "the tach runs backwards", expected, hint)


_BACKWARDS = {
    "tach": ("tach-backwards", "the tach runs backwards"),
    "speed": ("speed-backwards", "the sensor sees it go backwards"),
}


def negative_speed(speed: Array, place: ColumnPlace, sensor: str = "tach") -> list[Finding]:
    """Return an error where a speed (n,) is below zero although the ``sensor``, a tach or one of the speed over ground,
    is declared unsigned.
    """
    hint = f"set {sensor}.signed = true if the vehicle rolled back"
    expected = f"a speed of zero or more, as {sensor}.signed = false"
    return place.at_first_value(speed, speed < 0, *_BACKWARDS[sensor], expected, hint)


def negative_magnitude(speed: Array, place: ColumnPlace) -> list[Finding]:
    """Return an error where speeds (n,) of a receiver, which measures a magnitude, are below zero."""
    hint = "leave the cell empty where the receiver has no speed"
    message, expected = "a receiver's speed below zero", "a speed of zero or more"
    return place.at_first_value(speed, speed < 0, "negative-speed", message, expected, hint)


def outside(values: Array, low: float, high: float, place: ColumnPlace) -> list[Finding]:
    """Return an error where latitudes or longitudes (n,), deg, do not exist."""
    wrong = (values < low) | (values > high)
    hint = 'check the order in gnss.position: latitude, longitude, height; for east, north, up set frame = "local"'
    expected = f"{low:g} to {high:g} deg"
    return place.at_first_value(values, wrong, "position-range", "no such position on the Earth", expected, hint)


def too_few_rows(file: str, kind: str, rows: int) -> list[Finding]:
    """Return an error where a table of a ``kind`` has so few rows that it says nothing."""
    fewest = FEWEST_ROWS.get(kind, 1)
    if rows >= fewest:
        return []
    message = "the table is empty" if rows == 0 else f"the table has {rows} row{'s' if rows > 1 else ''}"
    expected = f"at least {fewest} data row{'s' if fewest > 1 else ''}"
    hint = None if kind == "imu" else "leave the sensor out where it has given nothing"
    return [Finding("error", "empty-table", message, file=file, expected=expected, hint=hint)]


def memory_faults(recording: Recording, limits: CheckLimits) -> list[Finding]:
    """Return what a reader refuses in files, of a recording that was made from tables in memory.

    Tables of fixes, positions and speeds may be empty, as those of a part of a run are.
    """
    if not isinstance(recording.description, RecordingDescription):
        message, hint = (
            f"is of type {type(recording.description).__name__}",
            "RecordingDescription.model_validate makes one",
        )
        return [
            Finding(
                "error", "not-a-description", message, file="description", expected="a RecordingDescription", hint=hint
            )
        ]
    findings = []
    for name, table in recording.tables.items():
        kind = name.partition("/")[0]
        if kind not in _IN_MEMORY:
            continue
        if not getattr(recording.description, kind):
            message = f"the recording has this table, but its description has no [{kind}]"
            hint = f"describe it in the {kind} of RecordingDescription, or leave it out"
            findings.append(Finding("error", "missing-key", message, file=f"table {name!r}", hint=hint))
        findings += _table_faults(f"table {name!r}", table, _IN_MEMORY[kind])
        if kind in ("tach", "laser") and isinstance(table, pd.DataFrame):
            findings += too_few_rows(f"table {name!r}", kind, len(table))
    if not findings:
        findings += _imu_clock_faults(recording.imu["t_s"].to_numpy(), limits)
    return findings


def _imu_clock_faults(t: Array, limits: CheckLimits) -> list[Finding]:
    """Return errors for times (n,), s, at which no samples come: holes would be filled, one after the other, until no
    memory is left.
    """
    file, column = "table 'imu'", "t_s"
    interval = interval_finding(median_interval(t), file, column, limits)
    return (
        [interval] if interval is not None else gaps(t, ColumnPlace(file, column), limits.far_row_s, limits.far_row_s)
    )


def _table_faults(file: str, table: pd.DataFrame, names: tuple[str, ...]) -> list[Finding]:
    if not isinstance(table, pd.DataFrame):
        message = f"is of type {type(table).__name__}"
        return [Finding("error", "not-numeric", message, file=file, expected="a pandas.DataFrame")]
    missing = [name for name in names if name not in table.columns]
    if missing:
        message = "there is no such column"
        hint = "name the columns so; rates are in rad/s, forces in m/s^2, lengths in m and times in s"
        expected = ", ".join(names)
        return [Finding("error", "missing-column", message, file=file, column=missing[0], expected=expected, hint=hint)]
    findings = []
    for name in names:
        dtype = table[name].dtype
        if not pd.api.types.is_numeric_dtype(dtype) or not isinstance(dtype, np.dtype):
            message, expected = f"holds {dtype}", "numbers" + (", s" if name == names[0] else "")
            remedy = None
            if pd.api.types.is_numeric_dtype(dtype):
                expected, remedy = f"{expected}, as NumPy has them", "convert the table by astype('float64')"
            findings.append(
                Finding("error", "not-numeric", message, file=file, column=name, expected=expected, hint=remedy)
            )
    if findings:
        return findings
    t = table[names[0]].to_numpy(dtype=np.float64, na_value=np.nan)
    for name in names:
        values, place = table[name].to_numpy(dtype=np.float64, na_value=np.nan), ColumnPlace(file, name, t)
        findings += not_finite(values, place)
        _, is_sigma, unit = name.rpartition("_sd_")
        findings += unusable_sigmas(values, place, _SIGMA_UNITS[unit]) if is_sigma else []
    return findings if findings else not_increasing(t, ColumnPlace(file, names[0]))


def too_fast_hint(imu: Imu) -> str:
    """Return what to do about angular rates that no vehicle has: their unit is a smaller one than declared."""
    if imu.gyro_unit == "rad/s":
        return 'the data look like deg/s: set imu.gyro_unit = "deg/s"'
    another = 'import them with imu.gyro_unit = "mdeg/s", say, or with what one count is worth'
    return f"the data are in a smaller unit than deg/s: {another}"

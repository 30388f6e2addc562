"""From the tables as they were recorded to those of :mod:`trackfg.recording`: SI, FLU, one clock.

For each part of the description one function reads the columns, checks their structure (:mod:`trackfg.series_checks`)
and, if nothing is wrong, converts:

* time: ``t = raw * unit + time_offset_s``; an IMU stamp at the start or end of the interval that a sample averages is
  moved to its centre by half the median interval (not by each row's own, which would spread the stamps' jitter);
* IMU: ``x_body = R_mount A x_columns``, with A from ``axes`` and R_mount from ``mount_rpy_deg``;
* tach: pulses to ``count * pi * wheel_diameter_m / pulses_per_rev``; speed by the trapezoid rule, from 0;
* GNSS: geodetic to ENU about ``gnss.origin``, or the first row.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from trackfg import frames, series_checks, units
from trackfg.check_limits import CheckLimits
from trackfg.description import Fixes, Gnss, Imu, Laser, Model, Table, Tach
from trackfg.findings import Finding, errors
from trackfg.frames import Array
from trackfg.recording import FIX_COLUMNS, GNSS_COLUMNS, IMU_COLUMNS, LASER_COLUMNS, TACH_COLUMNS
from trackfg.table_file import TableFile, open_table

MIN_ROWS = {Imu: 10, Tach: 2}
"""Below it a table says nothing; other tables need one row."""


@dataclass(frozen=True)
class Columns:
    """A part's columns as recorded, structurally sound. ``t_s`` is in the file's clock, without ``time_offset_s``."""

    t_s: Array
    data: tuple[Array, ...]


def data_columns(part: Table) -> tuple[str, ...]:
    """The columns that a part of the description refers to, without the time."""
    match part:
        case Imu():
            return (*part.gyro, *part.accel)
        case Tach() | Laser():
            return (part.column,)
        case Fixes():
            return (part.chainage, part.sd)
        case Gnss():
            return (*part.position, *part.sd)
    return ()


class Tables:
    """The tables of one recording, each file opened once however many parts refer to it."""

    def __init__(self, folder: Path, parts: Iterable[Model]) -> None:
        self._folder = folder
        self._wanted: dict[str, list[str]] = {}
        self._opened: dict[str, tuple[TableFile | None, list[Finding]]] = {}
        for part in parts:
            if isinstance(part, Table):
                self._wanted.setdefault(part.file, []).extend((part.time, *data_columns(part)))

    def open(self, file: str) -> tuple[TableFile | None, list[Finding]]:
        """The open file, or None and why not."""
        if file not in self._opened:
            self._opened[file] = open_table(self._folder, file, self._wanted.get(file, ()))
        return self._opened[file]

    def columns(self, part: Table, limits: CheckLimits) -> tuple[Columns | None, list[Finding]]:
        """The part's columns, or None where one is unusable; and all that is wrong with their structure."""
        table, findings = self.open(part.file)
        if table is None:
            return None, findings
        read = {}
        for name in dict.fromkeys((part.time, *data_columns(part))):
            read[name], faults = table.numbers(name)
            findings = findings + faults
        raw_t = read[part.time]
        t = None if raw_t is None else raw_t * units.to_si("time", getattr(part, "time_unit", "s"))
        rows = next((values.size for values in read.values() if values is not None), None)
        if rows is not None and rows < (least := MIN_ROWS.get(type(part), 1)):
            message = "the table is empty" if rows == 0 else f"the table has {rows} row(s)"
            return None, [
                *findings,
                Finding("error", "empty-table", message, part.file, expected=f"at least {least} data row(s)"),
            ]
        for name, values in {**read, part.time: t}.items():
            if values is not None:
                findings = findings + series_checks.not_finite(
                    values, part.file, name, None if name == part.time else t
                )
        if t is not None and np.isfinite(t).all():
            findings = findings + series_checks.not_increasing(t, part.file, part.time)
            findings = findings + _gaps(part, t, limits)
        findings = findings + _value_checks(part, read, t)
        structural = [f for f in errors(findings) if f.code != "gap"]
        if structural or t is None:
            return None, findings
        return Columns(t, tuple(v for name in data_columns(part) if (v := read[name]) is not None)), findings


def _gaps(part: Table, t: Array, limits: CheckLimits) -> list[Finding]:
    match part:
        case Imu():
            return series_checks.gaps(t, part.file, part.time, limits.imu_gap_warning_s, limits.imu_gap_error_s)
        case Tach():
            return series_checks.gaps(t, part.file, part.time, limits.tach_gap_warning_s, None)
    return []


def _value_checks(part: Table, read: Mapping[str, Array | None], t: Array | None) -> list[Finding]:
    """What the values themselves must satisfy, part by part."""
    findings: list[Finding] = []
    sigmas = (part.sd,) if isinstance(part, Fixes) else part.sd if isinstance(part, Gnss) else ()
    for name in sigmas:
        if (sd := read[name]) is not None:
            findings += series_checks.not_positive(sd, part.file, name, t)
    if isinstance(part, Gnss) and part.frame == "geodetic":
        for name, limit in zip(part.position, ((-90.0, 90.0), (-180.0, 360.0)), strict=False):
            if (degrees := read[name]) is not None:
                findings += series_checks.outside(degrees, *limit, part.file, name, t)
    if isinstance(part, Tach) and not part.signed and (values := read[part.column]) is not None:
        check = series_checks.negative_speed if part.kind == "speed" else series_checks.falling
        findings += check(values, part.file, part.column, t)
    return findings


def imu_table(part: Imu, columns: Columns) -> pd.DataFrame:
    """The ``imu`` table."""
    shift = {"start": 0.5, "centre": 0.0, "end": -0.5}[part.stamp] * float(np.median(np.diff(columns.t_s)))
    R = imu_rotation(part)
    gyro = _rotated(columns.data[:3], R, units.to_si("angular rate", part.gyro_unit))
    accel = _rotated(columns.data[3:], R, units.to_si("acceleration", part.accel_unit))
    return _table(IMU_COLUMNS, _shifted(columns.t_s, part.time_offset_s + shift), *gyro, *accel)


def imu_rotation(part: Imu) -> Array:
    """The matrix from the file's columns to the vehicle's FLU axes, ``R_mount A``. Shape (3, 3)."""
    A = frames.axes_matrix(part.axes)
    if not any(part.mount_rpy_deg):
        return A
    roll, pitch, yaw = np.radians(part.mount_rpy_deg)
    return frames.matrix_from_rpy(roll, pitch, yaw) @ A


def _rotated(columns: tuple[Array, ...], R: Array, scale: float) -> list[Array]:
    """``scale * R`` applied to three columns, without arithmetic where it would change nothing (values stay exact)."""
    out = []
    for row in scale * R:
        used = np.flatnonzero(row)
        if used.size == 1:
            column = columns[used[0]]
            out.append(column if row[used[0]] == 1.0 else row[used[0]] * column)
        else:
            out.append(row[0] * columns[0] + row[1] * columns[1] + row[2] * columns[2])
    return out


def tach_table(part: Tach, columns: Columns) -> pd.DataFrame:
    """The ``tach`` table."""
    (values,) = columns.data
    if part.kind == "pulses":
        distance = values * pulse_m(part)
    elif part.kind == "distance":
        distance = _scaled(values, units.to_si("length", part.unit))
    else:
        speed = _scaled(values, units.to_si("speed", part.unit))
        steps = np.diff(columns.t_s) * 0.5 * (speed[1:] + speed[:-1])
        distance = np.concatenate([[0.0], np.cumsum(steps)])
    return _table(TACH_COLUMNS, _shifted(columns.t_s, part.time_offset_s), distance)


def pulse_m(part: Tach) -> float:
    """The nominal distance of one pulse, m. Raises ``ValueError`` unless the tach counts pulses."""
    if part.kind != "pulses" or part.wheel_diameter_m is None or part.pulses_per_rev is None:
        raise ValueError(f"a tach of kind {part.kind!r} has no pulses")
    return float(np.pi * part.wheel_diameter_m / part.pulses_per_rev)


def fix_table(part: Fixes, columns: Columns) -> pd.DataFrame:
    """The ``fixes`` table."""
    return _table(FIX_COLUMNS, _shifted(columns.t_s, part.time_offset_s), *columns.data)


def gnss_table(part: Gnss, columns: Columns) -> tuple[pd.DataFrame, Array | None]:
    """The ``gnss`` table and its origin (latitude deg, longitude deg, height m), None where that is not known."""
    origin = None if part.origin is None else np.array(part.origin)
    position = columns.data[:3]
    if part.frame == "geodetic":
        geodetic = np.column_stack(position)
        origin = geodetic[0] if origin is None else origin
        position = tuple(frames.geodetic_to_enu(geodetic, origin).T)
    return _table(GNSS_COLUMNS, _shifted(columns.t_s, part.time_offset_s), *position, *columns.data[3:]), origin


def laser_table(part: Laser, columns: Columns) -> pd.DataFrame:
    """The table of one laser."""
    (values,) = columns.data
    displacement = _scaled(values, units.to_si("length", part.unit))
    return _table(LASER_COLUMNS, _shifted(columns.t_s, part.time_offset_s), displacement)


def _scaled(values: Array, factor: float) -> Array:
    return values if factor == 1.0 else values * factor


def _shifted(t: Array, offset_s: float) -> Array:
    return t if offset_s == 0.0 else t + offset_s


def _table(names: tuple[str, ...], *columns: Array) -> pd.DataFrame:
    return pd.DataFrame(dict(zip(names, columns, strict=True)))

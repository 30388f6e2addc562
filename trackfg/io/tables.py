"""The tables of a recording, from its files to those of :mod:`trackfg.recording.model`.

For each part of the description one function reads the columns, checks their structure (:mod:`trackfg.checks.columns`)
and, if nothing is wrong, converts them by the formulas of :mod:`trackfg.recording.canonical`.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from trackfg.checks import columns
from trackfg.checks.limits import CheckLimits
from trackfg.io.table_file import TableFile, open_table
from trackfg.numerics import spans
from trackfg.numerics.arrays import Array
from trackfg.recording import canonical
from trackfg.recording.canonical import data_columns
from trackfg.recording.description import Fixes, Gnss, Imu, Laser, Model, Table, Tach
from trackfg.recording.findings import Finding, errors
from trackfg.recording.model import FIX_COLUMNS, GNSS_COLUMNS, IMU_COLUMNS, LASER_COLUMNS, TACH_COLUMNS

MIN_ROWS = {Imu: 10, Tach: 2}
"""Below it a table says nothing; other tables need one row."""


@dataclass(frozen=True)
class Columns:
    """A part's columns as recorded, structurally sound. ``t_s`` is in the file's clock, without ``time_offset_s``."""

    t_s: Array
    data: tuple[Array, ...]


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
        t = None if raw_t is None else canonical.seconds(part, raw_t)
        rows = next((values.size for values in read.values() if values is not None), None)
        if rows is not None and rows < (least := MIN_ROWS.get(type(part), 1)):
            message = "the table is empty" if rows == 0 else f"the table has {rows} row(s)"
            return None, [
                *findings,
                Finding("error", "empty-table", message, part.file, expected=f"at least {least} data row(s)"),
            ]
        for name, values in {**read, part.time: t}.items():
            if values is not None:
                findings = findings + columns.not_finite(values, part.file, name, None if name == part.time else t)
        if t is not None and np.isfinite(t).all():
            findings = findings + columns.not_increasing(t, part.file, part.time)
            findings = findings + _gaps(part, t, limits)
        findings = findings + _value_checks(part, read, t)
        structural = [f for f in errors(findings) if f.code != "gap"]
        if structural or t is None:
            return None, findings
        return Columns(t, tuple(v for name in data_columns(part) if (v := read[name]) is not None)), findings


def _gaps(part: Table, t: Array, limits: CheckLimits) -> list[Finding]:
    match part:
        case Imu():
            return columns.gaps(t, part.file, part.time, limits.imu_gap_warning_s, limits.imu_gap_error_s)
        case Tach():
            return columns.gaps(t, part.file, part.time, limits.tach_gap_warning_s, None)
    return []


def _value_checks(part: Table, read: Mapping[str, Array | None], t: Array | None) -> list[Finding]:
    """What the values themselves must satisfy, part by part."""
    findings: list[Finding] = []
    sigmas = (part.sd,) if isinstance(part, Fixes) else part.sd if isinstance(part, Gnss) else ()
    for name in sigmas:
        if (sd := read[name]) is not None:
            findings += columns.not_positive(sd, part.file, name, t)
    if isinstance(part, Gnss) and part.frame == "geodetic":
        for name, limit in zip(part.position, ((-90.0, 90.0), (-180.0, 360.0)), strict=False):
            if (degrees := read[name]) is not None:
                findings += columns.outside(degrees, *limit, part.file, name, t)
    if isinstance(part, Tach) and not part.signed and (values := read[part.column]) is not None:
        check = columns.negative_speed if part.kind == "speed" else columns.falling
        findings += check(values, part.file, part.column, t)
    return findings


def imu_table(part: Imu, columns: Columns) -> pd.DataFrame:
    """The ``imu`` table."""
    t = canonical.on_common_clock(part, columns.t_s, spans.median_interval(columns.t_s))
    return _table(IMU_COLUMNS, t, *canonical.imu_in_body(part, canonical.imu_rotation(part), columns.data))


def tach_table(part: Tach, columns: Columns) -> pd.DataFrame:
    """The ``tach`` table."""
    t = canonical.on_common_clock(part, columns.t_s)
    return _table(TACH_COLUMNS, t, canonical.tach_distance(part, t, columns.data[0]))


def fix_table(part: Fixes, columns: Columns) -> pd.DataFrame:
    """The ``fixes`` table."""
    return _table(FIX_COLUMNS, canonical.on_common_clock(part, columns.t_s), *columns.data)


def gnss_table(part: Gnss, columns: Columns) -> tuple[pd.DataFrame, Array | None]:
    """The ``gnss`` table and its origin (latitude deg, longitude deg, height m), None where that is not known."""
    origin = canonical.gnss_origin(part, columns.data)
    position = canonical.gnss_position(part, origin, columns.data)
    return _table(GNSS_COLUMNS, canonical.on_common_clock(part, columns.t_s), *position, *columns.data[3:]), origin


def laser_table(part: Laser, columns: Columns) -> pd.DataFrame:
    """The table of one laser."""
    t = canonical.on_common_clock(part, columns.t_s)
    return _table(LASER_COLUMNS, t, canonical.laser_displacement(part, columns.data[0]))


def _table(names: tuple[str, ...], *columns: Array) -> pd.DataFrame:
    return pd.DataFrame(dict(zip(names, columns, strict=True)))

"""The tables of a recording, each file opened once, and the columns of each sensor with all that is wrong with them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from trackfg.checks import columns
from trackfg.checks.columns import ColumnPlace
from trackfg.checks.limits import CheckLimits
from trackfg.io.formats.registry import format_of
from trackfg.io.formats.sensor_format import Converter, ReadColumns
from trackfg.io.table_file import TableFile, open_table
from trackfg.numerics.arrays import Array
from trackfg.numerics.spans import median_interval
from trackfg.recording import canonical
from trackfg.recording.description import Imu, Table
from trackfg.recording.findings import Finding, errors


@dataclass(frozen=True)
class Columns:
    """A sensor's columns as recorded, structurally sound. ``t_s`` is in the file's clock, without ``time_offset_s``."""

    t_s: Array
    data: tuple[Array, ...]


class Tables:
    """The tables of one recording, each file opened once however many sensors refer to it, and dropped after the last.

    The columns of each part are asked for once.
    """

    def __init__(self, folder: Path, parts: Iterable[Table]) -> None:
        self._folder = folder
        self._wanted: dict[str, list[str]] = {}
        self._opened: dict[str, tuple[TableFile | None, list[Finding]]] = {}
        self._awaited: Counter[str] = Counter()
        for part in parts:
            self._awaited[part.file] += 1
            self._wanted.setdefault(part.file, []).extend((part.time, *format_of(part).columns(part)))

    def _open(self, file: str) -> tuple[TableFile | None, list[Finding]]:
        """Return the open file, or None and why not."""
        opened = self._opened.pop(file, None) or open_table(self._folder, file, self._wanted.get(file, ()))
        self._awaited[file] -= 1
        if self._awaited[file] > 0:
            self._opened[file] = opened
        return opened

    def columns(self, part: Table, limits: CheckLimits) -> tuple[Columns | None, list[Finding]]:
        """Return the part's columns, or None where one is unusable; and all that is wrong with their structure."""
        table, findings = self._open(part.file)
        if table is None:
            return None, findings
        sensor, read = format_of(part), {}
        for name in dict.fromkeys((part.time, *sensor.columns(part))):
            read[name], faults = table.numbers(name)
            findings = findings + faults
        raw_t = read[part.time]
        t = None if raw_t is None else canonical.seconds(part, raw_t)
        rows = next((values.size for values in read.values() if values is not None), None)
        if rows is not None and (too_few := columns.too_few_rows(part.file, sensor.key, rows)):
            return None, [*findings, *too_few]
        other_unit = [] if t is None else self._in_another_unit(part, t, limits)
        for name, values in {**read, part.time: t}.items():
            if values is not None and not (other_unit and name == part.time):
                place = ColumnPlace(part.file, name, None if name == part.time else t)
                empty = np.isnan(values) & (name != part.time) & sensor.may_be_silent
                findings = findings + columns.not_finite(np.where(empty, 0.0, values), place)
        if other_unit:
            return None, [*findings, *other_unit]
        if t is not None and np.isfinite(t).all():
            t, spread = sensor.with_even_times(part, ReadColumns(t, read))
            findings = findings + spread
        if t is not None and np.isfinite(t).all():
            findings = findings + columns.not_increasing(t, ColumnPlace(part.file, part.time))
            if gap_limits := sensor.gap_limits_s(limits):
                findings = findings + columns.gaps(t, ColumnPlace(part.file, part.time), *gap_limits)
        findings = findings + sensor.value_faults(part, ReadColumns(t, read))
        structural = [f for f in errors(findings) if f.code != "gap"]
        if structural or t is None:
            return None, findings
        return Columns(t, tuple(v for name in sensor.columns(part) if (v := read[name]) is not None)), findings

    @staticmethod
    def _in_another_unit(part: Table, t: Array, limits: CheckLimits) -> list[Finding]:
        """Return an error where all times of a table, s, are beyond what can be; of the IMU its rate says more."""
        beyond = columns.times_of_another_unit(t, ColumnPlace(part.file, part.time), part.time_unit)
        if beyond and isinstance(part, Imu):
            interval = columns.interval_finding(median_interval(t), part.file, part.time, limits, part.time_unit)
            return beyond if interval is None else [interval]
        return beyond


def canonical_table(part: Table, columns: Columns) -> tuple[pd.DataFrame, Converter]:
    """Return the sensor's table as :mod:`trackfg.recording.model` has it, and the conversion after its last row."""
    sensor = format_of(part)
    converter, t = sensor.converter(part), sensor.on_common_clock(part, columns.t_s)
    data = (t, *converter(t, columns.data))
    table = pd.DataFrame(dict(zip(sensor.canonical, data, strict=True)), copy=False)
    return table.dropna(ignore_index=True) if sensor.may_be_silent else table, converter

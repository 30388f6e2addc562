"""Named arrays, as MATLAB, NumPy and HDF5 keep them, become tables: those of one length beside each other."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import pandas as pd

from trackfg.checks.limits import CheckLimits
from trackfg.interchange.importing.columns.time_columns import time_columns
from trackfg.interchange.importing.columns.written_units import factor_of
from trackfg.interchange.importing.source_table import SourceTable, column_of, holds_numbers

_FEWEST_ROWS = 2
_DATE = ("year", "month", "day", "hour", "minute", "second")
_DATE_BOUNDS = ((1970, 2100), (1, 12), (1, 31), (0, 23), (0, 59), (0, 60))
"""Least and greatest number of each part of a date."""
_RATE = re.compile(r"(fs|f_?s(ample)?|sampl\w*[ _]?(rate|freq\w*)|rate|srate)([ _]?hz)?", re.IGNORECASE)
"""Names of a number that is the sampling rate, Hz."""
_INTERVAL = re.compile(
    r"(d_?t|delta_?t|ts|t_?sample|sampl\w*[ _]?(interval|period|time)|time[ _]?step)([ _]?s)?", re.IGNORECASE
)
"""Names of a number that is the interval of samples, s."""


def names_rate(name: str) -> bool:
    """Return whether a number of this name is the sampling rate or the interval of samples."""
    return (_RATE.fullmatch(name) or _INTERVAL.fullmatch(name)) is not None


def tables_of_arrays(arrays: Mapping[str, Any], name: str, units: Mapping[str, str] | None = None) -> list[SourceTable]:
    """Return the tables of arrays by their paths (``imu/gyro``): arrays of one group and length are one table.

    An array (n, 3) or (3, n) is three columns x, y, z. A group without times gets those of another one of its length,
    if only one has any. Texts go beside numbers of their length. ``units`` are those that arrays state, by their paths.
    A sampling rate is that of the group, or of the array, that it stands in or at.
    """
    stated: dict[tuple[str, int], dict[str, str]] = {}
    groups: dict[tuple[str, int], dict[str, np.ndarray | pd.Series]] = {}
    for path, value in arrays.items():
        array = _by_rows(np.asarray(value))
        if array is not None:
            parent, _, leaf = path.rpartition("/")
            columns = _columns(leaf, array)
            groups.setdefault((parent, len(array)), {}).update(columns)
            if units is not None and path in units:
                stated.setdefault((parent, len(array)), {}).update(dict.fromkeys(columns, units[path]))
    groups = {key: columns for key, columns in groups.items() if holds_numbers(columns)}
    rates = dict(_rates(arrays, units or {}))
    parents = {parent for parent, _ in groups}
    tables = []
    for (parent, rows), columns in groups.items():
        alone = sum(other == parent for other, _ in groups) == 1
        parts = [name, *([parent] if len(parents) > 1 else []), *([] if alone else [f"{rows} rows"])]
        frame, of_columns = pd.DataFrame(columns), stated.get((parent, rows), {})
        tables.append(SourceTable("/".join(parts), frame, of_columns, remarks=_rates_of(parent, rates)))
    return _with_times(tables)


def _by_rows(array: np.ndarray) -> np.ndarray | pd.Series | None:
    """Return an array of numbers as (n,) or (n, columns), of texts as (n,); None for anything else."""
    if array.size < _FEWEST_ROWS or array.ndim not in (1, 2):
        return None
    if array.ndim == 2:
        array = array if array.shape[0] >= array.shape[1] else array.T
        if array.shape[1] > 1:
            return array if array.dtype.kind in "iufb" else None
        array = array[:, 0]
    return column_of(array)


def _columns(leaf: str, array: np.ndarray | pd.Series) -> Mapping[str, np.ndarray | pd.Series]:
    if isinstance(array, pd.Series) or array.ndim == 1:
        return {leaf: array}
    if _are_dates(array):
        return dict(zip(_DATE, array.T, strict=True))
    axes = "xyz" if array.shape[1] == 3 else [str(i + 1) for i in range(array.shape[1])]
    return {f"{leaf} {axis}": array[:, i] for i, axis in enumerate(axes)}


def _are_dates(array: np.ndarray) -> bool:
    """Return whether rows (n, 6) are those that MATLAB's ``datevec`` gives: year, month, day, hour, minute, second."""
    if array.shape[1] != len(_DATE) or not np.isfinite(array).all():
        return False
    whole, (low, high) = array[:, :-1], np.array(_DATE_BOUNDS).T
    return bool((whole == np.floor(whole)).all() and (array >= low).all() and (array <= high).all())


def _rates(arrays: Mapping[str, Any], units: Mapping[str, str]) -> Iterator[tuple[str, str]]:
    """Yield the paths of numbers that are a sampling rate, or the interval of samples, and what they say in words.

    An interval that no inertial sensor has is in a unit that nothing states.
    """
    shortest_s, longest_s = CheckLimits().imu_interval_s
    for path, value in arrays.items():
        leaf, number = path.rpartition("/")[2], np.asarray(value)
        if number.size != 1 or number.dtype.kind not in "iuf":
            continue
        size = float(number.ravel()[0])
        if _RATE.fullmatch(leaf):
            yield path, f"sampling rate: {size:.12g} Hz"
        elif _INTERVAL.fullmatch(leaf):
            seconds = size * (factor_of(units.get(path, "s"), "time") or 1.0)
            if shortest_s <= seconds <= longest_s:
                yield path, f"sampling interval: {seconds:.12g} s"


def _rates_of(parent: str, rates: Mapping[str, str]) -> str:
    """Return what is said of the sampling rate of a group: in it or at its arrays, else outside all groups, else
    anywhere.
    """
    within = [text for path, text in rates.items() if parent and path.startswith(f"{parent}/")]
    outside = [text for path, text in rates.items() if "/" not in path]
    return "\n".join(within or outside or rates.values())


def _with_times(tables: list[SourceTable]) -> list[SourceTable]:
    """Return the tables, those without times beside the only one of their length that has times."""
    timed = {table.name: time_columns(table) is not None for table in tables}
    out: list[SourceTable] = []
    for table in tables:
        same = [other for other in tables if timed[other.name] and len(other.frame) == len(table.frame)]
        if timed[table.name] or len(same) != 1:
            out.append(table)
            continue
        times = time_columns(same[0]) or ()
        clash = [column for column in times if column in table.columns]
        frame = table.frame if clash else pd.concat([same[0].frame[list(times)], table.frame], axis=1)
        of_times = {name: unit for name, unit in same[0].units.items() if name in times and not clash}
        out.append(SourceTable(table.name, frame, {**table.units, **of_times}, remarks=table.remarks))
    return out

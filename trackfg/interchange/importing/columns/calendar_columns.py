"""A date that a table has in parts becomes one column.

The parts are year, month, day, hour, minute and second, a column each, the week of GPS and the time in it, or a date
and a time of day in digits, as receivers write them (``010526``, ``031200.005``).
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import replace

import numpy as np
import pandas as pd

from trackfg.interchange.importing.source_table import SourceTable
from trackfg.interchange.importing.times import are_clock_digits, clock_ns, gps_ns

COMPOSED = "date_and_time_ns"
"""The column that is added: ns since 1970."""

_PARTS = ("year", "month", "day", "hour", "minute", "second")
_FRACTIONS = {"nano": 1, "nanosecond": 1, "microsecond": 1_000, "millisecond": 1_000_000}
"""Columns of what is beyond the whole seconds, ns."""


_WEEK = re.compile(r"(^|[\s_.]|gps)week(.?(no|num|number))?$", re.IGNORECASE)
_TIME_OF_WEEK = re.compile(
    r"(^|[\s_.]|gps)i?tow(_?m?s)?$|time.?of.?week|(week|gps).?(s|sec|seconds?|ms|time)$", re.IGNORECASE
)
_WEEK_S = 604_800.0
_FIRST_WEEK, _LAST_WEEK = 960, 4000
"""Weeks of GPS that are not taken for those of a year: 1998 to 2056."""


def with_whole_dates(table: SourceTable) -> SourceTable:
    """Return a table with the column :data:`COMPOSED` where it has all parts of a date, else the table as it is."""
    readings = (read(table) for read in (_of_the_week, _of_the_calendar, _of_digits))
    ns = next((ns for ns in readings if ns is not None), None)
    if ns is None:
        return table
    return replace(table, frame=table.frame.assign(**{COMPOSED: ns}), units={**table.units, COMPOSED: "ns"})


def parts_of_dates(table: SourceTable) -> set[str]:
    """Return the columns that :data:`COMPOSED` is made of, and others that are called as such."""
    names = [table.name_like(pattern) for pattern in (_WEEK, _TIME_OF_WEEK, _DATE, _CLOCK)]
    names += [_column(table, part) for part in (*_PARTS, *_FRACTIONS)]
    return {name for name in names if name is not None} if COMPOSED in table.columns else set()


def _of_the_week(table: SourceTable) -> np.ndarray | None:
    """Return the times (n,), ns since 1970, of a week of GPS and the time in it, s or ms; None without them."""
    names = [table.name_like(pattern) for pattern in (_WEEK, _TIME_OF_WEEK)]
    if None in names or names[0] == names[1]:
        return None
    columns = [table.frame[name] for name in names]
    if not _are_numbers(columns):
        return None
    week, time = (column.to_numpy(dtype=np.float64) for column in columns)
    if not ((week >= _FIRST_WEEK) & (week <= _LAST_WEEK) & (week == np.floor(week)) & (time >= 0.0)).all():
        return None
    seconds = time * (1e-3 if time.max() > _WEEK_S else 1.0)
    return gps_ns(week * _WEEK_S) + np.round(seconds * 1e9).astype(np.int64)


def _of_the_calendar(table: SourceTable) -> np.ndarray | None:
    """Return the times (n,), ns since 1970, of columns from the year to the second; None without them."""
    parts = [_column(table, part) for part in _PARTS]
    if any(part is None for part in parts):
        return None
    numbers = {part: table.frame[name] for part, name in zip(_PARTS, parts, strict=True)}
    if not _are_numbers(numbers.values()):
        return None
    whole = {part: np.floor(column).astype(np.int64) for part, column in numbers.items()}
    dates = pd.to_datetime(pd.DataFrame(whole), errors="coerce")
    if dates.isna().any():
        return None
    ns = dates.astype("datetime64[ns]").astype(np.int64).to_numpy()
    ns = ns + np.round((numbers["second"] - whole["second"]).to_numpy(dtype=np.float64) * 1e9).astype(np.int64)
    for fraction, factor in _FRACTIONS.items():
        name = _column(table, fraction)
        if name is not None and pd.api.types.is_integer_dtype(table.frame[name]):
            ns = ns + table.frame[name].to_numpy(dtype=np.int64) * factor
            break
    return np.asarray(ns)


_DATE = re.compile(r"date|datum|\bday$|ddmmyy|yymmdd", re.IGNORECASE)
_CLOCK = re.compile(r"time|utc|zeit|clock|hhmmss", re.IGNORECASE)
_ORDERS = ("%d%m%y", "%y%m%d", "%Y%m%d", "%d%m%Y")
"""Orders of a date in digits: NMEA's first. That of America is not taken for one."""
_OLDEST_YEAR = 2005
"""Year before which nothing was logged that is imported."""


def _of_digits(table: SourceTable) -> np.ndarray | None:
    """Return the times (n,), ns since 1970, of dates and times of day in digits; None without them.

    None as well where the digits can be two dates (``110512``).
    """
    date, clock = table.name_like(_DATE), table.name_like(_CLOCK)
    names = [name for name in (date, clock) if name is not None and date != clock]
    if len(names) < 2 or not _are_numbers(table.frame[name] for name in names):
        return None
    days, seconds = (table.numbers(name) for name in names)
    if not are_clock_digits(seconds, names[1]) or not (days == np.floor(days)).all() or not (days > 0).all():
        return None
    written = pd.Series(days.astype(np.int64)).drop_duplicates()
    if len(written) > 2:
        return None
    width = 6 if written.max() < 1_000_000 else 8
    text = written.astype(str).str.zfill(width)
    candidates = []
    for order in _ORDERS:
        if len(pd.Timestamp(2026, 1, 1).strftime(order)) == width:
            dates = pd.to_datetime(text, format=order, errors="coerce")
            if dates.notna().all() and dates.between(pd.Timestamp(_OLDEST_YEAR, 1, 1), pd.Timestamp.now()).all():
                candidates.append(dict(zip(written, dates.astype("datetime64[ns]").astype(np.int64), strict=True)))
    if len(candidates) != 1:
        return None
    ns = np.array([candidates[0][day] for day in days.astype(np.int64)], dtype=np.int64)
    return np.asarray(ns + clock_ns(seconds))


def _are_numbers(columns: Iterable[pd.Series]) -> bool:
    return all(pd.api.types.is_numeric_dtype(column) and column.notna().all() for column in columns)


def _column(table: SourceTable, part: str) -> str | None:
    return table.name_like(re.compile(rf"(^|[\s_.]){part}s?$", re.IGNORECASE))

"""A time that a table has in parts becomes one column.

The parts are year, month, day (or day of the year), hour, minute and second, a column each, the week of GPS and the
time in it, a date and a time of day in digits, as receivers write them (``010526``, ``031200.005``), or whole seconds
and a fraction of them, as ROS 2 has it (``stamp.sec``, ``stamp.nanosec``).
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import replace

import numpy as np
import pandas as pd

from trackfg.interchange.importing.columns.column_names import parts_of
from trackfg.interchange.importing.columns.written_units import factor_of
from trackfg.interchange.importing.source_table import SourceTable
from trackfg.interchange.importing.times.numeric_times import WEEK_S, are_clock_digits, clock_ns, gps_ns

COMPOSED = "date_and_time_ns"
"""The column that is added: ns since 1970, or of seconds alone since the zero that they count from."""

_PARTS = {
    "year": r"(?<!of[\s_.])year|jahr|ann[ée]e|a[ñn]o|anno",
    "month": "month|monat|mois|mese?",
    "day": "day|tag|jour|d[ií]a|giorno",
    "hour": "hour|hr|stunden?|heure|hora|ora",
    "minute": "minuten?|min|minuto",
    "second": "second|sec|sekunden?|seconde|segundo|secondo",
}
"""Parts of a date, and the names of their columns in English, German, French, Spanish and Italian. Without a month the
day is that of the year."""
_DAY_OF_YEAR = re.compile(r"(^|[\s_.])(doy|y(ear)?[\s_]?day|day[\s_]?of[\s_]?year|julian[\s_]?day)$", re.IGNORECASE)
_FRACTIONS = {"nano": 1, "nanosecond": 1, "microsecond": 1_000, "millisecond": 1_000_000}
"""Columns of what is beyond the whole seconds, ns."""
_OF_A_SECOND = re.compile(r"(?P<stem>.*?)(?P<part>nano|micro|milli|n|u|m)?sec(?:ond)?s?", re.IGNORECASE)
"""The name of whole seconds, which has no ``part``, or of what is beyond them."""
_PARTS_NS = {"nano": 1, "n": 1, "micro": 1_000, "u": 1_000, "milli": 1_000_000, "m": 1_000_000}
_SECOND_NS = 1_000_000_000
_BEYOND_SECONDS = {
    3: re.compile(r"(^|[\s_.])(ms|msecs?|millis?|milliseconds?)$", re.IGNORECASE),
    6: re.compile(r"(^|[\s_.])(us|µs|usecs?|micros?|microseconds?)$", re.IGNORECASE),
    9: re.compile(r"(^|[\s_.])(ns|nsecs?|nanos?|nanoseconds?)$", re.IGNORECASE),
}
"""Names of columns beside times of whole seconds, by how many decimals they give these."""
_UNIT_OF_DECIMALS = {3: "ms", 6: "us", 9: "ns"}
_WHOLE_SECONDS = r"(.*\D)?\d{1,2}:\d\d:\d\d"
_UNIX_S = (900_000_000, 4_000_000_000)
"""Whole seconds that are taken for those since 1970: 1998 to 2096."""
_DAY_S = 86_400
_OF_THE_DAY = re.compile(r"of.?(the.?)?day|midnight|mitternacht|tages(zeit|sek)|^(tod|sod)$", re.IGNORECASE)
"""Names of numbers that count from midnight."""
_DATE_ALONE = r"\d{4}-\d{1,2}-\d{1,2}|\d{1,2}[./]\d{1,2}[./]\d{4}"
_OFFSET = r"(?:UTC|GMT)?[+-]\d{2}:?\d{2}"
_DATE_AND_TIME = r"\d{4}-\d{2}-\d{2}[ T]\d{2}:\d{2}:\d{2}(?:[.,]\d+)?"
"""A date without an offset, behind which one may stand."""
_GROWING = 0.99
"""Share of rows that no earlier one follows: seconds of a minute fall in one of 60."""

_WEEK = re.compile(r"(^|[\s_.]|gps)(week|wnc?)(.?(no|num|number))?$", re.IGNORECASE)
_TIME_OF_WEEK = re.compile(
    r"(^|[\s_.]|gps)(i?tow|sow)(_?m?s)?$|(time|seconds?).?of.?week|(week|gps).?(s|sec|seconds?|ms|time)$",
    re.IGNORECASE,
)
_FIRST_WEEK, _LAST_WEEK = 960, 4000
"""Weeks of GPS that are not taken for those of a year: 1998 to 2056."""


def with_whole_dates(table: SourceTable) -> SourceTable:
    """Return a table with the column :data:`COMPOSED` where it has all parts of a date, else the table as it is.

    Times of whole seconds get the milli- or microseconds that stand in a column beside them, and dates the offset from
    UTC; seconds of the day beside a date become a time of day.
    """
    table = _with_offset(_with_clock(_with_decimals(table)))
    readings = (read(table) for read in (_of_the_week, _of_the_calendar, _of_serial_days, _of_digits, _of_seconds))
    ns = next((ns for ns in readings if ns is not None), None)
    if ns is None:
        return table
    return replace(table, frame=table.frame.assign(**{COMPOSED: ns}), units={**table.units, COMPOSED: "ns"})


def _with_decimals(table: SourceTable) -> SourceTable:
    """Return a table whose times of whole seconds have the milli-, micro- or nanoseconds of a column beside them."""
    columns = ((digits, table.name_like(pattern)) for digits, pattern in _BEYOND_SECONDS.items())
    digits, name = next(((digits, name) for digits, name in columns if name is not None), (0, None))
    if name is None or not pd.api.types.is_integer_dtype(table.frame[name]):
        return table
    clock = next((column for column in table.columns if _are_whole_seconds(table.frame[column])), None)
    if clock is None:
        return table
    part, cells = table.frame[name].to_numpy(dtype=np.int64), table.frame[clock]
    same_second = (cells.to_numpy()[1:] == cells.to_numpy()[:-1]).astype(bool)
    rises = np.diff(part)[same_second] >= 0
    if part.min() < 0 or part.max() >= 10**digits or not rises.size or rises.mean() <= _GROWING:
        return table
    if pd.api.types.is_integer_dtype(cells):
        whole, units = cells * 10**digits + part, {**table.units, clock: _UNIT_OF_DECIMALS[digits]}
    else:
        whole = cells + "." + pd.Series(part, index=cells.index).astype("string").str.zfill(digits)
        units = dict(table.units)
    return replace(table, frame=table.frame.assign(**{clock: whole}).drop(columns=name), units=units)


def _are_whole_seconds(column: pd.Series) -> bool:
    """Return whether a column has times in text, or since 1970 in numbers, of whole seconds."""
    if pd.api.types.is_string_dtype(column):
        return bool(column.str.fullmatch(_WHOLE_SECONDS).all())
    return pd.api.types.is_integer_dtype(column) and bool(column.between(*_UNIX_S).all())


def _with_clock(table: SourceTable) -> SourceTable:
    """Return a table with a time of day in text in place of seconds or milliseconds of the day beside a date."""
    name = table.name_like(_OF_THE_DAY)
    texts = [column for column in table.columns if pd.api.types.is_string_dtype(table.frame[column])]
    date = next((column for column in texts if table.frame[column].str.fullmatch(_DATE_ALONE).all()), None)
    if name is None or date is None or not _are_numbers([table.frame[name]]):
        return table
    stated = factor_of(table.units.get(name) or parts_of(name).unit, "time")
    values = table.numbers(name)
    seconds = values * (stated or (1.0 if values.max() < _DAY_S else 1e-3))
    if not ((seconds >= 0.0) & (seconds < _DAY_S)).all():
        return table
    clock = pd.to_datetime(np.round(seconds * 1e9).astype(np.int64)).strftime("%H:%M:%S.%f")
    units = {other: unit for other, unit in table.units.items() if other != name}
    return replace(table, frame=table.frame.assign(**{name: pd.Series(clock, dtype="string")}), units=units)


def _with_offset(table: SourceTable) -> SourceTable:
    """Return a table whose dates have the offset from UTC that stands in brackets in their name, or in a column beside
    them, in place of this.
    """
    texts = [column for column in table.columns if pd.api.types.is_string_dtype(table.frame[column])]
    named = next((column for column in texts if re.fullmatch(_OFFSET, table.units.get(column, ""))), None)
    if named is not None and table.frame[named].str.fullmatch(_DATE_AND_TIME).all():
        units = {name: unit for name, unit in table.units.items() if name != named}
        zoned = table.frame[named] + re.sub("^(UTC|GMT)", "", table.units[named])
        return replace(table, frame=table.frame.assign(**{named: zoned}), units=units)
    offset = next((column for column in texts if table.frame[column].str.fullmatch(_OFFSET).all()), None)
    dates = next((column for column in texts if table.frame[column].str.fullmatch(_DATE_AND_TIME).all()), None)
    if offset is None or dates is None:
        return table
    zoned = table.frame[dates] + table.frame[offset].str.replace(r"^(UTC|GMT)", "", regex=True)
    return replace(table, frame=table.frame.assign(**{dates: zoned}).drop(columns=offset))


def parts_of_dates(table: SourceTable) -> set[str]:
    """Return the columns that :data:`COMPOSED` is made of, and others that are called as such."""
    names = [table.name_like(pattern) for pattern in (_WEEK, _TIME_OF_WEEK, _DATE, _CLOCK)]
    names += [_column(table, part) for part in (*_PARTS.values(), *_FRACTIONS)]
    names += [table.name_like(_DAY_OF_YEAR), *(_seconds_and_part(table) or ())[:2]]
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
    seconds = time * (1e-3 if time.max() > WEEK_S else 1.0)
    return gps_ns(week * WEEK_S) + np.round(seconds * 1e9).astype(np.int64)


def _of_the_calendar(table: SourceTable) -> np.ndarray | None:
    """Return the times (n,), ns since 1970, of columns from the year to the second; None without them."""
    names = {part: _column(table, words) for part, words in _PARTS.items()}
    day_of_year = table.name_like(_DAY_OF_YEAR) or (names["day"] if names["month"] is None else None)
    if day_of_year is not None:
        names |= {"month": day_of_year, "day": day_of_year}
    numbers = {part: table.frame[name] for part, name in names.items() if name is not None}
    if len(numbers) < len(_PARTS) or not _are_numbers(numbers.values()):
        return None
    whole = pd.DataFrame({part: np.floor(column).astype(np.int64) for part, column in numbers.items()})
    if day_of_year is not None:
        dates = pd.to_datetime(whole.assign(month=1, day=1), errors="coerce") + pd.to_timedelta(whole["day"] - 1, "D")
    else:
        dates = pd.to_datetime(whole, errors="coerce")
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
_DAYS_TO_1970, _DAY_NS = 25_569, _DAY_S * _SECOND_NS
_OLDEST_DAY, _NEWEST_DAY = 38_000, 60_000
"""Days of a spreadsheet, since 1899-12-30, that are taken for dates: 2004 to 2064."""
_OLDEST_YEAR = 2005
"""Year before which nothing was logged that is imported."""


def _of_serial_days(table: SourceTable) -> np.ndarray | None:
    """Return the times (n,), ns since 1970, of a date and a time of day in a spreadsheet's days; None without them."""
    names = [name for name in (table.name_like(_DATE), table.name_like(_CLOCK)) if name is not None]
    if len(set(names)) < 2 or not _are_numbers(table.frame[name] for name in names):
        return None
    days, part = (table.numbers(name) for name in names)
    dated = (days == np.floor(days)).all() and ((days > _OLDEST_DAY) & (days < _NEWEST_DAY)).all()
    if not dated or not ((part >= 0.0) & (part < 1.0)).all() or not (np.diff(days + part) >= 0.0).mean() > _GROWING:
        return None
    whole = (days.astype(np.int64) - _DAYS_TO_1970) * _DAY_NS
    return np.asarray(whole + np.round(part * _DAY_NS).astype(np.int64))


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


def _of_seconds(table: SourceTable) -> np.ndarray | None:
    """Return the times (n,), ns, of whole seconds and what is beyond them, in two columns; None without them."""
    names = _seconds_and_part(table)
    if names is None or not all(pd.api.types.is_integer_dtype(table.frame[name]) for name in names[:2]):
        return None
    seconds, part = (table.frame[name].to_numpy(dtype=np.int64) for name in names[:2])
    ns = seconds * _SECOND_NS + part * names[2]
    fits = part.size > 1 and part.min() >= 0 and part.max() * names[2] < _SECOND_NS
    return ns if fits and (np.diff(ns) >= 0).mean() > _GROWING else None


def _seconds_and_part(table: SourceTable) -> tuple[str, str, int] | None:
    """Return the columns of whole seconds and of what is beyond them, and the unit of these, ns; None without them."""
    matches = [match for name in table.columns if (match := _OF_A_SECOND.fullmatch(name))]
    whole = {match["stem"]: match.string for match in matches if match["part"] is None}
    parts = [match for match in matches if match["part"] is not None and match["stem"] in whole]
    return next(((whole[match["stem"]], match.string, _PARTS_NS[match["part"].casefold()]) for match in parts), None)


def _are_numbers(columns: Iterable[pd.Series]) -> bool:
    return all(pd.api.types.is_numeric_dtype(column) and column.notna().all() for column in columns)


def _column(table: SourceTable, words: str) -> str | None:
    return table.name_like(re.compile(rf"(^|[\s_.])({words})s?$", re.IGNORECASE))

"""Which columns of a foreign table are its times, and in which unit they count."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd

from trackfg.checks.limits import CheckLimits
from trackfg.errors import BadInputError
from trackfg.interchange.importing.columns.calendar_columns import COMPOSED
from trackfg.interchange.importing.columns.column_names import meaning, parts_of
from trackfg.interchange.importing.columns.written_units import factor_of
from trackfg.interchange.importing.source_table import ROW_NUMBER, SourceTable
from trackfg.interchange.importing.times.clock import Times, stated_day
from trackfg.interchange.importing.times.numeric_times import (
    are_clock_digits,
    are_gps_seconds,
    guessed_unit,
    tick_of_dates,
)
from trackfg.interchange.importing.times.reading import times_by_keys
from trackfg.interchange.importing.times.written_times import are_dates, are_durations
from trackfg.interchange.importing.times.zones import states_zone

_TIME_UNITS = {1.0: "s", 1e-3: "ms", 1e-6: "us", 1e-9: "ns"}
_COUNTER = re.compile(r"^(sample|packet|frame|msg|message|seq(uence)?|row|index|idx|nr|no|n|#|record|line|count(er)?|"
                      r"cnt)[\s_]*(no|nr|num(ber)?|index|idx|id|count(er)?|#)?\.?$", re.IGNORECASE)  # fmt: skip
"""Names of columns that count samples."""
_TICKS_S = {"sampletimefine": (1e-4, 1e-6)}
"""Counters whose tick is known, s: Xsens counts 100 us (MT Low-Level Communication Protocol, XDI_SampleTimeFine), or
1 us in a DOT."""
_GPS = re.compile(r"gps(?!.*(unix|utc|epoch|posix))", re.IGNORECASE)
"""The name of a time that may count from the epoch of GPS."""
_RATE = re.compile(
    r"(?:(?:sampl\w*|update|output|data|abtast\w*|mess\w*|log\w*)[\s_-]*(?:rate|freq\w*|frequenz)?|fs|freq\w*)"
    r"[^\d\n]{0,12}?(\d+(?:[.,]\d+)?)\s*(k?)(?:hz|sps|s/s|samples)",
    re.IGNORECASE,
)
"""The sampling rate in the remarks above a table."""
_INTERVAL = re.compile(
    r"(?:delta_x|(?:sampl\w*|abtast)[\s_-]*(?:interval\w*|period|zeit|time))"
    r"[^\d\n]{0,12}?(\d+(?:[.,]\d*)?(?:e[+-]?\d+)?)[\t ]*(ms|us|µs|s|$)?(?![\w/])",
    re.IGNORECASE | re.MULTILINE,
)
"""The interval of samples in these remarks, in s unless stated; LabVIEW calls it Delta_X."""


_STATED_TICK = re.compile(r"^tscale\W(\d+(?:\.\d*)?(?:e[+-]?\d+)?)\s*$", re.IGNORECASE | re.MULTILINE)
"""Length of a tick of the times above the table of a GCSV log (Gyroflow), s."""
_DISPLACED = 0.05
"""Share of rows that are earlier than the one before; a time that starts again has fewer."""
_MEASURED = re.compile(r"header[\s_./]*stamp$")
"""The time at which a ROS message was measured; others as fine, such as ``%time``, say when it was received."""
_ENDS, _SAME_S = 100, 1e-6
"""Rows at the beginning and at the end of a table by which two clocks are compared, and how far they differ, s."""
_COARSER = 2
"""A number that has less than half as many values as a date beside it is the time of something else, as of a phone's
last position."""


def time_columns(table: SourceTable) -> tuple[str, ...] | None:
    """Return the column of the time, or those of date and time of day; None where none is found.

    A date that was put together of its parts is preferred, unless it is coarser than another time, then a column whose
    name means a time, of several the finest one, a number rather than a text as fine, and that of the measurement
    rather than of its receipt; dates take the place of a number from a zero of its own that says the same. Else it is
    the first whose cells are dates with a time of day; else the first that grows steadily and does not count samples.
    """
    named = [name for name in table.columns if meaning(name) == "time" or name.casefold() in _TICKS_S]
    named = [name for name in named if name != COMPOSED and table.frame[name].notna().any()]
    if COMPOSED in table.columns and not any(_is_finer(table, name, COMPOSED) for name in named):
        return (COMPOSED,)
    text = [name for name in named if pd.api.types.is_string_dtype(table.frame[name])]
    if len(text) >= 2:
        first, second = (str(table.frame[name].iloc[0]) for name in text[:2])
        if ":" not in first and ":" in second:
            return (text[0], text[1])
        if ":" in first and ":" not in second:
            return (text[1], text[0])
    numeric = [name for name in named if name not in text and _grows(table.numbers(name))]
    if numeric:
        finest = max(numeric, key=lambda name: (_resolution(table.numbers(name)), bool(_MEASURED.search(name))))
        dates = [name for name in text if are_dates(table.frame[name])]
        coarse = bool(dates) and _COARSER * _resolution(table.numbers(finest)) < table.frame[dates[0]].nunique()
        return (dates[0] if coarse else _date_that_goes_with(table, finest, named) or finest,)
    if not text:
        text = [name for name in table.columns if _holds_dates(table.frame[name])]
    if text:
        return (text[0],)
    return next(
        ((name,) for name in table.columns if pd.api.types.is_numeric_dtype(table.frame[name])
         and not _COUNTER.match(name) and len(table.frame) > 2 and not _counts_rows(table.frame[name])
         and _grows(table.numbers(name)) and _steady(table.numbers(name))),
        None,
    )  # fmt: skip


def _date_that_goes_with(table: SourceTable, name: str, named: list[str]) -> str | None:
    """Return the column of dates that says the same as a time from a zero of its own: from row to row they differ by
    less than a microsecond at the beginning and at the end of the table. None without one.
    """
    ends = replace(table, frame=pd.concat([table.frame.head(_ENDS), table.frame.tail(_ENDS)]))
    others = [other for other in named if other != name and ends.frame[other].notna().all()]
    clocks = {other: clock for other in (name, *others) if (clock := _times_if_read(ends, other)) is not None}
    if name not in clocks or not clocks[name].have_own_zero:
        return None
    steps = np.diff(clocks[name].since(None))
    dates = {other: np.diff(clock.ns) / 1e9 for other, clock in clocks.items() if clock.ns is not None}
    return next((other for other, of_date in dates.items() if np.abs(of_date - steps).max() < _SAME_S), None)


def _times_if_read(table: SourceTable, name: str) -> Times | None:
    try:
        return times_in(table, (name,))
    except BadInputError:
        return None


def _is_finer(table: SourceTable, name: str, date: str) -> bool:
    """Return whether a column of numbers is a time with more than twice the values of a date."""
    if not pd.api.types.is_numeric_dtype(table.frame[name]) or not _grows(table.numbers(name)):
        return False
    return _resolution(table.numbers(name)) > _COARSER * table.frame[date].nunique()


def _counts_rows(column: pd.Series) -> bool:
    """Return whether whole numbers rise by one from row to row: where no name says a time, they are those of rows."""
    return pd.api.types.is_integer_dtype(column) and _counts(column.to_numpy(dtype=np.float64))


def _holds_dates(column: pd.Series) -> bool:
    return pd.api.types.is_string_dtype(column) and are_dates(column)


def is_sample_counter(table: SourceTable, name: str) -> bool:
    """Return whether a column counts the rows, by its name and its values."""
    return (
        bool(_COUNTER.match(name)) and pd.api.types.is_integer_dtype(table.frame[name]) and _counts(table.numbers(name))
    )


def counter_of(table: SourceTable) -> str:
    """Return the column that counts samples, also one that starts again; else :data:`~.ROW_NUMBER`."""
    return next((name for name in table.columns if is_sample_counter(table, name)), ROW_NUMBER)


def stalled_times(table: SourceTable) -> tuple[str, int] | None:
    """Return a column named as a time that does not grow, for want of digits, and how many values it has; else None."""
    for name in table.columns:
        if meaning(name) == "time" and pd.api.types.is_numeric_dtype(table.frame[name]):
            return name, _resolution(table.numbers(name))
    return None


def refuse_displaced_times(table: SourceTable) -> None:
    """Raise :class:`BadInputError` where a column named as a time would grow steadily if its rows were in sequence."""
    for name in table.columns:
        if meaning(name) == "time" and pd.api.types.is_numeric_dtype(table.frame[name]):
            values = table.numbers(name)
            falls = np.diff(values) < 0.0
            if falls.mean() > _DISPLACED and _steady(np.sort(values)):
                row = table.first_row + int(np.argmax(falls)) + 1
                raise BadInputError(
                    f"{table.name}: column {name!r}, row {row}: earlier than the row before "
                    f"({np.count_nonzero(falls)} such rows); expected times that grow from row to row. Hint: sort the "
                    "rows by time"
                )


def stated_rate_hz(table: SourceTable) -> float | None:
    """Return the sampling rate that the remarks above a table state, Hz, as such or by the interval of samples; None
    where they state none, or several.
    """
    rates = {float(m[1].replace(",", ".")) * (1e3 if m[2] else 1.0) for m in _RATE.finditer(table.remarks)} - {0.0}
    if not rates:
        stated = ((float(m[1].replace(",", ".")), m[2] or "s") for m in _INTERVAL.finditer(table.remarks))
        rates = {1.0 / (interval * (factor_of(unit, "time") or 1.0)) for interval, unit in stated if interval}
    return rates.pop() if len(rates) == 1 else None


def _grows(values: np.ndarray) -> bool:
    step = np.diff(values)
    return bool(np.isfinite(values).all() and values.size > 1 and (step >= 0).mean() > 0.99 and (step > 0).any())


def _counts(values: np.ndarray) -> bool:
    """Return whether values mostly rise by one."""
    return values.size > 1 and bool((np.diff(values) == 1.0).mean() > 0.9)


def _resolution(values: np.ndarray) -> int:
    """Return how many different values there are: a Unix time in ms is finer than a counter of seconds."""
    return int(np.unique(values).size)


def _steady(values: np.ndarray) -> bool:
    step = np.diff(values)
    return bool((step > 0).all() and np.median(np.abs(step - np.median(step))) < 0.2 * np.median(step))


def times_in(table: SourceTable, columns: tuple[str, ...]) -> Times:
    """Read the times in such columns of a table in their probable unit. Raises as :func:`times_by_keys` does."""
    return times_by_keys(table, {"time": columns, **time_unit(table, columns)})


def time_unit(
    table: SourceTable, columns: tuple[str, ...], beside: tuple[SourceTable, str] | None = None
) -> dict[str, Any]:
    """Return ``time_unit`` of a numeric column of times, and ``tick_s`` of ticks; nothing for text.

    It is that of its name, its stated unit, its values or the sampling rate in the remarks. ``beside``: the table of
    the inertial sensor and its column of times, which events within it are counted like.
    """
    name = columns[0]
    if len(columns) == 2 or pd.api.types.is_string_dtype(table.frame[name]):
        return {}
    if (ticks := _TICKS_S.get(name.casefold())) is not None:
        step, (_, slowest_s) = float(np.median(np.diff(table.numbers(name)))), CheckLimits().imu_interval_s
        return {"time_unit": "ticks", "tick_s": next((tick for tick in ticks if step * tick <= slowest_s), ticks[-1])}
    stated, values = table.units.get(name) or parts_of(name).unit, table.numbers(name)
    factor = factor_of(stated, "time")
    if _GPS.search(name):
        scales = _TIME_UNITS if factor is None else (factor,)
        since_1980 = next((scale for scale in scales if are_gps_seconds(values * scale)), None)
        if since_1980 is not None:
            return {"time_unit": "gps"} | ({} if since_1980 == 1.0 else {"tick_s": since_1980})
    if (tick := tick_of_dates(values)) is not None:
        return {"time_unit": "ticks", "tick_s": tick}
    if factor in _TIME_UNITS:
        return {"time_unit": _TIME_UNITS[factor]}
    if factor is not None:
        return {"time_unit": "ticks", "tick_s": factor}
    if stated.casefold().replace(".", "").startswith("hhmmss") or are_clock_digits(values, name):
        return {"time_unit": "hhmmss"}
    if beside is not None and not pd.api.types.is_string_dtype(beside[0].frame[beside[1]]):
        t = beside[0].numbers(beside[1])
        if np.nanmin(t) <= np.nanmin(values) and np.nanmax(values) <= np.nanmax(t):
            return time_unit(beside[0], (beside[1],))
    if (stated_tick := _STATED_TICK.search(table.remarks)) is not None:
        return {"time_unit": "ticks", "tick_s": float(stated_tick[1])}
    return _by_rate(table, values) or {"time_unit": guessed_unit(values)}


def _by_rate(table: SourceTable, values: np.ndarray) -> dict[str, Any] | None:
    """Return the unit in which times have the sampling rate that the table states; None where none does."""
    rate = stated_rate_hz(table)
    step = np.diff(values)
    typical = float(np.median(step[step > 0])) if (step > 0).any() else 0.0
    if rate is None or typical == 0.0:
        return None
    return next(
        ({"time_unit": unit} for factor, unit in _TIME_UNITS.items() if 0.9 < typical * factor * rate < 1.1), None
    )


def states_no_zone(table: SourceTable, time: str | list[str], unit: str | None) -> bool:
    """Return whether the times of a table are dates, or times of a day that lines above state, of an unstated zone."""
    columns = [time] if isinstance(time, str) else time
    stated = [name.casefold() for name in (*columns, *map(table.units.get, columns)) if name]
    if any("utc" in name or "gmt" in name for name in stated) or not set(columns) <= set(table.columns):
        return False
    if unit == "days":
        return True
    column = table.frame[columns[-1]]
    if not pd.api.types.is_string_dtype(column):
        return False
    cells = column.dropna()
    if are_durations(cells.iloc[:1]):
        return False
    cell = "" if cells.empty else str(cells.iloc[0]).strip()
    is_date = len(columns) == 2 or not re.fullmatch(r"[\d:.,]+", cell) or stated_day([table.remarks]) is not None
    return is_date and not states_zone(cell)

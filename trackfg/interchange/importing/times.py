"""Times of a source become seconds: numbers in a unit, dates, times of day, sample counters that wrap.

Dates are kept as whole nanoseconds since 1970 (UTC) until the recording's start is taken off, so that nothing is lost
to rounding. Stamps that repeat, because they are written more coarsely than samples are taken, are spread again.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime, tzinfo
from zoneinfo import ZoneInfo, ZoneInfoNotFoundError

import numpy as np
import pandas as pd

from trackfg.errors import BadInputError, printable
from trackfg.interchange.importing.source_table import SourceTable
from trackfg.numerics.arrays import Array

UNIT_S = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
"""Units of numeric times, s."""

_NS_PER = {"s": 1_000_000_000, "ms": 1_000_000, "us": 1_000, "ns": 1}

_SPREADSHEET_EPOCH_DAYS = 25_569
"""Days from 1899-12-30, which spreadsheets count from, to 1970-01-01."""
_SPREADSHEET_DAYS = (2e4, 8e4)
"""Numbers that are taken for such days where they grow by less than 10 s: 1954 to 2119."""
_EPOCH_S = (0.9e9, 4.0e9)
"""Numbers of seconds that are taken for a Unix time: 1998 to 2096."""

_GPS_EPOCH = np.datetime64("1980-01-06T00:00:00", "ns")
_GPS_LEAP_S = 18
"""GPS is ahead of UTC by so much since 2017 (IERS Bulletin C 52 to 70 announce no further one)."""

_DATE_FORMATS = (
    "ISO8601",
    "%d.%m.%Y %H:%M:%S.%f",
    "%d.%m.%Y %H:%M:%S",
    "%Y/%m/%d %H:%M:%S.%f",
    "%Y/%m/%d %H:%M:%S",
    "%d/%m/%Y %H:%M:%S.%f",
    "%d/%m/%Y %H:%M:%S",
    "%m/%d/%Y %I:%M:%S.%f %p",
    "%m/%d/%Y %I:%M:%S %p",
    "%Y%m%d %H%M%S.%f",
    "%Y%m%d_%H%M%S.%f",
    "%m/%d/%Y %H:%M:%S.%f",
    "%m/%d/%Y %H:%M:%S",
)
"""Tried in this order. A date with slashes is day first where it can be; with AM or PM it is month first."""

_CLOCK_FORMATS = ("%H:%M:%S.%f", "%H:%M:%S")
_DAY_S = 86_400
_DAY_NS = _DAY_S * 1_000_000_000


@dataclass(frozen=True)
class TimeNotation:
    """How a source writes its times.

    ``unit`` is one of ``s, ms, us, ns`` for numbers, which are Unix times where they are as large as those; ``"gps"``
    for seconds since the GPS epoch; ``"days"`` for those of spreadsheets, since 1899-12-30; ``"ticks"`` for a counter
    of ``tick_s`` that starts again at ``wraps_at``.
    ``format`` is a ``strptime`` format for text, or None to find it out. ``zone`` is where times without one were
    written.
    """

    unit: str | None = None
    format: str | None = None
    zone: str = "UTC"
    tick_s: float | None = None
    wraps_at: float | None = None


@dataclass(frozen=True)
class Times:
    """Times are either on the calendar, ``ns`` (n,) since 1970 UTC, or ``seconds`` (n,) from a zero of their own.

    That zero is midnight where they are times of day, written in ``zone``.
    """

    ns: np.ndarray | None
    seconds: Array | None
    zone: tzinfo | None = None

    def since(self, start_ns: int | None) -> Array:
        """Return seconds since ``start_ns``, or since their own zero where they are not on the calendar."""
        if self.ns is None:
            assert self.seconds is not None
            return self.seconds
        return np.asarray((self.ns - (start_ns or 0)) / 1e9)

    @classmethod
    def after(cls, start_ns: int | None, seconds: Array, zone: tzinfo | None) -> Times:
        """Return times that :meth:`since` turns into ``seconds`` (n,); None: they are not on the calendar."""
        if start_ns is None:
            return cls(None, seconds, zone)
        return cls(start_ns + np.round(seconds * 1e9).astype(np.int64), None)

    def beside(self, others: Sequence[Times]) -> Times:
        """Return times of day on the day of ``others``: the first of those with dates, else the first times of day.

        They begin less than half a day before or after these. Other times stay what they are.
        """
        if self.zone is None:
            return self
        assert self.seconds is not None
        dated = next((other.first_ns for other in others if other.first_ns is not None), None)
        if dated is not None:
            day = as_datetime(dated).astimezone(self.zone).replace(hour=0, minute=0, second=0, microsecond=0)
            ns = as_ns(day) + np.round(self.seconds * 1e9).astype(np.int64)
            return Times(ns - _DAY_NS * round((int(ns[0]) - dated) / _DAY_NS), None)
        first = next(other.since(None)[0] for other in others if other.zone is not None)
        return replace(self, seconds=self.seconds - _DAY_S * round((self.seconds[0] - first) / _DAY_S))

    @property
    def first_ns(self) -> int | None:
        """The first time, ns since 1970; None where they are not on the calendar."""
        return None if self.ns is None else int(self.ns[0])


def read_times(table: SourceTable, columns: tuple[str, ...], notation: TimeNotation) -> Times:
    """Read the time of each row from one column, or from a date and a time of day in two.

    Raises :class:`BadInputError` that names file, column and row where one cannot be read.
    """
    series = [table.column(name) for name in columns]
    label = f"{table.name}: column {' and '.join(repr(name) for name in columns)}"
    if len(series) == 1 and not pd.api.types.is_string_dtype(series[0]) and notation.format is None:
        return _numeric(table.numbers(columns[0]), series[0], notation, label, table.first_row)
    text = series[0].astype("string").str.strip()
    for further in series[1:]:
        text = text + " " + further.astype("string").str.strip()
    if empty := _first((text.isna() | (text == "")).to_numpy(dtype=bool, na_value=True)):
        raise BadInputError(f"{label}, row {table.first_row + empty - 1}: is empty; expected a time")
    return _textual(text, notation, label, table.first_row)


def guessed_unit(values: Array) -> str:
    """Return the unit of numeric times: by their size for Unix times, else by their step, ``s`` from 1 ms to 5 s."""
    largest = float(np.nanmax(np.abs(values)))
    for unit, factor in UNIT_S.items():
        if _EPOCH_S[0] <= largest * factor <= _EPOCH_S[1] and (unit == "s" or largest > _EPOCH_S[1]):
            return unit
    step = np.diff(values)
    step = step[step > 0]
    if step.size == 0:
        return "s"
    typical = float(np.median(step))
    if _SPREADSHEET_DAYS[0] <= largest <= _SPREADSHEET_DAYS[1] and typical * _DAY_S < 10.0:
        return "days"
    # A logger writes at 0.5 Hz to 20 kHz: its step in s is below 2, in ms above, and so on.
    return "s" if typical < 2.0 else "ms" if typical < 2e3 else "us" if typical < 2e6 else "ns"


def _numeric(values: Array, series: pd.Series, notation: TimeNotation, label: str, first_row: int) -> Times:
    if empty := _first(~np.isfinite(values)):
        raise BadInputError(f"{label}, row {first_row + empty - 1}: is empty; expected a time")
    unit = notation.unit or guessed_unit(values)
    if unit == "ticks":
        if notation.tick_s is None:
            raise BadInputError(f"{label}: a counter of ticks needs tick_s, the time of one tick in s")
        return Times(None, unwrapped(values, notation.wraps_at) * notation.tick_s)
    if unit == "gps":
        return Times(gps_ns(values), None)
    if unit == "days":
        days = np.floor(values)
        ns = (days.astype(np.int64) - _SPREADSHEET_EPOCH_DAYS) * _DAY_NS
        return Times(ns + np.round((values - days) * _DAY_NS).astype(np.int64), None)
    if unit not in UNIT_S:
        known = ", ".join((*UNIT_S, "ticks", "gps", "days"))
        raise BadInputError(f"{label}: unknown time_unit {unit!r}; expected one of {known}")
    on_calendar = _EPOCH_S[0] <= float(np.median(values)) * UNIT_S[unit] <= _EPOCH_S[1]
    if not on_calendar:
        return Times(None, values * UNIT_S[unit])
    if pd.api.types.is_integer_dtype(series):
        return Times(series.to_numpy(dtype=np.int64) * _NS_PER[unit], None)
    whole = np.floor(values)
    return Times(
        whole.astype(np.int64) * _NS_PER[unit] + np.round((values - whole) * _NS_PER[unit]).astype(np.int64), None
    )


def gps_ns(seconds: Array) -> np.ndarray:
    """Return times (n,) since the GPS epoch, s, as ns since 1970 UTC."""
    return np.asarray(
        np.round(seconds * 1e9).astype(np.int64) - _GPS_LEAP_S * 1_000_000_000 + _GPS_EPOCH.astype(np.int64)
    )


def unwrapped(count: Array, wraps_at: float | None = None) -> Array:
    """Return a counter (n,) that goes on where it starts again.

    ``wraps_at``: the first value that it does not reach; by default the next power of two above its largest value where
    that is the end of its range, else nothing is undone.
    """
    falls = np.flatnonzero(np.diff(count) < 0)
    if falls.size == 0:
        return count
    if wraps_at is None:
        wraps_at = float(2.0 ** np.ceil(np.log2(count.max() + 1.0)))
        if count[falls].min() < 0.9 * wraps_at or count[falls + 1].max() > 0.1 * wraps_at:
            return count
    turns = np.zeros(count.size)
    turns[falls + 1] = 1.0
    return np.asarray(count + np.cumsum(turns) * wraps_at)


def _textual(text: pd.Series, notation: TimeNotation, label: str, first_row: int) -> Times:
    text = text.str.replace(",", ".", regex=False) if notation.format is None else text
    clock = notation.format is None and text.iloc[:100].str.fullmatch(r"\d{1,2}:\d{2}(:\d{2}(\.\d+)?)?").all()
    formats = (notation.format,) if notation.format else _CLOCK_FORMATS if clock else _DATE_FORMATS
    parsed = None
    for form in formats:
        parsed = _parsed(text, form)
        if parsed is not None:
            break
    if parsed is None:
        row, cell = _first_unread(text, formats[0])
        raise BadInputError(
            f"{label}, row {first_row + row}: {printable(cell)[:40]!r} is no time in a known notation; expected one "
            "such as 2026-05-01T03:12:00.005. Hint: state time_format, e.g. '%d.%m.%Y %H:%M:%S.%f', in the mapping"
        )
    if clock:
        ns = parsed.dt.tz_localize(None).astype("datetime64[ns]").astype(np.int64).to_numpy() % _DAY_NS
        days = np.concatenate([[0], np.cumsum(np.diff(ns) < -_DAY_NS // 2)])
        return Times(None, (ns + days * _DAY_NS) / 1e9, _zone(notation.zone, label))
    if parsed.dt.tz is None:
        parsed = parsed.dt.tz_localize(_zone(notation.zone, label), ambiguous="infer", nonexistent="shift_forward")
    return Times(
        parsed.dt.tz_convert("UTC").dt.tz_localize(None).astype("datetime64[ns]").astype(np.int64).to_numpy(), None
    )


def _parsed(text: pd.Series, form: str) -> pd.Series | None:
    try:
        zoned = bool(re.search(r"(Z|[+-]\d{2}:?\d{2})$", str(text.iloc[0])))
        pd.to_datetime(text.iloc[:20], format=form, utc=zoned)  # most notations fail at once
        return pd.to_datetime(text, format=form, utc=zoned)
    except (ValueError, TypeError, OverflowError):
        return None


def _first_unread(text: pd.Series, form: str) -> tuple[int, str]:
    read = pd.to_datetime(text, format=form, errors="coerce", utc=True)
    at = int(np.flatnonzero(read.isna())[0]) if read.isna().any() else 0
    return at, str(text.iloc[at])


def _zone(name: str, label: str) -> tzinfo:
    try:
        return UTC if name == "UTC" else ZoneInfo(name)
    except (ZoneInfoNotFoundError, ValueError):
        raise BadInputError(f"{label}: unknown time_zone {name!r}; expected one such as Europe/Zurich") from None


def _first(wrong: np.ndarray) -> int:
    """Return the number of the first row that is marked, from 1; 0 for none."""
    return int(np.argmax(wrong)) + 1 if wrong.any() else 0


def spread_stamps(t: Array) -> Array:
    """Return times (n,), s, without the repetitions that coarse stamps have: samples are as far apart as on average.

    Between two breaks (steps of more than 10 usual intervals) the samples of a clock that ticks every q lie on a
    straight line, up to q; a slow change of the rate is followed by lines over some 2000 samples. Times that grow from
    row to row are returned as they are.
    """
    step = np.diff(t)
    if t.size < 3 or (step > 0).all():
        return t
    if (step < 0).any():
        return t  # a clock that runs backwards is not corrected here: `check` names the row
    usual = (t[-1] - t[0]) / (t.size - 1)
    ticks = step[step > 0]
    quantum = float(ticks.min()) if ticks.size else 0.0
    breaks = np.flatnonzero(step > max(10.0 * usual, 3.0 * quantum)) + 1
    out = t.copy()
    for first, last in zip([0, *breaks], [*breaks, t.size], strict=True):
        for a in range(first, last, _LINE_ROWS):
            b = last if last - a < 2 * _LINE_ROWS else a + _LINE_ROWS
            if b - a >= 3:
                out[a:b] = _line(t[a:b])
            if b == last:
                break
    return out if (np.diff(out) > 0).all() else _strictly(out, usual)


_LINE_ROWS = 2000
"""Rows of one straight line: 10 s at 200 Hz, in which no logger's rate drifts by a sample."""


def _line(t: Array) -> Array:
    i = np.arange(t.size, dtype=np.float64)
    slope, offset = np.polyfit(i, t, 1)
    return np.asarray(offset + slope * i)


def _strictly(t: Array, usual: float) -> Array:
    """Return times that grow by at least a tenth of the usual step: where two lines meet they may overlap a little."""
    least = 0.1 * usual * np.arange(t.size)
    return np.asarray(np.maximum.accumulate(t - least) + least)


def start_of(times: Times) -> int | None:
    """Return the whole second at or before the first time, ns since 1970; None for times that are not on the calendar.

    Spread stamps may begin a few ms before the first one that was written, so as much is allowed for.
    """
    first_ns = times.first_ns
    return None if first_ns is None else (first_ns + 50_000_000) // 1_000_000_000 * 1_000_000_000


def as_datetime(ns: int) -> datetime:
    """Return a time in ns since 1970 as a date."""
    return datetime.fromtimestamp(ns / 1e9, tz=UTC)


def as_ns(date: datetime) -> int:
    """Return a date with a time zone in ns since 1970."""
    return int(date.timestamp()) * 1_000_000_000 + date.microsecond * 1000

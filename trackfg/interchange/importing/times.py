"""Times of a source become seconds: numbers in a unit, dates, times of day, sample counters that wrap.

Dates are kept as whole nanoseconds since 1970 (UTC) until the recording's start is taken off, so that nothing is lost
to rounding. Stamps that repeat, because they are written more coarsely than samples are taken, are spread again.
"""

from __future__ import annotations

import contextlib
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, date, datetime, time, tzinfo
from typing import Any
from zoneinfo import ZoneInfo, ZoneInfoNotFoundError

import numpy as np
import pandas as pd

from trackfg.errors import BadInputError, printable
from trackfg.interchange.importing.source_table import SourceTable
from trackfg.numerics.arrays import Array

UNIT_S = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
"""Units of numeric times, s."""

_NS_PER = {"s": 1_000_000_000, "ms": 1_000_000, "us": 1_000, "ns": 1}

_DAYS_TO_1970 = (25_569.0, 40_587.0, 719_529.0, 2_440_587.5)
"""Days to 1970-01-01 from where spreadsheets (1899-12-30), modified Julian dates, MATLAB and Julian dates count. The
first is meant from which the days are those of no date to come."""
_DAYS_SINCE_1970 = (-5_500.0, 55_000.0)
"""Numbers that are taken for days where they grow by less than 10 s: 1954 to 2120."""
_TICK_100_NS = 1e-7
_TICKS_TO_1970 = (116_444_736_000_000_000, 621_355_968_000_000_000)
"""Ticks of 100 ns to 1970-01-01 from 1601 and from the year 1, which Windows and .NET count from."""
_LABVIEW_S = 2_082_844_800
"""Seconds from 1904-01-01, which LabVIEW counts from, to 1970-01-01."""
_EPOCH_S = (0.9e9, 4.0e9)
"""Numbers of seconds that are taken for a Unix time: 1998 to 2096."""

_NO_HOLES = 0.995
"""Share of steps that are no holes: those between packets of up to 200 samples are among them."""
_IN_PACKETS = 5.0
"""Ratio of the mean step to the median one above which most steps are within packets, as in
:mod:`trackfg.checks.inertial.packet_stamps`."""

_GPS_EPOCH = np.datetime64("1980-01-06T00:00:00", "ns")
_GPS_LEAP_S = 18
"""GPS is ahead of UTC by so much since 2017 (IERS Bulletin C 52 to 70 announce no further one)."""

_DATE_FORMATS = (
    "ISO8601",
    "%Y-%m-%d %H:%M:%S.%f",
    "%Y-%m-%d %H:%M:%S",
    "%d.%m.%Y %H:%M:%S.%f",
    "%d.%m.%Y %H:%M:%S",
    "%d.%m.%Y %H.%M.%S.%f",
    "%d.%m.%Y %H.%M.%S",
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
    "%d-%b-%Y %H:%M:%S.%f",
    "%d-%b-%Y %H:%M:%S",
    "%Y-%jT%H:%M:%S.%f",
    "%Y:%j:%H:%M:%S.%f",
    "%d-%m-%Y %H:%M:%S.%f",
    "%d-%m-%Y %H:%M:%S",
    "%m-%d-%Y %H:%M:%S.%f",
    "%m-%d-%Y %H:%M:%S",
    "%Y-%m-%d_%H-%M-%S.%f",
    "%d %b %Y %H:%M:%S.%f",
    "%d %B %Y %H:%M:%S.%f",
    "%b %d. %Y %I:%M:%S.%f %p",
    "%b %d. %Y %H:%M:%S.%f",
    "%a %b %d %H:%M:%S.%f %Y",
    "%d/%m/%y %H:%M:%S.%f",
    "%d/%m/%y %H:%M:%S",
    "%m/%d/%y %H:%M:%S.%f",
    "%m/%d/%y %H:%M:%S",
    "%d.%m.%y %H:%M:%S.%f",
    "%d.%m.%y %H:%M:%S",
    "%y.%m.%d %H:%M:%S.%f",
    "%y.%m.%d %H:%M:%S",
)
"""Tried in this order. With AM or PM a date is month first. Commas are points when they are tried."""
_OTHER_ORDER = {
    "%d/%m/%Y": "%m/%d/%Y",
    "%d-%m-%Y": "%m-%d-%Y",
    "%d/%m/%y": "%m/%d/%y",
    "%d.%m.%y": "%y.%m.%d",
}
"""Beginnings of formats whose dates may be meant in another order: that is taken where only so no day is left out."""

_ZONE_HOURS = {"utc": 0, "gmt": 0, "z": 0, "cet": 1, "mez": 1, "cest": 2, "mesz": 2, "eet": 2, "eest": 3, "jst": 9}
"""Abbreviations of zones that mean one only, h; CST, EST, IST and the like are used for several."""

_PERIODS_S = (604_800.0, 86_400.0)
"""Times that start again: those of the week of GPS, and of the day, s."""

_CLOCK_FORMATS = ("%H:%M:%S.%f", "%H:%M:%S", "%I:%M:%S.%f %p", "%I:%M:%S %p")
_CLOCK = r"\d{1,2}:\d{1,2}(:\d{1,2}(\.\d+)?)?( ?[AaPp][Mm])?"
"""A time of day."""
_WHOLE_SECONDS = re.compile(r"(?<=\d:\d{2}:\d{2})(?=$| ?[AaPp][Mm]$)")
"""The end of a time without decimals."""
_DURATION = r"(?:(-?\d+) days?[,.]? ?)?\+?(\d{1,2}):(\d{2}):(\d{2}(?:\.\d+)?)"
"""A time since a zero of its own, as pandas and Python write it: ``0 days 00:00:00.005``."""
_COLON_BEFORE_MS = re.compile(r"(\d:\d{1,2}:\d{1,2}):(\d{1,3})$")
_THREE_DIGITS = re.compile(r":\d{3}$")
_LEAST_RANGE = 256
"""That of a counter of 8 bit: what starts again after less may as well be a vehicle that turns round."""
_FASTER = 3.0
"""Largest step across a wrap, in units of the largest other step: rows may be missing there."""
_FEWEST_TURNS = 3
_LEAST_TURN = 16
_SURE = 1e-3
"""Relative error of the modulus of a turn's count that is small beside that of a wheel's diameter."""
_OF_AN_HOUR = r"(\d{1,2}):([0-5]\d\.\d+)"
"""Minutes and seconds, as a spreadsheet shows times with fractions by default (``mm:ss.0``): the hour is lost."""
_HOUR_S = 3_600
_DAY_S = 86_400
_DAY_NS = _DAY_S * 1_000_000_000


@dataclass(frozen=True)
class TimeNotation:
    """How a source writes its times.

    ``unit`` is one of ``s, ms, us, ns`` for numbers, which are Unix times where they are as large as those; ``"gps"``
    for seconds since the GPS epoch; ``"days"`` for those of spreadsheets, of MATLAB or Julian dates; ``"hhmmss"`` for a
    time of day in one number, as receivers write it; ``"ticks"`` for a counter of ``tick_s`` that starts again at
    ``wraps_at``, or for dates as large as those of Windows and .NET.
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

    That zero is midnight where they are times of day, written in ``zone``, and a full hour where they are times of an
    hour, ``of_hour``. ``notes`` say what reading has assumed.
    """

    ns: np.ndarray | None
    seconds: Array | None
    zone: tzinfo | None = None
    notes: tuple[str, ...] = ()
    of_hour: bool = False

    @property
    def have_own_zero(self) -> bool:
        """Return whether nothing is known of the zero from which they count."""
        return self.ns is None and self.zone is None and not self.of_hour

    def since(self, start_ns: int | None) -> Array:
        """Return seconds since ``start_ns``, or since their own zero where they are not on the calendar."""
        if self.ns is None:
            assert self.seconds is not None
            return self.seconds
        return np.asarray((self.ns - (start_ns or 0)) / 1e9)

    @classmethod
    def after(cls, start_ns: int | None, seconds: Array, zone: tzinfo | None, notes: tuple[str, ...] = ()) -> Times:
        """Return times that :meth:`since` turns into ``seconds`` (n,); None: they are not on the calendar."""
        if start_ns is None:
            return cls(None, seconds, zone, notes)
        return cls(start_ns + np.round(seconds * 1e9).astype(np.int64), None, notes=notes)

    @classmethod
    def noon_of(cls, day: date, zone: tzinfo) -> Times:
        """Return the one time from which no time of that day is half a day away."""
        return cls(np.array([as_ns(datetime.combine(day, time(12), tzinfo=zone))]), None)

    def beside(self, others: Sequence[Times]) -> Times:
        """Return times of day on the day of ``others``: the first of those with dates, else the first times of day.

        They begin less than half a day before or after these. Times of an hour are those of the hour of ``others``, and
        begin less than half an hour before or after these. Other times stay what they are.
        """
        if self.of_hour:
            return self._of_their_hour(others)
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

    def _of_their_hour(self, others: Sequence[Times]) -> Times:
        assert self.seconds is not None
        dated = next((other.first_ns for other in others if other.first_ns is not None), None)
        clocks = (other.seconds[0] for other in others if other.seconds is not None and other.zone is not None)
        first = next(clocks, next(other.since(None)[0] for other in others if other.of_hour))
        nearest = first if dated is None else dated / 1e9
        hours_s = _HOUR_S * round((nearest - self.seconds[0]) / _HOUR_S)
        if dated is None:
            return replace(self, seconds=self.seconds + hours_s)
        return Times.after(hours_s * 1_000_000_000, self.seconds, None, self.notes)

    @property
    def first_ns(self) -> int | None:
        """The first time, ns since 1970; None where they are not on the calendar."""
        return None if self.ns is None else int(self.ns[0])


_DAY = re.compile(r"\b(?P<y>20\d\d)-(?P<m>\d\d)-(?P<d>\d\d)\b|\b(?P<D>\d{1,2})\.(?P<M>\d{1,2})\.(?P<Y>20\d\d)\b")
"""A date as ISO 8601 and as German and other languages write it; one with slashes has its day first or its month."""


def stated_day(remarks: Iterable[str]) -> date | None:
    """Return the one date that remarks above tables state; None without any, or with several."""
    dates = set()
    for match in (match for text in remarks for match in _DAY.finditer(text)):
        year, month, day = (int(match[a] or match[b]) for a, b in ("yY", "mM", "dD"))
        with contextlib.suppress(ValueError):
            dates.add(date(year, month, day))
    return dates.pop() if len(dates) == 1 else None


def times_by_keys(table: SourceTable, keys: Mapping[str, Any]) -> Times:
    """Read a table's times by the keys of a section of a mapping: ``time``, one column or several, and where there are
    such ``time_unit``, ``time_format``, ``time_zone`` and ``tick_s``. Raises as :func:`read_times` does.
    """
    columns = (keys["time"],) if isinstance(keys["time"], str) else tuple(keys["time"])
    names = {"unit": "time_unit", "format": "time_format", "zone": "time_zone", "tick_s": "tick_s"}
    return read_times(table, columns, TimeNotation(**{name: keys[key] for name, key in names.items() if key in keys}))


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


def _typical_step(step: Array) -> float:
    """Return the median of steps (n,), or their mean where most are within packets of samples: these are far shorter.

    The mean leaves out holes.
    """
    usual, mean = float(np.median(step)), float(step[step <= np.quantile(step, _NO_HOLES)].mean())
    return mean if mean > _IN_PACKETS * usual else usual


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
    typical = _typical_step(step)
    since_1970 = [largest - zero for zero in _DAYS_TO_1970]
    if typical * _DAY_S < 10.0 and any(_DAYS_SINCE_1970[0] <= day <= _DAYS_SINCE_1970[1] for day in since_1970):
        return "days"
    # A logger writes at 0.5 Hz to 20 kHz: its step in s is below 2, in ms above, and so on.
    return "s" if typical < 2.0 else "ms" if typical < 2e3 else "us" if typical < 2e6 else "ns"


def are_clock_digits(values: Array, name: str) -> bool:
    """Return whether numbers (n,) are times of day as receivers write them, ``hhmmss.sss``.

    That shows where a minute ends: 59.99 is followed by 100. Numbers within one minute are, where ``name`` is UTC's.
    """
    whole = np.floor(values)
    valid = (values >= 0.0) & (whole % 100 < 60) & (whole // 100 % 100 < 60) & (whole < 240_000)
    if not valid.all():
        return False
    step = np.diff(values)
    minutes = np.isin(np.diff(whole // 100), (1.0, 41.0)) & (step >= 40.0)
    return bool(minutes.any()) or (bool(re.search(r"utc|hhmmss", name.casefold())) and bool(values.min() >= 100.0))


def are_gps_seconds(values: Array) -> bool:
    """Return whether numbers (n,), s, are as large as Unix times and, since the GPS epoch, those of no date to come."""
    latest = float(values.max(initial=0.0))
    return latest >= _EPOCH_S[0] and int(gps_ns(np.array([latest]))[0]) <= _tomorrow_ns()


def tick_of_dates(values: Array) -> float | None:
    """Return the tick of numbers (n,) that are as large as dates of Windows or .NET, s; None where they are not."""
    return _TICK_100_NS if _ticks_to_1970(values) is not None else None


def _ticks_to_1970(values: Array) -> int | None:
    latest = float(values.max(initial=0.0))
    return next((zero for zero in _TICKS_TO_1970 if _EPOCH_S[0] <= (latest - zero) * 1e-7 <= _EPOCH_S[1]), None)


def _tomorrow_ns() -> int:
    return as_ns(datetime.now(UTC)) + _DAY_NS


def _numeric(values: Array, series: pd.Series, notation: TimeNotation, label: str, first_row: int) -> Times:
    if empty := _first(~np.isfinite(values)):
        raise BadInputError(f"{label}, row {first_row + empty - 1}: is empty; expected a time")
    unit = notation.unit or guessed_unit(values)
    if unit == "ticks":
        if notation.tick_s is None:
            raise BadInputError(f"{label}: a counter of ticks needs tick_s, the time of one tick in s")
        to_1970 = _ticks_to_1970(values) if notation.tick_s == _TICK_100_NS else None
        if to_1970 is not None:
            return Times((series.to_numpy(dtype=np.int64) - to_1970) * 100, None)
        return Times(None, unwrapped(values, notation.wraps_at) * notation.tick_s)
    if unit == "gps":
        return Times(gps_ns(values), None)
    if unit == "days":
        known = (values - zero for zero in _DAYS_TO_1970 if 0.0 <= values[-1] - zero <= _tomorrow_ns() / _DAY_NS)
        since_1970 = next(known, values - _DAYS_TO_1970[0])
        days = np.floor(since_1970)
        ns = days.astype(np.int64) * _DAY_NS + np.round((since_1970 - days) * _DAY_NS).astype(np.int64)
        return Times(_as_utc(ns, notation.zone, label), None)
    if unit == "hhmmss":
        return _of_the_day(clock_ns(values), notation.zone, label)
    on_calendar = _EPOCH_S[0] <= float(np.median(values)) * UNIT_S[unit] <= _EPOCH_S[1]
    if not on_calendar:
        return Times(None, _going_on(values, unit) * UNIT_S[unit])
    if unit == "s" and values[-1] * 1e9 > _tomorrow_ns() and values[-1] > _LABVIEW_S:
        note = f"{label}: {values[0]:.0f} s, to come as a Unix time, is taken for a time since 1904, as of LabVIEW"
        read = _numeric(values - _LABVIEW_S, series - _LABVIEW_S, notation, label, first_row)
        return replace(read, notes=(note,))
    if pd.api.types.is_integer_dtype(series):
        return Times(series.to_numpy(dtype=np.int64) * _NS_PER[unit], None)
    whole = np.floor(values)
    return Times(
        whole.astype(np.int64) * _NS_PER[unit] + np.round((values - whole) * _NS_PER[unit]).astype(np.int64), None
    )


def _going_on(values: Array, unit: str) -> Array:
    """Return times (n,) in ``unit`` that go on where a counter, the week or the day starts again."""
    falls = np.flatnonzero(np.diff(values) < 0)
    if falls.size == 0:
        return values
    usual = float(np.median(np.abs(np.diff(values))))
    for period in (seconds / UNIT_S[unit] for seconds in _PERIODS_S):
        if (np.abs(values[falls] - values[falls + 1] - period) < 10.0 * usual).all():
            return unwrapped(values, period)
    return unwrapped(values) if (values == np.floor(values)).all() else values


def clock_ns(values: Array) -> np.ndarray:
    """Return numbers (n,) ``hhmmss.sss`` as ns since midnight."""
    whole = np.floor(values).astype(np.int64)
    seconds = 3600 * (whole // 10_000) + 60 * (whole // 100 % 100) + whole % 100
    return np.asarray(seconds * 1_000_000_000 + np.round((values - whole) * 1e9).astype(np.int64))


def _of_the_day(ns: np.ndarray, zone: str, label: str) -> Times:
    """Return times of day (n,), ns since midnight, which goes on to the next day."""
    days = np.concatenate([[0], np.cumsum(np.diff(ns) < -_DAY_NS // 2)])
    return Times(None, (ns + days * _DAY_NS) / 1e9, zone_named(zone, label))


def gps_ns(seconds: Array) -> np.ndarray:
    """Return times (n,) since the GPS epoch, s, as ns since 1970 UTC."""
    return np.asarray(
        np.round(seconds * 1e9).astype(np.int64) - _GPS_LEAP_S * 1_000_000_000 + _GPS_EPOCH.astype(np.int64)
    )


def unwrapped(count: Array, wraps_at: float | None = None) -> Array:
    """Return a counter (n,) unwrapped.

    ``wraps_at`` is its modulus; by default the first of these with which the steps across the wraps are like the other
    steps, else the counter stays as it is: the next power of two or ten above its largest value, and, where it wraps
    many times, as one of each turn does, its largest value plus one. A counter that also runs backwards is unwrapped at
    both ends of its range.
    """
    falls = np.flatnonzero(np.diff(count) < 0)
    if wraps_at is None and count.size > 1:
        to_and_fro = _unwrapped_to_and_fro(count)
        if to_and_fro is not None:
            return to_and_fro
    if falls.size == 0:
        return count
    if wraps_at is None:
        moduli = [min(end_of_range(float(count.max()))), *_modulus_of_turns(count, falls)]
        wraps_at = next((modulus for modulus in moduli if _is_modulus(count, falls, modulus)), None)
        if wraps_at is None:
            return count
    turns = np.zeros(count.size)
    turns[falls + 1] = 1.0
    return np.asarray(count + np.cumsum(turns) * wraps_at)


def _is_modulus(count: Array, falls: np.ndarray, modulus: float) -> bool:
    """Return whether the steps of a counter (n,) across its wraps, after rows ``falls``, are like its other steps."""
    steps = np.diff(count)
    usual, across = float(steps.max()), steps[falls] + modulus
    return bool(across.min() >= 0.0 and max(usual, across.max()) < 0.5 * modulus and across.max() <= _FASTER * usual)


def _modulus_of_turns(count: Array, falls: np.ndarray) -> list[float]:
    """Return the modulus of a counter (n,) of each turn, such as 360: its largest value plus one.

    Of many values before the wraps, after rows ``falls``, the largest is below the true one by a small part of a step;
    none is returned where there are too few.
    """
    modulus = float(count.max()) + 1.0
    whole = bool((count == np.floor(count)).all())
    sure = falls.size >= _FEWEST_TURNS and float(np.diff(count).max()) < _SURE * falls.size * modulus
    return [modulus] if whole and sure and modulus >= _LEAST_TURN else []


def end_of_range(largest: float) -> tuple[float, float]:
    """Return the next powers of two and of ten above the ``largest`` value of a counter."""
    whole = largest + (1.0 if largest == np.floor(largest) else 0.0)
    two, ten = (float(base ** np.ceil(np.log(whole) / np.log(base) - 1e-9)) for base in (2.0, 10.0))
    return two, ten


def _unwrapped_to_and_fro(count: Array) -> Array | None:
    """Return a counter (n,) that runs forwards and back, going on at both ends of its range; None where none is plain.

    It leaves its range near one end and is near the other one in the next row, no further on than its other steps lead.
    Below zero the range is that of a signed number.
    """
    lowest = float(count.min())
    largest = max(float(count.max()), -lowest - 1.0) if lowest < 0.0 else float(count.max())
    if not largest > 0.0:
        return None
    end = min(end_of_range(largest))
    begin = -end if lowest < 0.0 else 0.0
    span = end - begin
    steps = np.diff(count)
    wraps = np.flatnonzero(np.abs(steps) > 0.8 * span)
    inside = np.delete(steps, wraps)
    if span < _LEAST_RANGE or wraps.size == 0 or (lowest >= 0.0 and (steps[wraps] < 0).all() and (inside >= 0).all()):
        return None
    usual = float(np.abs(inside).max(initial=0.0))
    across = steps[wraps] - np.sign(steps[wraps]) * span
    if usual > 0.1 * span or np.abs(across).max() > 2.0 * max(usual, 1.0):
        return None
    turns = np.zeros(count.size)
    turns[wraps + 1] = -np.sign(steps[wraps])
    return np.asarray(count + np.cumsum(turns) * span)


def _textual(text: pd.Series, notation: TimeNotation, label: str, first_row: int) -> Times:
    if notation.format is None:
        text = text.str.replace(",", ".", regex=False)
        if text.str.contains(_THREE_DIGITS).any():  # else they may be frames
            text = text.str.replace(_COLON_BEFORE_MS, _with_point, regex=True)
        text, ahead_ns = _without_zones(text)
    else:
        ahead_ns = None
    text = _with_decimals(text)
    if notation.format is None and text.iloc[:100].str.fullmatch(_OF_AN_HOUR).all():
        return _of_the_hour(text, label, first_row)
    if notation.format is None and are_durations(text.iloc[:100]):
        return _durations(text, label, first_row)
    clock = notation.format is None and text.iloc[:100].str.fullmatch(_CLOCK).all()
    formats = (notation.format,) if notation.format else _CLOCK_FORMATS if clock else _DATE_FORMATS
    parsed, notes = None, tuple[str, ...]()
    for form in formats:
        parsed = _parsed(text, form)
        if parsed is not None:
            if notation.format is None:
                parsed, notes = _in_order_of_days(text, parsed, form, label)
            break
    if parsed is None:
        row, cell = _first_unread(text, formats)
        raise BadInputError(
            f"{label}, row {first_row + row}: {printable(cell)[:40]!r} is no time in a known notation; expected one "
            "such as 2026-05-01T03:12:00.005. Hint: state time_format, e.g. '%d.%m.%Y %H:%M:%S.%f', in the mapping"
        )
    if clock:
        ns = parsed.dt.tz_localize(None).astype("datetime64[ns]").astype(np.int64).to_numpy() % _DAY_NS
        return _of_the_day(ns - (0 if ahead_ns is None else ahead_ns), notation.zone, label)
    if parsed.dt.tz is not None:
        parsed = parsed.dt.tz_convert("UTC").dt.tz_localize(None)
        return Times(parsed.astype("datetime64[ns]").astype(np.int64).to_numpy(), None, notes=notes)
    ns = parsed.astype("datetime64[ns]").astype(np.int64).to_numpy()
    return Times(_as_utc(ns, notation.zone, label) if ahead_ns is None else ns - ahead_ns, None, notes=notes)


def _with_point(match: re.Match[str]) -> str:
    """Return a time with its milliseconds, which may have lost their zeros in front, behind a point."""
    return f"{match[1]}.{match[2]:0>3}"


def _with_decimals(text: pd.Series) -> pd.Series:
    """Return times (n,) of which either none or all have decimals: some programs leave them out where they are zero."""
    whole = text.str.contains(_WHOLE_SECONDS).to_numpy(dtype=bool)
    return text.str.replace(_WHOLE_SECONDS, ".0", regex=True) if whole.any() and not whole.all() else text


def are_durations(text: pd.Series) -> bool:
    """Return whether all cells (n,) of text are durations, some of them with their days."""
    return bool(text.str.fullmatch(_DURATION).all() and text.str.contains("day", regex=False).any())


def _durations(text: pd.Series, label: str, first_row: int) -> Times:
    """Return times (n,) since a zero of their own."""
    parts = text.str.extract(f"^{_DURATION}$")
    days, hours, minutes, seconds = (part.astype("Float64") for _, part in parts.items())
    seconds += 60.0 * minutes + _HOUR_S * hours + _DAY_S * days.fillna(0.0)
    if unread := _first(seconds.isna().to_numpy(dtype=bool)):
        cell = printable(str(text.iloc[unread - 1]))[:40]
        raise BadInputError(
            f"{label}, row {first_row + unread - 1}: {cell!r} is no time; expected one as 0 days 00:00:12.005"
        )
    return Times(None, np.asarray(seconds.to_numpy(dtype=np.float64), dtype=np.float64))


def _of_the_hour(text: pd.Series, label: str, first_row: int) -> Times:
    """Return times (n,) of minutes and seconds, which go on where the next hour begins."""
    minutes, seconds = (part.astype("Float64") for _, part in text.str.extract(f"^{_OF_AN_HOUR}$").items())
    if unread := _first(minutes.isna().to_numpy(dtype=bool)):
        cell = printable(str(text.iloc[unread - 1]))[:40]
        raise BadInputError(f"{label}, row {first_row + unread - 1}: {cell!r} is no time; expected one as 12:00.5")
    values = (60.0 * minutes + seconds).to_numpy(dtype=np.float64)
    hours = np.concatenate([[0], np.cumsum(np.diff(values) < -_HOUR_S // 2)])
    lost = f"{label}: {text.iloc[0]!r} has no hour, as spreadsheets show times: the seconds in the hour are taken"
    return Times(None, values + _HOUR_S * hours, notes=(lost,), of_hour=True)


def _in_order_of_days(text: pd.Series, parsed: pd.Series, form: str, label: str) -> tuple[pd.Series, tuple[str, ...]]:
    """Return dates in that order of day and month in which no day is left out, with a note where both orders do."""
    taken = next((order for order in _OTHER_ORDER if form.startswith(order)), None)
    if taken is None:
        return parsed, ()
    other_form = form.replace(taken, _OTHER_ORDER[taken])
    other = _parsed(text, other_form)
    if other is None or other.equals(parsed):
        return parsed, ()
    if _leaves_out_days(parsed) != _leaves_out_days(other):
        return (other if _leaves_out_days(parsed) else parsed), ()
    at = int(np.argmax((parsed != other).to_numpy()))
    note = f"{label}: {text.iloc[at]!r} is taken for {parsed.iloc[at]:%Y-%m-%d}"
    hint = f"Hint: if it is {other.iloc[at]:%Y-%m-%d}, state time_format = '{other_form}' in the mapping"
    return parsed, (f"{note}. {hint}",)


def _leaves_out_days(dates: pd.Series) -> bool:
    """Return whether a day follows another one than itself and those beside it."""
    return bool((dates.dt.normalize().diff().abs() > pd.Timedelta(days=1)).any())


def _without_zones(text: pd.Series) -> tuple[pd.Series, np.ndarray | None]:
    """Return times (n,) without the abbreviation of a zone at their end, and how far that is ahead of UTC, ns.

    None where one of them has none that means one zone only.
    """
    parts = text.str.extract(r"^(.*\d)\s?([A-Za-z]+)$")
    hours = parts[1].str.casefold().map(_ZONE_HOURS)
    if hours.isna().any():
        return text, None
    return parts[0], hours.to_numpy(dtype=np.int64) * 3_600_000_000_000


def _as_utc(ns: np.ndarray, zone: str, label: str) -> np.ndarray:
    """Return times (n,) that were written in a zone, ns since 1970, as those of UTC."""
    if zone == "UTC":
        return ns
    written, place = pd.Series(ns.astype("datetime64[ns]")), zone_named(zone, label)
    hint = "Hint: state a zone without summer time as time_zone, such as Etc/GMT-1 (one hour ahead of UTC)"
    try:
        local = written.dt.tz_localize(place, ambiguous="infer", nonexistent="NaT")
    except ValueError:  # the hour that is there twice, without the change within the log
        raise BadInputError(
            f"{label}: lies in the hour that {zone} has twice; expected times of which it is plain. {hint}"
        ) from None
    left_out = local.isna().to_numpy()
    if np.count_nonzero(left_out) > 1:
        first = written.iloc[int(np.argmax(left_out))]
        raise BadInputError(
            f"{label}: {np.count_nonzero(left_out)} times such as {first:%Y-%m-%d %H:%M:%S} lie in the hour that "
            f"{zone} leaves out; expected times of a clock that was set to summer time. {hint}"
        )
    if left_out.any():  # the one at which the clock was set
        local = written.dt.tz_localize(place, ambiguous="infer", nonexistent="shift_forward")
    return np.asarray(local.dt.tz_convert("UTC").dt.tz_localize(None).astype(np.int64))


_FIRST_CELLS = 20
"""Cells by which a notation of dates is recognised: most notations fail at the first one."""


def _parsed(text: pd.Series, form: str) -> pd.Series | None:
    try:
        zoned = bool(re.search(r"(Z|[+-]\d{2}:?\d{2})$", str(text.iloc[0])))
        pd.to_datetime(text.iloc[:_FIRST_CELLS], format=form, utc=zoned)
        return pd.to_datetime(text, format=form, utc=zoned)
    except (ValueError, TypeError, OverflowError):
        return None


def are_dates(column: pd.Series) -> bool:
    """Return whether the first cells of a text column are dates with a time of day, in their sequence, or durations."""
    text = column.dropna().iloc[:_FIRST_CELLS].astype("string").str.strip().str.replace(",", ".", regex=False)
    if not len(text) or not text.str.contains(":", regex=False).all():
        return False
    if are_durations(text):
        return True
    dates = next((dates for form in _DATE_FORMATS if (dates := _parsed(text, form)) is not None), None)
    return dates is not None and bool(dates.is_monotonic_increasing)


def _first_unread(text: pd.Series, formats: Sequence[str]) -> tuple[int, str]:
    """Return the first row that is not read by the format which reads most rows before it, and its cell."""
    missing = (pd.to_datetime(text, format=form, errors="coerce", utc=True).isna() for form in formats)
    at = max(int(np.argmax(rows)) for rows in missing)
    return at, str(text.iloc[at])


def is_zone(name: str) -> bool:
    """Return whether a time zone has this name."""
    try:
        zone_named(name, "")
    except BadInputError:
        return False
    return True


def states_zone(cell: str) -> bool:
    """Return whether a written time states its zone: ``Z``, an offset from UTC, or an abbreviation that is known."""
    match = re.search(r"\d\s?([A-Za-z]+)$", cell)
    return bool(re.search(r"\d\s?[+-]\d{2}:?\d{2}$", cell)) or (
        match is not None and match[1].casefold() in _ZONE_HOURS
    )


def zone_named(name: str, label: str) -> tzinfo:
    """Return the time zone of a name. Raises :class:`BadInputError` for an unknown one, which ``label`` has."""
    try:
        return UTC if name == "UTC" else ZoneInfo(name)
    except (ZoneInfoNotFoundError, ValueError):
        raise BadInputError(f"{label}: unknown time_zone {name!r}; expected one such as Europe/Zurich") from None


def _first(wrong: np.ndarray) -> int:
    """Return the number of the first row that is marked, from 1; 0 for none."""
    return int(np.argmax(wrong)) + 1 if wrong.any() else 0


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

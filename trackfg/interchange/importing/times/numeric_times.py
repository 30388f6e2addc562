"""Times in numbers: seconds and parts of them, days, ticks, since 1970 or another date, or times of day in digits."""

from __future__ import annotations

import re
from dataclasses import replace
from datetime import UTC, datetime

import numpy as np
import pandas as pd

from trackfg.errors import BadInputError
from trackfg.interchange.importing.times.clock import DAY_NS, DAY_S, Times, as_ns
from trackfg.interchange.importing.times.counters import unwrapped
from trackfg.interchange.importing.times.notation import UNIT_S, TimeNotation
from trackfg.interchange.importing.times.zones import GPS_LEAP_S, as_utc
from trackfg.numerics.arrays import Array

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


WEEK_S = 604_800.0
"""A week of GPS, s."""
_PERIODS_S = (WEEK_S, 86_400.0)
"""Times that start again: those of the week of GPS, and of the day, s."""


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
    if typical * DAY_S < 10.0 and any(_DAYS_SINCE_1970[0] <= day <= _DAYS_SINCE_1970[1] for day in since_1970):
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
    return as_ns(datetime.now(UTC)) + DAY_NS


def times_of_numbers(values: Array, series: pd.Series, notation: TimeNotation, label: str) -> Times:
    """Return times (n,) in numbers, of which ``series`` has all digits. Raises :class:`BadInputError`, as ``label``."""
    unit = notation.unit or guessed_unit(values)
    if unit == "ticks":
        if notation.tick_s is None:
            raise BadInputError(f"{label}: a counter of ticks needs tick_s, the time of one tick in s")
        to_1970 = _ticks_to_1970(values) if notation.tick_s == _TICK_100_NS else None
        if to_1970 is not None:
            return Times((series.to_numpy(dtype=np.int64) - to_1970) * 100, None)
        return Times(None, unwrapped(values, notation.wraps_at) * notation.tick_s)
    if unit == "gps":
        tick_s = 1.0 if notation.tick_s is None else notation.tick_s
        if not pd.api.types.is_integer_dtype(series) or tick_s * 1e9 != round(tick_s * 1e9):
            return Times(gps_ns(values * tick_s), None)
        return Times(gps_ns(np.zeros(1)) + series.to_numpy(dtype=np.int64) * round(tick_s * 1e9), None)
    if unit == "days":
        known = (values - zero for zero in _DAYS_TO_1970 if 0.0 <= values[-1] - zero <= _tomorrow_ns() / DAY_NS)
        since_1970 = next(known, values - _DAYS_TO_1970[0])
        days = np.floor(since_1970)
        ns = days.astype(np.int64) * DAY_NS + np.round((since_1970 - days) * DAY_NS).astype(np.int64)
        return Times(as_utc(ns, notation.zone, label), None)
    if unit == "hhmmss":
        return Times.of_the_day(clock_ns(values), notation.zone, label)
    on_calendar = _EPOCH_S[0] <= float(np.median(values)) * UNIT_S[unit] <= _EPOCH_S[1]
    if not on_calendar:
        return Times(None, _going_on(values, unit) * UNIT_S[unit])
    if unit == "s" and values[-1] * 1e9 > _tomorrow_ns() and values[-1] > _LABVIEW_S:
        note = f"{label}: {values[0]:.0f} s, to come as a Unix time, is taken for a time since 1904, as of LabVIEW"
        read = times_of_numbers(values - _LABVIEW_S, series - _LABVIEW_S, notation, label)
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


def gps_ns(seconds: Array) -> np.ndarray:
    """Return times (n,) since the GPS epoch, s, as ns since 1970 UTC."""
    return np.asarray(
        np.round(seconds * 1e9).astype(np.int64) - GPS_LEAP_S * 1_000_000_000 + _GPS_EPOCH.astype(np.int64)
    )

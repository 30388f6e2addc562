"""The times of a table: on the calendar, of a day, of an hour, or from a zero of their own."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, date, datetime, time, tzinfo

import numpy as np

from trackfg.interchange.importing.times.zones import zone_named
from trackfg.numerics.arrays import Array

HOUR_S = 3_600


DAY_S = 86_400


DAY_NS = DAY_S * 1_000_000_000


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
    def of_the_day(cls, ns: np.ndarray, zone: str, label: str) -> Times:
        """Return times of day (n,), ns since midnight, on consecutive days: each midnight makes the next one begin."""
        days = np.concatenate([[0], np.cumsum(np.diff(ns) < -DAY_NS // 2)])
        return cls(None, (ns + days * DAY_NS) / 1e9, zone_named(zone, label))

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
            return Times(ns - DAY_NS * round((int(ns[0]) - dated) / DAY_NS), None)
        first = next(other.since(None)[0] for other in others if other.zone is not None)
        return replace(self, seconds=self.seconds - DAY_S * round((self.seconds[0] - first) / DAY_S))

    def _of_their_hour(self, others: Sequence[Times]) -> Times:
        assert self.seconds is not None
        dated = next((other.first_ns for other in others if other.first_ns is not None), None)
        clocks = (other.seconds[0] for other in others if other.seconds is not None and other.zone is not None)
        first = next(clocks, next(other.since(None)[0] for other in others if other.of_hour))
        nearest = first if dated is None else dated / 1e9
        hours_s = HOUR_S * round((nearest - self.seconds[0]) / HOUR_S)
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

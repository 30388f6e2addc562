"""Sentences of NMEA 0183 become positions and speeds: GGA, GST, RMC, VTG and ZDA, in any mixture.

Sentences of one epoch are put together by their time of day; RMC and ZDA give dates, GGA the position, RMC the speed. A
time of day is on the day on which it is nearest to the date or position before it, so that a log may pass midnight;
positions before the first date are near that one. Without any GGA positions are those of RMC, without heights.

VTG has a speed without a time. Where no RMC has one it is that of the GGA before it, or of the one after it where the
speeds between the positions fit that better: a receiver sends the sentences of an epoch in an order of its own.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from datetime import UTC, datetime, time, timedelta
from typing import Any

import numpy as np

from trackfg.interchange.importing.columns.receiver_state import (
    HIGHEST_MEASURED,
    RANGE_SD_BY_QUALITY_M,
    RANGE_SD_M,
    UNKNOWN_HEIGHT_SD_M,
)
from trackfg.interchange.importing.times.clock import as_ns
from trackfg.numerics import geodesy
from trackfg.numerics.arrays import Array
from trackfg.numerics.units import KNOT

_QUALITY_OF_MODE = {"N": 0, "D": 2, "R": 4, "F": 5, "E": 6, "M": 7, "S": 8}
"""Quality of GGA for the mode of RMC and VTG since NMEA 2.3; an autonomous fix (A) and older sentences have 1."""


@dataclass(frozen=True)
class _Position:
    """A position has the time of day of its epoch, the last date before it, and the number of its epoch."""

    date: datetime | None
    time: time
    epoch: int
    place: tuple[float, float, float]
    sd_m: tuple[float, float, float]


class NmeaEpochs:
    """The epochs of a log, sentence by sentence."""

    def __init__(self) -> None:
        self.counts: Counter[str] = Counter()
        """Sentences of each kind."""
        self._date: datetime | None = None
        self._positions: dict[str, list[_Position]] = {"GGA": [], "RMC": []}
        self._sigmas: dict[time, tuple[float, float, float]] = {}
        self._speeds: dict[datetime, float] = {}
        self._untimed: dict[int, float] = {}
        self._epoch = 0

    def take(self, kind: str, message: Any) -> None:
        """Take up a sentence."""
        self.counts[kind] += 1
        at = getattr(message, "time", None)
        if kind == "VTG" and message.sogn != "" and _measured(message):
            self._untimed[self._epoch] = float(message.sogn) * KNOT
        if not isinstance(at, time):
            return
        if kind == "RMC" and message.date:
            self._date = datetime.combine(message.date, at, tzinfo=UTC)
        elif kind == "ZDA" and message.year:
            day = datetime(int(message.year), int(message.month), int(message.day), tzinfo=UTC)
            self._date = datetime.combine(day, at, tzinfo=UTC)
        if kind == "GST" and message.stdLat != "":
            self._sigmas[at] = (message.stdLong, message.stdLat, message.stdAlt)
        elif kind == "GGA":
            self._take_gga(at, message)
        elif kind == "RMC" and message.status == "A" and _measured(message):
            self._take_rmc(at, message)

    def _take_gga(self, at: time, message: Any) -> None:
        self._epoch += 1
        quality = int(message.quality or 0)
        if 0 < quality <= HIGHEST_MEASURED and message.lat != "":
            sd = float(message.HDOP or 1.0) * RANGE_SD_BY_QUALITY_M.get(quality, RANGE_SD_M)
            height = float(message.alt or 0.0) + float(message.sep or 0.0)
            place = (message.lat, message.lon, height)
            self._positions["GGA"].append(_Position(self._date, at, self._epoch, place, (sd, sd, 2.0 * sd)))

    def _take_rmc(self, at: time, message: Any) -> None:
        if self._date is not None and message.spd != "":
            self._speeds[self._date] = float(message.spd) * KNOT
        if message.lat != "":
            sd = RANGE_SD_BY_QUALITY_M.get(_quality(message), RANGE_SD_M)
            place = (message.lat, message.lon, 0.0)
            self._positions["RMC"].append(_Position(self._date, at, self._epoch, place, (sd, sd, UNKNOWN_HEIGHT_SD_M)))

    def rows(self) -> list[tuple[int, tuple[float, ...]]]:
        """Return times, ns since 1970, and positions, their sigmas, speeds and theirs. Without any date there is none.

        A speed without a sigma has NaN, as has a row without a speed.
        """
        positions = self._positions["GGA"] or self._positions["RMC"]
        last = next((position.date for position in positions if position.date is not None), self._date)
        if last is None:
            return []
        times: list[datetime] = []
        for position in positions:
            last = _nearest(position.time, last if position.date is None else max(last, position.date))
            times.append(last)
        speeds = [self._speeds.get(at, np.nan) for at in times]
        if times and not self._speeds:
            speeds = self._speeds_of_vtg(times, positions)
        return [
            (as_ns(at), (*position.place, *self._sigmas.get(position.time, position.sd_m), speed, np.nan))
            for at, position, speed in zip(times, positions, speeds, strict=True)
        ]

    def _speeds_of_vtg(self, times: list[datetime], positions: list[_Position]) -> list[float]:
        """Return the speed of each position, m/s, NaN without any: of the sentence after it or of that before it."""
        t = np.array([(at - times[0]).total_seconds() for at in times])
        places = np.array([position.place for position in positions])
        across = geodesy.geodetic_to_enu(places, places[0])[:, :2]
        following, preceding = (
            np.array([self._untimed.get(position.epoch - earlier, np.nan) for position in positions])
            for earlier in (0, 1)
        )
        speeds = preceding if _misfit(t, across, preceding) < _misfit(t, across, following) else following
        return list(speeds)


def _misfit(t: Array, across: Array, speed: Array) -> float:
    """Return the mean difference, m/s, between speeds (n,) and those from the position (n, 2) before to the next."""
    if len(t) < 3:
        return np.nan
    span = t[2:] - t[:-2]
    moved = np.hypot(*(across[2:] - across[:-2]).T)
    off = np.abs(moved - speed[1:-1] * span)[span > 0.0] / span[span > 0.0]
    return float(np.nanmean(off)) if np.isfinite(off).any() else np.nan


def _quality(message: Any) -> int:
    """Return the quality that the mode of a sentence means."""
    return _QUALITY_OF_MODE.get(getattr(message, "posMode", ""), 1)


def _measured(message: Any) -> bool:
    """Return whether the mode of a sentence is that of a measurement."""
    return 0 < _quality(message) <= HIGHEST_MEASURED


def _nearest(at: time, reference: datetime) -> datetime:
    """Return the date nearest to ``reference`` with this time of day."""
    same_day = datetime.combine(reference, at, tzinfo=UTC)
    return same_day - timedelta(days=round((same_day - reference) / timedelta(days=1)))

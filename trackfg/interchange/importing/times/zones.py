"""The zones in which dates were written."""

from __future__ import annotations

import re
from datetime import UTC, timedelta, timezone, tzinfo
from zoneinfo import ZoneInfo, ZoneInfoNotFoundError

import numpy as np
import pandas as pd

from trackfg.errors import BadInputError

GPS_LEAP_S = 18
"""GPS is ahead of UTC by so much since 2017 (IERS Bulletin C 52 to 70 announce no further one)."""
_GPS = timezone(timedelta(seconds=GPS_LEAP_S), "GPS")
"""The zone of dates that a receiver has not turned into those of UTC."""


_ZONE_HOURS = {"utc": 0, "gmt": 0, "z": 0, "cet": 1, "mez": 1, "cest": 2, "mesz": 2, "eet": 2, "eest": 3, "jst": 9}
"""Abbreviations of zones that mean one only, h; CST, EST, IST and the like are used for several."""


def without_zones(text: pd.Series) -> tuple[pd.Series, np.ndarray | None]:
    """Return times (n,) without the abbreviation of a zone at their end, and how far that is ahead of UTC, ns.

    None where one of them has none that means one zone only.
    """
    parts = text.str.extract(r"^(.*\d)\s?([A-Za-z]+)$")
    hours = parts[1].str.casefold().map(_ZONE_HOURS)
    if hours.isna().any():
        return text, None
    return parts[0], hours.to_numpy(dtype=np.int64) * 3_600_000_000_000


def as_utc(ns: np.ndarray, zone: str, label: str) -> np.ndarray:
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


def is_zone(name: str) -> bool:
    """Return whether a time zone has this name."""
    try:
        zone_named(name, "")
    except BadInputError:
        return False
    return True


OFFSET = re.compile(r"(?:Z|(?::\d{2}|T\d{4,6})(?:[.,]\d+)?\s?[+-]\d{2}(?::?\d{2})?)$")
"""The offset from UTC behind a time, of which databases leave out minutes that are zero."""


def states_zone(cell: str) -> bool:
    """Return whether a written time states its zone: ``Z``, an offset from UTC, or an abbreviation that is known."""
    match = re.search(r"\d\s?([A-Za-z]+)$", cell)
    return bool(OFFSET.search(cell)) or (match is not None and match[1].casefold() in _ZONE_HOURS)


def zone_named(name: str, label: str) -> tzinfo:
    """Return the time zone of a name. Raises :class:`BadInputError` for an unknown one, which ``label`` has."""
    try:
        return UTC if name == "UTC" else _GPS if name == "GPS" else ZoneInfo(name)
    except (ZoneInfoNotFoundError, ValueError):
        raise BadInputError(
            f"{label}: unknown time_zone {name!r}; expected one such as Europe/Zurich, or GPS"
        ) from None

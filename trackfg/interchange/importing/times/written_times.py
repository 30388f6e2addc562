"""Times in text: dates, times of day, minutes and seconds, durations."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import NoReturn

import numpy as np
import pandas as pd

from trackfg.errors import BadInputError, printable
from trackfg.interchange.importing.times.clock import DAY_NS, HOUR_S, Times
from trackfg.interchange.importing.times.date_words import in_english
from trackfg.interchange.importing.times.notation import TimeNotation
from trackfg.interchange.importing.times.zones import OFFSET, as_utc, without_zones
from trackfg.numerics.arrays import Array

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
    "%d/%m/%Y %I:%M:%S.%f %p",
    "%d/%m/%Y %I:%M:%S %p",
    "%Y-%m-%d %I:%M:%S.%f %p",
    "%Y-%m-%d %I:%M:%S %p",
    "%d-%b-%Y %I:%M:%S.%f %p",
    "%d-%b-%Y %I:%M:%S %p",
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
    "%d %b %Y %H:%M:%S",
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


_CLOCK_FORMATS = ("%H:%M:%S.%f", "%H:%M:%S", "%I:%M:%S.%f %p", "%I:%M:%S %p")


_CLOCK = r"\d{1,2}:\d{1,2}(:\d{1,2}(\.\d+)?)?( ?[AaPp][Mm])?"
"""A time of day."""


_NOON = re.compile(r"(?<=\d)(?=[AaPp][Mm]$)")
"""Where a time of day with AM or PM lacks its blank."""


_WHOLE_SECONDS = re.compile(r"(?<=\d:\d{2}:\d{2})(?=$| ?[AaPp][Mm]$)")
"""The end of a time without decimals."""


_DURATION = r"(?:-?\d+ days?[,.]? ?)?\+?\d+:\d{2}:\d{2}(?:\.\d+)?|P(?:\d+D)?T(?:\d+H)?(?:\d+M)?[\d.]+S"
"""A time since a zero of its own, as pandas, Python, spreadsheets and ISO 8601 write it: ``0 days 00:00:00.005``,
``27:12:00``, ``PT0.005S``."""
_NO_TIME_OF_DAY = re.compile(r"day|P|^(?:2[4-9]|[3-9]\d|\d{3,}):")
_POINT_BEHIND_DAYS = re.compile(r"(?<=day)[.,]|(?<=days)[.,]")
_COLON_BEFORE_MS = re.compile(r"(\d:\d{1,2}:\d{1,2}):(\d{1,3})$")


_THREE_DIGITS = re.compile(r":\d{3}$")


_OF_AN_HOUR = r"(\d{1,2}):([0-5]\d\.\d+)"
"""Minutes and seconds, as a spreadsheet shows times with fractions by default (``mm:ss.0``): the hour is lost."""


def times_of_text(text: pd.Series, notation: TimeNotation, label: str, first_row: int) -> Times:
    """Return times (n,) in text. Raises :class:`BadInputError` for one that is in no known notation, or not in that of
    the ``notation``; the message has the ``label`` of the column and the row, of which ``first_row`` is the first.
    """
    if notation.format is not None:
        return _dates(_with_decimals(text), (notation.format,), notation, label, first_row)
    text = text.str.replace(",", ".", regex=False)
    if _NOON.search(str(text.iloc[0])):
        text = text.str.replace(_NOON, " ", regex=True)
    if text.str.contains(_THREE_DIGITS).any():  # else they may be frames
        text = text.str.replace(_COLON_BEFORE_MS, _with_point, regex=True)
    first = text.iloc[:100]
    if first.str.fullmatch(_OF_AN_HOUR).all():
        return _of_the_hour(text, label, first_row)
    if are_durations(first):
        return Times(None, _durations(text, label, first_row))
    text, ahead_ns = without_zones(text)
    if text.iloc[:100].str.fullmatch(_CLOCK).all():
        return _clock(_with_decimals(text), ahead_ns, notation, label, first_row)
    return _dates(_with_decimals(in_english(text)), _DATE_FORMATS, notation, label, first_row, ahead_ns)


def _clock(text: pd.Series, ahead_ns: np.ndarray | None, notation: TimeNotation, label: str, first_row: int) -> Times:
    """Return times of day (n,), which may go on beyond 24 hours."""
    parsed = next((times for form in _CLOCK_FORMATS if (times := _parsed(text, form)) is not None), None)
    if parsed is not None:
        ns = parsed.dt.tz_localize(None).astype("datetime64[ns]").astype(np.int64).to_numpy() % DAY_NS
    elif text.str.fullmatch(_DURATION).all():
        ns = np.round(_durations(text, label, first_row) * 1e9).astype(np.int64)
    else:
        _refuse_unread(text, _CLOCK_FORMATS, label, first_row)
    return Times.of_the_day(ns - (0 if ahead_ns is None else ahead_ns), notation.zone, label)


def _dates(
    text: pd.Series,
    formats: Sequence[str],
    notation: TimeNotation,
    label: str,
    first_row: int,
    ahead_ns: np.ndarray | None = None,
) -> Times:
    """Return dates (n,) in the first of the formats that they all are in, ``ahead_ns`` of UTC or in their zone."""
    read = ((form, dates) for form in formats if (dates := _parsed(text, form)) is not None)
    form, parsed = next(read, (None, None))
    if form is None or parsed is None:
        _refuse_unread(text, formats, label, first_row)
    notes = tuple[str, ...]()
    if notation.format is None:
        parsed, notes = _in_order_of_days(text, parsed, form, label)
    zoned = parsed.dt.tz is not None
    if zoned:
        parsed = parsed.dt.tz_convert("UTC").dt.tz_localize(None)
    ns = parsed.astype("datetime64[ns]").astype(np.int64).to_numpy()
    if ahead_ns is not None:
        return Times(ns - ahead_ns, None, notes=notes)
    return Times(ns if zoned else as_utc(ns, notation.zone, label), None, notes=notes)


def _refuse_unread(text: pd.Series, formats: Sequence[str], label: str, first_row: int) -> NoReturn:
    """Raise :class:`BadInputError` with the first time that is not read."""
    row, cell = _first_unread(text, formats)
    raise BadInputError(
        f"{label}, row {first_row + row}: {printable(cell)[:40]!r} is no time in a known notation; expected one "
        "such as 2026-05-01T03:12:00.005. Hint: state time_format, e.g. '%d.%m.%Y %H:%M:%S.%f', in the mapping"
    )


def _with_point(match: re.Match[str]) -> str:
    """Return a time with its milliseconds, which may have lost their zeros in front, behind a point."""
    return f"{match[1]}.{match[2]:0>3}"


def _with_decimals(text: pd.Series) -> pd.Series:
    """Return times (n,) of which either none or all have decimals: some programs leave them out where they are zero."""
    whole = text.str.contains(_WHOLE_SECONDS).to_numpy(dtype=bool)
    return text.str.replace(_WHOLE_SECONDS, ".0", regex=True) if whole.any() and not whole.all() else text


def are_durations(text: pd.Series) -> bool:
    """Return whether all cells (n,) of text are durations: some say so by a day, by ISO 8601's P or by more hours than
    a day has.
    """
    return bool(text.str.fullmatch(_DURATION).all() and text.str.contains(_NO_TIME_OF_DAY).any())


def _durations(text: pd.Series, label: str, first_row: int) -> Array:
    """Return durations (n,), s."""
    read = pd.to_timedelta(text.str.replace(_POINT_BEHIND_DAYS, " ", regex=True), errors="coerce")
    _refuse_first(read.isna().to_numpy(), text, "0 days 00:00:12.005", label, first_row)
    return np.asarray(read.dt.total_seconds().to_numpy(dtype=np.float64))


def _of_the_hour(text: pd.Series, label: str, first_row: int) -> Times:
    """Return times (n,) of minutes and seconds, which go on where the next hour begins."""
    minutes, seconds = (part.astype("Float64") for _, part in text.str.extract(f"^{_OF_AN_HOUR}$").items())
    _refuse_first(minutes.isna().to_numpy(dtype=bool), text, "12:00.5", label, first_row)
    values = (60.0 * minutes + seconds).to_numpy(dtype=np.float64)
    hours = np.concatenate([[0], np.cumsum(np.diff(values) < -HOUR_S // 2)])
    lost = f"{label}: {text.iloc[0]!r} has no hour, as spreadsheets show times: the seconds in the hour are taken"
    return Times(None, values + HOUR_S * hours, notes=(lost,), of_hour=True)


def _refuse_first(unread: np.ndarray, text: pd.Series, example: str, label: str, first_row: int) -> None:
    """Raise :class:`BadInputError` with the first of the cells (n,) that are not read."""
    if unread.any():
        at = int(np.argmax(unread))
        cell = printable(str(text.iloc[at]))[:40]
        raise BadInputError(f"{label}, row {first_row + at}: {cell!r} is no time; expected one as {example}")


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


_FIRST_CELLS = 20
"""Cells by which a notation of dates is recognised: most notations fail at the first one."""


def _parsed(text: pd.Series, form: str) -> pd.Series | None:
    try:
        zoned = bool(OFFSET.search(str(text.iloc[0])))
        pd.to_datetime(text.iloc[:_FIRST_CELLS], format=form, utc=zoned)
        return pd.to_datetime(text, format=form, utc=zoned)
    except (ValueError, TypeError, OverflowError):
        return None


def are_dates(column: pd.Series) -> bool:
    """Return whether the first cells of a text column are dates with a time of day, in their sequence, or durations."""
    text = column.dropna().iloc[:_FIRST_CELLS].astype("string").str.strip().str.replace(",", ".", regex=False)
    if len(text) and are_durations(text):
        return True
    if not len(text) or not text.str.contains(":", regex=False).all():
        return False
    text = in_english(text)
    dates = next((dates for form in _DATE_FORMATS if (dates := _parsed(text, form)) is not None), None)
    return dates is not None and bool(dates.is_monotonic_increasing)


def _first_unread(text: pd.Series, formats: Sequence[str]) -> tuple[int, str]:
    """Return the first row that is not read by the format which reads most rows before it, and its cell."""
    missing = (pd.to_datetime(text, format=form, errors="coerce", utc=True).isna() for form in formats)
    at = max(int(np.argmax(rows)) for rows in missing)
    return at, str(text.iloc[at])

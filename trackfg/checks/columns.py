"""Faults of a single column that make its table unusable: each function takes an array and returns findings.

``place`` says where the array comes from. Rows in findings count from 1.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from trackfg.numerics.arrays import Array
from trackfg.recording.findings import Finding, Level

LARGEST = 1e12
"""In any unit that a column may have; times are in s here."""
SMALLEST_SIGMA_M = 1e-9
"""No place is known to a nanometre. The square of its reciprocal, a weight, is far from any limit of a number."""


@dataclass(frozen=True)
class ColumnPlace:
    """The file and the name of a column, and the time of each row (n,), s, for the message; None if not known."""

    file: str
    column: str
    t: Array | None = None

    def error(self, code: str, message: str, row: int, *, expected: str | None, hint: str | None) -> Finding:
        """Return an error in the row of that index."""
        return self.at_row("error", code, message, row, expected=expected, hint=hint)

    def at_row(
        self, level: Level, code: str, message: str, row: int, *, expected: str | None, hint: str | None
    ) -> Finding:
        """Return a finding in the row of that index."""
        time = float(self.t[row]) if self.t is not None and np.isfinite(self.t[row]) else None
        return Finding(
            level,
            code,
            message,
            file=self.file,
            column=self.column,
            row=row + 1,
            time_s=time,
            expected=expected,
            hint=hint,
        )


def not_finite(values: Array, place: ColumnPlace) -> list[Finding]:
    """Empty cells, NaN, infinities, and numbers that no quantity here can have; one finding for each kind."""
    magnitude = np.abs(values)
    if (magnitude <= LARGEST).all():
        return []
    empty = np.isnan(values)
    hint = "remove the row, or write the value"
    return [
        *_at_first(empty, place, "nan", "empty or NaN", "a finite number", hint),
        *_at_first(magnitude > LARGEST, place, "infinite", f"infinite, or above {LARGEST:g}", "a finite number", hint),
    ]


def not_increasing(t: Array, place: ColumnPlace) -> list[Finding]:
    """Times that repeat or fall from one row to the next."""
    steps = np.diff(t, prepend=-np.inf)
    if (steps > 0).all():
        return []
    expected = "times that grow from row to row"
    place = replace(place, t=t)
    return [
        *_at_first(
            steps == 0, place, "time-repeated", "the time of the row before again",
            expected, "remove the repeated rows, or give the time more digits",
        ),
        *_at_first(
            steps < 0, place, "time-falls", "earlier than the row before",
            expected, "sort the rows by time; repair a clock that was set while recording",
        ),
    ]  # fmt: skip


def gaps(t: Array, place: ColumnPlace, warning_s: float, error_s: float | None) -> list[Finding]:
    """Times without rows longer than the limits; the finding names the longest and where it ends."""
    if t.size < 2:
        return []
    steps = np.diff(t)
    longest = int(np.argmax(steps))
    gap = float(steps[longest])
    interval = float(np.median(steps))
    limit = max(warning_s, 3.0 * interval)
    if gap <= limit:
        return []
    is_error = error_s is not None and gap > error_s
    limit = error_s if is_error and error_s is not None else limit
    count = int(np.count_nonzero(steps > limit))
    more = f"; {count} gaps above {limit:.3g} s" if count > 1 else ""
    return [
        Finding(
            "error" if is_error else "warning",
            "gap",
            f"no rows for {gap:.4g} s before this one{more}",
            file=place.file,
            column=place.column,
            row=longest + 2,
            time_s=float(t[longest + 1]),
            expected=f"at most {limit:.3g} s",
            hint="recover the missing rows, or cut the recording in two here" if is_error else None,
        )
    ]


def unusable_sigmas(sd: Array, place: ColumnPlace) -> list[Finding]:
    """Sigmas that are zero or negative, or too small for any place; one finding for each kind."""
    hint = "write the 1-sigma error in m"
    tiny, expected = (sd > 0) & (sd < SMALLEST_SIGMA_M), f"{SMALLEST_SIGMA_M:g} m or more"
    return [
        *_at_first(sd <= 0, place, "bad-sigma", "a sigma that is zero or negative", "a number above 0", hint, sd),
        *_at_first(tiny, place, "bad-sigma", "a sigma that no place has", expected, hint, sd),
    ]


def falling(distance: Array, place: ColumnPlace) -> list[Finding]:
    """A cumulative count or distance that falls although the tach is declared unsigned."""
    hint = "set tach.signed = true if the vehicle rolled back; a counter that wraps must be unwrapped first"
    expected = "a value that never falls, as tach.signed = false"
    back = np.diff(distance, prepend=-np.inf) < 0
    return _at_first(back, place, "tach-backwards", "the tach runs backwards", expected, hint, distance)


def negative_speed(speed: Array, place: ColumnPlace) -> list[Finding]:
    """A speed below zero although the tach is declared unsigned."""
    hint = "set tach.signed = true if the vehicle rolled back"
    expected = "a speed of zero or more, as tach.signed = false"
    return _at_first(speed < 0, place, "tach-backwards", "the tach runs backwards", expected, hint, speed)


def negative_speed_over_ground(speed: Array, place: ColumnPlace) -> list[Finding]:
    """A speed over ground below zero although its sensor is declared unsigned."""
    hint = "set speed.signed = true if the vehicle rolled back"
    expected = "a speed of zero or more, as speed.signed = false"
    return _at_first(speed < 0, place, "speed-backwards", "the sensor sees it go backwards", expected, hint, speed)


def outside(values: Array, low: float, high: float, place: ColumnPlace) -> list[Finding]:
    """Latitudes or longitudes (deg) that do not exist."""
    wrong = (values < low) | (values > high)
    hint = 'check the order in gnss.position: latitude, longitude, height; for east, north, up set frame = "local"'
    expected = f"{low:g} to {high:g} deg"
    return _at_first(wrong, place, "position-range", "no such position on the Earth", expected, hint, values)


def _at_first(
    wrong: NDArray[np.bool_],
    place: ColumnPlace,
    code: str,
    message: str,
    expected: str,
    hint: str,
    values: Array | None = None,
) -> list[Finding]:
    """One error for the first row marked in ``wrong``, with its value if ``values`` are given; none if no row is."""
    count = int(np.count_nonzero(wrong))
    if count == 0:
        return []
    i = int(np.argmax(wrong))
    if values is not None:
        message = f"{values[i]:.9g}: {message}"
    if count > 1:
        message += f" ({count} such rows)"
    return [place.error(code, message, i, expected=expected, hint=hint)]

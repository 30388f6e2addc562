"""Faults of a single column that make its table unusable: each function takes an array and returns findings.

Common arguments: ``file`` and ``column`` say where the array comes from; ``t`` is the time of each row in s, used for
the message only. Rows in findings count from 1.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from trackfg.numerics.arrays import Array
from trackfg.recording.findings import Finding

LARGEST = 1e12
"""In any unit that a column may have; times are in s here."""


def not_finite(values: Array, file: str, column: str, t: Array | None = None) -> list[Finding]:
    """Empty cells, NaN, infinities, and numbers that no quantity here can have; one finding for each kind."""
    magnitude = np.abs(values)
    if (magnitude <= LARGEST).all():
        return []
    empty = np.isnan(values)
    mend = "remove the row, or write the value"
    return [
        *_at_first(empty, "nan", "empty or NaN", file, column, t, expected="a finite number", mend=mend),
        *_at_first(
            magnitude > LARGEST,
            "infinite",
            f"infinite, or above {LARGEST:g}",
            file,
            column,
            t,
            expected="a finite number",
            mend=mend,
        ),
    ]


def not_increasing(t: Array, file: str, column: str) -> list[Finding]:
    """Times that repeat or fall from one row to the next."""
    steps = np.diff(t, prepend=-np.inf)
    if (steps > 0).all():
        return []
    expected = "times that grow from row to row"
    return [
        *_at_first(
            steps == 0, "time-repeated", "the time of the row before again", file, column, t,
            expected=expected, mend="remove the repeated rows, or give the time more digits",
        ),
        *_at_first(
            steps < 0, "time-falls", "earlier than the row before", file, column, t,
            expected=expected, mend="sort the rows by time; repair a clock that was set while recording",
        ),
    ]  # fmt: skip


def gaps(t: Array, file: str, column: str, warning_s: float, error_s: float | None) -> list[Finding]:
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
            file,
            column,
            longest + 2,
            float(t[longest + 1]),
            f"at most {limit:.3g} s",
            "recover the missing rows, or cut the recording in two here" if is_error else None,
        )
    ]


def not_positive(sd: Array, file: str, column: str, t: Array | None = None) -> list[Finding]:
    """Sigmas that are zero or negative."""
    mend = "write the 1-sigma error in m"
    return _at_first(
        sd <= 0, "bad-sigma", "a sigma that is zero or negative", file, column, t, sd, "a number above 0", mend
    )


def falling(distance: Array, file: str, column: str, t: Array | None = None) -> list[Finding]:
    """A cumulative count or distance that falls although the tach is declared unsigned."""
    mend = "set tach.signed = true if the vehicle rolled back; a counter that wraps must be unwrapped first"
    back = np.diff(distance, prepend=-np.inf) < 0
    return _at_first(back, "tach-backwards", "the tach runs backwards", file, column, t, distance,
                     "a value that never falls, as tach.signed = false", mend)  # fmt: skip


def negative_speed(speed: Array, file: str, column: str, t: Array | None = None) -> list[Finding]:
    """A speed below zero although the tach is declared unsigned."""
    mend = "set tach.signed = true if the vehicle rolled back"
    return _at_first(speed < 0, "tach-backwards", "the tach runs backwards", file, column, t, speed,
                     "a speed of zero or more, as tach.signed = false", mend)  # fmt: skip


def outside(values: Array, low: float, high: float, file: str, column: str, t: Array | None = None) -> list[Finding]:
    """Latitudes or longitudes (deg) that do not exist."""
    wrong = (values < low) | (values > high)
    mend = 'check the order in gnss.position: latitude, longitude, height; for east, north, up set frame = "local"'
    return _at_first(wrong, "position-range", "no such position on the Earth", file, column, t, values,
                     f"{low:g} to {high:g} deg", mend)  # fmt: skip


def _at_first(
    wrong: NDArray[np.bool_],
    code: str,
    message: str,
    file: str,
    column: str,
    t: Array | None,
    values: Array | None = None,
    expected: str | None = None,
    mend: str | None = None,
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
    time = float(t[i]) if t is not None and np.isfinite(t[i]) else None
    return [Finding("error", code, message, file, column, i + 1, time, expected, mend)]

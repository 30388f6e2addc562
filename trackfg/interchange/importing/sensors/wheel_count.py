"""Unwrapping of a wheel's count, whose modulus may be any number.

Across a wrap from c_k to c_k+1 the wheel turns as far as in the rows beside it, by e: the modulus is c_k - c_k+1 + e,
or c_k+1 - c_k - e of a wheel that turns back. Each wrap brackets it so, by the least and the largest of the steps
nearby, and all of them must agree. What remains of the bracket is a fraction of a step, and within that the roundest
number is taken. A count that was set to zero has as good a bracket, but as a rule no round number in it.
"""

from __future__ import annotations

import numpy as np

from trackfg.interchange.importing.times.counters import end_of_range, unwrapped
from trackfg.numerics.arrays import Array

_WRAP = 0.8
"""A larger step, as a share of the range of the counts, may be a wrap."""
_LARGEST_STEP = 0.1
"""A larger step of the wheel, as a share of the range, does not show which steps are wraps."""
_NEARBY = 3
"""Steps on either side by which the step across a wrap is bracketed."""
_NARROW = 1e-3
"""Relative width of a bracket that is small beside the error of a wheel's diameter."""
_ROUNDING = 1e-6
"""That of a count with decimals, as a share of the range."""
_DIGITS = 2
"""Significant digits of a round number."""


def unwrapped_count(count: Array, modulus: float | None = None, *, signed: bool = False) -> Array:
    """Return a wheel's count or distance (n,) unwrapped, at its ``modulus`` or at that which its wraps show.

    ``signed``: the wheel also turns back. Where nothing shows a modulus the count stays as it is.
    """
    if modulus is not None:
        return np.unwrap(count, period=modulus) if signed else unwrapped(count, modulus)
    if count.size < 2 * _NEARBY:
        return unwrapped(count)
    steps = np.diff(count)
    wraps = _wraps(count, steps)
    modulus = _modulus(count, steps, wraps) if wraps.size else None
    if modulus is None:
        return unwrapped(count)
    return np.unwrap(count, period=modulus)


def _wraps(count: Array, steps: Array) -> np.ndarray:
    """Return the rows after which a count (n,) may wrap; none where its other steps do not set these apart.

    Two that follow each other at once are a value that drops out.
    """
    span = float(np.ptp(count))
    wraps = np.flatnonzero(np.abs(steps) > _WRAP * span)
    others = np.abs(np.delete(steps, wraps))
    is_apart = (np.diff(wraps) > _NEARBY).all() and others.max(initial=0.0) <= _LARGEST_STEP * span
    return wraps if is_apart else wraps[:0]


def _modulus(count: Array, steps: Array, wraps: np.ndarray) -> float | None:
    """Return the modulus that all wraps, after rows ``wraps``, show; None where they do not agree, or too vaguely."""
    # At an end of the record steps on one side alone do not bracket the one across.
    is_inside = (wraps >= _NEARBY) & (wraps < steps.size - _NEARBY)
    if is_inside.any():
        wraps = wraps[is_inside]
    span = float(np.ptp(count))
    rounding = 1.0 if (count == np.floor(count)).all() else _ROUNDING * span
    low, high = _bracket(steps, wraps, rounding)
    low = max(low, span + rounding)
    if low > high:
        return None
    ends = [end for end in end_of_range(span) if low <= end <= high]
    if ends:
        return ends[0]
    modulus, is_round = _roundest(low, high)
    is_narrow = high - low <= _NARROW * high
    evidence = (wraps.size > 1) + is_round + is_narrow
    return modulus if evidence >= 2 else None


def _bracket(steps: Array, wraps: np.ndarray, rounding: float) -> tuple[float, float]:
    """Return the least and the largest modulus that agrees with all wraps."""
    beside = wraps[:, None] + np.delete(np.arange(-_NEARBY, _NEARBY + 1), _NEARBY)
    is_step = (beside >= 0) & (beside < steps.size)
    nearby = np.where(is_step, steps[np.clip(beside, 0, steps.size - 1)], np.nan)
    least, largest = np.nanmin(nearby, axis=1), np.nanmax(nearby, axis=1)
    margin = largest - least + rounding
    across, sense = steps[wraps], -np.sign(steps[wraps])
    ends = np.abs(across)[:, None] + sense[:, None] * np.stack([least - margin, largest + margin], axis=1)
    return float(ends.min(axis=1).max()), float(ends.max(axis=1).min())


def _roundest(low: float, high: float) -> tuple[float, bool]:
    """Return the number from ``low`` to ``high`` with the fewest digits, and whether it is a round one."""
    digits = np.arange(1, 16)
    units = 10.0 ** (np.floor(np.log10(high)) + 1.0 - digits)
    numbers = np.ceil(low / units) * units
    fewest = int(np.argmax(numbers <= high))
    return float(numbers[fewest]), bool(digits[fewest] <= _DIGITS)

"""Counters that start again, of times, samples or pulses, go on."""

from __future__ import annotations

import numpy as np

from trackfg.numerics.arrays import Array

_LEAST_RANGE = 256
"""That of a counter of 8 bit: what starts again after less may as well be a vehicle that turns round."""


_FASTER = 3.0
"""Largest step across a wrap, in units of the largest other step: rows may be missing there."""


_FEWEST_TURNS = 3


_LEAST_TURN = 16


_SURE = 1e-3
"""Relative error of the modulus of a turn's count that is small beside that of a wheel's diameter."""


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

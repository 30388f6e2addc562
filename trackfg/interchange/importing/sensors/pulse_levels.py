"""The level of a wheel's pulse signal, 0 or 1 in each row: its rises are pulses, as long as none is between two rows.

A level that lasts less than the interval between two rows is in one of them or in none, and pulses are lost.
"""

from __future__ import annotations

import numpy as np

from trackfg.numerics.arrays import Array

_FEWEST_CHANGES = 10
"""Fewer changes of a column do not show whether they are those of a level."""
_LONG_ROWS = 3
"""Pulses that are counted in each row make no level of so many rows beside another one: first ones stand alone, then
zeros do."""
_IN_TURN = 20
"""A level that lasts d rows, 1 < d < 2, is in two rows every 1 / (d - 1) times: one that is in a single row so many
times in turn lasts less than 1.05."""


def are_levels(values: Array) -> bool:
    """Return whether values (n,) are the levels of a pulse signal, 0 or 1, for several rows each at low speed.

    Of pulses that are counted in each row ones stand alone, or where there are more than one in two rows, zeros.
    """
    if not np.isin(values, (0.0, 1.0)).all():
        return False
    rows = _rows_of_levels(values)
    longer = np.maximum(rows[:-2], rows[2:])  # of two with the same value: few rows a pulse make levels of 1 and 2
    shorter = np.minimum(longer[:-1], longer[1:])
    several = shorter.size >= _FEWEST_CHANGES and float(np.median(shorter)) >= 2.0
    return several or bool(np.count_nonzero(shorter >= _LONG_ROWS) >= _FEWEST_CHANGES)


def rises(levels: Array) -> Array:
    """Return how often levels (n,) have risen until each row."""
    return np.cumsum(np.diff(levels, prepend=levels[:1]) > 0.0).astype(np.float64)


def first_missed(levels: Array) -> int | None:
    """Return the row of levels (n,) from which pulses may lie between two rows; None where there is none."""
    begins = np.flatnonzero(np.diff(levels) != 0.0) + 1
    rows = _rows_of_levels(levels)
    first = [begins[state:-1:2][at] for state in (0, 1) if (at := _in_turn(rows[state::2] == 1)) is not None]
    return int(min(first)) if first else None


def _rows_of_levels(values: Array) -> np.ndarray:
    """Return how many rows each level has, without the first and the last one."""
    return np.diff(np.flatnonzero(np.diff(values) != 0.0))


def _in_turn(single: np.ndarray) -> int | None:
    """Return the first place from which on so many in turn are true; None without any."""
    if single.size < _IN_TURN:
        return None
    whole = np.convolve(single, np.ones(_IN_TURN, dtype=np.int64), mode="valid") == _IN_TURN
    return int(np.argmax(whole)) if whole.any() else None

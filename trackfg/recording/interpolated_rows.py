"""Rows of a receiver that a logger has interpolated between its measurements, to write its table faster.

Such positions lie on straight lines, evenly in time, and bend at the receiver's measurements alone: a row is off the
straight between its neighbours by no more than rounding, but for one or two rows per measurement. They hold no
measurement of their own, and their errors are those of the measurements around them.

What a receiver has measured bends in every row, by its noise and by the vehicle's acceleration; so bends are taken for
measurements only if they are regular and rare, and if straight is also what lies between two of them as a whole.
"""

from __future__ import annotations

import numpy as np

from trackfg.numerics.arrays import Array
from trackfg.numerics.spans import median_interval
from trackfg.recording.receiver_epochs import IN_MOTION_MPS, LONGER

_STRAIGHT = 0.7
"""Share of the rows below which the deviations from the straight show what rounding is: bends are rarer than others."""
_ROUNDING = 3.0
"""Times that deviation: from two coordinates rounded to whole units, 2.8 units at most where most are 1."""
_LEAST = 1e-6
"""Deviation that is always taken for rounding, m or m/s: conversion between coordinates bends straight lines by it."""
_FEWEST_BENDS = 10
"""Bends in motion below which nothing shows that they are regular."""
_REGULAR = 0.8
"""Share of the bends that are as far apart as the usual ones, to within a row and a half, and of one or two rows; the
bends of random rows that are as rare are so in 43 %."""


def interpolated_rows(t: Array, measured: Array) -> np.ndarray:
    """Return which rows (n,) at times t (n,), s, are interpolated: ``measured`` (n, k) are places, m, or speeds, m/s.

    A single column is a speed. A row per interval is kept where the vehicle stands.
    """
    none = np.zeros(len(t), dtype=bool)
    if len(t) < 2 * _FEWEST_BENDS or (step_s := median_interval(t)) is None:
        return none
    off, row = np.zeros(len(t)), np.arange(1, len(t) - 1)
    off[row] = _off_straight(t, measured, row - 1, row, row + 1)
    rounding = max(_ROUNDING * float(np.quantile(off, _STRAIGHT)), _LEAST)
    bends = off > rounding
    first = np.flatnonzero(bends & ~np.append(False, bends[:-1]))
    last = np.flatnonzero(bends & ~np.append(bends[1:], False))
    if len(first) < _FEWEST_BENDS:
        return none
    knots = np.where(off[last] > off[first], last, first)
    apart_s = np.diff(t[knots])
    moving = _moving(measured[knots], apart_s)
    if np.count_nonzero(moving) < _FEWEST_BENDS:
        return none
    interval_s = float(np.median(apart_s[moving]))
    begin, end = last[:-1] + 1, first[1:] - 1
    chord = _off_straight(t, measured, begin, (begin + end) // 2, end)
    usual = (np.abs(apart_s - interval_s) < LONGER * step_s) & (last - first <= 1)[1:] & (chord <= rounding)
    if interval_s < 2.0 * LONGER * step_s or np.mean(usual[moving]) < _REGULAR:
        return none
    knots = np.unique([0, *knots, len(t) - 1])
    apart_s = np.diff(t[knots])
    left_out = ~none
    left_out[knots] = False
    for i in np.flatnonzero((apart_s > LONGER * interval_s) & ~_moving(measured[knots], apart_s)):
        # at rest the receiver measures as often
        again = np.arange(t[knots[i]] + interval_s, t[knots[i + 1]] - 0.5 * interval_s, interval_s)
        left_out[np.searchsorted(t, again)] = False
    return left_out


def _off_straight(t: Array, measured: Array, begin: np.ndarray, row: np.ndarray, end: np.ndarray) -> Array:
    """Return how far values in rows (m,) are from the straights between those of ``begin`` and of ``end``."""
    share = ((t[row] - t[begin]) / np.where(end > begin, t[end] - t[begin], 1.0))[:, None]
    off = measured[row] - measured[begin] - share * (measured[end] - measured[begin])
    return np.asarray(np.linalg.norm(off, axis=1))


def _moving(measured: Array, apart_s: Array) -> np.ndarray:
    """Return between which of successive bends (m, k) the vehicle has moved on."""
    if measured.shape[1] == 1:
        return np.asarray(measured[1:, 0] > IN_MOTION_MPS)
    return np.asarray(np.linalg.norm(np.diff(measured, axis=0), axis=1) > IN_MOTION_MPS * apart_s)

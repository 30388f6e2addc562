"""The IMU and the tach averaged over the same short intervals, so that they can be compared.

Averages are differences of integrals, interpolated at the edges of the intervals: exact for any rates of sampling, the
same operator for both sensors, and without delay between them.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import pandas as pd
from scipy.ndimage import binary_erosion

from trackfg.numerics.arrays import Array
from trackfg.numerics.convolution import convolve_inside
from trackfg.numerics.spans import median_interval
from trackfg.recording.model import IMU_COLUMNS

_MOST_PER_SAMPLE = 10
"""With more intervals than so many for each sample of the IMU, nearly all are in gaps."""

_ROUNDING = 1e-13
"""Share of the largest value below which one that an FFT gives is rounding."""

_REACH = 4.0
"""A Gaussian average reaches so many of its standard deviations to either side, as SciPy's do."""


@dataclass(frozen=True)
class Motion:
    """``t_s`` (n,): the centres of intervals ``step_s`` long. ``gyro``, ``accel`` (n, 3): mean rate and specific force
    in body axes. ``speed`` (n,): from the nominal tach distance, NaN where there is none. ``valid`` (n,): no gap of the
    IMU or the tach touches the interval."""

    t_s: Array
    step_s: float
    gyro: Array
    accel: Array
    speed: Array
    valid: np.ndarray


def averaged(imu: pd.DataFrame, tach: pd.DataFrame | None, step_s: float) -> Motion | None:
    """Average over intervals of about ``step_s`` within the time that IMU and tach share; None if there are none.

    An interval is at least one IMU interval long. There are none either where a clock has jumped so far that nearly all
    of them would be empty: the jump must not decide how much memory is taken.
    """
    t = imu["t_s"].to_numpy()
    if t.size < 2:
        return None
    interval = median_interval(t)
    step = max(step_s, interval)
    begin, end = t[0], t[-1]
    if tach is not None:
        tach_t, distance = tach["t_s"].to_numpy(), tach["distance_m"].to_numpy()
        begin, end = max(begin, tach_t[0]), min(end, tach_t[-1])
    n = int((end - begin) / step)
    if not 1 <= n <= _MOST_PER_SAMPLE * t.size:
        return None
    edges = begin + step * np.arange(n + 1)
    values = _integrals(edges, t, (imu[name].to_numpy() for name in IMU_COLUMNS[1:])) / step
    valid = ~_touched(edges, t, max(0.5, 3.0 * interval))
    speed = np.full(n, np.nan)
    if tach is not None:
        speed = np.diff(np.interp(edges, tach_t, distance)) / step
        valid &= ~_touched(edges, tach_t, max(5.0, 5.0 * float(np.median(np.diff(tach_t)))))
    return Motion(edges[:-1] + 0.5 * step, step, values[:, :3], values[:, 3:], speed, valid)


def _integrals(edges: Array, t: Array, channels: Iterable[Array]) -> Array:
    """Integrals of channels (m,) at ``t`` (m,) from each edge (n + 1,) to the next, by the trapezoid rule: (n, c)."""
    half = 0.5 * np.diff(t)
    row = np.clip(np.searchsorted(t, edges, side="right") - 1, 0, t.size - 2)
    share, is_same = (edges - t[row]) / (t[row + 1] - t[row]), row[1:] == row[:-1]
    columns = []
    for values in channels:
        areas = values[1:] + values[:-1]
        areas *= half
        whole = np.where(is_same, 0.0, np.add.reduceat(areas, row)[:-1])
        columns.append(whole + np.diff(share * areas[row]))
    return np.column_stack(columns)


def _touched(edges: Array, t: Array, gap_s: float) -> np.ndarray:
    """Return which intervals a gap longer than ``gap_s`` between successive times touches."""
    touched = np.zeros(edges.size - 1, dtype=bool)
    for i in np.flatnonzero(np.diff(t) > gap_s):
        first, last = np.searchsorted(edges, [t[i], t[i + 1]])
        touched[max(first - 1, 0) : last] = True
    return touched


def band_passed(values: Array, valid: np.ndarray, step_s: float, short_s: float, long_s: float) -> Array:
    """``values`` (n,) less what is faster than ``short_s`` and slower than ``long_s``, without delay.

    The difference of two Gaussian averages with these standard deviations. Invalid intervals are bridged linearly
    before; near them and near both ends the result is set to 0, so that what is known from one side only weighs nothing
    in a correlation.
    """
    index = np.arange(values.size)
    if not valid.any():
        return np.zeros_like(values)
    bridged = np.interp(index, index[valid], values[valid])
    whole = int(_REACH * max(short_s, long_s) / step_s + 0.5)
    kernel = _gaussian(short_s / step_s, whole) - _gaussian(long_s / step_s, whole)
    out = convolve_inside(np.pad(bridged, whole, mode="symmetric"), kernel)
    out[np.abs(out) <= _ROUNDING * np.max(np.abs(bridged))] = 0.0  # a tach at rest has no acceleration
    reach = max(1, round(3.0 * short_s / step_s))
    known = binary_erosion(valid, iterations=reach)
    return np.where(known, out, 0.0)


def _gaussian(sd: float, whole: int) -> Array:
    """Return the weights of a Gaussian average, shape (2 whole + 1,); ``sd`` in steps."""
    step = np.arange(-whole, whole + 1)
    weights = np.where(np.abs(step) <= int(_REACH * sd + 0.5), np.exp(-0.5 * np.square(step / sd)), 0.0)
    return np.asarray(weights / weights.sum())

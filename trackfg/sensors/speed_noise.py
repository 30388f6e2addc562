"""The noise of a speed signal is seen against the accelerometer's.

The third difference of the integrated speed over times T apart, less that of the double integral of the forward
acceleration, is noise: gravity's part is another one on each gradient, but the same over some seconds. White noise of
the speed with the density n (m/s in 1 s) gives it the variance ``6 n^2 T``; that of the accelerometer with the density
a gives it ``a^2 T^3``, and a follows from the differences of successive samples.
"""

from __future__ import annotations

import numpy as np

from trackfg.numerics.robust import robust_sd
from trackfg.numerics.spans import median_interval
from trackfg.sensors.imu_intervals import Intervals
from trackfg.sensors.tach import Wheel

_STEP_S = 1.0
"""T, s: a wheel rolls smoothly for longer, and a gradient hardly changes."""

_ROWS = 2.0
"""T is at least so many intervals between rows."""

_MOVING_MPS = 1.0
"""Slower than this a signal may be silent, or stand still without noise."""

_FEWEST = 20
"""Fewer differences determine no noise: the sigma of a sigma is a sixth then."""

_LEAST_MPS = 0.005
"""m/s in 1 s: less than a sensor of the speed on a vehicle that rocks on its springs has."""


def speed_noise(wheel: Wheel, data: Intervals) -> float | None:
    """Return the density of the noise of a speed signal, m/s in 1 s; None where the run is too short to show it."""
    step = max(_STEP_S, _ROWS * median_interval(wheel.t))
    t = np.arange(max(wheel.t[0], data.edges[0]), min(wheel.t[-1], data.edges[-1]), step)
    if len(t) < _FEWEST + 3:
        return None
    gained = np.concatenate([[0.0], np.cumsum(data.accel[:, 0] * data.durations)])
    twice = np.concatenate([[0.0], np.cumsum(0.5 * (gained[1:] + gained[:-1]) * data.durations)])
    rolled = wheel.at(t)
    noise = np.diff(rolled - np.interp(t, data.edges, twice), n=3)
    known = (np.abs(rolled[3:] - rolled[:-3]) > 3.0 * step * _MOVING_MPS) & wheel.covers(t)[1:-2]
    if np.count_nonzero(known) < _FEWEST:
        return None
    sample = robust_sd(np.diff(data.accel[:, 0])) / np.sqrt(2.0)
    by_accel = sample**2 * median_interval(data.edges) * step**3
    variance = max(robust_sd(noise[known]) ** 2 - by_accel, 0.0)
    return max(float(np.sqrt(variance / (6.0 * step))), _LEAST_MPS)

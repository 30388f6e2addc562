"""The noise of a speed signal is seen against the accelerometer's.

The third difference of the integrated speed over times T apart, less that of the double integral of the forward
acceleration, is noise: gravity's part is another one on each gradient, but the same over some seconds. White noise of
the speed with the density n (m/s in 1 s) gives it the variance ``6 n^2 T``; that of the accelerometer with the density
a gives it ``a^2 T^3``, and a follows from the differences of successive samples.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from trackfg.numerics.arrays import Array
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

FEWEST = 20
"""Fewer differences determine no noise: the sigma of a sigma is a sixth then."""

_LEAST_MPS = 0.005
"""m/s in 1 s: less than a sensor of the speed on a vehicle that rocks on its springs has."""


class ThirdDifferences(NamedTuple):
    """The third differences of what a wheel rolls, less what the accelerometer says of them, where it moves.

    ``noise`` (n,), m; in the three steps of each the wheel rolls ``distance`` (n, 3), m, and the mean forward ``force``
    is (n, 3), m/s^2. ``by_accel`` is the variance that the accelerometer's white noise has in ``noise``, m^2.
    """

    noise: Array
    distance: Array
    force: Array
    by_accel: float


def third_differences(wheel: Wheel, data: Intervals, steps_s: Iterable[float]) -> Iterator[ThirdDifferences]:
    """Yield the third differences over times T, s, of each of ``steps_s``; gaps of the wheel are left out."""
    gained = np.concatenate([[0.0], np.cumsum(data.accel[:, 0] * data.durations)])
    twice = np.concatenate([[0.0], np.cumsum(0.5 * (gained[1:] + gained[:-1]) * data.durations)])
    sample = robust_sd(np.diff(data.accel[:, 0])) / np.sqrt(2.0)
    for step in steps_s:
        t = np.arange(max(wheel.t[0], data.edges[0]), min(wheel.t[-1], data.edges[-1]), step)
        if len(t) < FEWEST + 3:
            yield ThirdDifferences(np.zeros(0), np.zeros((0, 3)), np.zeros((0, 3)), 0.0)
            continue
        rolled = wheel.at(t)
        noise = np.diff(rolled - np.interp(t, data.edges, twice), n=3)
        known = (np.abs(rolled[3:] - rolled[:-3]) > 3.0 * step * _MOVING_MPS) & wheel.covers(t)[1:-2]
        distance, force = (
            sliding_window_view(np.diff(x), 3)[known] for x in (rolled, np.interp(t, data.edges, gained) / step)
        )
        by_accel = sample**2 * median_interval(data.edges) * step**3
        yield ThirdDifferences(noise[known], distance, force, by_accel)


def speed_noise(wheel: Wheel, data: Intervals) -> float | None:
    """Return the density of the noise of a speed signal, m/s in 1 s; None where the run is too short to show it."""
    step = max(_STEP_S, _ROWS * median_interval(wheel.t))
    (differences,) = third_differences(wheel, data, [step])
    if len(differences.noise) < FEWEST:
        return None
    variance = max(robust_sd(differences.noise) ** 2 - differences.by_accel, 0.0)
    return max(float(np.sqrt(variance / (6.0 * step))), _LEAST_MPS)

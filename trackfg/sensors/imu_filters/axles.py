"""A frame on two axles is a filter: its middle follows the mean of the track under both, it points along the chord.

On a wave of the wave number k the middle of axles L apart moves by cos(kL/2) of the amplitude, and the slope of the
chord is sin(kL/2) / (kL/2) of the track's. To second order the path is curved upwards by ``1 + b d^2/dx^2`` of what the
frame's pitch rate shows, with

    b = L^2 / 12.

So a sensor on such a frame measures at the speed v, where w is its rate and l its place, over the distance x,

    f_z / v^2 = (1 + b d^2/dx^2) p - l_x p' + l_y q' - T v p',   p = -w_y / v,   q = w_x / v,

beside gravity, with a delay T of the force. Least squares give b, with the sigma of errors that are correlated within
blocks, as in :mod:`~trackfg.sensors.imu_filters.accelerometer_clock`. Noise of the gyro makes the short waves of p
larger than they are, and b with them: a share e of noise in the power of p, by e / k^2 at most. The share of the
force's power that is not explained is not less than e, so that so much of b may be noise.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter1d

from trackfg.numerics.arrays import Array
from trackfg.numerics.spans import true_runs
from trackfg.sensors.imu_filters.block_fit import block_fit
from trackfg.sensors.imu_intervals import Intervals, means_between

STEP_S = 0.02
"""Step of the means that are brought to places, s."""

_STEP_M = 0.5
"""Step of the places, m."""

_SHORT_M, _LONG_M = 1.6, 6.0
"""Standard deviations of the two averages between which the band lies, m: waves of some 8 to 30 m. Axles of 2.5 m are
to second order right down to waves of 8 m (kL/2 = 1)."""

_END_M = 18.0
"""So much is left out at either end, m: three standard deviations of the longer average."""

_SLOWEST_MPS = 4.0
"""Slower than this gravity and noise are most of the force over the square of the speed, m/s."""

_SPEED_S = 0.5
"""Standard deviation of the speed's average, s: pulses are no motion."""

_BLOCK_M = 100.0
"""Blocks are far longer than what the band remembers, m."""

_LEAST_EXPLAINED = 0.9
"""The share of the force's power that the equation explains at least: what is on springs has a motion of its own."""

_SURE_SIGMAS = 4.0

SIGNALS = 7
"""Signals that have products: the terms p, p', v p', q, q' and p'', and the force."""


@dataclass(frozen=True)
class Axles:
    """``apart_m``: the distance L of the axles of the frame that the sensor is on."""

    apart_m: float


def means(samples: Intervals, t: Array, speed: Array) -> Array:
    """Return means over :data:`STEP_S` (n, 5) of samples, and speeds at the times ``t`` (m,).

    The columns are the speed, the rates of roll and pitch, the force upwards, and 1 where all was measured.
    """
    edges = np.arange(samples.edges[0], samples.edges[-1], STEP_S)
    if len(edges) < 2 or not len(t):
        return np.zeros((0, 5))
    middle = 0.5 * (edges[1:] + edges[:-1])
    gyro, accel = (means_between(edges[:-1], edges[1:], samples.edges, of) for of in (samples.gyro, samples.accel))
    measured = ~samples.bridged[np.searchsorted(samples.edges, middle) - 1]
    return np.column_stack([np.abs(np.interp(middle, t, speed)), gyro[:, :2], accel[:, 2], measured])


def products(means: Array) -> Array:
    """Return the sums of products of all signals by block (b, 7, 7), of :func:`means` (n, 5)."""
    blocks = [np.zeros((0, SIGNALS, SIGNALS))]
    if not len(means):
        return blocks[0]
    speed = gaussian_filter1d(means[:, 0], _SPEED_S / STEP_S)
    for first, end in true_runs((means[:, 4] > 0.0) & (speed > _SLOWEST_MPS)):
        v, (roll, pitch, up) = speed[first:end], means[first:end, 1:4].T
        x = np.concatenate([[0.0], np.cumsum(v * STEP_S)])
        if x[-1] >= _BLOCK_M + 2.0 * _END_M:
            blocks.append(_of_stretch(x, np.column_stack([-pitch / v, roll / v, (up - np.median(up)) / v**2, v])))
    return np.concatenate(blocks)


def _of_stretch(x: Array, shown: Array) -> Array:
    """Return the products of a stretch, by block; ``shown`` (n, 4) between the places ``x`` (n + 1,), m."""
    grid = np.arange(0.0, x[-1], _STEP_M)
    sums = np.concatenate([np.zeros((1, 4)), np.cumsum(shown * np.diff(x)[:, None], axis=0)])
    mean = np.column_stack([np.diff(np.interp(grid, x, one)) / _STEP_M for one in sums.T])
    band = gaussian_filter1d(mean[:, :3], _SHORT_M / _STEP_M, axis=0)
    band -= gaussian_filter1d(mean[:, :3], _LONG_M / _STEP_M, axis=0)
    slope = np.gradient(band, _STEP_M, axis=0)
    p, q, force = band.T
    bend = np.gradient(slope[:, 0], _STEP_M)
    rows = np.column_stack([p, slope[:, 0], mean[:, 3] * slope[:, 0], q, slope[:, 1], bend, force])
    rows = rows[round(_END_M / _STEP_M) : -round(_END_M / _STEP_M)]
    size = round(_BLOCK_M / _STEP_M)
    count = len(rows) // size
    parts = rows[: count * size].reshape(count, size, SIGNALS)
    return np.asarray(np.swapaxes(parts, 1, 2) @ parts)


def axles(products: Array) -> Axles | None:
    """Return how far apart axles are at least, of sums by block (b, 7, 7); None where nothing surely shows them."""
    fit = block_fit(products)
    if fit is None:
        return None
    noise = (1.0 - fit.explained) * fit.whole[0, 0] / fit.whole[1, 1]
    bend = fit.ratio - noise
    if fit.explained < _LEAST_EXPLAINED or bend < _SURE_SIGMAS * fit.sd:
        return None
    return Axles(math.sqrt(12.0 * bend))

"""A frame on two axles is a filter: its middle follows the mean of the track under both, it points along the chord.

On a wave of the wave number k the middle of axles L apart moves by cos(kL/2) of the amplitude, and the slope of the
chord is sin(kL/2) / (kL/2) of the track's. To second order the path is curved upwards by ``1 + b d^2/dx^2`` of what the
frame's pitch rate shows, with

    b = L^2 / 12.

So a sensor on such a frame measures at the speed v, where w is its rate and l its place, over the distance x,

    f_z / v^2 = (1 + b d^2/dx^2) p - l_x p' + l_y q' - T v p',   p = -w_y / v,   q = w_x / v,

beside gravity, with a delay T of the force; backwards v is negative, and x falls. Least squares give b, with the sigma
of errors that are correlated within blocks, as in :mod:`~trackfg.sensors.imu_filters.accelerometer_clock`. Noise of the
gyro makes the short waves of p larger than they are, and b with them: a share e of noise in the power of p, by e / k^2
at most. The share of the force's power that is not explained is not less than e, and the noise that the samples show
not either, so that so much of b may be noise. Vibration is no white noise: what the samples show of it may be several
times what there is in the band. So equation and noise together have to explain the force's power to a tenth.

What neither the equation nor the noise of the samples explains of the force is motion of the sensor's own: a body on
springs turns and moves otherwise than the track does. White noise of the density N in a mean over the time T has the
variance ``N^2 / T``; the band keeps of it the sum of the squares of its weights.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from scipy.ndimage import gaussian_filter1d

from trackfg.numerics.arrays import Array
from trackfg.numerics.chi_square import widening_of_few
from trackfg.numerics.spans import true_runs
from trackfg.sensors.imu_filters.block_fit import LEAST_EXPLAINED, block_fit
from trackfg.sensors.imu_intervals import Intervals, means_between
from trackfg.sensors.imu_noise.white_noise import WhiteNoise

STEP_S = 0.02
"""Step of the means that are brought to places, s."""

_STEP_M = 0.5
"""Step of the places, m."""

_SHORT_M, _LONG_M = 1.6, 6.0
"""Standard deviations of the two averages between which the band lies, m: waves of some 8 to 30 m. Axles of 2.5 m are
to second order right down to waves of 8 m (kL/2 = 1)."""

_END_M = 18.0
"""So much is left out at either end, m: three standard deviations of the longer average."""

_REACH = 4.0
"""Averages reach so many standard deviations to either side, as SciPy's do."""

_SLOWEST_MPS = 4.0
"""Slower than this gravity and noise are most of the force over the square of the speed, m/s."""

_SPEED_S = 0.5
"""Standard deviation of the speed's average, s: pulses are no motion."""

_BLOCK_M = 100.0
"""Blocks are far longer than what the band remembers, m."""

_SURE_SIGMAS = 4.0
"""Axles, or a motion of the sensor's own, are sure from so many sigmas on: 1 in 30,000 runs by chance."""

SIGNALS = 7
"""Signals that have products: the terms p, p', v p', q, q' and p'', and the force."""

MEANS = 7
"""Columns of :func:`means`."""


@dataclass(frozen=True)
class Axles:
    """``apart_m``: the distance L of the axles of the frame that the sensor is on."""

    apart_m: float


@dataclass(frozen=True)
class TrackSums:
    """Sums of products of all signals by block (b, 7, 7), and the ``noise`` in those of p and of the force (b, 2)."""

    products: Array = field(default_factory=lambda: np.zeros((0, SIGNALS, SIGNALS)))
    noise: Array = field(default_factory=lambda: np.zeros((0, 2)))

    def __len__(self) -> int:
        return len(self.products)

    def __add__(self, other: TrackSums) -> TrackSums:
        return TrackSums(np.concatenate([self.products, other.products]), np.concatenate([self.noise, other.noise]))


def means(samples: Intervals, noise: WhiteNoise, t: Array, speed: Array) -> Array:
    """Return means over :data:`STEP_S` (n, 7) of samples, and speeds at the times ``t`` (m,), between which the samples
    have the ``noise`` (m - 1,).

    The columns are the speed, backwards negative, the rates of roll and pitch, the force upwards, the squared densities
    of the noise of the rate of pitch and of the force, and 1 where all was measured.
    """
    edges = np.arange(samples.edges[0], samples.edges[-1], STEP_S)
    if len(edges) < 2 or len(t) < 2:
        return np.zeros((0, MEANS))
    middle = 0.5 * (edges[1:] + edges[:-1])
    gyro, accel = (means_between(edges[:-1], edges[1:], samples.edges, of) for of in (samples.gyro, samples.accel))
    measured = ~samples.bridged[np.searchsorted(samples.edges, middle) - 1]
    k = np.clip(np.searchsorted(t, middle) - 1, 0, len(t) - 2)
    densities = np.column_stack([noise.gyro[k, 1], noise.accel[k, 2]]) ** 2
    return np.column_stack([np.interp(middle, t, speed), gyro[:, :2], accel[:, 2], densities, measured])


def track_sums(means: Array) -> TrackSums:
    """Return the sums of :func:`means` (n, 7)."""
    sums = TrackSums()
    if not len(means):
        return sums
    speed = gaussian_filter1d(means[:, 0], _SPEED_S / STEP_S)
    for first, end in true_runs((means[:, -1] > 0.0) & (np.abs(speed) > _SLOWEST_MPS)):
        v, (roll, pitch, up, of_pitch, of_up) = speed[first:end], means[first:end, 1:6].T
        way = np.concatenate([[0.0], np.cumsum(np.abs(v) * STEP_S)])
        if way[-1] >= _BLOCK_M + 2.0 * _END_M:
            noise = of_pitch / np.abs(v), of_up / np.abs(v) ** 3
            shown = np.column_stack([-pitch / v, roll / v, (up - np.median(up)) / v**2, v, *noise])
            sums += _of_stretch(way, shown, 1.0 if v[0] > 0.0 else -1.0)
    return sums


def _of_stretch(way: Array, shown: Array, sense: float) -> TrackSums:
    """Return the sums of a stretch; ``shown`` (n, 6) between the places ``way`` (n + 1,), m, on a way in one ``sense``,
    -1 backwards.
    """
    grid = np.arange(0.0, way[-1], _STEP_M)
    sums = np.concatenate([np.zeros((1, shown.shape[1])), np.cumsum(shown * np.diff(way)[:, None], axis=0)])
    mean = np.column_stack([np.diff(np.interp(grid, way, integral)) / _STEP_M for integral in sums.T])
    band = _in_band(mean[:, :3])
    slope = sense * np.gradient(band, _STEP_M, axis=0)
    p, q, force = band.T
    bend = sense * np.gradient(slope[:, 0], _STEP_M)
    rows = np.column_stack([p, slope[:, 0], mean[:, 3] * slope[:, 0], q, slope[:, 1], bend, force])
    impulse = np.zeros(2 * round(_REACH * _LONG_M / _STEP_M) + 1)
    impulse[len(impulse) // 2] = 1.0
    noise = mean[:, 4:] / _STEP_M * np.sum(_in_band(impulse) ** 2)
    parts, noise_parts = (_by_block(of[round(_END_M / _STEP_M) : -round(_END_M / _STEP_M)]) for of in (rows, noise))
    return TrackSums(np.asarray(np.swapaxes(parts, 1, 2) @ parts), noise_parts.sum(axis=1))


def _in_band(values: Array) -> Array:
    """Return values at each :data:`_STEP_M` (n, ...) in the band."""
    short, long = (gaussian_filter1d(values, sd / _STEP_M, axis=0) for sd in (_SHORT_M, _LONG_M))
    return np.asarray(short - long)


def _by_block(rows: Array) -> Array:
    size = round(_BLOCK_M / _STEP_M)
    count = len(rows) // size
    return rows[: count * size].reshape(count, size, -1)


def axles(sums: TrackSums) -> Axles | None:
    """Return how far apart axles are at least, of sums by block; None where nothing surely shows them."""
    fit = block_fit(sums.products)
    if fit is None:
        return None
    of_rate, of_force = sums.noise.sum(axis=0)
    noise = min((1.0 - fit.explained) * fit.whole[0, 0], of_rate) / fit.whole[1, 1]
    bend = fit.ratio - noise
    left = 1.0 - fit.explained - of_force / fit.power
    if abs(left) > 1.0 - LEAST_EXPLAINED or bend < _SURE_SIGMAS * fit.sd:
        return None
    return Axles(math.sqrt(12.0 * bend))


def own_motion(sums: TrackSums) -> float | None:
    """Return the share of the force's power that is surely motion of the sensor's own, and not the track's; None where
    it may be less than a rigid sensor leaves.
    """
    fit = block_fit(sums.products)
    if fit is None:
        return None
    unexplained = fit.left - sums.noise.sum(axis=1)
    beyond = unexplained - (1.0 - LEAST_EXPLAINED) * sums.products[:, -1, -1]
    sd = widening_of_few(len(beyond) - 1) * float(np.std(beyond)) * math.sqrt(len(beyond))
    return float(unexplained.sum()) / fit.power if beyond.sum() > _SURE_SIGMAS * sd else None

"""The gyro's bias at the start is estimated before there is a graph.

At rest the gyro shows its bias. Rests are of different worth: one of T s gives the bias to ``density / sqrt(T)``, and
from one to the next it walks. So the means of rests are smoothed by

    sum (b_i - mean_i)^2 T_i / density^2 + sum (b_i+1 - b_i)^2 / (walk^2 dt_i)

The accelerometer's bias across tilts the vertical, and a turn of the vehicle by psi about a vertical that is off by e
looks to the gyro like a tilt by psi e across e: by that error the integrated rates of roll and pitch, less the tilt of
the specific force, change with the heading. It is accepted as far as the declared sigma allows; beyond three sigmas,
its own size is its sigma. So do the gyro's own errors where a slow vehicle turns once in a long time: with ``J_i`` the
derivative of the fitted e by the rate at time i, white noise n, a bias that walks by q, a response g to forces f and
the Earth's rate W, whose direction is not known yet, make of e the sigma

    s^2 = (n^2 / dt) sum J_i^2 + q^2 dt sum (sum_k>=i J_k)^2 + g^2 |sum J_i f_i|^2 + (W^2 / 2) |sum J_i exp(i psi_i)|^2.

What is left of the fit counts as its autocorrelation says: an hour of it may be a few independent values.

**Without any rest** the bias across is what makes the integrated gyro run away from gravity: the slope, over the run,
of the same difference. Kinematic accelerations spoil single tilts by 0.01 rad; over a minute that leaves 2e-4 rad/s.

The vertical part follows from GNSS positions in the same way, as the slope of the integrated yaw rate less the heading
of the path from position to position. Without them nothing measures it directly, but track is straight for a good part,
and curves go both ways: the middle of the yaw rates is that of the shortest interval that holds half of them, the
shorth (Andrews et al., *Robust Estimates of Location* (1972)). A run that lies in one curve has its rate there, too.
The three axes of a sensor are alike, so a bias beyond twice what the other two show is doubted by the excess, and all
are held against their level.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np
import pandas as pd
from scipy.linalg import solve_banded

from trackfg.numerics.arrays import Array
from trackfg.numerics.convolution import fast_length
from trackfg.numerics.geodesy import EARTH_RATE
from trackfg.numerics.robust import SD_PER_MAD, cauchy_fit
from trackfg.numerics.spans import median_interval, within
from trackfg.numerics.units import STANDARD_GRAVITY
from trackfg.recording.description import ImuNoise
from trackfg.sensors.imu_intervals import interpolate_columns
from trackfg.sensors.tilt import euler_rates, force_tilt

_ROUNDS = 3
"""The tilt depends on the yaw rate, and so on the bias: each round leaves some per cent of the error."""

_KINEMATIC_S = 5.0
"""Tilts by the specific force err for so long, s: accelerations that the speed does not show, gradients that change."""

_TILT_SD = 0.1
"""Sigma of the tilt by the bias of any accelerometer, rad: a sensor of a few euros is off by 50 to 100 mg."""

_LEAST_TILT_SD = 1e-3
"""Tilts by the specific force err by so much at least, rad: 0.01 m/s^2."""

_CURVE_LASTS_S = 10.0
"""A curve or a straight lasts so long, s: yaw rates are as many independent ones as there are such times in a run."""

_MEAN_S = 1.0
"""Yaw rates and tilts are means over this, s: vibration, and the yaw of a body on its springs, vanish in them."""

_FEWEST_MEANS = 100
"""Of tilts there are so many at least, over less time where the run is short."""

_OUTLIER_SIGMAS = 3.0
"""What is further from a straight line is no part of it."""

_STANDING_MPS = 0.5
"""A vehicle that is slower, m/s, has no heading that positions show, and is on no part of the track in particular."""

_CHORD_SIGMAS = 10.0
"""Headings are those between positions that are so many of their sigmas apart: 0.14 rad."""

_FEWEST_CHORDS = 3
"""Fewer headings determine no rate."""

_LONGEST_CHORD_S = 60.0
"""A pair of positions further apart in time, s, determines no heading: a bias of 3 deg/s turns by half a circle."""


@dataclass(frozen=True)
class StartingBias:
    """``gyro`` (n, 3) is its bias over time, rad/s; ``accel`` (3,), m/s^2, is the accelerometer's across the vertical,
    as far as turns show it. ``gyro_level``, rad/s, and ``accel_level``, m/s^2, are how large biases of the sensor are
    at least, by what shows of them.

    ``vertical_sd``, rad/s: sigma of the gyro's vertical part where it follows from what tracks are like; None where
    rests or positions measure it.
    """

    gyro: Array
    accel: Array
    gyro_level: float
    accel_level: float
    vertical_sd: float | None = None


@dataclass(frozen=True)
class GridMotion:
    """Means at times ``t`` (n,), s: rates and forces (n, 3), forward ``speed``, m/s, and ``acceleration`` (n,)."""

    t: Array
    gyro: Array
    accel: Array
    speed: Array
    acceleration: Array

    def kinematic(self, bias: Array) -> Array:
        """Return the specific force (n, 3), m/s^2, of the motion, with the gyro's bias (3,) or (n, 3), rad/s."""
        w = self.gyro - bias
        return np.stack([self.acceleration, self.speed * w[:, 2], -self.speed * w[:, 1]], axis=1)

    def tilt(self, bias: Array, accel_bias: Array) -> Array:
        """Return roll and pitch (n, 2), rad, by the specific force less its kinematic part and its bias (3,)."""
        return force_tilt(self.accel - accel_bias - self.kinematic(bias))


def starting_bias(
    motion: GridMotion, rests: Array, earth_rate: Array, noise: ImuNoise, gnss: pd.DataFrame | None
) -> StartingBias:
    """Return the gyro's bias by rests (m, 2), s, or else by tilt and heading, and how large biases are.

    ``earth_rate`` (3,), rad/s, in n; ``noise`` as declared.
    """
    if len(rests):
        gyro, vertical_sd = rest_bias(motion.t, motion.gyro, rests, earth_rate, noise.gyro_bias_walk), None
    else:
        start, vertical_sd = _without_rests(motion, earth_rate, noise, gnss)
        gyro = np.tile(start, (len(motion.t), 1))
    across = _Across.of(motion, gyro, noise)
    force = motion.accel - motion.kinematic(gyro)
    resting = within(motion.t, rests) if len(rests) else np.ones(len(motion.t), dtype=bool)
    excess = float(np.linalg.norm(np.median(force[resting], axis=0))) - STANDARD_GRAVITY
    level = max(abs(excess), across.accel_level)
    return StartingBias(gyro, across.accel, float(np.abs(gyro[0]).max()), level, vertical_sd)


@dataclass(frozen=True)
class _Across:
    """The difference of roll and pitch by the gyro (:attr:`turned`, (n, 3), rad, with the heading) and by the specific
    force, over turns and time: ``gyro`` (2,), rad/s, is what is left of its bias, ``accel`` (3,), m/s^2, the bias that
    tilts, ``accel_level``, m/s^2, how large such a bias is at least.
    """

    gyro: Array
    accel: Array
    accel_level: float
    turned: Array

    @classmethod
    def of(cls, motion: GridMotion, bias: Array, noise: ImuNoise) -> _Across:
        """Return them for a gyro's bias (3,) or (n, 3), rad/s; ``noise`` as declared."""
        step, since = np.gradient(motion.t), motion.t - motion.t[0]
        size = max(1, min(round(_MEAN_S / median_interval(motion.t)), len(motion.t) // _FEWEST_MEANS))
        error = np.zeros(2)
        for _ in range(_ROUNDS):
            # A pitch that is off makes a turn look like rolling, a roll that is off like pitching downhill.
            tilt = motion.tilt(bias, -STANDARD_GRAVITY * np.append(error, 0.0))
            turned = np.cumsum(euler_rates(motion.gyro - bias, tilt) * step[:, None], axis=0)
            terms = np.stack([np.ones_like(since), since, turned[:, 2]], axis=1)
            off = turned[:, :2] - tilt + error * turned[:, 2:]
            by_gyro_sd = tilt_error_sd_by_gyro(terms, motion.accel, noise)
            means, off = _means(terms, size), _means(off, size)
            fits = [_drift_and_error(means, y, noise.accel_bias_sd / STANDARD_GRAVITY, by_gyro_sd) for y in off.T]
            drift, error, level = np.array(fits).T
        return cls(drift, -STANDARD_GRAVITY * np.append(error, 0.0), STANDARD_GRAVITY * float(level.max()), turned)


def rest_bias(t: Array, gyro: Array, rests: Array, earth_rate: Array, walk: float = np.inf) -> Array:
    """Return the gyro's bias at ``t`` (n, 3): mean rates of rests less the Earth's vertical rate, smoothed (see above)
    and interpolated; 0 where there are none. Without a ``walk`` each mean stands for itself.

    The horizontal part of the Earth's rate, whose direction in the body is not known yet, stays in.
    """
    bounds = zip(np.searchsorted(t, rests[:, 0]), np.searchsorted(t, rests[:, 1], side="right"), strict=True)
    inside = [slice(first, end) for first, end in bounds if end > first]
    if not inside:
        return np.zeros((t.size, 3))
    step = median_interval(t)
    duration = step * np.array([rows.stop - rows.start for rows in inside])
    middle = np.array([t[rows].mean() for rows in inside])
    mean = np.stack([gyro[rows].mean(axis=0) for rows in inside]) - [0.0, 0.0, earth_rate[2]]
    variance = np.average([gyro[rows].var(axis=0).mean() for rows in inside], weights=duration) * step
    ratio = variance / (walk**2 * np.diff(middle))
    band = np.zeros((3, len(middle)))
    band[1] = duration + np.append(ratio, 0.0) + np.append(0.0, ratio)
    band[0, 1:] = band[2, :-1] = -ratio
    return interpolate_columns(t, middle, np.asarray(solve_banded((1, 1), band, mean * duration[:, None])))


def tilt_error_sd_by_gyro(terms: Array, accel: Array, noise: ImuNoise) -> float:
    """Return the sigma, rad, of the tilt's error that the gyro's declared errors make (module docstring).

    ``terms`` (n, 3): one, time and heading; ``accel`` (n, 3): forces, m/s^2.
    """
    step, heading = median_interval(terms[:, 1]), terms[:, 2]
    by_rate = step * np.cumsum(np.linalg.pinv(terms)[2, ::-1])[::-1]
    by_walk = np.cumsum(by_rate[::-1])
    parts = [
        noise.gyro_white * by_rate / np.sqrt(step),
        noise.gyro_bias_walk * by_walk * np.sqrt(step),
        noise.g_sensitivity_sd * (by_rate @ accel),
        EARTH_RATE * np.sqrt(0.5) * np.array([by_rate @ np.cos(heading), by_rate @ np.sin(heading)]),
    ]
    return float(np.linalg.norm(np.concatenate(parts)))


def _drift_and_error(terms: Array, off: Array, declared_sd: float, by_gyro_sd: float) -> tuple[float, float, float]:
    """Return a drift, rad/s, and an error of the tilt, rad, by which ``terms`` (n, 3) make ``off`` (n,), rad, and how
    large the error is at least: 0 where it is within three sigmas, of ``declared_sd``, rad, and what the gyro makes.
    """
    size = max(1, round(_KINEMATIC_S / median_interval(terms[:, 1])))
    fit = partial(cauchy_fit, terms, off, least_sd=_LEAST_TILT_SD)
    free = np.array([np.inf, np.inf, _TILT_SD])
    coefficients, _ = fit(prior_sd=free, per_value=size)
    fit = partial(fit, per_value=size * _spans_per_value(terms, off - terms @ coefficients, size))
    (_, _, error), sd = fit(prior_sd=free)
    usual = _OUTLIER_SIGMAS * float(np.linalg.norm([declared_sd, by_gyro_sd, sd[2]]))
    level = abs(error) if abs(error) > usual else 0.0
    (_, drift, error), _ = fit(prior_sd=np.array([np.inf, np.inf, max(level, declared_sd)]))
    return drift, error, level


def _spans_per_value(terms: Array, rest: Array, size: int) -> float:
    """Return how many spans, of ``size`` values of ``rest`` (n,) each, determine the heading's share as well as one
    that is independent of the others.

    It is ``1 + 2 sum r s`` over the lags up to which both autocorrelations are positive, r that of the rest and s that
    of the heading less a straight line (Bartlett, Journal of the Royal Statistical Society 98, 1935).
    """
    if len(rest) < 2 * size:
        return 1.0
    line = terms[:, :2]
    heading = terms[:, 2] - line @ np.linalg.lstsq(line, terms[:, 2])[0]
    r, s = (_autocorrelation(x, size) for x in (rest, heading))
    lasting = int(np.argmax(np.append(np.minimum(r, s), 0.0) <= 0.0))
    return 1.0 + 2.0 * float(r[:lasting] @ s[:lasting])


def _autocorrelation(x: Array, size: int) -> Array:
    """Return the autocorrelation of means of x (n,) over ``size`` values each, from lag 1 on; 0 where none varies."""
    means = _means(x, size)
    means -= means.mean()
    length = fast_length(2 * len(means))  # what wraps round falls behind
    products = np.fft.irfft(np.abs(np.fft.rfft(means, length)) ** 2, length)[: len(means)]
    return np.asarray(products[1:] / max(products[0], np.finfo(np.float64).tiny))


def _means(x: Array, size: int) -> Array:
    """Return means of x (n, ...) over ``size`` rows each."""
    count = len(x) // size
    return np.asarray(x[: count * size].reshape(count, size, *x.shape[1:]).mean(axis=1))


def _without_rests(
    motion: GridMotion, earth_rate: Array, noise: ImuNoise, gnss: pd.DataFrame | None
) -> tuple[Array, float | None]:
    """Return the gyro's bias (3,), rad/s, and the sigma of its vertical part where that is assumed."""
    bias, vertical_sd = np.median(motion.gyro, axis=0) * [1.0, 1.0, 0.0], None
    for _ in range(_ROUNDS):
        across = _Across.of(motion, bias, noise)
        bias[:2] += across.gyro
        level = max(noise.gyro_bias_sd, float(np.abs(bias[:2]).max()))
        rate = np.gradient(across.turned[:, 2], motion.t)
        middle, sd = _shorth(_yaw_rates(motion, rate + bias[2] - earth_rate[2]))
        sd = max(sd, abs(middle) - 2.0 * level)
        headings = _headings(motion, across.turned[:, 2], gnss)
        if headings is not None and _slope_sd(headings[:, 0]) < sd:
            bias[2] += _slope(headings[:, 0], headings[:, 1:])[0] - earth_rate[2]
            vertical_sd = None
        else:
            share = level**2 / (level**2 + sd**2)
            bias[2], vertical_sd = share * middle, float(np.sqrt(share)) * sd
    return bias, vertical_sd


def _slope(t: Array, y: Array) -> Array:
    """Return the slopes (c,) of straight lines through y (n, c), at times t (n,). What is further from the line than
    three sigmas, by the median, is left out of a second fit.
    """
    weight = np.ones_like(y)
    for _ in range(2):
        total = weight.sum(axis=0)
        middle, level = weight.T @ t / total, (weight * y).sum(axis=0) / total
        since = t[:, None] - middle
        slope: Array = (weight * since * (y - level)).sum(axis=0) / (weight * since**2).sum(axis=0)
        rest = np.abs(y - level - since * slope)
        limit = _OUTLIER_SIGMAS * SD_PER_MAD * np.median(rest, axis=0)
        weight = (rest <= limit + 1e-12).astype(np.float64)
    return slope


def _slope_sd(t: Array) -> float:
    """Return the sigma of the slope of headings at times t (m,), s, that lie one chord each, rad/s."""
    heading_sd = np.sqrt(2.0) / _CHORD_SIGMAS
    return float(heading_sd / (t.std() * np.sqrt(len(t))))


def _shorth(x: Array) -> tuple[float, float]:
    """Return the mean of the shortest interval that holds half of x (n,), one each second, and its sigma."""
    ordered = np.sort(x)
    half = (len(ordered) + 1) // 2
    width = ordered[half - 1 :] - ordered[: len(ordered) - half + 1]
    first = int(np.argmin(width))
    independent = max(1.0, len(x) * _MEAN_S / _CURVE_LASTS_S)
    return float(ordered[first : first + half].mean()), 0.5 * float(width[first]) / float(np.sqrt(independent))


def _yaw_rates(motion: GridMotion, rate: Array) -> Array:
    """Return means of the yaw rate (n,) over a second each, where the vehicle moves or nothing measures its speed."""
    size = max(1, round(_MEAN_S / median_interval(motion.t)))
    means, speed = _means(rate, size), _means(np.abs(motion.speed), size)
    moving = speed > _STANDING_MPS
    return np.asarray(means[moving] if moving.any() else means)


def _headings(motion: GridMotion, turned: Array, gnss: pd.DataFrame | None) -> Array | None:
    """Return times, s, and the integrated yaw rate (n,) less the heading between positions, rad, shape (m, 2).

    None where positions are too few, or too close together for their errors.
    """
    if gnss is None or len(gnss) <= _FEWEST_CHORDS:
        return None
    t, place = gnss["t_s"].to_numpy(), gnss[["east_m", "north_m"]].to_numpy()
    sigma = float(np.median(gnss[["east_sd_m", "north_sd_m"]]))
    way = np.cumsum(np.abs(motion.speed) * np.gradient(motion.t))
    at = np.interp(t, motion.t, way)
    knots = np.unique(np.searchsorted(at, np.arange(at[0], at[-1], _CHORD_SIGMAS * sigma)))
    begin, end = t[knots[:-1]], t[knots[1:]]
    chord = np.diff(place[knots], axis=0)
    used = (np.hypot(*chord.T) > 0.5 * _CHORD_SIGMAS * sigma) & (end - begin < _LONGEST_CHORD_S)
    if used.sum() < _FEWEST_CHORDS:
        return None
    begin, end, chord = begin[used], end[used], chord[used]
    integral = np.cumsum(turned * np.gradient(motion.t))
    mean = (np.interp(end, motion.t, integral) - np.interp(begin, motion.t, integral)) / (end - begin)
    backwards = np.interp(end, motion.t, motion.speed) + np.interp(begin, motion.t, motion.speed) < 0.0
    heading = np.arctan2(chord[:, 1], chord[:, 0]) + np.pi * backwards
    return np.stack([0.5 * (begin + end), np.unwrap(mean - heading)], axis=1)

"""Positions against the tach and the gyro: how late they are, which way they turn, which way chainage counts.

*Late:* speed from GNSS chords is correlated with that of the tach over the same intervals, as forward force is in
:mod:`trackfg.checks.diagnosis_clock`. A fix that is tau late has a chainage c = c0 + s d(t - tau) for the tach's
distance d, so that between fixes Delta c = s Delta d - s tau Delta v. The fit has Cauchy's weights, and of a tag that
is read again while it is passed the first row counts.

*Turning:* the course of the chords turns as the yaw rate says, slope 1; -1 where east and north (or longitude and
latitude) are exchanged, which mirrors the path.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import pandas as pd

from trackfg.checks.diagnosis_clock import CREEP_SD, Lag, best_lag
from trackfg.checks.diagnosis_speed import Slope, slope_of
from trackfg.numerics.arrays import Array
from trackfg.numerics.chi_square import widening_of_few
from trackfg.numerics.integrals import trapezoid_integral
from trackfg.numerics.robust import cauchy_fit, jackknife_sd
from trackfg.numerics.spans import median_interval
from trackfg.numerics.units import STANDARD_GRAVITY
from trackfg.recording.model import Recording
from trackfg.sensors.averages import averaged, band_passed

_STEP_S = 0.5
"""Step of the chords' centres, s."""
_CHORD_S = 4.0
"""Chords are this long, s, or two intervals of the receiver: their noise is its own over this time."""
_SHORT_S, _LONG_S = 1.0, 8.0
_COURSE_LONG_S = 20.0
"""The band's standard deviations, s: stops, starts and curves."""
_MIN_SPEED_CHANGE = 0.2
"""m/s, rms in the band: below it speed does not say when anything happened."""
_MIN_CHORD_SIGMAS = 10.0
"""A chord has a course where it is so many sigmas of a position long."""
_MIN_CORRELATION = 0.7
"""A peak of the correlation shows a delay from this on: speeds of one vehicle, unlike forces, agree but for noise."""
_MAX_LAG_S = 20.0
"""Longest delay that is looked for, s. Records of less than some times as much are not compared."""
_MAX_GAP_S = 5.0
"""Chords do not span a longer gap of the positions, s."""
_FEWEST_FIXES = 6
"""Fewer fixes show no delay: two unknowns and the scatter of their differences."""
_READ_AGAIN_S = 1.0
"""A tag that is read again within this was not left between, s: no vehicle turns back as fast."""
_SURE_SIGMAS = 3.3
"""Of a delay, within which it is chance, at the probability of 1e-3."""
_ROUNDING = 1e-6
"""Residuals of fixes in their sigmas are at least so large."""
_FURTHER_ROUNDS, _SETTLED_S = 3, 0.1
"""Rounds after which the delay must have settled, to so many s or its sigma."""


@dataclass(frozen=True)
class FixDelay:
    """Fixes are stamped ``delay_s`` after their place was passed; ``slope``: of chainage on the tach's distance.

    ``sd_s`` is that of leave-one-out (jackknife) values, which one wrong fix widens, and few do, and of the creep.
    """

    delay_s: float
    sd_s: float
    slope: float

    @property
    def is_sure(self) -> bool:
        """Return whether the fixes are surely late, or early."""
        return abs(self.delay_s) > _SURE_SIGMAS * self.sd_s


class FixPassages(NamedTuple):
    """Fixes by the times that they are stamped with, ``t`` (n,), s: the ``distance`` then, m, the ``speed``, m/s, the
    ``chainage`` that they give, m, and its sigma ``sd``, m.
    """

    t: Array
    distance: Array
    speed: Array
    chainage: Array
    sd: Array


@dataclass(frozen=True)
class PositionFit:
    """``gnss_delay``: how late positions are on the IMU's clock; ``course``: slope of the turns of the path on those of
    the gyro. None where the recording does not show it.
    """

    gnss_delay: Lag | None = None
    course: Slope | None = None
    fix_delay: FixDelay | None = None


def fit_positions(recording: Recording, tach: pd.DataFrame | None) -> PositionFit:
    """Compare the positions of a recording with its gyro and a ``tach`` table on the IMU's clock."""
    gnss, fixes = recording.gnss, recording.fixes
    delay = None if gnss is None or tach is None else gnss_delay(tach, gnss)
    return PositionFit(
        delay,
        None if gnss is None else course_slope(recording.imu, gnss, 0.0 if delay is None else delay.lag_s),
        None if fixes is None or tach is None else fix_delay(tach, fixes),
    )


def gnss_delay(tach: pd.DataFrame, gnss: pd.DataFrame) -> Lag | None:
    """Return how much later than the tach the positions are, s; None where speed does not show it.

    It is found again with the positions brought forward by what was found: the ends of both signals then agree.
    """
    rest = _gnss_lag(tach, gnss)
    delay_s = 0.0 if rest is None else rest.lag_s
    for _ in range(_FURTHER_ROUNDS):
        if rest is None:
            return None
        rest = _gnss_lag(tach, gnss.assign(t_s=gnss["t_s"] - delay_s))
        delay_s += 0.0 if rest is None else rest.lag_s
    is_settled = rest is not None and abs(rest.lag_s) < max(_SETTLED_S, rest.sd_s)
    return replace(rest, lag_s=delay_s) if rest is not None and is_settled else None


def _gnss_lag(tach: pd.DataFrame, gnss: pd.DataFrame) -> Lag | None:
    t, valid, chord_s = _chord_times(gnss, tach["t_s"].to_numpy())
    if t.size < 3.0 * _MAX_LAG_S / _STEP_S:
        return None
    ends = t[:, None] + 0.5 * chord_s * np.array([-1.0, 1.0])
    by_tach = np.diff(np.interp(ends, tach["t_s"], tach["distance_m"]), axis=1)[:, 0] / chord_s
    by_gnss = np.linalg.norm(_chords(gnss, ends), axis=1) / chord_s
    a, b = (band_passed(np.abs(x), valid, _STEP_S, _SHORT_S, _LONG_S) for x in (by_tach, by_gnss))
    if np.sqrt(np.mean(a**2)) < _MIN_SPEED_CHANGE:
        return None
    return best_lag(a, b, _STEP_S, _LONG_S, _MAX_LAG_S, _MIN_CORRELATION)


def path_of(speeds: pd.DataFrame) -> pd.DataFrame:
    """Return the path of a receiver's speeds as a tach's table."""
    t = speeds["t_s"].to_numpy()
    return pd.DataFrame({"t_s": t, "distance_m": trapezoid_integral(t, speeds["speed_mps"].to_numpy())})


def path_along(gnss: pd.DataFrame, shared: Array) -> pd.DataFrame | None:
    """Return the path along chords of the positions as a tach's table, in the time ``shared`` (n,), s, with a table.

    None where positions are too few, or span no time without a gap.
    """
    t, valid, chord_s = _chord_times(gnss, shared)
    if t.size < 3 or not valid.any():
        return None
    chords = _chords(gnss, t[:, None] + 0.5 * chord_s * np.array([-1.0, 1.0]))
    path = np.cumsum(np.linalg.norm(chords, axis=1)) * _STEP_S / chord_s
    return pd.DataFrame({"t_s": t[valid], "distance_m": path[valid]})


def course_slope(imu: pd.DataFrame, gnss: pd.DataFrame, delay_s: float) -> Slope | None:
    """Return the slope of the turns of GNSS chords on those that the gyro shows; None without curves.

    ``delay_s``: how late the positions are.
    """
    gnss = gnss.assign(t_s=gnss["t_s"] - delay_s)
    motion = averaged(imu, None, _STEP_S)
    if motion is None:
        return None
    t, valid, chord_s = _chord_times(gnss, motion.t_s)
    if t.size < 4 * _MAX_LAG_S / _STEP_S:
        return None
    chord = _chords(gnss, t[:, None] + 0.5 * chord_s * np.array([-1.0, 1.0]))
    sd = float(np.median(gnss[["east_sd_m", "north_sd_m"]]))
    valid &= np.linalg.norm(chord, axis=1) > max(_MIN_CHORD_SIGMAS * sd, chord_s)
    if not valid.any():
        return None
    yaw = np.cumsum(motion.gyro[:, 2] - np.median(motion.gyro[:, 2])) * motion.step_s
    mean_yaw = pd.Series(yaw).rolling(max(1, round(chord_s / motion.step_s)), center=True, min_periods=1).mean()
    course = np.interp(t, t[valid], np.unwrap(np.arctan2(chord[valid, 1], chord[valid, 0])))
    x, y = (
        band_passed(values, valid, _STEP_S, _SHORT_S, _COURSE_LONG_S)
        for values in (np.interp(t, motion.t_s, mean_yaw), course)
    )
    return slope_of(x, y, (np.arange(t.size) * _STEP_S // _MAX_LAG_S).astype(np.int64))


def _chord_times(gnss: pd.DataFrame, shared: Array) -> tuple[Array, np.ndarray, float]:
    """Return the centres of chords in the time shared with a table, which of them span no gap, and their length, s."""
    t = gnss["t_s"].to_numpy()
    if t.size < 3:
        return np.zeros(0), np.zeros(0, dtype=np.bool_), _CHORD_S
    chord_s = max(_CHORD_S, 2.0 * median_interval(t))
    begin, end = max(t[0], shared[0]) + 0.5 * chord_s, min(t[-1], shared[-1]) - 0.5 * chord_s
    centres = np.arange(begin, end, _STEP_S)
    valid = np.ones(centres.size, dtype=np.bool_)
    for i in np.flatnonzero(np.diff(t) > max(_MAX_GAP_S, chord_s)):
        valid &= (centres < t[i] - 0.5 * chord_s) | (centres > t[i + 1] + 0.5 * chord_s)
    return centres, valid, chord_s


def _chords(gnss: pd.DataFrame, ends: Array) -> Array:
    """Return horizontal chords (n, 2) between the positions at the times ``ends`` (n, 2)."""
    return np.column_stack([np.diff(np.interp(ends, gnss["t_s"], gnss[c]), axis=1) for c in ("east_m", "north_m")])


def fix_delay(tach: pd.DataFrame, fixes: pd.DataFrame) -> FixDelay | None:
    """Return how late fixes are on the clock of a tach; None as of :func:`delay_of`."""
    t, distance = tach["t_s"].to_numpy(), tach["distance_m"].to_numpy()
    inside = fixes[(fixes["t_s"] > t[0] + 1.0) & (fixes["t_s"] < t[-1] - 1.0)]
    at = inside["t_s"].to_numpy()
    speed = 0.5 * (np.interp(at + 1.0, t, distance) - np.interp(at - 1.0, t, distance))
    shown = (inside[name].to_numpy() for name in ("chainage_m", "chainage_sd_m"))
    return delay_of(FixPassages(at, np.interp(at, t, distance), speed, *shown))


def delay_of(passages: FixPassages, creep_sd: float = CREEP_SD) -> FixDelay | None:
    """Return how late fixes are, by the differences of successive ones.

    ``creep_sd``: the sigma of how much the wheel, by which the distance was measured, creeps per force, 1/g. A wheel
    that creeps by a share c of the force rolls further by ``c v Delta v / g`` while the vehicle becomes faster, as if
    fixes were late. None with fewer than six fixes, or where all were passed at one speed.
    """
    if not len(passages.t):
        return None
    read_again = (np.diff(passages.t) <= _READ_AGAIN_S) & (np.diff(passages.chainage) == 0.0)
    first = np.concatenate([[True], ~read_again])
    _, distance, speed, chainage, sd = (of[first] for of in passages)
    if len(distance) < _FEWEST_FIXES:
        return None
    sd = np.hypot(sd[1:], sd[:-1])
    A, b = np.column_stack([np.diff(distance), -np.diff(speed)]) / sd[:, None], np.diff(chainage) / sd
    if np.linalg.matrix_rank(A) < 2:
        return None

    def solved(kept: np.ndarray) -> tuple[float, float]:
        (slope, product), _ = cauchy_fit(A[kept], b[kept], np.full(2, np.inf), _ROUNDING)
        return float(slope), float(product / slope) if slope != 0.0 else np.nan

    everything = np.ones(b.size, dtype=np.bool_)
    slope, delay = solved(everything)
    others = np.array([solved(np.arange(b.size) != i)[1] for i in range(b.size)])
    chance = widening_of_few(b.size - 2) * jackknife_sd(others, delay)
    sd_s = float(np.hypot(chance, creep_sd * np.mean(np.abs(speed)) / STANDARD_GRAVITY))
    return FixDelay(delay, sd_s, slope) if np.isfinite(sd_s) and np.isfinite(delay) else None

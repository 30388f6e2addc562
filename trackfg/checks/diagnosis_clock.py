"""The offset between the clocks of IMU and tach.

Forward specific force is ``f_x = dv/dt - g sin(pitch)``; the tach gives ``dv/dt``. Both, averaged over the same
intervals and band-passed alike (what is slow in f_x is the gradient, what is fast is vibration and pulses), are
correlated over a range of lags. The peak, refined by a parabola through its three highest points, is the offset.

Its sigma is that of the zero of ``sum y(t) x'(t + offset)`` for ``y(t) = k x(t + offset) + e(t)`` with coloured e:
``var = sum_l R_e(l) R_x'(l) / (sum y' x')^2``, R_e being the residual's sample autocovariance and R_x' the
autocorrelation sum of ``x'`` (the sandwich formula; Newey & West, Econometrica 55, 1987). Noise of the force enlarges
``x'^2`` without saying anything of the offset; its product with ``y'`` is on average that of the motion alone.

A wheel that pulls or brakes creeps in proportion to the force, and turns by ``v (1 + c f / g)``. Its acceleration has
``c |v| f' / g`` more, which looks as if the tach were ahead by ``c |v| / g``: 0.08 s at 20 m/s with c = 0.04. Least
squares in ``f``, ``f'`` and ``|v| f' / g`` about the peak separate the clock from it, as far as speeds differ; c is 0
within the sigma that the smoother takes for it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pandas as pd
from scipy.ndimage import gaussian_filter1d

from trackfg.numerics.arrays import Array
from trackfg.numerics.robust import jackknife_sd, robust_sd
from trackfg.numerics.units import STANDARD_GRAVITY
from trackfg.recording.model import Recording
from trackfg.sensors.averages import Motion, averaged, band_passed

_STEP_S = 0.05
"""Step of the averages that are compared, s; a parabola through three of them gives the offset between."""
_SHORT_S, _LONG_S = 0.4, 3.0
"""Standard deviations of the two averages between which the band lies, s: pulses and vibration are faster, gradients
slower."""
_MIN_CORRELATION = 0.4
"""A peak of the correlation shows an offset from this on: its sigma says how well."""
_MIN_DURATION_S = 20.0
"""A shorter motion is not compared, s: it has less than seven times the band's longer average."""
_MIN_ACCELERATION = 0.01
"""m/s^2, rms in the band: below it the tach does not say when anything happened."""


_MEMORIES = 3.5
"""Residuals further apart than so many standard deviations of the band's longer average are taken for independent."""


_SURE_SIGMAS, _SURE_SPREADS = 4.0, 3.0
"""An offset is sure from so many of its sigmas on (1 in 16,000 by chance), and of the scatter over parts of the run."""
_FEWEST_BLOCKS = 3
"""With fewer blocks of a signal the scatter of its lag is not estimated."""
_LEAST_OFFSET_S = 0.02
"""Offsets below do not matter, s: the smoother estimates them."""
_MADE_BY = 2.0
"""An offset that moves by so many sigmas, and is no longer sure, without the outliers is due to them."""
_FAR_SIGMAS = 5.0
"""A tach's acceleration that is so many robust sigmas off the force is an outlier: a wheel slips, for example."""
CREEP_SD = 0.05
"""Sigma of how much a wheel creeps per force, 1/g: what the smoother takes it for (``tach.creep_per_traction_sd``)."""
_MAX_ACCELERATION = 8.0
"""m/s^2: a tach that changes faster slips, or jumps."""


@dataclass(frozen=True)
class ClockOffset:
    """``offset_s`` is to be added to the tach's time, besides ``tach.time_offset_s``, to bring it to the IMU's clock.

    ``correlation`` at that offset is negative where the forward axis points backwards. ``spread_s``: as of a
    :class:`Lag`.
    """

    offset_s: float
    sd_s: float
    spread_s: float
    correlation: float

    @property
    def is_sure(self) -> bool:
        """Return whether the clocks are surely apart."""
        return Lag(self.offset_s, self.sd_s, self.spread_s, self.correlation).is_sure(_LEAST_OFFSET_S)


class Likeness(NamedTuple):
    """The ``correlation`` of two signals, 0 or more, and how many of their values are ``independent``."""

    correlation: float
    independent: float


NOT_ALIKE = Likeness(0.0, 0.0)


def estimate_clock_offset(recording: Recording, max_offset_s: float = 20.0) -> ClockOffset | None:
    """Return the :func:`clock_offset` of a recording; None without a tach."""
    return None if recording.tach is None else clock_offset(recording.imu, recording.tach, max_offset_s)


def clock_offset(imu: pd.DataFrame, tach: pd.DataFrame, max_offset_s: float = 20.0) -> ClockOffset | None:
    """Return the offset between tach and IMU, or None where the rows do not show it.

    That is where they are shorter than 20 s, without acceleration, with a correlation below 0.4, or with the best
    offset at the end of the range +-``max_offset_s`` (at most half of the time).
    """
    signals = _Signals.between(imu, tach)
    if signals is None:
        return None
    valid = signals.plausible
    estimate = signals.offset(valid, max_offset_s)
    if estimate is None or not estimate.is_sure:
        return estimate
    again = signals.offset(valid & ~signals.far_off(valid, estimate.offset_s), max_offset_s)
    by_slips = again is None or (
        not again.is_sure and abs(again.offset_s - estimate.offset_s) > _MADE_BY * estimate.sd_s
    )
    return again if by_slips else estimate


def likeness(imu: pd.DataFrame, tach: pd.DataFrame, offset: ClockOffset, within_s: float) -> Likeness:
    """Return how alike the accelerations of tach and IMU are, to ``within_s`` of an offset that another part of the
    recording shows.
    """
    signals = _Signals.between(imu, tach)
    acceleration = None if signals is None else signals.acceleration(signals.plausible)
    if signals is None or acceleration is None:
        return NOT_ALIKE
    step_s = signals.motion.step_s
    lags, correlation = lagged_correlation(acceleration, signals.force, (abs(offset.offset_s) + within_s) / step_s)
    near = np.abs(lags * step_s - offset.offset_s) <= within_s
    alike = float(np.max(np.sign(offset.correlation) * correlation[near], initial=0.0))
    return Likeness(alike, np.count_nonzero(acceleration) * step_s / _LONG_S)


@dataclass(frozen=True)
class _Signals:
    """The signals that are compared: the ``motion``, the tach's acceleration ``speed_change`` (n,) and, in the band
    whose shorter average has the standard deviation ``short_s``, the forward ``force`` (n,).
    """

    motion: Motion
    short_s: float
    speed_change: Array
    force: Array

    @classmethod
    def between(cls, imu: pd.DataFrame, tach: pd.DataFrame) -> _Signals | None:
        """Return the signals of both tables; None where they share less than 20 s."""
        motion = averaged(imu, tach, _STEP_S)
        if motion is None or motion.t_s.size * motion.step_s < _MIN_DURATION_S:
            return None
        short_s = max(_SHORT_S, 0.5 * float(np.median(np.diff(tach["t_s"]))), motion.step_s)
        force = band_passed(motion.accel[:, 0], motion.valid, motion.step_s, short_s, _LONG_S)
        return cls(motion, short_s, tach_acceleration(motion), force)

    @property
    def plausible(self) -> np.ndarray:
        """Return where a vehicle may change its speed like that, (n,)."""
        smooth = gaussian_filter1d(self.speed_change, self.short_s / self.motion.step_s)
        return np.asarray(self.motion.valid & (np.abs(smooth) < _MAX_ACCELERATION))

    def in_band(self, values: Array, valid: np.ndarray) -> Array:
        return band_passed(values, valid, self.motion.step_s, self.short_s, _LONG_S)

    def acceleration(self, valid: np.ndarray) -> Array | None:
        """Return the tach's acceleration in the ``valid`` (n,) intervals in the band, (n,); None if there is little."""
        acceleration = self.in_band(self.speed_change, valid)
        return acceleration if np.sqrt(np.mean(acceleration**2)) >= _MIN_ACCELERATION else None

    def offset(self, valid: np.ndarray, max_offset_s: float) -> ClockOffset | None:
        """Return the offset that the ``valid`` (n,) intervals of the tach show."""
        acceleration = self.acceleration(valid)
        if acceleration is None:
            return None
        lag = best_lag(acceleration, self.force, self.motion.step_s, _LONG_S, max_offset_s, _MIN_CORRELATION)
        if lag is None:
            return None
        moved_s, wider = self._beside_creep(acceleration, valid, lag.lag_s)
        return ClockOffset(lag.lag_s + moved_s, wider * lag.sd_s, lag.spread_s, lag.correlation)

    def far_off(self, valid: np.ndarray, offset_s: float) -> np.ndarray:
        """Return where the tach's acceleration is far from the force that shows it ``offset_s`` later, (n,)."""
        acceleration, force = self.in_band(self.speed_change, valid), self._later(self.force, offset_s)
        known = acceleration != 0.0
        gain = float(force[known] @ acceleration[known] / (force[known] @ force[known]))
        off = np.where(known, acceleration - gain * force, 0.0)
        return np.asarray(np.abs(off) > _FAR_SIGMAS * robust_sd(off[known]))

    def _later(self, values: Array, offset_s: float) -> Array:
        index = np.arange(values.size)
        return np.asarray(np.interp(index + offset_s / self.motion.step_s, index, values))

    def _beside_creep(self, acceleration: Array, valid: np.ndarray, lag_s: float) -> tuple[float, float]:
        """Return how far the offset is from the lag, s, and how many times wider its sigma, if the wheel may creep."""
        motion, known = self.motion, acceleration != 0.0
        force = self._later(motion.accel[:, 0], lag_s)
        change = np.gradient(force, motion.step_s)
        speed = gaussian_filter1d(np.abs(np.nan_to_num(motion.speed)), self.short_s / motion.step_s)
        regressors = (force, change, speed * change / STANDARD_GRAVITY)
        A = np.column_stack([self.in_band(values, valid)[known] for values in regressors])
        y = acceleration[known]
        residual = y - A[:, 0] * float(A[:, 0] @ y / (A[:, 0] @ A[:, 0]))
        variance = float(np.mean(residual**2)) * _LONG_S / motion.step_s  # of residuals that are alike so long
        information, right = A.T @ A, A.T @ y
        information[2, 2] += variance / CREEP_SD**2
        with_creep, without = (np.linalg.pinv(part, hermitian=True) for part in (information, information[:2, :2]))
        gain, moved, _ = with_creep @ right
        gain_without, moved_without = without @ right[:2]
        wider = float(np.sqrt(with_creep[1, 1] / without[1, 1]))
        return float(moved / gain - moved_without / gain_without), wider


def on_imu_clock(tach: pd.DataFrame, offset: ClockOffset | None) -> pd.DataFrame:
    """Return a tach table on the IMU's clock, as far as the clocks are surely apart."""
    return tach.assign(t_s=tach["t_s"] + offset.offset_s) if offset is not None and offset.is_sure else tach


def tach_acceleration(motion: Motion) -> Array:
    """Return dv/dt of the tach at the centres of the intervals, m/s^2, by central differences. Shape (n,).

    Over a gap the speed is only known on average, which would be a jump at its ends: there the difference is that of
    the known side, and within it dv/dt is interpolated. It is 0 where nothing is known.
    """
    change = np.diff(np.where(motion.valid, motion.speed, np.nan)) / motion.step_s
    behind, ahead = np.append(np.nan, change), np.append(change, np.nan)
    only = np.where(np.isnan(ahead), behind, ahead)
    acceleration = np.where(np.isnan(behind) | np.isnan(ahead), only, 0.5 * (behind + ahead))
    known = np.isfinite(acceleration)
    if not known.any():
        return np.zeros_like(acceleration)
    index = np.arange(acceleration.size)
    return np.asarray(np.interp(index, index[known], acceleration[known]))


@dataclass(frozen=True)
class Lag:
    """The lag (s) of one signal behind another that shows the same, and their correlation then.

    ``sd_s`` is its sigma by least squares, ``spread_s`` that of its leave-one-block-out (jackknife) values, which is
    wider, as blocks cut events in two, and far wider where a single event, a slip among them, makes the peak.
    """

    lag_s: float
    sd_s: float
    spread_s: float
    correlation: float

    def is_sure(self, least_s: float) -> bool:
        """Return whether the lag is surely not 0, and more than ``least_s``."""
        return abs(self.lag_s) > max(least_s, _SURE_SIGMAS * self.sd_s, _SURE_SPREADS * self.spread_s)


def best_lag(a: Array, b: Array, step_s: float, long_s: float, max_lag_s: float, min_correlation: float) -> Lag | None:
    """Return how much later ``b`` (n,) shows what ``a`` (n,) shows.

    Both are band-passed; ``long_s`` is the standard deviation of the band's longer average. None where the correlation
    stays below ``min_correlation`` or is highest at an end of +-``max_lag_s``, or where leaving out one block moves it
    there.
    """
    lags, correlation = lagged_correlation(a, b, max_lag_s / step_s)
    peak = _peak(correlation)
    if peak is None or abs(correlation[round(peak)]) < min_correlation:
        return None
    memory = round(_MEMORIES * long_s / step_s)
    lag = lags[0] + peak
    sd, spread = _lag_sd(a, b, lag, memory), _jackknife_sd(a, b, lags, correlation, memory)
    if sd is None or spread is None:
        return None
    return Lag(float(lag * step_s), float(sd * step_s), float(spread * step_s), float(correlation[round(peak)]))


def _peak(correlation: Array) -> float | None:
    """Return where its magnitude has its top, by a parabola, in samples from the first; None at an end."""
    top = int(np.argmax(np.abs(correlation)))
    if top in (0, correlation.size - 1):
        return None
    return top + _parabola_vertex(np.abs(correlation[top - 1 : top + 2]))


def _jackknife_sd(a: Array, b: Array, lags: Array, correlation: Array, size: int) -> float | None:
    """Return the sigma of the peak, in samples, from the peaks without each block of ``size`` rows of ``a``; None where
    leaving one out moves it to an end.
    """
    reach = int(lags[-1])
    padded = np.pad(b, reach)
    shifts = np.arange(2 * reach + 1)
    blocks = [slice(i, min(i + size, a.size)) for i in range(0, a.size, size)]
    parts = [
        _products(padded[block.start : block.stop + 2 * reach], np.pad(a[block], (0, 2 * reach)), shifts)
        for block in blocks
        if np.any(a[block])
    ]
    total = np.sum(parts, axis=0)
    scale = np.divide(correlation, total, out=np.zeros_like(total), where=np.abs(total) > 0.0)
    peaks = [_peak(scale * (total - part)) for part in parts]
    peak_lags = np.array([peak for peak in peaks if peak is not None])
    if peak_lags.size < len(peaks) or peak_lags.size < _FEWEST_BLOCKS:
        return None
    return jackknife_sd(peak_lags, float(peak_lags.mean()))


def lagged_correlation(a: Array, b: Array, max_lag: float) -> tuple[Array, Array]:
    """Return integer lags l, at most half of the length, and the correlation of ``a[i]`` with ``b[i + l]`` (both (n,))
    in the overlap.
    """
    n = a.size
    limit = int(min(max_lag, n // 2))
    lags = np.arange(-limit, limit + 1)
    products = _products(b, a, lags)
    energy_a, energy_b = (np.concatenate([[0.0], np.cumsum(x * x)]) for x in (a, b))
    first, last = np.maximum(0, -lags), np.minimum(n, n - lags)
    energy = (energy_a[last] - energy_a[first]) * (energy_b[last + lags] - energy_b[first + lags])
    floor = 1e-6 * energy_a[-1] * energy_b[-1]
    correlation = np.where(energy > floor, products / np.sqrt(np.maximum(energy, floor + 1e-300)), 0.0)
    return lags.astype(np.float64), correlation


def _products(a: Array, b: Array, lags: np.ndarray) -> Array:
    """Return ``sum_i a[i + l] b[i]`` of two signals of one length at each lag l, by FFT. (n,), (n,), (m,) to (m,)."""
    least = a.size + int(np.abs(lags).max())
    length = 1 << (least - 1).bit_length()  # a prime one of a day would take minutes
    both = np.fft.irfft(np.fft.rfft(a, length) * np.conj(np.fft.rfft(b, length)), length)
    return np.asarray(both[lags])


def _parabola_vertex(y: Array) -> float:
    """Return where the parabola through (-1, y0), (0, y1), (1, y2) has its top, for y1 the highest."""
    bend = y[0] - 2.0 * y[1] + y[2]
    return 0.0 if bend >= 0 else float(0.5 * (y[0] - y[2]) / bend)


def _lag_sd(y: Array, x: Array, lag: float, memory: int) -> float | None:
    """Return the sigma of ``lag`` in samples (module docstring); residuals ``memory`` samples apart are independent."""
    index = np.arange(y.size, dtype=np.float64)
    inside = (index + lag >= 0) & (index + lag <= y.size - 1)
    shifted = np.interp(index + lag, index, x)[inside]
    slope, y_slope = np.interp(index + lag, index, np.gradient(x))[inside], np.gradient(y)[inside]
    gain = float(shifted @ y[inside] / (shifted @ shifted))
    residual = y[inside] - gain * shifted
    n = residual.size
    reach = min(n // 4, memory)
    lags = np.arange(-reach, reach + 1)
    taper = 1.0 - np.abs(lags) / (reach + 1.0)
    noise = _products(residual, residual, lags) / n
    signal = _products(slope, slope, lags)
    information = float(slope @ y_slope)
    variance = float(np.sum(taper * noise * signal))
    if not information * gain > 0.0 or variance <= 0.0:
        return None
    return float(np.sqrt(variance) / abs(information))

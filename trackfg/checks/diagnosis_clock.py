"""The offset between the clocks of IMU and tach.

Forward specific force is ``f_x = dv/dt - g sin(pitch)``; the tach gives ``dv/dt``. Both, averaged over the same
intervals and band-passed alike (what is slow in f_x is the gradient, what is fast is vibration and pulses), are
correlated over a range of lags. The peak, refined by a parabola through its three highest points, is the offset.

Its sigma is that of least squares in ``y(t) = k x(t + offset) + e(t)`` with coloured e:
``var = sum_l R_e(l) R_x'(l) / (k sum x'^2)^2``, R_e being the residual's sample autocovariance and R_x' the
autocorrelation sum of ``x'`` (the sandwich formula; Newey & West, Econometrica 55, 1987).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.signal import correlate

from trackfg.numerics.arrays import Array
from trackfg.recording.model import Recording
from trackfg.sensors.averages import Motion, averaged, band_passed

_STEP_S = 0.05
_SHORT_S, _LONG_S = 0.4, 3.0
_MIN_CORRELATION = 0.4
_MIN_DURATION_S = 20.0
_MIN_ACCELERATION = 0.01
"""m/s^2, rms in the band: below it the tach does not say when anything happened."""


_MAX_ACCELERATION = 8.0
"""m/s^2: a tach that changes faster slips, or jumps."""


@dataclass(frozen=True)
class ClockOffset:
    """``offset_s`` is to be added to the tach's time, besides ``tach.time_offset_s``, to bring it to the IMU's clock.

    ``correlation`` at that offset is negative where the forward axis points backwards.
    """

    offset_s: float
    sd_s: float
    correlation: float


def estimate_clock_offset(recording: Recording, max_offset_s: float = 20.0) -> ClockOffset | None:
    """The offset between tach and IMU, or None where the recording does not show it.

    That is without tach, shorter than 20 s, without acceleration, with a correlation below 0.4, or with the best offset
    at the end of the range +-``max_offset_s`` (at most half of the recording).
    """
    if recording.tach is None:
        return None
    tach_interval = float(np.median(np.diff(recording.tach["t_s"])))
    motion = averaged(recording.imu, recording.tach, _STEP_S)
    if motion is None or motion.t_s.size * motion.step_s < _MIN_DURATION_S:
        return None
    short_s = max(_SHORT_S, 0.5 * tach_interval, motion.step_s)
    speed_change = tach_acceleration(motion)
    valid = motion.valid & (np.abs(gaussian_filter1d(speed_change, short_s / motion.step_s)) < _MAX_ACCELERATION)
    acceleration = band_passed(speed_change, valid, motion.step_s, short_s, _LONG_S)
    force = band_passed(motion.accel[:, 0], motion.valid, motion.step_s, short_s, _LONG_S)
    if np.sqrt(np.mean(acceleration**2)) < _MIN_ACCELERATION:
        return None
    lags, correlation = lagged_correlation(acceleration, force, max_offset_s / motion.step_s)
    peak = int(np.argmax(np.abs(correlation)))
    if abs(correlation[peak]) < _MIN_CORRELATION or peak in (0, lags.size - 1):
        return None
    lag = lags[peak] + _parabola_vertex(np.abs(correlation[peak - 1 : peak + 2]))
    sd = _lag_sd(acceleration, force, lag)
    if sd is None:
        return None
    return ClockOffset(float(lag * motion.step_s), float(sd * motion.step_s), float(correlation[peak]))


def tach_acceleration(motion: Motion) -> Array:
    """dv/dt of the tach at the centres of the intervals, m/s^2, by central differences. Shape (n,)."""
    return np.asarray(np.gradient(motion.speed, motion.step_s), dtype=np.float64)


def lagged_correlation(a: Array, b: Array, max_lag: float) -> tuple[Array, Array]:
    """Integer lags l, at most half of the length, and the correlation of ``a[i]`` with ``b[i + l]`` in the overlap."""
    n = a.size
    limit = int(min(max_lag, n // 2))
    lags = np.arange(-limit, limit + 1)
    products = correlate(b, a, mode="full", method="fft")[n - 1 + lags]
    energy_a, energy_b = (np.concatenate([[0.0], np.cumsum(x * x)]) for x in (a, b))
    first, last = np.maximum(0, -lags), np.minimum(n, n - lags)
    energy = (energy_a[last] - energy_a[first]) * (energy_b[last + lags] - energy_b[first + lags])
    floor = 1e-6 * energy_a[-1] * energy_b[-1]
    correlation = np.where(energy > floor, products / np.sqrt(np.maximum(energy, floor + 1e-300)), 0.0)
    return lags.astype(np.float64), correlation


def _parabola_vertex(y: Array) -> float:
    """Where the parabola through (-1, y0), (0, y1), (1, y2) has its top, for y1 the highest."""
    bend = y[0] - 2.0 * y[1] + y[2]
    return 0.0 if bend >= 0 else float(0.5 * (y[0] - y[2]) / bend)


def _lag_sd(y: Array, x: Array, lag: float) -> float | None:
    """The sigma of ``lag`` in samples, by the formula above."""
    index = np.arange(y.size, dtype=np.float64)
    inside = (index + lag >= 0) & (index + lag <= y.size - 1)
    shifted = np.interp(index + lag, index, x)[inside]
    slope = np.interp(index + lag, index, np.gradient(x))[inside]
    gain = float(shifted @ y[inside] / (shifted @ shifted))
    residual = y[inside] - gain * shifted
    n = residual.size
    reach = min(n // 4, int(10.0 / _STEP_S))
    around = slice(n - 1 - reach, n + reach)
    taper = 1.0 - np.abs(np.arange(-reach, reach + 1)) / (reach + 1.0)
    noise = correlate(residual, residual, mode="full", method="fft")[around] / n
    signal = correlate(slope, slope, mode="full", method="fft")[around]
    information = gain * float(slope @ slope)
    variance = float(np.sum(taper * noise * signal))
    if information == 0.0 or variance <= 0.0:
        return None
    return float(np.sqrt(variance) / abs(information))

"""Twist by an IMU on an axle box and an adaptive extended Kalman filter: Kato and others, patent JP7628028B2.

The state is roll ``theta`` and pitch ``phi`` of the wheelset (the patent's letters; signs are trackfg's: left side up,
nose-down, specific force +g upwards). The patent's numbers of equations; (3)-(7), (11) and (12) are images there, and
reconstructed here from its text and claims and the kinematics:

    (1)     Tw(x) = CL(x) - CL(x - 5)
    (2)     CL = L sin(theta)                               printed: L tan(theta)
    (3)     x = [theta, phi]
    (4)     y = [atan(ay/az), atan(-ax/sqrt(ay^2 + az^2))]  of the low-passed specific force, 0 to F
    (5, 6)  theta' = theta + dt (wx + (wy sin theta + wz cos theta) tan phi),
            phi'   = phi + dt (wy cos theta - wz sin theta)
    (7)     y = x + w,   H = I
    (8)     F = F_space V,      F_space = 1 per metre, V the speed
    (9)     F_h = 7 F
    (10)    s = fs / (2 F)
    (11)    R(k) = R0 + diag(K_y R_y(k), K_x R_x(k))
    (12)    Q = diag(q, q)

``R_x`` and ``R_y`` are the vibration indices: the mean over s samples of the square of ax and ay between F and F_h.
Vibration (flange contact in curves, braking) makes (7) less credible against (5).

docs/baselines/adaptive-ekf.md says where K, R0 and q come from, and what is corrected unless ``as_printed``: (2), the
acceleration of a curve in (4), (8) for a speed that varies, the delay of the filters, and K.

The filter runs at the full sampling rate: its bands scale with the speed, so no fixed lower rate would do. The 2 x 2
algebra is written out on plain numbers, some microseconds a step.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import cos, sin
from typing import Any

import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.signal import butter, sosfilt, sosfilt_zi, sosfiltfilt

from trackfg.baselines.attitude import Attitude, SampledMotion, motion_of, tables
from trackfg.baselines.result import BaselineResult, recorded
from trackfg.errors import BadInputError
from trackfg.geometry.cross_level import cross_level
from trackfg.numerics.arrays import Array
from trackfg.numerics.units import STANDARD_GRAVITY
from trackfg.recording.model import Recording
from trackfg.sensors.tilt import force_tilt

GAL = 0.01
"""m/s^2."""
K_PRINTED = 1.0e-6 / GAL**2
"""The patent's coefficient, rad^2/(m/s^2)^2, its accelerations taken to be in Gal."""
K = 1.0 / STANDARD_GRAVITY**2
"""rad^2/(m/s^2)^2."""
HIGH_RATIO = 7.0
"""Upper to lower edge of the vibration band, (9)."""

_ORDER = 2
"""Order of the Butterworth filters. Assumed: the patent gives none."""
_CELLS_PER_WAVE = 50
"""Cells of the distance to the wave of F_space: 2 cm at 1 per metre. Chosen here, seven per wave of the upper edge."""
_MOVING_MPS = 0.1
"""Speed above which the printed form's mean speed counts a sample as moving, m/s. Chosen here."""
_HIGHEST_OF_NYQUIST = 0.9
"""Highest edge of a filter, as a share of the Nyquist frequency: at 1 there is no filter. Chosen here."""
_START_SD_RAD = 0.01
"""1-sigma of roll and pitch at the start, rad; forgotten after the time constant. Chosen here."""
_BLOCK = 50_000
"""Samples that are plain numbers at a time: these take ten times the memory."""


@dataclass(frozen=True)
class AdaptiveEkfParameters:
    """The parameters of the filter (docs/baselines/adaptive-ekf.md).

    Raises ``BadInputError`` for those that are not above 0. ``centripetal`` None: unless ``as_printed``.
    """

    adaptive: bool = True
    F_space_1pm: float = 1.0
    R0_rad2: float = 1e-6
    T_c_s: float = 12.5
    remove_static_bias: bool = True
    centripetal: bool | None = None
    as_printed: bool = False

    def __post_init__(self) -> None:
        for name in ("F_space_1pm", "R0_rad2", "T_c_s"):
            if not 0.0 < getattr(self, name) < np.inf:
                raise BadInputError(f"{name} is {getattr(self, name)!r}; expected a number above 0")
        if self.centripetal is None:
            object.__setattr__(self, "centripetal", not self.as_printed)


def run(recording: Recording, **parameters: Any) -> BaselineResult:
    """Estimate roll, pitch, cross-level and twist of a recording.

    ``parameters`` are fields of :class:`AdaptiveEkfParameters`. Raises ``BadInputError`` without a tachometer, and for
    parameters that are not above 0.
    """
    p = AdaptiveEkfParameters(**parameters)
    motion = motion_of(recording, remove_static_bias=p.remove_static_bias)
    force = motion.without_centripetal() if p.centripetal else motion.accel
    smoothing = in_time(motion, p.F_space_1pm) if p.as_printed else along_the_track(motion, p.F_space_1pm)
    y = force_tilt(smoothing.low_passed(force))
    R = np.full_like(y, p.R0_rad2)
    if p.adaptive:
        index = smoothing.vibration(motion.accel[:, :2])
        R += (K_PRINTED if p.as_printed else K) * index[:, ::-1]  # roll hangs on ay, pitch on ax
    q = process_noise(p.R0_rad2, motion.sampling_s, p.T_c_s)
    x, variance = kalman_filter(motion.gyro, motion.dt, y, R, q)
    roll, sd = x[:, 0], np.sqrt(variance)
    base = recording.description.track.cross_level_base_m
    attitude = Attitude(
        roll=roll,
        cross_level=base * np.tan(roll) if p.as_printed else cross_level(roll, base),
        pitch=x[:, 1],
        roll_sd=sd[:, 0],
        pitch_sd=sd[:, 1],
    )
    return tables("adaptive-ekf", recording, motion, attitude, recorded(p) | {"q_rad2": q})


def process_noise(R0_rad2: float, dt: float, T_c_s: float) -> float:
    """Return ``q = R0 (dt/T_c)^2``, rad^2 per step: at R0 the filter forgets with the time constant T_c."""
    return R0_rad2 * (dt / T_c_s) ** 2


def window_samples(sampling_hz: float, F_hz: float) -> int:
    """Return ``s = fs / (2 F)``, (10), at least one."""
    return max(1, round(sampling_hz / (2.0 * F_hz)))


def propagate(
    theta: float, phi: float, w: Sequence[float], dt: float
) -> tuple[float, float, tuple[float, float, float]]:
    """Return (6) and its Jacobian: roll and pitch, rad, after ``dt`` s at the angular rate ``w``, rad/s, and (f, g, h).

    The derivative of (theta', phi') by (theta, phi) is ``F = [[f, g], [h, 1]]``.
    """
    wx, wy, wz = w
    s, c = sin(theta), cos(theta)
    tan = sin(phi) / cos(phi)
    along, across = wy * s + wz * c, wy * c - wz * s
    h = -dt * along
    return theta + dt * (wx + along * tan), phi + dt * across, (1.0 + dt * across * tan, -h * (1.0 + tan * tan), h)


def kalman_filter(gyro: Array, dt: Array, y: Array, R: Array, q: float) -> tuple[Array, Array]:
    """Return angles (n, 2), rad, and their variances (n, 2) after each measurement.

    ``gyro`` (n, 3) rad/s over the ``dt`` (n,) before each measurement ``y`` (n, 2) of the angles; ``R`` (n, 2) are its
    variances. The first measurement starts the filter.
    """
    theta, phi = float(y[0, 0]), float(y[0, 1])
    a, b, c = _START_SD_RAD**2, 0.0, _START_SD_RAD**2  # P = [[a, b], [b, c]]
    out = np.empty((len(y), 4))
    for first in range(0, len(y), _BLOCK):
        rows = slice(first, first + _BLOCK)
        # Plain numbers: five times faster than arrays of two.
        block = zip(gyro[rows].tolist(), dt[rows].tolist(), y[rows].tolist(), R[rows].tolist(), strict=True)
        done = []
        for w, step, (y1, y2), (r1, r2) in block:
            theta, phi, (f, g, h) = propagate(theta, phi, w, step)
            fa, fb = f * a + g * b, f * b + g * c  # first row of F P
            a, b, c = fa * f + fb * g + q, fa * h + fb, h * h * a + 2.0 * h * b + c + q
            s1, s2 = a + r1, c + r2
            determinant = s1 * s2 - b * b
            e1, e2 = y1 - theta, y2 - phi
            k11, k12 = (a * s2 - b * b) / determinant, b * r1 / determinant
            k21, k22 = b * r2 / determinant, (c * s1 - b * b) / determinant
            theta += k11 * e1 + k12 * e2
            phi += k21 * e1 + k22 * e2
            a, b, c = k11 * r1, k12 * r2, k22 * r2  # P = K R, since H = I
            done.append((theta, phi, a, c))
        out[rows] = done
    return out[:, :2], out[:, 2:]


@dataclass(frozen=True)
class Smoothing:
    """The patent's two bands and its window on a uniform axis, of time or of distance.

    ``number`` (n,): which of the axis's cells a sample is in; ``low``, ``high``: edges of the bands, cycles per cell;
    ``window``: cells; ``both_ways``: without delay.
    """

    number: np.ndarray
    low: float
    high: float
    window: int
    both_ways: bool

    def low_passed(self, x: Array) -> Array:
        """Return what is below the lower edge. Shape (n, c) to the same."""
        return self._back(self._filtered(butter(_ORDER, self.low, fs=1.0, output="sos"), self._onto(x)))

    def vibration(self, x: Array) -> Array:
        """Return the running mean square of what is between the edges. Shape (n, c) to the same."""
        band = butter(_ORDER, [self.low, self.high], btype="bandpass", fs=1.0, output="sos")
        squared = self._filtered(band, self._onto(x)) ** 2
        # A trailing window of s cells is a centred one shifted by half of it.
        origin = 0 if self.both_ways else (self.window - 1) // 2
        return self._back(uniform_filter1d(squared, self.window, axis=0, mode="nearest", origin=origin))

    def _filtered(self, sos: Array, x: Array) -> Array:
        if self.both_ways:
            return np.asarray(sosfiltfilt(sos, x, axis=0, padlen=min(len(x) - 1, round(3.0 / self.low))))
        state = sosfilt_zi(sos)[..., None] * x[0]
        return np.asarray(sosfilt(sos, x, axis=0, zi=state)[0])

    def _onto(self, x: Array) -> Array:
        """Return means of the samples in each cell; cells without any are interpolated."""
        count = np.bincount(self.number)
        taken = np.flatnonzero(count)
        cells = np.arange(len(count))
        means = [np.bincount(self.number, column)[taken] / count[taken] for column in x.T]
        return np.stack([np.interp(cells, taken, mean) for mean in means], axis=1)

    def _back(self, x: Array) -> Array:
        return np.asarray(x[self.number])


def in_time(motion: SampledMotion, F_space_1pm: float) -> Smoothing:
    """Filter as printed: F = F_space times the mean speed while moving, over samples, one way.

    Bands that a sampling rate cannot hold are cut at 0.9 of half of it.
    """
    speed = np.abs(motion.speed)
    moving = speed > _MOVING_MPS
    mean = float(speed[moving].mean()) if moving.any() else 1.0 / F_space_1pm
    dt = motion.sampling_s
    highest = 0.5 * _HIGHEST_OF_NYQUIST
    low = min(F_space_1pm * mean * dt, highest / HIGH_RATIO)
    return Smoothing(
        number=np.arange(len(motion.t)),
        low=low,
        high=HIGH_RATIO * low,
        window=window_samples(1.0, low),
        both_ways=False,
    )


def along_the_track(motion: SampledMotion, F_space_1pm: float) -> Smoothing:
    """Filter by (8) for a speed that varies: over cells of the distance run, 50 to the wave of F_space, both ways.

    A rest is one cell: its mean.
    """
    run_m = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(motion.distance)))])
    return Smoothing(
        number=np.floor(run_m * F_space_1pm * _CELLS_PER_WAVE).astype(np.int64),
        low=1.0 / _CELLS_PER_WAVE,
        high=HIGH_RATIO / _CELLS_PER_WAVE,
        window=window_samples(_CELLS_PER_WAVE, 1.0),
        both_ways=True,
    )

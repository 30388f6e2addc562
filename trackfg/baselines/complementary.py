"""Cross-level by a complementary filter: Naganuma and Uematsu, Central Japan Railway.

Roll from the accelerometer below a crossover frequency and from the gyro above it. The paper's equations, with the
angle ``r`` of the accelerometer, the rate ``omega`` about the forward axis and the sampling interval ``dt``:

    (1)  r = atan(a_y / sqrt(a_x^2 + a_z^2))
    (2)  Theta(s) = (R(s) + T Omega(s)) / (1 + T s)
    (4)  theta(k) = alpha (theta(k-1) + omega(k) dt) + (1 - alpha) r(k),   alpha = T / (T + dt)

(4) is (2) with the backward difference ``s = (1 - z^-1)/dt``. T = 12.5 s: crossover at 1/(2 pi T) = 0.0127 Hz, at the
paper's 200 Hz alpha = 0.99960. The cross-level is ``base * sin(theta)``. Signs are those of trackfg: a_y to the left,
roll with the left side up.

Its comparators are the accelerometer alone, low-passed (figure 1; the paper does not say how: here a Butterworth
filter, run both ways), and the gyro alone, integrated and less its straight line over time (figure 2).

The static bias is removed, and unless ``as_printed`` so is ``v omega_z`` from a_y, which (1) takes for tilt;
docs/baselines/complementary.md says how much either is, and what stays as in the paper.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np
from scipy.signal import butter, detrend, lfilter, sosfiltfilt

from trackfg.baselines.attitude import Attitude, motion_of, tables
from trackfg.baselines.result import BaselineResult, recorded
from trackfg.errors import BadInputError
from trackfg.geometry.cross_level import cross_level
from trackfg.numerics.arrays import Array
from trackfg.recording.model import Recording

Method = Literal["complementary", "accelerometer", "gyro"]


@dataclass(frozen=True)
class ComplementaryParameters:
    """The method and its filters (docs/baselines/complementary.md).

    Raises ``BadInputError`` for parameters that make no filter. ``centripetal`` None: unless ``as_printed``.
    """

    method: Method = "complementary"
    T_s: float = 12.5
    low_pass_hz: float | None = 0.5
    detrended: bool = True
    remove_static_bias: bool = True
    centripetal: bool | None = None
    as_printed: bool = False

    def __post_init__(self) -> None:
        if self.method not in get_args(Method):
            raise BadInputError(f"method is {self.method!r}; expected {', '.join(get_args(Method))}")
        if not 0.0 < self.T_s < np.inf:
            raise BadInputError(f"T_s is {self.T_s!r}; expected a time above 0")
        if self.centripetal is None:
            object.__setattr__(self, "centripetal", not self.as_printed)


def run(recording: Recording, **parameters: Any) -> BaselineResult:
    """Estimate roll, cross-level and twist of a recording.

    ``parameters`` are fields of :class:`ComplementaryParameters`. Raises ``BadInputError`` without a tachometer and for
    parameters that make no filter.
    """
    p = ComplementaryParameters(**parameters)
    motion = motion_of(recording, remove_static_bias=p.remove_static_bias)
    dt = motion.sampling_s
    if p.low_pass_hz is not None and not 0.0 < p.low_pass_hz < 0.5 / dt:
        raise BadInputError(f"low_pass_hz is {p.low_pass_hz!r}; expected a frequency below {0.5 / dt:g} Hz, or None")

    force = motion.without_centripetal() if p.centripetal else motion.accel
    r = accelerometer_roll(force)
    turned = motion.gyro[:, 0] * motion.dt
    start = float(accelerometer_roll(force[motion.start].mean(axis=0)))
    alpha = smoothing(p.T_s, dt)
    if p.method == "complementary":
        roll = complementary_roll(r, turned, alpha, start)
    elif p.method == "accelerometer":
        roll = r if p.low_pass_hz is None else _low_passed(r, p.low_pass_hz, dt)
    else:
        roll = start + np.cumsum(turned)
        roll = detrend(roll) if p.detrended else roll
    base = recording.description.track.cross_level_base_m
    attitude = Attitude(roll=roll, cross_level=cross_level(roll, base))
    return tables("complementary", recording, motion, attitude, recorded(p) | {"alpha": alpha})


def smoothing(T_s: float, dt: float) -> float:
    """Return ``alpha = T / (T + dt)``."""
    return T_s / (T_s + dt)


def accelerometer_roll(accel: Array) -> Array:
    """Return equation (1), rad, of specific forces (..., 3): the inclination of the y axis."""
    return np.asarray(np.arctan2(accel[..., 1], np.hypot(accel[..., 0], accel[..., 2])))


def complementary_roll(r: Array, turned: Array, alpha: float, start: float) -> Array:
    """Return equation (4), rad, from each sample's angle ``r`` by the accelerometer and ``turned`` (omega dt).

    Both (n,), rad; ``start`` is theta before the first sample.
    """
    theta, _ = lfilter([1.0], [1.0, -alpha], alpha * turned + (1.0 - alpha) * r, zi=[alpha * start])
    return np.asarray(theta)


def _low_passed(x: Array, cut_hz: float, dt: float) -> Array:
    sos = butter(2, cut_hz, fs=1.0 / dt, output="sos")
    return np.asarray(sosfiltfilt(sos, x, padlen=min(len(x) - 1, round(3.0 / (cut_hz * dt)))))

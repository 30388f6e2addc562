"""Vibration moves a sensor that follows the track by more than the track does, on waves as short as no track has.

A block of samples shows a spectrum of angular rate and of specific force. Above the frequency ``v / 0.7 m`` it is not
the track's, nor anything but vibration above 1.5 Hz at rest. What is above the white floor there, over (2 pi f)^2 and
(2 pi f)^4, is a variance of the sensor's attitude and place that the path of the track does not have.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trackfg.numerics.arrays import Array
from trackfg.numerics.spans import median_interval
from trackfg.sensors.imu_intervals import Intervals
from trackfg.sensors.imu_noise import EULER

SHORTEST_WAVE_M = 0.7
"""Below this wavelength a track has corrugation and joints, and hardly any roll: what a sensor shows there is taken for
its vibration. EN 13848-1 measures geometry from 1 m on.
"""

_BLOCK_S = 2.56
"""Length of a block, s: lines 0.4 Hz apart, while a train changes its speed by 2 m/s at most."""

_LEAST_HZ = 1.5
"""At rest what is faster is vibration: boarding passengers sway a body at 1 Hz."""

_AT_REST_MPS, _IN_MOTION_MPS = 0.1, 1.0
"""Blocks slower and faster than these are those of a rest and of motion, m/s."""

_LEAST_BLOCKS = 3
"""Fewer blocks say nothing of a level."""


@dataclass(frozen=True)
class Shaking:
    """How far vibration moves the sensor, 1-sigma: ``roll``, rad, ``across`` and ``up``, m.

    NaN where the record does not show it.
    """

    roll: float
    across: float
    up: float


_NOTHING = Shaking(np.nan, np.nan, np.nan)


def shaking(data: Intervals, t: Array, speed: Array) -> tuple[Shaking, Shaking]:
    """Return the shaking at rest and in motion of a vehicle of ``speed`` (n,), m/s, at times ``t`` (n,), s.

    In motion it is what is seen on waves below :data:`SHORTEST_WAVE_M`.
    """
    step = median_interval(data.edges)
    length = 2 ** round(np.log2(_BLOCK_S / step))
    if len(data) < 2 * length:
        return _NOTHING, _NOTHING
    starts = np.arange(0, len(data) - length, length // 2)
    speeds = np.abs(np.interp(data.edges[starts + length // 2], t, speed))
    channels = np.column_stack([data.gyro[:, 0], data.accel[:, 1:]])
    window = np.hanning(length + 1)[:-1]
    f = np.fft.rfftfreq(length, step)
    variance = np.empty((len(starts), 3))
    for block, start in enumerate(starts):
        samples = channels[start : start + length]
        lines = np.fft.rfft((samples - samples.mean(axis=0)) * window[:, None], axis=0)
        power = 2.0 * np.abs(lines) ** 2 / (length * np.sum(window**2))
        floor = np.exp(np.mean(np.log(np.maximum(power[f > 0.5 * f[-1]], 1e-30)), axis=0) + EULER)
        fast = f > max(speeds[block] / SHORTEST_WAVE_M, _LEAST_HZ)
        over = (power - floor)[fast] / (2.0 * np.pi * f[fast, None]) ** [2.0, 4.0, 4.0]
        variance[block] = over.sum(axis=0)
    resting, moving = speeds < _AT_REST_MPS, speeds > _IN_MOTION_MPS
    return _rms(variance[resting]), _rms(variance[moving])


def _rms(variance: Array) -> Shaking:
    if len(variance) < _LEAST_BLOCKS:
        return _NOTHING
    return Shaking(*np.sqrt(np.maximum(variance.mean(axis=0), 0.0)).tolist())

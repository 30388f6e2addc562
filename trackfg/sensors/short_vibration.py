"""Vibration moves a sensor that follows the track by more than the track does, on waves as short as no track has.

A block of samples shows a spectrum of angular rate and of specific force. Above the frequency ``v / 0.7 m`` it is not
the track's, nor anything but vibration above 1.5 Hz at rest. What is above the white floor there, over (2 pi f)^2 and
(2 pi f)^4, is a variance of the sensor's attitude and place that the path of the track does not have.

On longer waves the track hides it. There the angular acceleration is taken to be as dense as on the shortest: vibration
of running gear is specified as an acceleration of even density from 5 Hz on (IEC 61373, categories 1 and 2). The angle
above a frequency f has a variance that goes with f^-3 then, and with the square of the speed. The kinks at both ends of
a cant ramp have such a spectrum, too, but few blocks have one: the median over blocks passes over them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from trackfg.numerics.arrays import Array
from trackfg.numerics.robust import robust_sd
from trackfg.numerics.spans import median_interval
from trackfg.sensors.imu_intervals import Intervals
from trackfg.sensors.imu_noise.sample_blocks import EULER

SHORTEST_WAVE_M = 0.7
"""Below this wavelength a track has corrugation and joints, and hardly any roll: what a sensor shows there is taken for
its vibration. EN 13848-1 measures geometry from 1 m on.
"""

_BLOCK_S = 2.56
"""Length of a block, s: lines 0.4 Hz apart, while a train changes its speed by 2 m/s at most."""

_LEAST_HZ = 1.5
"""At rest what is faster is vibration: boarding passengers sway a body at 1 Hz."""

_EVEN_FROM_HZ = 5.0
"""The angular acceleration is of even density from here on, Hz: IEC 61373, the lower end of functional random vibration
of bodies and bogies; that of axles is 10 Hz."""

_CHANCE_SIGMAS = 3.0
"""What is above the floor is vibration where its median over the blocks is beyond so many of its sigmas."""

_EFFICIENCY = 2.0 / np.pi
"""Of a median against a mean, of normal values: its variance is larger by the reciprocal."""

_AT_REST_MPS, _IN_MOTION_MPS = 0.1, 1.0
"""Blocks slower and faster than these are those of a rest and of motion, m/s."""

_PASSED = 0.5
"""Share of a bandwidth up to which a filter passes the floor as it is: one of second order leaves 0.94 of its power."""

_BLOCKS_AT_ONCE = 16
"""Spectra of so many blocks are taken at once: they fit into the cache."""

_LEAST_BLOCKS = 3
"""Fewer blocks say nothing of a level."""


@dataclass(frozen=True)
class Shaking:
    """The sigmas of how far vibration moves the sensor: ``roll``, rad, ``across`` and ``up``, m.

    NaN where the record does not show it.
    """

    roll: float
    across: float
    up: float


class Blocks(NamedTuple):
    """Spectra of blocks of a record: the ``speed`` (b,), m/s, the frequency (b,), Hz, from which on a block ``shows``
    vibration, and the ``variance`` (b, 3) of roll, rad^2, across and up, m^2, there.
    """

    speed: Array
    shows: Array
    variance: Array

    @classmethod
    def of(cls, data: Intervals, t: Array, speed: Array, bandwidth_hz: float | None = None) -> Blocks:
        """Return those of samples of a vehicle of ``speed`` (n,), m/s, at times ``t`` (n,), s; none of few samples.

        Of a sensor with a filter of such a ``bandwidth_hz`` only what is below half of it counts: further up its white
        floor falls.
        """
        if len(data.stretches) > 1:
            parts = [cls.of(data.take(rows), t, speed, bandwidth_hz) for rows in data.stretches]
            return cls(*(np.concatenate(each) for each in zip(*parts, strict=True)))
        step = median_interval(data.edges) if len(data) else 1.0
        length = 2 ** round(np.log2(_BLOCK_S / step))
        starts = np.arange(0, max(len(data) - length, 0), length // 2)
        if not starts.size:
            return cls(np.zeros(0), np.zeros(0), np.zeros((0, 3)))
        speeds = np.abs(np.interp(data.edges[starts + length // 2], t, speed))
        channels = np.vstack([data.gyro[:, 0], data.accel[:, 1:].T])
        window = np.hanning(length + 1)[:-1]
        f = np.fft.rfftfreq(length, step)
        seen_from = np.maximum(speeds / SHORTEST_WAVE_M, _LEAST_HZ)
        per_rate = np.zeros((3, len(f)))  # an angular rate is integrated once, a force twice
        per_rate[:, 1:] = (2.0 * np.pi * f[1:]) ** np.array([[-2.0], [-4.0], [-4.0]])
        top = f[-1] if bandwidth_hz is None else min(f[-1], _PASSED * bandwidth_hz)
        fast = (f > seen_from[:, None]) & (f <= top)
        of_floor = (f > 0.5 * top) & (f <= top)
        variance = np.empty((len(starts), 3))
        for first in range(0, len(starts), _BLOCKS_AT_ONCE):
            some = slice(first, first + _BLOCKS_AT_ONCE)
            samples = channels[:, starts[some, None] + np.arange(length)]
            samples -= samples.mean(axis=2, keepdims=True)
            lines = np.fft.rfft(samples * window)
            power = 2.0 * (lines.real**2 + lines.imag**2) / (length * np.sum(window**2))
            floor = np.exp(np.mean(np.log(np.maximum(power[:, :, of_floor], 1e-30)), axis=2) + EULER)
            over = np.where(fast[some], power - floor[:, :, None], 0.0)
            variance[some] = np.einsum("cbf,cf->bc", over, per_rate)
        return cls(speeds, seen_from, variance)

    def shaking(self, roll_wave_m: float = SHORTEST_WAVE_M) -> tuple[Shaking, Shaking]:
        """Return the shaking at rest and in motion.

        In motion it is what is seen on waves below :data:`SHORTEST_WAVE_M`, and the roll that on waves up to
        ``roll_wave_m``, as far as it is vibration of 5 Hz or more.
        """
        resting, moving = self.speed < _AT_REST_MPS, self.speed > _IN_MOTION_MPS
        in_motion = _rms(self.variance[moving])
        if moving.any():
            speeds, seen_from = self.speed[moving], self.shows[moving]
            hidden_from = np.clip(speeds / roll_wave_m, _EVEN_FROM_HZ, seen_from)
            density = _lasting(self.variance[moving, 0] * seen_from**3 / speeds**2)
            in_motion = replace(in_motion, roll=float(np.sqrt(density * np.mean(speeds**2 / hidden_from**3))))
        return _rms(self.variance[resting]), in_motion


def _rms(variance: Array) -> Shaking:
    if len(variance) < _LEAST_BLOCKS:
        return Shaking(np.nan, np.nan, np.nan)
    return Shaking(*np.sqrt(np.maximum(variance.mean(axis=0), 0.0)).tolist())


def _lasting(density: Array) -> float:
    """Return the median of densities (n,) about their true one; 0 where that may be chance, NaN of too few."""
    if len(density) < _LEAST_BLOCKS:
        return np.nan
    usual = float(np.median(density))
    chance = robust_sd(density - usual) / np.sqrt(_EFFICIENCY * len(density))
    return usual if usual > _CHANCE_SIGMAS * chance else 0.0

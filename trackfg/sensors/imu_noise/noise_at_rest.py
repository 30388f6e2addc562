"""Noise is all that an inertial sensor shows at rest: means over half a second show it below the keyframe rate."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.special import chdtri, ndtr

from trackfg.numerics.arrays import Array
from trackfg.numerics.robust import robust_sd
from trackfg.numerics.spans import within
from trackfg.sensors.imu_intervals import Intervals, means_around

_REST_MEAN_S = 0.5
"""At rest means over this, s, show what is below the keyframe rate."""

_REST_MEANS = 40
"""Means in a row, 20 s of them, that are compared with one median. In a long rest a bias walks by more than they do,
within 20 s only where its walk per sqrt(s) is above 0.3 of their density per sqrt(Hz). Usual is 0.02."""

_EFFICIENCY = 0.37
"""Of a variance by the median magnitude, which the end of a rest that is none does not change, against plain squares
(Rousseeuw & Croux, J. American Statistical Association 88 (1993))."""

_SIGMAS = 3.0
"""Means at rest scatter by more than the floor where their variance is so many of its sigmas beyond."""

_INDEPENDENT = 2.0 / 3.0
"""Degrees of freedom of differences of neighbouring means, per difference, in white noise (Howe, Allan & Barnes, Proc.
35th Annual Frequency Control Symposium (1981))."""

_AT_MOST = float(ndtr(2.0))
"""Probability with which a variance is below the limit that rests show: that of a normal value below 2 sigmas."""

_LEAST = 0.1
"""A declared density is lowered to this share of it at most. Assumed."""

_NOT_NOISE = 0.01
"""Samples whose noise at rest is below this share of the declared density are held or set to zero there, as some
firmware does, or were made without noise. Assumed."""


@dataclass(frozen=True, eq=False)
class NoiseAtRest:
    """The noise of all intervals as rests show it, as densities squared (6,), gyro first.

    ``excess`` is beyond the floor of the spectrum. ``most`` is the upper limit of the sensor's own noise: it takes the
    place of a declared density that is larger.
    """

    excess: Array = field(default_factory=lambda: np.zeros(6))
    most: Array = field(default_factory=lambda: np.full(6, np.inf))

    def assumed(self, gyro: float, accel: float) -> Array:
        """Return the densities squared (6,) of the sensor, gyro first, where these densities are declared."""
        declared = np.repeat([gyro, accel], 3) ** 2
        lowered = np.clip(self.most, _LEAST**2 * declared, declared)
        return np.where(self.most > _NOT_NOISE**2 * declared, lowered, declared)


@dataclass(frozen=True)
class RestNoise:
    """Means over half a second at rest differ by ``off`` (k, 6), gyro first, from the median of those nearby.

    ``step`` (m, 6) are the differences of two in a row over sqrt(2), and ``floor`` (b, 6) is the floor of spectra in
    blocks at rest.
    """

    off: Array = field(default_factory=lambda: np.zeros((0, 6)))
    step: Array = field(default_factory=lambda: np.zeros((0, 6)))
    floor: Array = field(default_factory=lambda: np.zeros((0, 6)))

    @classmethod
    def of(cls, data: Intervals, knots: Array, floor: Array, rests: Array) -> RestNoise:
        """Return that of ``rests`` (r, 2), s, in a record; none where they are too short.

        ``floor`` (b, 6): the record's floor of spectra between times ``knots`` (b + 1,), s.
        """
        middle = 0.5 * (knots[1:] + knots[:-1])
        long = rests[np.diff(rests, axis=1)[:, 0] >= _REST_MEAN_S]
        counts = ((long[:, 1] - long[:, 0]) / _REST_MEAN_S).astype(int)
        edges = [np.linspace(begin, end, count + 1) for (begin, end), count in zip(long, counts, strict=True)]
        t = np.concatenate([np.zeros(0), *(0.5 * (each[1:] + each[:-1]) for each in edges)])
        means = np.hstack([means_around(t, _REST_MEAN_S, data.edges, samples) for samples in (data.gyro, data.accel)])
        by_rest = [rest for rest in np.split(means, np.cumsum(counts)[:-1]) if len(rest)]
        parts = [part for rest in by_rest for part in np.array_split(rest, -(-len(rest) // _REST_MEANS))]
        resting = within(middle, rests)
        if len(t) <= len(rests) or not floor[resting].any():
            return cls()
        off = [part - np.median(part, axis=0) for part in parts]
        step = [np.diff(rest, axis=0) / np.sqrt(2.0) for rest in by_rest]
        return cls(np.concatenate(off), np.concatenate(step), floor[resting])

    def joined(self, later: RestNoise, most: int) -> RestNoise:
        """Return that of these and later rests, of no more than the newest ``most`` means and blocks."""
        both = ((self.off, later.off), (self.step, later.step), (self.floor, later.floor))
        return RestNoise(*(np.concatenate(each)[-most:] for each in both))

    def shown(self) -> NoiseAtRest:
        """Return what the means show beyond the floor where it is clearly more, and what there is at most."""
        if not len(self.step):
            return NoiseAtRest()
        floor = np.median(self.floor, axis=0)
        off, step = (
            _REST_MEAN_S * np.array([robust_sd(channel) for channel in means.T]) ** 2 for means in (self.off, self.step)
        )
        clearly = off > (1.0 + _SIGMAS * np.sqrt(2.0 / (_EFFICIENCY * len(self.off)))) * floor
        degrees = _EFFICIENCY * _INDEPENDENT * len(self.step)
        limit = np.maximum(off, step) * degrees / chdtri(degrees, _AT_MOST)
        return NoiseAtRest(np.where(clearly, off - floor, 0.0), np.maximum(limit, floor))

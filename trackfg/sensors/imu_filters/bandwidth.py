"""The bandwidth of an inertial sensor: what its filter leaves out, no sample shows.

A sensor's own noise is white up to the Nyquist frequency, unless the samples were filtered, averaged over more than
their interval, or interpolated between slower ones. At rest there is little else: the spectrum is that of the filter.
It is taken by bands of half an octave, as means of log periodograms over blocks of rests and over the three axes of a
sensor (:mod:`trackfg.sensors.imu_noise`).

The power of a filter, at a frequency f, is taken to be ``1 / (1 + (f / f_h)^(2 n))``. Of noise without and with
filters of some frequencies f_h and orders n that one is right whose logarithms are least far off, as a sum of
magnitudes: what shakes a vehicle at rest adds to some bands, and a median passes over them while they are fewer than
half.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from trackfg.numerics.arrays import Array
from trackfg.numerics.spans import median_interval, true_runs, within
from trackfg.sensors.imu_intervals import Intervals

SHORTEST_D1_M = 3.0
"""The shortest waves of the band D1 (EN 13848-1), m, which a sensor that follows the track is to see."""

_BLOCK_S = 2.56
"""Length of a block, s: lines 0.4 Hz apart, and some of them in a rest of five seconds."""

_LOWEST_HZ = 0.8
"""Lower edge of the lowest band, Hz: two lines from what a bias and its slope leave."""

_HIGHEST = 0.9
"""Share of the Nyquist frequency up to which bands go: what lies above, stamps that scatter take part of."""

_FEWEST_LINES = 24
"""A band's density is known from so many values on: the mean of their logs has a sigma of a quarter."""

_FEWEST_BANDS = 5
"""Fewer bands do not distinguish a filter from chance."""

_FREQUENCIES, _ORDERS = 60, (1.0, 2.0, 4.0)
"""So many frequencies of half power, and these orders are tried: data sheets have first to fourth."""

_CLEARLY = 0.25
"""Share of power that a filter leaves of the highest band at most: one of second order at three quarters of the Nyquist
frequency leaves as much, and a track loses nothing by one further up."""

_WHOLE = 0.8
"""Bands of which a filter leaves so much or more show the noise before it; two bands do at least."""

_BETTER = 2.0
"""By so much, as a sum of magnitudes, a filter explains the bands' logarithms better than none does."""

_NO_POWER = 1e-300
"""Power of samples that do not change, as those of some firmware at rest: it is the same in all bands."""


@dataclass(frozen=True)
class Bandwidths:
    """The frequencies at which half of the power of gyro and accelerometer is left, Hz; None where samples show no
    filter.
    """

    gyro_hz: float | None
    accel_hz: float | None

    @property
    def least_hz(self) -> float | None:
        """The smaller one."""
        return min((hz for hz in (self.gyro_hz, self.accel_hz) if hz is not None), default=None)


@dataclass(frozen=True)
class RestSpectra:
    """Sums of log periodograms at rest by band, of gyro and accelerometer (2, bands); the number of ``lines`` (bands,)
    that are summed up in each; and the bands' ``edges`` (bands + 1,), Hz.
    """

    logs: Array
    lines: Array
    edges: Array

    @classmethod
    def of(cls, data: Intervals, rests: Array) -> RestSpectra:
        """Return those of samples within ``rests`` (r, 2), s, away from holes; where the rate changes, of the longest
        stretch of one rate.
        """
        if len(data.stretches) > 1:
            data = data.take(max(data.stretches, key=lambda rows: data.edges[rows.stop] - data.edges[rows.start]))
        step = median_interval(data.edges)
        length = 2 ** max(round(np.log2(_BLOCK_S / step)), 1)
        bands = int(2.0 * np.log2(max(_HIGHEST * 0.5 / step / _LOWEST_HZ, 1.0)))
        edges: Array = _LOWEST_HZ * np.exp2(0.5 * np.arange(bands + 1, dtype=np.float64))
        logs, lines = np.zeros((2, bands)), np.zeros(bands)
        resting = within(data.edges[:-1], rests) & within(data.edges[1:], rests) & ~data.bridged
        if np.count_nonzero(resting) < length:
            return cls(logs, lines, edges)
        band = np.searchsorted(edges, np.fft.rfftfreq(length, step), side="right") - 1
        inside = (band >= 0) & (band < bands)
        window = np.hanning(length + 1)[:-1, None]
        for begin, end in true_runs(resting):
            for start in range(begin, end - length + 1, length):
                for sensor, samples in enumerate((data.gyro, data.accel)):
                    block = samples[start : start + length]
                    power = np.abs(np.fft.rfft((block - block.mean(axis=0)) * window, axis=0)[inside]) ** 2
                    levels = np.log(np.maximum(power, _NO_POWER)).sum(axis=1)
                    logs[sensor] += np.bincount(band[inside], levels, minlength=bands)
                lines += 3.0 * np.bincount(band[inside], minlength=bands)
        return cls(logs, lines, edges)

    def __add__(self, other: RestSpectra) -> RestSpectra:
        return RestSpectra(self.logs + other.logs, self.lines + other.lines, self.edges)

    @cached_property
    def bandwidths(self) -> Bandwidths:
        """The bandwidths that the spectra show."""
        known = self.lines >= _FEWEST_LINES
        f = np.sqrt(self.edges[:-1] * self.edges[1:])[known]
        gyro, accel = (_half_power(f, logs[known] / self.lines[known]) for logs in self.logs)
        return Bandwidths(gyro, accel)


def _half_power(f: Array, level: Array) -> float | None:
    """Return where the power of bands at ``f`` (n,), Hz, with logarithms ``level`` (n,), falls to half for good, Hz."""
    if len(f) < _FEWEST_BANDS:
        return None
    half_hz, order = (grid.ravel() for grid in np.meshgrid(np.geomspace(f[0], f[-1], _FREQUENCIES), _ORDERS))
    passed = -np.log1p((f / half_hz[:, None]) ** (2.0 * order[:, None]))
    passed = np.concatenate([np.zeros((1, len(f))), passed[passed[:, -1] < np.log(_CLEARLY)]])
    white = np.median(level - passed, axis=1)
    distance = np.abs(level - passed - white[:, None]).sum(axis=1)
    best = int(np.argmin(distance))
    if distance[best] > distance[0] - _BETTER:
        return None
    in_band = passed[best] >= min(np.log(_WHOLE), passed[best, 1])
    over_half = level - np.median(level[in_band]) - np.log(0.5)
    last = np.flatnonzero(over_half > 0.0)
    if not len(last) or last[-1] == len(f) - 1:
        return None
    falling = slice(last[-1], last[-1] + 2)
    return float(np.exp(np.interp(0.0, -over_half[falling], np.log(f[falling]))))

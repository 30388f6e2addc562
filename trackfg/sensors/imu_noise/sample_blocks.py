"""Blocks of inertial samples show the white floor of their spectra, what samples hide, and what shocks show."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.ndimage import median_filter

from trackfg.numerics.arrays import Array
from trackfg.numerics.kernels import kernel_argument
from trackfg.numerics.robust import SD_PER_MAD, median
from trackfg.numerics.spans import true_stretches
from trackfg.sensors.imu_intervals import Intervals

_BLOCK_S = 1.28
"""Length of a block, s, about: 128 samples at 100 Hz, so that 8 periodogram values lie in the lowest band and 32 in the
highest. Speed, and vibration with it, changes little meanwhile."""

_SHORTEST_BLOCK = 32
"""Samples: a shorter record is not judged."""

_BANDS = 3
"""Octaves below the Nyquist frequency: a sensor's filter is in the first, motion rarely in all."""

_NEIGHBOURS = 5
"""Blocks, overlapping by half, of which the median is taken: a shock is in two of them."""

EULER = 0.5772156649
"""Mean of -log of an exponentially distributed value of mean 1, as a periodogram has them."""

_SCATTER = 0.88
"""Sigma of log S times the root of the number of periodogram values in a band, with overlap and median, as white noise
shows it. A band is lower than another by more than its own scatter, else the least of three would be 10 % low."""

_CHUNK = 64
"""Blocks at a time, so that the spectra of a long record need little memory."""

_SAME = 5e-11
"""Samples nearer than this, rad/s or m/s^2, are equal: rounding of a change of units or axes."""

_LONGER = 1.4
"""Of an interval with a sample missing beside it, in usual ones: 1.5."""

_EXTREMES = 3
"""Samples at a channel's extreme value from which on it is an end of the range."""

_FINE_STEPS = 50.0
"""Steps between the median and the extreme at least: a coarse channel is at its extreme by chance."""

_NEAR_EXTREME = 0.1
"""Share of the way from median to extreme within which a channel that is not cut off has more samples than at it."""

_SHOCK_SIGMAS = 6.0
"""A sample further from the median of its block, in its robust sigmas, is part of a shock: none of a hundred million of
normal noise is."""

_SHOCK_PAUSE_S = 0.05
"""Swings of one shock follow each other within this, s: frames and sensors ring at 20 Hz or more."""

_SHOCK_S = 0.2
"""A shock lasts no longer, s: what does is vibration or motion."""

_SHOCK_LIMIT = 3.0
"""Of the rms of what the shocks of a run sum up to along the vehicle: beyond it, across and upwards, it is motion."""

NOISE_LIMITS = np.array(
    [
        *(_SCATTER, EULER, _SAME, _LONGER, _EXTREMES, _FINE_STEPS, _NEAR_EXTREME),
        *(_SHOCK_SIGMAS * SD_PER_MAD, _SHOCK_PAUSE_S, _SHOCK_S, _SHOCK_LIMIT),
    ]
)
"""As ``kernels/noise.cpp`` takes them."""


def block_length(data: Intervals) -> int:
    """Return how many samples a block of a record has, a power of 2; 0 where it is too short for one."""
    length: int = 2 ** round(np.log2(max(min(_BLOCK_S / data.usual_duration, len(data)), 1.0)))
    length = length if length <= len(data) else length // 2
    return length if length >= _SHORTEST_BLOCK else 0


@dataclass(frozen=True)
class SampleBlocks:
    """A record is cut into blocks of ``length`` samples that overlap by half; the last one ends with the record.

    ``starts`` (b,): the first sample of each.
    """

    data: Intervals
    length: int
    starts: np.ndarray

    @classmethod
    def of(cls, data: Intervals, length: int) -> SampleBlocks:
        """Return the blocks of a record of at least as many samples as a block has."""
        last = len(data) - length
        return cls(data, length, np.append(np.arange(0, last, length // 2), last))

    @property
    def dt(self) -> float:
        """The usual sampling interval, s."""
        return self.data.usual_duration

    @cached_property
    def channels(self) -> Array:
        """The samples of gyro, rad/s, and accelerometer, m/s^2, shape (6, n)."""
        return np.concatenate([self.data.gyro.T, self.data.accel.T])

    def by_kernel(self) -> tuple[Array, Array, Array, Array, Array]:
        """Return what :meth:`floor`, :meth:`rounding`, :meth:`hidden` and :meth:`shocks` do."""
        from trackfg.numerics import compiled

        data, count = self.data, len(self.data)
        edges, gyro, accel = map(kernel_argument, (data.edges, data.gyro, data.accel))
        floor, lost, shock = np.empty((len(self.starts), 6)), np.empty((count, 6)), np.empty((count, 6))
        lost_rows, shock_rows = np.empty((2, count), dtype=np.int64)
        lost_count, shown = compiled.noise_floor(
            *(edges, gyro, accel, np.ascontiguousarray(data.bridged), self.starts, self.length, self.dt),
            *(NOISE_LIMITS, floor, lost_rows, lost, shock_rows, shock),
        )
        rows = shock_rows[:shown]
        shock_t = 0.5 * (data.edges[rows] + data.edges[rows + 1])
        return floor, data.edges[lost_rows[:lost_count]], lost[:lost_count].copy(), shock_t, shock[:shown].copy()

    def samples(self, blocks: np.ndarray | slice) -> Array:
        """Return the samples of some blocks, shape (blocks, 6, length)."""
        views = sliding_window_view(self.channels, self.length, axis=1)[:, self.starts[blocks]]
        return np.ascontiguousarray(views.swapaxes(0, 1))

    @property
    def knots(self) -> Array:
        """Times between which a block stands for the record, s, shape (blocks + 1,)."""
        t = self.data.edges
        centre = 0.5 * (t[self.starts] + t[self.starts + self.length])
        return np.concatenate([t[:1], 0.5 * (centre[1:] + centre[:-1]), t[-1:]])

    def floor(self) -> Array:
        """Return the density squared of the white floor, 0 in blocks with bridged samples. Shape (blocks, 6)."""
        window = np.hanning(self.length + 1)[:-1]
        ends = self.length // 2 >> np.arange(_BANDS, -1, -1)
        logs = np.empty((len(self.starts), 6, _BANDS))
        for begin in range(0, len(self.starts), _CHUNK):
            part = self.samples(slice(begin, begin + _CHUNK))
            part -= part.mean(axis=2, keepdims=True)
            part *= window
            spectrum = np.fft.rfft(part, axis=2)[:, :, ends[0] : ends[-1]]
            power = np.log(np.maximum(spectrum.real**2 + spectrum.imag**2, np.finfo(float).tiny))
            logs[begin : begin + _CHUNK] = np.add.reduceat(power, ends[:-1] - ends[0], axis=2) / np.diff(ends)
        smooth = median_filter(logs, size=(_NEIGHBOURS, 1, 1), mode="nearest")
        floor = np.min(smooth + _SCATTER / np.sqrt(np.diff(ends)), axis=2)
        bounds = np.column_stack([self.starts, self.starts + self.length]).ravel()
        bridged = np.add.reduceat(np.append(self.data.bridged, False), bounds)[::2] > 0
        return np.asarray(np.where(bridged[:, None], 0.0, np.exp(floor + EULER) * self.dt / np.sum(window**2)))

    def rounding(self) -> Array:
        """Return the density squared of the rounding to steps: it lasts as long as a value. Shape (blocks, 6)."""
        count = np.empty((len(self.starts), 6))
        for channel, samples in enumerate(self.channels):
            changes = np.append(0, np.cumsum(np.abs(np.diff(samples)) > _SAME))
            count[:, channel] = changes[self.starts + self.length - 1] - changes[self.starts]
        return np.asarray(self._step**2 / 12.0 * self.length * self.dt / (count + 1.0))

    def hidden(self) -> tuple[Array, Array]:
        """Return when short holes and the ends of the range hide something (h,), s, and how much (h, 6)."""
        durations = self.data.durations
        longer = np.where((durations > _LONGER * self.dt) & ~self.data.bridged, durations - self.dt, 0.0)
        cut_off = self._cut_off()
        rows = np.flatnonzero((longer > 0.0) | cut_off.any(axis=0))
        lost = np.maximum(longer[rows, None], self.dt * cut_off[:, rows].T)
        blocks, block_of_row = np.unique(self._block_of(rows), return_inverse=True)
        near = self.samples(blocks)
        furthest = np.abs(near - _medians(near)[:, :, None]).max(axis=2)
        return self.data.edges[rows], lost * furthest[block_of_row]

    def _block_of(self, rows: np.ndarray) -> np.ndarray:
        """Return the block in whose middle each sample is."""
        return np.asarray(np.clip((rows - self.length // 4) // (self.length // 2), 0, len(self.starts) - 1))

    def shocks(self) -> tuple[Array, Array]:
        """Return the times of samples in shocks (k,), s, and the changes of velocity that they show (k, 6), m/s."""
        force, block = self.channels[3:].T, self._block_of(np.arange(len(self.data)))
        centre, spread = np.empty((2, len(self.starts), 3))
        for begin in range(0, len(self.starts), _CHUNK):
            some = slice(begin, begin + _CHUNK)
            part = self.samples(some)[:, 3:]
            centre[some] = _medians(part)
            spread[some] = SD_PER_MAD * _medians(np.abs(part - centre[some, :, None]))
        limit = np.maximum(_SHOCK_SIGMAS * spread, _FINE_STEPS * self._step[3:])
        beyond = np.column_stack([np.abs(force[:, i] - centre[block, i]) > limit[block, i] for i in range(3)])
        spans = true_stretches(np.any(beyond, axis=1), round(_SHOCK_PAUSE_S / self.dt))
        spans = spans[np.diff(spans, axis=1)[:, 0] * self.dt <= _SHOCK_S]
        if not len(spans):
            return np.zeros(0), np.zeros((0, 6))
        count = np.diff(spans, axis=1)[:, 0]
        starts = np.cumsum(count) - count
        which = np.repeat(np.arange(len(spans)), count)
        rows = np.arange(len(which)) + (spans[:, 0] - starts)[which]
        around = 0.5 * (force[np.maximum(spans[:, 0] - 1, 0)] + force[np.minimum(spans[:, 1], len(force) - 1)])
        change = (force[rows] - around[which]) * self.data.durations[rows, None]
        change *= np.add.reduceat(beyond[rows], starts).astype(bool)[which]
        size = np.abs(np.add.reduceat(change, starts))
        most = _SHOCK_LIMIT * np.sqrt(np.mean(size[:, 0] ** 2))
        share = np.divide(most, size[:, 1:], out=np.ones_like(size[:, 1:]), where=size[:, 1:] > most)
        change[:, 1:] *= share[which]
        edges = self.data.edges
        return 0.5 * (edges[rows] + edges[rows + 1]), np.pad(change, [(0, 0), (3, 0)])

    def _cut_off(self) -> np.ndarray:
        """Return which samples are at an end of their range: more of them than near it. Shape (6, n)."""
        cut_off = np.zeros(self.channels.shape, dtype=bool)
        for samples, step, out in zip(self.channels, self._step, cut_off, strict=True):
            for sign, at_end in ((1.0, samples > samples.max() - _SAME), (-1.0, samples < samples.min() + _SAME)):
                count = np.count_nonzero(at_end)
                if count < _EXTREMES:
                    continue
                off = sign * (samples - median(samples))
                most = off.max()
                is_near = off > (1.0 - _NEAR_EXTREME) * most
                if 2 * count > np.count_nonzero(is_near) and most > _FINE_STEPS * step:
                    out |= at_end
        return cut_off

    @cached_property
    def _step(self) -> Array:
        return _finest_step(self.channels)


def _medians(samples: Array) -> Array:
    """Return the medians along the last axis, of an even length: numpy sorts blocks in a seventh of the time of
    ``np.median``.
    """
    half = samples.shape[-1] // 2
    return np.asarray(np.sort(samples, axis=-1)[..., half - 1 : half + 1].mean(axis=-1))


def _finest_step(channels: Array) -> Array:
    """Return the smallest difference of two samples in a row of each channel (c, n), 0 where all are equal."""
    finest = np.empty(len(channels))
    for i, samples in enumerate(channels):
        steps = np.diff(samples)
        np.abs(steps, out=steps)
        finest[i] = np.min(steps[steps > _SAME], initial=np.inf)
    return np.where(np.isfinite(finest), finest, 0.0)

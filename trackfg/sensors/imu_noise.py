"""The white noise of inertial samples is seen in the samples themselves, by axis and over time.

What preintegration adds up between two keyframes is noise of low frequency, below the keyframe rate. There the
vehicle's own motion hides it. But noise that is of the samples alone is white up to the Nyquist frequency: the sensor's
own, and vibration that is sampled without a filter, whose spectrum is folded until it is flat. Motion, and vibration
that is sampled as it should be, is not: its spectrum falls somewhere below the Nyquist frequency. So

    density^2 = min over bands of S(band), where that is clearly more than what is declared,

with S the two-sided power spectral density, (rad/s)^2/Hz or (m/s^2)^2/Hz, in the three octaves below the Nyquist
frequency. S is a mean of log periodograms over a band (lines of an engine hardly count), and the median over
neighbouring blocks of the record (a shock does not count): Welch, IEEE Trans. Audio Electroacoustics 15 (1967); Wahba,
J. American Statistical Association 75 (1980), for the mean of the log of a periodogram, which is that of the density
less Euler's constant.

A line of an engine's vibration that lies near a multiple of the sampling rate is folded to near zero, where no spectrum
in motion distinguishes it from motion. But at rest all is noise: there the variance of means over half a second shows
it, and what shakes a vehicle at rest shakes it in motion, too (:class:`RestNoise`).

For the same reason rests show what a sensor has at most where it is better than declared. The variance of means over
tau is theirs, and half the mean square of the difference of two means in a row, which a drift does not change: Allan,
Proc. IEEE 54 (1966). A limit of 2 sigma of it takes the place of a larger declared density where the floor shows what
motion adds: a record too short, or of too few samples a second for a floor, has what is declared.

Two more things count as noise of an interval:

- steps q of the numbers that the sensor puts out: q^2/12 for as long as a value stays, that is times dt of a signal
  that changes at each sample, and of one that rests on a value, times the time that it rests there;
- samples that are missing but not bridged, and samples at the end of the sensor's range: what was there may be as large
  as the largest deviation nearby;
- shocks: a vehicle does not change its speed within some hundredths of a second, so what a shock's samples sum up to
  along the vehicle is an error of the sensor's, in or beyond its range. Across and upwards the track moves the sensor
  as fast, but what the sensor makes of shocks is as large there.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.ndimage import median_filter, uniform_filter1d
from scipy.special import chdtri, ndtr

from trackfg.numerics.arrays import Array
from trackfg.numerics.kernels import compiled_kernels, kernel_argument
from trackfg.numerics.key_figures import Outlined
from trackfg.numerics.robust import SD_PER_MAD, median, robust_sd
from trackfg.numerics.spans import true_stretches, within
from trackfg.sensors.imu_intervals import Intervals, interpolate_columns, means_around

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

CLEARLY = 2.0
"""Of the declared density squared: of true ones the floor is further up in less than 0.1 % of blocks of 64 samples."""

_CHUNK = 64
"""Blocks at a time, so that the spectra of a long record need little memory."""

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

_MOTION_S = 0.25
"""Means over this, s, are motion: what is faster than 2-4 Hz is vibration, a body on its springs sways at 1-2 Hz."""

_STEADY_S = 5.0
"""Vibration changes with the speed, over as many seconds; its power over one second scatters by a fifth."""

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


@dataclass(frozen=True, repr=False)
class WhiteNoise(Outlined):
    """White noise of m intervals has densities ``gyro`` (m, 3), rad/s/sqrt(Hz), and ``accel`` (m, 3), m/s^2/sqrt(Hz).

    They are along the body's axes.
    """

    gyro: Array
    accel: Array

    @classmethod
    def alike(cls, gyro: float, accel: float, count: int) -> WhiteNoise:
        """Return the same noise on all axes of ``count`` intervals."""
        return cls(np.full((count, 3), gyro), np.full((count, 3), accel))

    def __len__(self) -> int:
        return len(self.gyro)

    def over_holes(self, bridged: np.ndarray, gyro: float, accel: float) -> WhiteNoise:
        """Return the noise with these densities in the intervals ``bridged`` (m,), of which there are no samples."""
        if not bridged.any():
            return self
        rows = bridged[:, None]
        return WhiteNoise(np.where(rows, gyro, self.gyro), np.where(rows, accel, self.accel))

    @property
    def variance(self) -> Array:
        """Squares of the densities, gyro first, shape (m, 6)."""
        return np.concatenate([self.gyro, self.accel], axis=1) ** 2

    @classmethod
    def of_variance(cls, variance: Array) -> WhiteNoise:
        """Return the noise of these squares of densities (m, 6)."""
        density = np.sqrt(variance)
        return cls(density[:, :3], density[:, 3:])


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
class NoiseFloor:
    """The floor of spectra is a density squared, ``seen`` (b, 6), gyro first, between times ``knots`` (b + 1,), s.

    At times ``lost_t`` (h,), s, samples hide a turn (rad) or a change of velocity (m/s) of about ``lost`` (h, 6), and
    at ``shock_t`` (k,), s, they show a change ``shock`` (k, 6) that was none. All times are in order. ``at_rest``: what
    rests show besides.
    """

    knots: Array
    seen: Array
    lost_t: Array
    lost: Array
    shock_t: Array
    shock: Array
    at_rest: NoiseAtRest = field(default_factory=NoiseAtRest)

    @classmethod
    def of(cls, data: Intervals) -> NoiseFloor:
        """Look at all samples of a record; one shorter than a block is not judged. Each rate has a floor of its own."""
        if len(data.stretches) > 1:
            return cls._joined([cls.of(data.take(rows)) for rows in data.stretches])
        length = block_length(data)
        if not length:
            return cls.unknown(data)
        blocks = _Blocks.of(data, length)
        if compiled_kernels():
            return cls(blocks.knots, *blocks.by_kernel())
        return cls(blocks.knots, np.maximum(blocks.floor(), blocks.rounding()), *blocks.hidden(), *blocks.shocks())

    @classmethod
    def _joined(cls, parts: list[NoiseFloor]) -> NoiseFloor:
        """Return that of records of which each begins where the one before ends."""
        later = [part.knots[1:] for part in parts[1:]]
        knots = np.concatenate([parts[0].knots, *later])
        seen, lost_t, lost, shock_t, shock = (
            np.concatenate([getattr(part, name) for part in parts])
            for name in ("seen", "lost_t", "lost", "shock_t", "shock")
        )
        return cls(knots, seen, lost_t, lost, shock_t, shock)

    @classmethod
    def unknown(cls, data: Intervals) -> NoiseFloor:
        """Return a floor of a record that is not judged."""
        nowhere = np.zeros(0), np.zeros((0, 6))
        return cls(data.edges[[0, -1]], np.zeros((1, 6)), *nowhere, *nowhere)

    def with_rests(self, data: Intervals, rests: Array) -> NoiseFloor:
        """Return the same with what ``rests`` (r, 2), s, show besides."""
        return replace(self, at_rest=RestNoise.of(data, self, rests).shown())

    def between(self, t: Array, gyro: float, accel: float) -> WhiteNoise:
        """Return the white noise between times ``t`` (m + 1,), s: as seen, at least as declared where rests do not show
        less.
        """
        assumed, seen, span = self.at_rest.assumed(gyro, accel), self.seen + self.at_rest.excess, np.diff(t)[:, None]
        if compiled_kernels():
            from trackfg.numerics import compiled

            t, knots, level = map(kernel_argument, (t, self.knots, seen))
            lost_t, lost, shock_t, shock = map(kernel_argument, (self.lost_t, self.lost, self.shock_t, self.shock))
            variance = np.empty((len(span), 6))
            compiled.white_noise(t, knots, level, assumed, CLEARLY, lost_t, lost, shock_t, shock, variance)
            return WhiteNoise.of_variance(variance)
        white = np.where(seen > CLEARLY * assumed, seen, assumed)
        total = np.concatenate([np.zeros((1, 6)), np.cumsum(white * np.diff(self.knots)[:, None], axis=0)])
        lost, shocks = (_summed(t, *parts) for parts in ((self.lost_t, self.lost), (self.shock_t, self.shock)))
        return WhiteNoise.of_variance(
            np.diff(interpolate_columns(t, self.knots, total), axis=0) / span + (lost**2 + shocks**2) / span
        )


def noise_seen(data: Intervals, t: Array, gyro: float, accel: float, at_rest: NoiseAtRest) -> WhiteNoise:
    """Return the white noise between times ``t`` (m + 1,), s, of a record of these samples, and of rests before it
    (:meth:`NoiseFloor.between`).
    """
    if not compiled_kernels() or len(data.stretches) > 1:
        return replace(NoiseFloor.of(data), at_rest=at_rest).between(t, gyro, accel)
    from trackfg.numerics import compiled

    variance = np.empty((len(t) - 1, 6))
    edges, rates, forces, times = map(kernel_argument, (data.edges, data.gyro, data.accel, t))
    compiled.noise_seen(
        *(edges, rates, forces, np.ascontiguousarray(data.bridged), block_length(data), data.usual_duration),
        *(NOISE_LIMITS, at_rest.assumed(gyro, accel), at_rest.excess, CLEARLY, times, variance),
    )
    return WhiteNoise.of_variance(variance)


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
    def of(cls, data: Intervals, floor: NoiseFloor, rests: Array) -> RestNoise:
        """Return that of ``rests`` (r, 2), s, in a record of this floor; none where they are too short."""
        middle = 0.5 * (floor.knots[1:] + floor.knots[:-1])
        long = rests[np.diff(rests, axis=1)[:, 0] >= _REST_MEAN_S]
        counts = ((long[:, 1] - long[:, 0]) / _REST_MEAN_S).astype(int)
        edges = [np.linspace(begin, end, count + 1) for (begin, end), count in zip(long, counts, strict=True)]
        t = np.concatenate([np.zeros(0), *(0.5 * (each[1:] + each[:-1]) for each in edges)])
        means = np.hstack([means_around(t, _REST_MEAN_S, data.edges, samples) for samples in (data.gyro, data.accel)])
        by_rest = [rest for rest in np.split(means, np.cumsum(counts)[:-1]) if len(rest)]
        parts = [part for rest in by_rest for part in np.array_split(rest, -(-len(rest) // _REST_MEANS))]
        resting = within(middle, rests)
        if len(t) <= len(rests) or not floor.seen[resting].any():
            return cls()
        off = [part - np.median(part, axis=0) for part in parts]
        step = [np.diff(rest, axis=0) / np.sqrt(2.0) for rest in by_rest]
        return cls(np.concatenate(off), np.concatenate(step), floor.seen[resting])

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


def _summed(edges: Array, t: Array, values: Array) -> Array:
    """Return the sums of ``values`` (k, 6) at ``t`` (k,) between ``edges`` (m + 1,). Shape (m, 6)."""
    first = np.searchsorted(edges, t, side="right") - 1
    inside = (first >= 0) & (first < len(edges) - 1)
    sums = np.zeros((len(edges) - 1, 6))
    np.add.at(sums, first[inside], values[inside])
    return sums


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


def block_length(data: Intervals) -> int:
    """Return how many samples a block of a record has, a power of 2; 0 where it is too short for one."""
    length: int = 2 ** round(np.log2(max(min(_BLOCK_S / data.usual_duration, len(data)), 1.0)))
    length = length if length <= len(data) else length // 2
    return length if length >= _SHORTEST_BLOCK else 0


def vibration_widths(data: Intervals) -> tuple[int, int]:
    """Return over how many samples means are motion, and over how many the vibration lasts."""
    fast, lasting = (max(3, round(span / data.usual_duration)) for span in (_MOTION_S, _STEADY_S))
    return fast, lasting


def vibration_power(data: Intervals) -> Iterator[Array]:
    """Yield the power of the vibration at each sample, (m/s^2)^2, shape (n,), of one axis after the other.

    That is the mean square, over some seconds, of what is faster than the motion of a vehicle on its springs.
    """
    widths = [(rows, *vibration_widths(data.take(rows))) for rows in data.stretches]
    for force in data.accel.T:
        power = np.empty(len(data))
        for rows, fast, lasting in widths:
            shaking = force[rows] - uniform_filter1d(force[rows], fast)
            uniform_filter1d(np.square(shaking, out=shaking), lasting, output=power[rows])
        yield power


@dataclass(frozen=True)
class _Blocks:
    """A record is cut into blocks of ``length`` samples that overlap by half; the last one ends with the record.

    ``channels`` (6, n), gyro first; ``dt`` is the usual sampling interval, s.
    """

    data: Intervals
    length: int
    starts: np.ndarray

    @classmethod
    def of(cls, data: Intervals, length: int) -> _Blocks:
        last = len(data) - length
        return cls(data, length, np.append(np.arange(0, last, length // 2), last))

    @property
    def dt(self) -> float:
        """The sampling interval, s."""
        return self.data.usual_duration

    @cached_property
    def channels(self) -> Array:
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

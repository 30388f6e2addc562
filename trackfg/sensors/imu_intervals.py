"""The inertial samples as intervals without holes, and their exact compression.

A sample is the mean angular rate and specific force over the interval around its stamp. :func:`intervals` lays these
intervals edge to edge; where samples are missing it bridges the hole with interpolated ones and marks them, so that
their noise can be widened and everything downstream sees one continuous record.

:func:`compress` turns groups of samples into one rotation and one velocity increment each, expressed in the body axes
at the start of the group, with the turning of the body within each sample included (coning and sculling; Savage,
"Strapdown inertial navigation integration algorithm design", J. Guidance, Control and Dynamics 21 (1998)). GTSAM then
preintegrates a quarter or a tenth of the samples.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from trackfg.numerics.arrays import Array
from trackfg.numerics.kernels import compiled_kernels, kernel_argument
from trackfg.numerics.key_figures import Outlined
from trackfg.numerics.robust import median
from trackfg.numerics.rotations import (
    cross,
    entries_from_quaternion,
    matrices,
    matrix_from_quaternion,
    quaternion_exp,
    quaternion_log,
)
from trackfg.numerics.spans import median_interval, true_runs
from trackfg.recording.model import Recording
from trackfg.sensors.sampling_rate import local_intervals, rate_stretches

_NO_BIAS = np.zeros(3)
SAME_S = 1e-9
"""Times nearer than this, s, are equal but for rounding."""
AT_REST_M = 1e-3
"""An interval over which the vehicle moves less, m, has no length to average over."""


@dataclass(frozen=True, repr=False)
class Intervals(Outlined):
    """n intervals: ``edges`` (n + 1,) s; mean ``gyro`` and ``accel`` (n, 3) in body axes; ``bridged`` (n,) of bool."""

    edges: Array
    gyro: Array
    accel: Array
    bridged: np.ndarray

    def __len__(self) -> int:
        return len(self.gyro)

    def take(self, rows: slice) -> Intervals:
        """Return some of the intervals, in a row."""
        first, end, _ = rows.indices(len(self))
        return Intervals(self.edges[first : end + 1], self.gyro[rows], self.accel[rows], self.bridged[rows])

    @cached_property
    def durations(self) -> Array:
        """Length of each interval, s."""
        return np.asarray(self.edges[1:] - self.edges[:-1])

    @cached_property
    def usual_duration(self) -> float:
        """Median length of the intervals, s."""
        if compiled_kernels():
            from trackfg.numerics import compiled

            return compiled.median_step(kernel_argument(self.edges))
        return median(self.durations)

    @cached_property
    def stretches(self) -> tuple[slice, ...]:
        """The intervals of one sampling rate each: all of them unless the rate changes."""
        return tuple(slice(first, end) for first, end in rate_stretches(self.durations))

    def usual_durations(self, rows: np.ndarray) -> float | Array:
        """Return the median length of the intervals of the rate that there is in each of the ``rows`` (m,), s."""
        if len(self.stretches) == 1:
            return self.usual_duration
        usual = np.array([self.take(stretch).usual_duration for stretch in self.stretches])
        ends = [stretch.stop for stretch in self.stretches[:-1]]
        return usual[np.searchsorted(ends, rows, side="right")]

    def bridged_from(self, t: Array) -> np.ndarray:
        """Return whether the record is bridged from each of some edges on, at ``t`` (m,), s. Shape (m,)."""
        return np.asarray(self.bridged[self.edges_at(t)])

    def edges_at(self, t: ArrayLike) -> np.ndarray:
        """Return the numbers of the edges at times ``t``, s, or of the next ones. Shape of ``t``."""
        return np.asarray(self.edges.searchsorted(np.asarray(t) - SAME_S))

    def gaps(self) -> Array:
        """Return bridged spans as rows (start, end), s. Shape (g, 2)."""
        spans: Array = self.edges[true_runs(self.bridged)]
        return spans


_HOLE_INTERVALS = 3.5
"""A hole is longer than so many sampling intervals: three samples or more are missing."""
_HOLE_S = 0.05
"""A hole is longer than this, s: a fast sensor may lose some samples and hardly anything moves meanwhile."""


def hole_s(dt: Array) -> Array:
    """Return from which distances (s) of neighbouring samples on there is a hole, at sampling intervals ``dt``, s."""
    return np.maximum(_HOLE_INTERVALS * dt, _HOLE_S)


def intervals(recording: Recording) -> Intervals:
    """Lay the samples edge to edge; bridge holes longer than three sampling intervals (and 50 ms).

    The interval is that of the rate at each place.
    """
    t = recording.imu["t_s"].to_numpy()
    return laid_out(t, recording.gyro, recording.accel, median_interval(t))


def laid_out(t: Array, gyro: Array, accel: Array, dt: float, begin: float | None = None) -> Intervals:
    """Return the :func:`intervals` of samples at ``t`` (n,), about every ``dt`` s; the first one starts at ``begin``,
    if known.

    Where the rate changes, ``dt`` is another one.
    """
    steps = np.diff(t)
    local = local_intervals(steps, dt) if len(steps) else np.array([dt])
    holes = np.flatnonzero(steps > hole_s(local))
    bridged = np.zeros(t.size, dtype=bool)
    if holes.size:
        inserted = [np.linspace(t[i], t[i + 1], round(steps[i] / local[i]) + 1)[1:-1] for i in holes]
        where = np.repeat(holes + 1, [len(x) for x in inserted])
        new = np.concatenate(inserted)
        gyro = np.insert(gyro, where, interpolate_columns(new, t, gyro), axis=0)
        accel = np.insert(accel, where, interpolate_columns(new, t, accel), axis=0)
        bridged = np.insert(bridged, where, values=True)
        t = np.insert(t, where, new)
    middle = 0.5 * (t[1:] + t[:-1])
    # To the nanosecond, so that a record that starts at 0 does so exactly and covers what others measure there.
    start, end = np.round([t[0] - 0.5 * local[0], t[-1] + 0.5 * local[-1]], 9)
    edges = np.concatenate([[start if begin is None else begin], middle, [end]])
    return Intervals(edges, gyro, accel, bridged)


def means_around(t: Array, width_s: float, edges: Array, samples: Array) -> Array:
    """Return means (m, 3) of samples (n, 3) between ``edges`` (n + 1,) over ``width_s`` s around each ``t`` (m,)."""
    if compiled_kernels():
        from trackfg.numerics import compiled

        means = np.empty((len(t), 3))
        compiled.means_around(kernel_argument(t), width_s, kernel_argument(edges), kernel_argument(samples), means)
        return means
    return means_between(t - 0.5 * width_s, t + 0.5 * width_s, edges, samples)


def means_between(begin: Array, end: Array, edges: Array, samples: Array) -> Array:
    """Return means of the samples (n, 3) between ``edges`` (n + 1,) from each ``begin`` (m,), s, to its ``end``,
    likewise.

    Shape (m, 3).
    """
    ends = np.clip([begin, end], edges[0], edges[-1])
    i = np.clip(np.searchsorted(edges, ends, side="right") - 1, 0, len(samples) - 1)
    durations, since, integral, out = np.diff(edges), ends - edges[i], np.zeros(len(edges)), np.empty((len(begin), 3))
    for values, mean in zip(samples.T, out.T, strict=True):
        np.cumsum(values * durations, out=integral[1:])
        at_begin, at_end = integral[i] + since * values[i]
        mean[:] = (at_end - at_begin) / (ends[1] - ends[0])
    return out


def interpolate_columns(at: Array, t: Array, values: Array) -> Array:
    """Return each column of ``values`` (n, c), given at ``t`` (n,), linearly at ``at`` (m,). Shape (m, c)."""
    if compiled_kernels():
        from trackfg.numerics import compiled

        out = np.empty((len(at), values.shape[1]))
        compiled.interpolate_columns(kernel_argument(at), kernel_argument(t), kernel_argument(values), out)
        return out
    return np.stack([np.interp(at, t, values[:, c]) for c in range(values.shape[1])], axis=1)


@dataclass(frozen=True)
class Increments:
    """Groups of intervals: duration (m,) s, rotation vector (m, 3) rad, velocity change (m, 3) m/s in starting axes."""

    duration: Array
    rotation: Array
    velocity: Array


def compress(data: Intervals, starts: np.ndarray, gyro_bias: Array = _NO_BIAS) -> Increments:
    """Group g covers the intervals from ``starts[g]`` to ``starts[g + 1]``. ``starts`` (m + 1,), increasing.

    The increments are those of the raw samples, biases included, but the specific force is turned by the rate less
    ``gyro_bias`` (3,), rad/s: a bias of 1e-3 rad/s would look like an acceleration of 1e-4 m/s^2 over 0.02 s.
    """
    if compiled_kernels():
        from trackfg.numerics import compiled

        count = len(starts) - 1
        increments = Increments(np.empty(count), np.empty((count, 3)), np.empty((count, 3)))
        part = data.take(slice(int(starts[0]), int(starts[-1])))  # what is not laid out by rows is copied
        edges, gyro, accel, bias = map(kernel_argument, (part.edges, part.gyro, part.accel, gyro_bias))
        groups = (starts - starts[0]).astype(np.int64)
        compiled.compress(
            edges, gyro, accel, groups, bias, increments.duration, increments.rotation, increments.velocity
        )
        return increments
    first, counts = starts[:-1], np.diff(starts)
    duration = np.diff(data.edges[starts])
    samples = slice(int(starts[0]), int(starts[-1]))
    dt = data.durations[samples, None]
    turn, change = (data.gyro[samples] - gyro_bias) * dt, data.accel[samples] * dt
    change += 0.5 * cross(turn, change)
    if counts.max(initial=0) <= 1:
        return Increments(duration, data.gyro[samples] * dt, change)
    running, whole = running_turn(starts - starts[0], turn)
    velocity = np.add.reduceat(np.einsum("mij,mj->mi", matrix_from_quaternion(running), change), first - starts[0])
    return Increments(duration, quaternion_log(whole).T + duration[:, None] * gyro_bias, velocity)


def running_turn(starts: np.ndarray, vectors: Array) -> tuple[Array, Array]:
    """Return how far groups of small rotations turn: ``vectors`` (m, 3) rad one after the other, each in the axes that
    the one before led to; group g has those from ``starts[g]`` to ``starts[g + 1]``. Quaternions, components first,
    from a group's start to before each rotation (4, m) and to its end (4, n).
    """
    first, counts = starts[:-1], np.diff(starts)
    w, x, y, z = quaternion_exp(vectors.T)
    steps = w + 1j * x, y + 1j * z
    longest = int(counts.max(initial=0))
    running, whole = (_by_doubling if len(first) < longest else _one_by_one)(first, counts, steps)
    return _components(*running), _components(*whole)


_Pair = tuple[NDArray[np.complex128], NDArray[np.complex128]]
"""Quaternions ``a + b j`` with a = w + x i and b = y + z i: their products are few operations on arrays."""


def _product(p: _Pair, q: _Pair) -> _Pair:
    (a, b), (c, d) = p, q
    return a * c - b * d.conj(), a * d + b * c.conj()


def _components(a: NDArray[np.complex128], b: NDArray[np.complex128]) -> Array:
    return np.stack([a.real, a.imag, b.real, b.imag])


def _one_by_one(first: np.ndarray, counts: np.ndarray, steps: _Pair) -> tuple[_Pair, _Pair]:
    """Many groups: the first of all, then the second of all, and so on, long groups ahead of short ones."""
    order = np.argsort(-counts, kind="stable")
    first, longer = first[order], np.searchsorted(-counts[order], -np.arange(counts.max(initial=0)))
    running = np.empty_like(steps[0]), np.empty_like(steps[1])
    now = np.ones(len(first), dtype=np.complex128), np.zeros(len(first), dtype=np.complex128)
    for i, count in enumerate(longer.tolist()):
        row = first[:count] + i
        a, b = now[0][:count], now[1][:count]
        running[0][row], running[1][row] = a, b
        a[:], b[:] = _product((a, b), (steps[0][row], steps[1][row]))
    whole = np.empty_like(now[0]), np.empty_like(now[1])
    whole[0][order], whole[1][order] = now
    return running, whole


def _by_doubling(first: np.ndarray, counts: np.ndarray, steps: _Pair) -> tuple[_Pair, _Pair]:
    """Few long groups: products of 2, 4, 8, ... steps, all at once."""
    since = np.arange(len(steps[0])) - np.repeat(first, counts)
    (a, b), reach = (steps[0].copy(), steps[1].copy()), 1
    while reach < int(counts.max()):
        far = np.flatnonzero(since >= reach)
        near = far - reach
        a[far], b[far] = _product((a[near], b[near]), (a[far], b[far]))
        reach *= 2
    running, later = (np.ones_like(a), np.zeros_like(b)), np.flatnonzero(since > 0)
    running[0][later], running[1][later] = a[later - 1], b[later - 1]
    last = first + counts - 1
    return running, (a[last], b[last])


@dataclass(frozen=True)
class Turning:
    """The turn of the body between keyframes k and k + 1, relative to k: ``turn`` (m, 3, 3) over the whole interval,
    and its ``mean`` and ``mean_by_time`` (weighted by the elapsed part of the interval's time) over the length of the
    path.
    """

    turn: Array
    mean: Array
    mean_by_time: Array


def turning(data: Intervals, keyframes: np.ndarray, gyro_bias: Array, distance: Array) -> Turning:
    """Return the gyro's attitude along each interval, averaged over the distance travelled.

    ``keyframes`` (m + 1,) index ``data.edges``; ``gyro_bias`` (3,) rad/s is taken out; ``distance`` (n + 1,) m at the
    edges. An interval without distance is averaged over time. The trapezoid rule at every sample.
    """
    if compiled_kernels():
        from trackfg.numerics import compiled

        attitudes = Turning(*np.empty((3, len(keyframes) - 1, 3, 3)))
        edges, gyro, bias, way = map(kernel_argument, (data.edges, data.gyro, gyro_bias, distance))
        turned = attitudes.turn, attitudes.mean, attitudes.mean_by_time
        compiled.turning(edges, gyro, keyframes.astype(np.int64), bias, way, AT_REST_M, *turned)
        return attitudes
    first, counts = keyframes[:-1], np.diff(keyframes)
    span, length = np.diff(data.edges[keyframes]), np.diff(distance[keyframes])
    moving = np.abs(length) > AT_REST_M
    interval, within = np.repeat(np.arange(len(first)), counts), slice(keyframes[0], keyframes[-1])
    edges = data.edges[keyframes[0] : keyframes[-1] + 1]
    dt, path_steps = np.diff(edges), np.diff(distance[keyframes[0] : keyframes[-1] + 1])
    running, whole = running_turn(keyframes - keyframes[0], (data.gyro[within] - gyro_bias) * dt[:, None])
    # Weights of the attitude before each sample: half of the sample's share, and half of that of the one before it.
    share = np.where(moving[interval], path_steps / np.where(moving, length, 1.0)[interval], dt / span[interval])
    late = (edges[:-1] - data.edges[first][interval]) / span[interval]
    start = first - keyframes[0]
    weight = 0.5 * (share + np.append(0.0, share[:-1]))
    weight[start] = 0.5 * share[start]
    last = np.append(start[1:], len(share)) - 1
    entries, end, at_end = entries_from_quaternion(running), matrix_from_quaternion(whole), 0.5 * share[last]

    def mean(weight: Array) -> Array:
        within = matrices([np.add.reduceat(weight * entry, start) for entry in entries])
        return np.asarray(within + at_end[:, None, None] * end)

    return Turning(end, mean(weight), mean(weight * late))


def samples_per_increment(usual_s: float | Array, duration: float | Array) -> np.ndarray:
    """Return how many samples, each of ``usual_s`` s, are in increments of at most ``duration`` s: at least one."""
    return np.maximum(1, np.asarray(duration / usual_s + 1e-6).astype(np.int64))


def increment_starts(
    data: Intervals, edges: np.ndarray, duration: float | Array, times: Array | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Split each keyframe interval into increments of at most ``duration`` s, of all or of each interval (n - 1,), but
    at least a sample each, with boundaries on both sides of each of ``times``.

    Returns the increments' starts as indices into ``data.edges``, with the last end appended, and for each keyframe the
    position of its first increment in that list.
    """
    group = np.broadcast_to(samples_per_increment(data.usual_durations(edges[:-1]), duration), len(edges) - 1)
    counts = -(-np.diff(edges) // group)
    offset = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    starts = np.append(np.repeat(edges[:-1], counts) + np.repeat(group, counts) * offset, edges[-1])
    if times is not None:
        lower = np.clip(np.searchsorted(data.edges, times + 1e-9, side="right") - 1, 0, len(data))
        upper = np.minimum(lower + 1, len(data))
        is_start = np.zeros(len(data) + 1, dtype=bool)
        is_start[starts] = is_start[lower] = is_start[upper[data.edges[lower] < times - 1e-9]] = True
        starts = np.flatnonzero(is_start)
    return starts, np.searchsorted(starts, edges)

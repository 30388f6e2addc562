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

import numpy as np

from trackfg.frames import Array, so3_exp, so3_log
from trackfg.recording import Recording
from trackfg.spans import true_runs

_NO_BIAS = np.zeros(3)


@dataclass(frozen=True)
class Intervals:
    """n intervals: ``edges`` (n + 1,) s; mean ``gyro`` and ``accel`` (n, 3) in body axes; ``bridged`` (n,) of bool."""

    edges: Array
    gyro: Array
    accel: Array
    bridged: np.ndarray

    def __len__(self) -> int:
        return len(self.gyro)

    @property
    def durations(self) -> Array:
        """Length of each interval, s."""
        return np.diff(self.edges)

    def gaps(self) -> Array:
        """Bridged spans as rows (start, end), s. Shape (g, 2)."""
        spans: Array = self.edges[true_runs(self.bridged)]
        return spans


def intervals(recording: Recording) -> Intervals:
    """Lay the samples edge to edge; bridge holes longer than three sampling intervals (and 50 ms)."""
    t = recording.imu["t_s"].to_numpy()
    gyro, accel = recording.gyro, recording.accel
    dt = float(np.median(np.diff(t))) if t.size > 1 else 0.0
    holes = np.flatnonzero(np.diff(t) > max(3.5 * dt, 0.05))
    bridged = np.zeros(t.size, dtype=bool)
    if holes.size:
        inserted = [np.linspace(t[i], t[i + 1], round((t[i + 1] - t[i]) / dt) + 1)[1:-1] for i in holes]
        where = np.repeat(holes + 1, [len(x) for x in inserted])
        new = np.concatenate(inserted)
        gyro = np.insert(gyro, where, interpolate_columns(new, t, gyro), axis=0)
        accel = np.insert(accel, where, interpolate_columns(new, t, accel), axis=0)
        bridged = np.insert(bridged, where, values=True)
        t = np.insert(t, where, new)
    middle = 0.5 * (t[1:] + t[:-1])
    # To the nanosecond, so that a record that starts at 0 does so exactly and covers what others measure there.
    start, end = np.round([t[0] - 0.5 * dt, t[-1] + 0.5 * dt], 9)
    edges = np.concatenate([[start], middle, [end]])
    return Intervals(edges, gyro, accel, bridged)


def means_around(t: Array, width_s: float, edges: Array, samples: Array) -> Array:
    """Means of the samples (n, 3) between ``edges`` (n + 1,) over ``width_s`` s around each ``t``. Shape (m, 3)."""
    integral = np.vstack([np.zeros(3), np.cumsum(samples * np.diff(edges)[:, None], axis=0)])
    low, high = (np.clip(t + shift, edges[0], edges[-1]) for shift in (-0.5 * width_s, 0.5 * width_s))
    turned = interpolate_columns(high, edges, integral) - interpolate_columns(low, edges, integral)
    return np.asarray(turned / (high - low)[:, None])


def interpolate_columns(at: Array, t: Array, values: Array) -> Array:
    """Each column of ``values`` (n, c), given at ``t`` (n,), linearly at ``at`` (m,). Shape (m, c)."""
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
    first, counts = starts[:-1], np.diff(starts)
    duration = np.diff(data.edges[starts])
    if counts.max(initial=0) <= 1:
        turn, change = (data.gyro[first] - gyro_bias) * duration[:, None], data.accel[first] * duration[:, None]
        return Increments(duration, data.gyro[first] * duration[:, None], change + 0.5 * np.cross(turn, change))
    R = np.tile(np.eye(3), (len(first), 1, 1))
    velocity = np.zeros((len(first), 3))
    dt = data.durations
    for i in range(int(counts.max(initial=0))):
        live = np.flatnonzero(counts > i)
        sample = first[live] + i
        turn = (data.gyro[sample] - gyro_bias) * dt[sample, None]
        change = data.accel[sample] * dt[sample, None]
        change = change + 0.5 * np.cross(turn, change)
        velocity[live] += np.einsum("mij,mj->mi", R[live], change)
        R[live] = R[live] @ so3_exp(turn)
    return Increments(duration, so3_log(R) + duration[:, None] * gyro_bias, velocity)


@dataclass(frozen=True)
class Turning:
    """How the body turns between keyframes k and k + 1, relative to k: ``turn`` (m, 3, 3) over the whole interval, and
    its ``mean`` and ``mean_by_time`` (weighted by the part of the interval's time gone by) over the length of the path.
    """

    turn: Array
    mean: Array
    mean_by_time: Array


def turning(data: Intervals, keyframes: np.ndarray, gyro_bias: Array, distance: Array) -> Turning:
    """The gyro's attitude along each interval, averaged over the distance travelled.

    ``keyframes`` (m + 1,) index ``data.edges``; ``gyro_bias`` (3,) rad/s is taken out; ``distance`` (n + 1,) m at the
    edges. An interval without distance is averaged over time. The trapezoid rule at every sample.
    """
    first, counts = keyframes[:-1], np.diff(keyframes)
    m, dt = len(first), data.durations
    span, length = np.diff(data.edges[keyframes]), np.diff(distance[keyframes])
    moving = np.abs(length) > 1e-3
    R = np.tile(np.eye(3), (m, 1, 1))
    mean, mean_by_time = np.zeros((2, m, 3, 3))
    for i in range(int(counts.max(initial=0))):
        live = np.flatnonzero(counts > i)
        sample = first[live] + i
        ahead = R[live] @ so3_exp((data.gyro[sample] - gyro_bias) * dt[sample, None])
        by_length = (distance[sample + 1] - distance[sample]) / np.where(moving, length, 1.0)[live]
        share = np.where(moving[live], by_length, dt[sample] / span[live])
        before = ((data.edges[sample] - data.edges[first[live]]) / span[live])[:, None, None]
        after = before + (dt[sample] / span[live])[:, None, None]
        half = 0.5 * share[:, None, None]
        mean[live] += half * (R[live] + ahead)
        mean_by_time[live] += half * (before * R[live] + after * ahead)
        R[live] = ahead
    return Turning(R, mean, mean_by_time)


def increment_starts(
    data: Intervals, edges: np.ndarray, duration: float, times: Array | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Split each keyframe interval into increments of at most ``duration`` s (but at least a sample each), with
    boundaries on both sides of each of ``times``.

    Returns the increments' starts as indices into ``data.edges``, with the last end appended, and for each keyframe the
    position of its first increment in that list.
    """
    group = max(1, int(duration / float(np.median(data.durations)) + 1e-6))
    counts = -(-np.diff(edges) // group)
    offset = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    starts = np.append(np.repeat(edges[:-1], counts) + group * offset, edges[-1])
    if times is not None:
        before = np.clip(np.searchsorted(data.edges, times + 1e-9, side="right") - 1, 0, len(data))
        after = np.minimum(before + 1, len(data))
        starts = np.unique(np.concatenate([starts, before, after[data.edges[before] < times - 1e-9]]))
    return starts, np.searchsorted(starts, edges)

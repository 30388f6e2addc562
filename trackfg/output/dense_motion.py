"""Dense motion: the smoothed motion between keyframes, at about the rate of the IMU.

From each keyframe the inertial increments are integrated with the smoothed bias to the next one; what is left over
there is spread over the interval: the rotation in proportion to time, position, velocity and distance by the cubic that
has the required end values and slopes. The result passes through every keyframe's smoothed state and has the inertial
sensor's detail in between.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from trackfg.factors.motion import mount_matrix
from trackfg.factors.states import Nav, States
from trackfg.graph.run_context import RunContext
from trackfg.numerics.arrays import Array
from trackfg.numerics.geodesy import EARTH_RADIUS, transport_rate
from trackfg.numerics.hermite import hermite_rates, hermite_weights
from trackfg.numerics.kernels import compiled_kernels, kernel_argument
from trackfg.numerics.rotations import (
    cross,
    matrices_times,
    matrix_from_quaternion,
    quaternion,
    quaternion_exp,
    quaternion_log,
    quaternion_product,
    so3_exp,
    so3_log,
)
from trackfg.sensors.imu_intervals import compress, increment_starts, running_turn

_LONGEST_STEP_S = 0.02
"""A row of dense motion is no longer than this, s: 50 Hz, above the motion of a body on springs (below 10 Hz)."""

_CHUNK = 400
"""Intervals at a time without kernels: what is needed on the way stays small."""

_CONJUGATE = np.array([[1.0], [-1.0], [-1.0], [-1.0]])


@dataclass(frozen=True)
class DenseMotion:
    """Rows of motion: ``t`` (m,) s, ``nav`` of the IMU, distance along the track ``distance`` (m,) m, body rate
    ``gyro`` (m, 3) rad/s, a mean of the samples over ``gyro_span`` (m,) s.

    ``keyframe`` (m,) and ``fraction`` (m,) say where between which keyframes each row lies; ``forward`` (3,) is the
    direction of travel in the IMU's axes.
    """

    t: Array
    nav: Nav
    distance: Array
    gyro: Array
    gyro_span: Array
    keyframe: np.ndarray
    fraction: Array
    forward: Array

    def without_rates(self) -> DenseMotion:
        """Return the motion without the body rate, which profiles do not need: a sixth of its memory."""
        return replace(self, gyro=np.empty((0, 3)), gyro_span=np.empty(0))

    def at(self, t: Array) -> DenseMotion:
        """Return the motion at times ``t`` (k,) within the run: constant acceleration and rate between rows."""
        i = np.clip(np.searchsorted(self.t, t, side="right") - 1, 0, len(self.t) - 2)
        width = (self.t[i + 1] - self.t[i])[:, None]
        tau = t[:, None] - self.t[i][:, None]
        f = tau / width
        row, next_row = self.nav[i], self.nav[i + 1]
        turn = so3_log(np.swapaxes(row.R, 1, 2) @ next_row.R)
        nav = Nav(
            row.R @ so3_exp(f * turn),
            row.p + f * (next_row.p - row.p) - 0.5 * tau * (width - tau) / width * (next_row.v - row.v),
            row.v + f * (next_row.v - row.v),
        )
        slow, fast = (np.sum(side.v * matrices_times(side.R, self.forward), axis=1) for side in (row, next_row))
        bend = 0.5 * tau[:, 0] * (1.0 - f[:, 0]) * (fast - slow)
        distance = self.distance[i] + f[:, 0] * (self.distance[i + 1] - self.distance[i]) - bend
        keyframe = self.keyframe[i]
        # The row after an interval's last one belongs to the next keyframe, at fraction 0.
        end = np.where(self.keyframe[i + 1] > keyframe, 1.0, self.fraction[i + 1])
        fraction = self.fraction[i] + f[:, 0] * (end - self.fraction[i])
        return DenseMotion(t, nav, distance, self.gyro[i], self.gyro_span[i], keyframe, fraction, self.forward)


def dense_step(states: States, step_m: float) -> float:
    """Return a step (s) that gives a row per step of the geometry's grid at the highest speed."""
    fastest = float(np.linalg.norm(states.nav.v, axis=1).max())
    return min(_LONGEST_STEP_S, 0.8 * step_m / max(fastest, 1e-3))


def dense_motion(run: RunContext, states: States, step_s: float, times: Array | None = None) -> DenseMotion:
    """Return rows about every ``step_s`` s (not finer than the IMU's samples), around each of ``times``, at the end."""
    starts, first = increment_starts(run.inertial, run.edges, step_s, times)
    last, rows = len(run.t) - 1, len(starts)
    motion = DenseMotion(
        t=np.empty(rows),
        nav=Nav(np.empty((rows, 3, 3)), np.empty((rows, 3)), np.empty((rows, 3))),
        distance=np.empty(rows),
        gyro=np.empty((rows, 3)),
        gyro_span=np.empty(rows),
        keyframe=np.append(np.arange(last).repeat(np.diff(first)), last - 1),
        fraction=np.empty(rows),
        forward=mount_matrix(states.mount)[0, :, 0],
    )
    columns = _columns(motion)
    write = _write_by_kernel if compiled_kernels() else _write_by_arrays
    write(run, states, starts, first, [column[:-1] for column in columns])
    nav, distance = states.nav, states.odo.distance
    of_motion = (run.t[last], nav.R[last], nav.p[last], nav.v[last], distance[last])
    of_last = (*of_motion, motion.gyro[-2], motion.gyro_span[-2], 1.0)
    for column, value in zip(columns, of_last, strict=True):
        column[-1] = value
    return motion


def _columns(motion: DenseMotion) -> tuple[Array, ...]:
    """Return what is computed of the rows, in the order of the kernel in ``kernels/dense.cpp``."""
    nav = motion.nav
    return motion.t, nav.R, nav.p, nav.v, motion.distance, motion.gyro, motion.gyro_span, motion.fraction


def _write_by_arrays(
    run: RunContext, states: States, starts: np.ndarray, first: np.ndarray, out: Sequence[Array]
) -> None:
    """Write the :func:`_columns` of the rows between all keyframes."""
    gyro_bias, n = states.bias[:, 3:].mean(axis=0), len(run.t) - 1
    for k in range(0, n, _CHUNK):
        intervals = slice(k, min(k + _CHUNK, n))
        part = _between(run, states, intervals, starts, first, gyro_bias)
        for column, written in zip(out, _columns(part), strict=True):
            column[first[intervals.start] : first[intervals.stop]] = written


def _write_by_kernel(
    run: RunContext, states: States, starts: np.ndarray, first: np.ndarray, out: Sequence[Array]
) -> None:
    """Do as :func:`_write_by_arrays`, in ``kernels/dense.cpp``."""
    from trackfg.numerics import compiled

    data = run.inertial.take(slice(int(starts[0]), int(starts[-1])))  # what is not laid out by rows is copied
    edges, gyro, accel = map(kernel_argument, (data.edges, data.gyro, data.accel))
    nav, forward, gyro_bias = states.nav, mount_matrix(states.mount)[0, :, 0], states.bias[:, 3:].mean(axis=0)
    keyframes = (run.t, nav.R, nav.p, nav.v, states.odo.distance, states.bias)
    compiled.dense_motion(
        edges,
        gyro,
        accel,
        (starts - starts[0]).astype(np.int64, copy=False),
        first.astype(np.int64, copy=False),
        np.concatenate([[run.world.gravity, EARTH_RADIUS], run.world.earth_rate, gyro_bias, forward]),
        tuple(map(kernel_argument, keyframes)),
        tuple(out),
    )


@dataclass(frozen=True)
class _Rows:
    """Rows of some intervals between keyframes: that of ``interval`` (m,) at share ``f`` (m,) of its ``span`` (k,), s.

    ``starts`` (k + 1,) are the first rows of the intervals, ``dt`` (m, 1) and ``since`` (m, 1) a row's length and its
    time since the keyframe, s.
    """

    starts: np.ndarray
    interval: np.ndarray
    f: Array
    dt: Array
    since: Array
    span: Array


def _between(
    run: RunContext, states: States, intervals: slice, starts: np.ndarray, first: np.ndarray, gyro_bias: Array
) -> DenseMotion:
    """Return the rows of some of the intervals between keyframes."""
    begin = first[intervals.start]
    starts = starts[begin : first[intervals.stop] + 1]
    ends = slice(intervals.start + 1, intervals.stop + 1)
    start, end, bias = states.nav[intervals], states.nav[ends], states.bias[intervals]
    increments = compress(run.inertial, starts, gyro_bias)
    t, span = run.inertial.edges[starts[:-1]], np.diff(run.t[intervals.start : intervals.stop + 1])
    first_rows = first[intervals.start : intervals.stop + 1] - begin
    i = np.repeat(np.arange(len(start)), np.diff(first_rows))
    since = t - run.t[intervals][i]
    rows = _Rows(first_rows, i, since / span[i], increments.duration[:, None], since[:, None], span)

    # The level frame turns as well, in n.
    turning = run.world.earth_rate + transport_rate(0.5 * (start.v + end.v))
    bias_accel, bias_gyro = np.split(bias.take(i, axis=0), 2, axis=1)
    rate = increments.rotation / rows.dt - bias_gyro
    R = _attitude(rows, start, end, rate, turning)
    push = np.einsum("mij,mj->mi", R, increments.velocity - bias_accel * rows.dt)
    gravity = np.array([0.0, 0.0, -run.world.gravity])
    fall = [gravity - cross(run.world.earth_rate + turning, side.v) for side in (start, end)]
    distance = states.odo.distance[intervals.start : intervals.stop + 1]
    forward = mount_matrix(states.mount)[0, :, 0]
    ahead = matrices_times(R, forward), matrices_times(end.R, forward)
    p, v, along = _path(rows, start, end, ahead, push, fall, distance)
    return DenseMotion(t, Nav(R, p, v), along, rate, increments.duration, i + intervals.start, rows.f, forward)


def _attitude(rows: _Rows, start: Nav, end: Nav, rate: Array, turning: Array) -> Array:
    """Integrate body rates (m, 3) to attitudes (m, 3, 3) that close at both keyframes.

    ``R(t) = Exp(-turning t) R_start Delta(t) Exp(f e)``, e what is left at the end, in proportion to time.
    """
    i, span = rows.interval, rows.span[:, None]
    turned, whole = running_turn(rows.starts, rate * rows.dt)
    first = quaternion(start.R).T
    arrived = quaternion_product(quaternion_product(quaternion_exp(-(turning * span).T), first), whole)
    closure = quaternion_log(quaternion_product(arrived * _CONJUGATE, quaternion(end.R).T))
    frame = quaternion_exp(-turning.T.take(i, axis=1) * rows.since[:, 0])
    attitude = quaternion_product(quaternion_product(frame, first.take(i, axis=1)), turned)
    return matrix_from_quaternion(quaternion_product(attitude, quaternion_exp(closure.take(i, axis=1) * rows.f)))


def _path(
    rows: _Rows, start: Nav, end: Nav, ahead: tuple[Array, Array], push: Array, fall: list[Array], distance: Array
) -> tuple[Array, Array, Array]:
    """Integrate velocity increments ``push`` (m, 3) and ``fall`` (m/s^2 at both ends) to position, velocity, distance.

    All close at both keyframes, by the cubic with the required end values and slopes; ``distance`` (k + 1,) is that of
    the keyframes, ``ahead`` the directions of travel (m, 3) of the rows and (k, 3) of the intervals' ends.
    """
    i, f, span = rows.interval, rows.f, rows.span
    middle = f[:, None] + 0.5 * rows.dt / span[i, None]
    gained = push + (fall[0].take(i, axis=0) + (fall[1] - fall[0]).take(i, axis=0) * middle) * rows.dt
    faster, v_end = _running_sum(gained, rows.starts)
    v = start.v.take(i, axis=0) + faster
    step = (v + 0.5 * gained) * rows.dt
    moved, p_end = _running_sum(step, rows.starts)
    travelled, d_end = _running_sum(np.einsum("mi,mi->m", step, ahead[0]), rows.starts)

    left_p, left_v = end.p - start.p - p_end, end.v - start.v - v_end
    left_speed, left_d = np.sum(left_v * ahead[1], axis=1), np.diff(distance) - d_end
    _, w, _, u = hermite_weights(f, span[i])
    _, w_rate, _, u_rate = hermite_rates(f, span[i])
    along = distance[i] + travelled + left_d[i] * w + left_speed[i] * u
    p, left_p, left_v = (each.take(i, axis=0) for each in (start.p, left_p, left_v))
    return (
        p + moved + left_p * w[:, None] + left_v * u[:, None],
        v + left_p * w_rate[:, None] + left_v * u_rate[:, None],
        along,
    )


def _running_sum(values: Array, starts: np.ndarray) -> tuple[Array, Array]:
    """Return the sum before each row within its group (m, ...), and of whole groups (n, ...). ``starts`` (n + 1,)."""
    total = np.concatenate([np.zeros_like(values[:1]), np.cumsum(values, axis=0)])
    offset = np.repeat(total[starts[:-1]], np.diff(starts), axis=0)
    return np.subtract(total[:-1], offset, out=offset), np.diff(total[starts], axis=0)

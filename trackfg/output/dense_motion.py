"""The smoothed motion between keyframes.

From each keyframe the inertial increments are integrated with the smoothed bias to the next one; what is left over
there is spread over the interval: the rotation in proportion to time, position, velocity and distance by the cubic that
has the required end values and slopes. The result passes through every keyframe's smoothed state and has the inertial
sensor's detail in between.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from trackfg.factors.states import Nav, States
from trackfg.graph.run_context import RunContext
from trackfg.numerics.arrays import Array
from trackfg.numerics.geodesy import transport_rate
from trackfg.numerics.hermite import hermite_rates, hermite_weights
from trackfg.numerics.rotations import (
    cross,
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
_CHUNK = 400
"""Intervals at a time: what is needed on the way stays small."""

_CONJUGATE = np.array([[1.0], [-1.0], [-1.0], [-1.0]])


@dataclass(frozen=True)
class DenseMotion:
    """``t`` (m,) s, ``nav`` of the IMU, distance along the track ``distance`` (m,) m, body rate ``gyro`` (m, 3) rad/s,
    a mean of the samples over ``gyro_span`` (m,) s.

    ``keyframe`` (m,) and ``fraction`` (m,) say where between which keyframes each row lies.
    """

    t: Array
    nav: Nav
    distance: Array
    gyro: Array
    gyro_span: Array
    keyframe: np.ndarray
    fraction: Array

    def at(self, t: Array) -> DenseMotion:
        """The motion at times ``t`` (k,) within the run: constant acceleration and rate between rows."""
        i = np.clip(np.searchsorted(self.t, t, side="right") - 1, 0, len(self.t) - 2)
        width = (self.t[i + 1] - self.t[i])[:, None]
        tau = t[:, None] - self.t[i][:, None]
        f = tau / width
        here, there = self.nav[i], self.nav[i + 1]
        turn = so3_log(np.swapaxes(here.R, 1, 2) @ there.R)
        nav = Nav(
            here.R @ so3_exp(f * turn),
            here.p + f * (there.p - here.p) - 0.5 * tau * (width - tau) / width * (there.v - here.v),
            here.v + f * (there.v - here.v),
        )
        slow, fast = (np.sum(side.v * side.R[:, :, 0], axis=1) for side in (here, there))
        bend = 0.5 * tau[:, 0] * (1.0 - f[:, 0]) * (fast - slow)
        distance = self.distance[i] + f[:, 0] * (self.distance[i + 1] - self.distance[i]) - bend
        keyframe = self.keyframe[i]
        # The row after an interval's last one belongs to the next keyframe, at fraction 0.
        end = np.where(self.keyframe[i + 1] > keyframe, 1.0, self.fraction[i + 1])
        fraction = self.fraction[i] + f[:, 0] * (end - self.fraction[i])
        return DenseMotion(t, nav, distance, self.gyro[i], self.gyro_span[i], keyframe, fraction)


def dense_step(states: States, step_m: float) -> float:
    """Fine enough for a row per step of the geometry's grid at the highest speed, s."""
    fastest = float(np.linalg.norm(states.nav.v, axis=1).max())
    return min(_LONGEST_STEP_S, 0.8 * step_m / max(fastest, 1e-3))


def dense_motion(run: RunContext, states: States, step_s: float, times: Array | None = None) -> DenseMotion:
    """States about every ``step_s`` s (not finer than the IMU's samples), around each of ``times``, at the end."""
    starts, first = increment_starts(run.inertial, run.edges, step_s, times)
    bias = states.bias[:, 3:].mean(axis=0)
    n = len(run.t) - 1
    parts = [_between(run, states, slice(k, min(k + _CHUNK, n)), starts, first, bias) for k in range(0, n, _CHUNK)]
    t, nav, distance = run.t[n:], states.nav[n:], states.odo.distance[n:]
    last = parts[-1].gyro[-1:], parts[-1].gyro_span[-1:]
    parts.append(DenseMotion(t, nav, distance, *last, np.array([n - 1]), np.ones(1)))
    return _joined(parts)


def _joined(parts: list[DenseMotion]) -> DenseMotion:
    def all_of(column: Callable[[DenseMotion], np.ndarray]) -> np.ndarray:
        return np.concatenate([column(part) for part in parts])

    return DenseMotion(
        all_of(lambda part: part.t),
        Nav(all_of(lambda part: part.nav.R), all_of(lambda part: part.nav.p), all_of(lambda part: part.nav.v)),
        all_of(lambda part: part.distance),
        all_of(lambda part: part.gyro),
        all_of(lambda part: part.gyro_span),
        all_of(lambda part: part.keyframe),
        all_of(lambda part: part.fraction),
    )


def _between(
    run: RunContext, states: States, intervals: slice, starts: np.ndarray, first: np.ndarray, gyro_bias: Array
) -> DenseMotion:
    """The rows of some of the intervals between keyframes."""
    begin = first[intervals.start]
    starts = starts[begin : first[intervals.stop] + 1]
    own = first[intervals.start : intervals.stop + 1] - begin
    ends = slice(intervals.start + 1, intervals.stop + 1)
    here, there, bias = states.nav[intervals], states.nav[ends], states.bias[intervals]
    i = np.repeat(np.arange(len(here)), np.diff(own))
    increments = compress(run.inertial, starts, gyro_bias)
    dt, span = increments.duration[:, None], np.diff(run.t[intervals.start : intervals.stop + 1])
    t = run.inertial.edges[starts[:-1]]
    since = t - run.t[intervals][i]
    f = since / span[i]

    # The level frame turns as well, in n: Exp(-turning t) R Delta, and what is left at the end in proportion to time.
    turning = run.world.earth_rate + transport_rate(0.5 * (here.v + there.v))
    rate = increments.rotation / dt - bias[i, 3:]
    turned, whole = running_turn(own, rate * dt)
    start = quaternion(here.R).T
    arrived = quaternion_product(quaternion_product(quaternion_exp(-(turning * span[:, None]).T), start), whole)
    left = quaternion_log(quaternion_product(arrived * _CONJUGATE, quaternion(there.R).T))
    attitude = quaternion_product(quaternion_product(quaternion_exp(-turning.T[:, i] * since), start[:, i]), turned)
    R = matrix_from_quaternion(quaternion_product(attitude, quaternion_exp(left[:, i] * f)))

    gravity = np.array([0.0, 0.0, -run.world.gravity])
    fall, falls = (gravity - cross(run.world.earth_rate + turning, side.v) for side in (here, there))
    middle = f[:, None] + 0.5 * dt / span[i, None]
    pushed = np.einsum("mij,mj->mi", R, increments.velocity - bias[i, :3] * dt)
    gained = pushed + (fall[i] + (falls - fall)[i] * middle) * dt
    faster, v_end = _running_sum(gained, own)
    v = here.v[i] + faster
    step = (v + 0.5 * gained) * dt
    moved, p_end = _running_sum(step, own)
    gone, d_end = _running_sum(np.einsum("mi,mi->m", step, R[:, :, 0]), own)

    left_p, left_v = there.p - here.p - p_end, there.v - here.v - v_end
    left_speed, left_d = np.sum(left_v * there.R[:, :, 0], axis=1), np.diff(states.odo.distance)[intervals] - d_end
    _, w, _, u = hermite_weights(f, span[i])
    _, w_rate, _, u_rate = hermite_rates(f, span[i])
    return DenseMotion(
        t,
        Nav(
            R,
            here.p[i] + moved + left_p[i] * w[:, None] + left_v[i] * u[:, None],
            v + left_p[i] * w_rate[:, None] + left_v[i] * u_rate[:, None],
        ),
        states.odo.distance[intervals][i] + gone + left_d[i] * w + left_speed[i] * u,
        rate,
        increments.duration,
        i + intervals.start,
        f,
    )


def _running_sum(values: Array, starts: np.ndarray) -> tuple[Array, Array]:
    """Sums of what comes before each row in its group (m, ...), and of whole groups (n, ...). ``starts`` (n + 1,)."""
    total = np.concatenate([np.zeros_like(values[:1]), np.cumsum(values, axis=0)])
    return total[:-1] - np.repeat(total[starts[:-1]], np.diff(starts), axis=0), np.diff(total[starts], axis=0)

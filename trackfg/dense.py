"""The smoothed motion between keyframes.

From each keyframe the inertial increments are integrated with the smoothed bias to the next one; what is left over
there is spread over the interval: the rotation in proportion to time, position, velocity and distance by the cubic that
has the required end values and slopes. The result passes through every keyframe's smoothed state and has the inertial
sensor's detail in between.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trackfg.factors.states import Nav, States
from trackfg.frames import Array, so3_exp, so3_log, transport_rate
from trackfg.graph import Problem
from trackfg.inertial import compress, increment_starts


@dataclass(frozen=True)
class DenseMotion:
    """``t`` (m,) s, ``nav`` of the IMU, distance along the track ``distance`` (m,) m, body rate ``gyro`` (m, 3) rad/s.

    ``keyframe`` (m,) and ``fraction`` (m,) say where between which keyframes each row lies.
    """

    t: Array
    nav: Nav
    distance: Array
    gyro: Array
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
        return DenseMotion(t, nav, distance, self.gyro[i], keyframe, fraction)


def dense_motion(problem: Problem, states: States, step_s: float, times: Array | None = None) -> DenseMotion:
    """States about every ``step_s`` s (not finer than the IMU's samples), around each of ``times``, at the end."""
    starts, first = increment_starts(problem.inertial, problem.edges, step_s, times)
    increments = compress(problem.inertial, starts, states.bias[:, 3:].mean(axis=0))
    n, m = len(problem.t) - 1, len(increments.duration)
    counts = np.diff(first)
    earth = problem.world.earth_rate
    turning = earth + transport_rate(0.5 * (states.nav.v[1:] + states.nav.v[:-1]))
    gravity = np.array([0.0, 0.0, -problem.world.gravity])

    R, p, v, d = np.empty((m, 3, 3)), np.empty((m, 3)), np.empty((m, 3)), np.empty(m)
    body_R, body_p, body_v = states.nav.R[:-1].copy(), states.nav.p[:-1].copy(), states.nav.v[:-1].copy()
    body_d = np.zeros(n)
    keyframe = np.repeat(np.arange(n), counts)
    dt = increments.duration[:, None]
    turned = so3_exp(increments.rotation - states.bias[keyframe, 3:] * dt)
    levelled = so3_exp(-turning[keyframe] * dt)
    pushed = increments.velocity - states.bias[keyframe, :3] * dt
    for i in range(int(counts.max())):
        live = np.flatnonzero(counts > i)
        row = first[live] + i
        R[row], p[row], v[row], d[row] = body_R[live], body_p[live], body_v[live], body_d[live]
        push = np.einsum("mij,mj->mi", body_R[live], pushed[row])
        faster = body_v[live] + push + (gravity - np.cross(earth + turning[live], body_v[live])) * dt[row]
        step = 0.5 * (body_v[live] + faster) * dt[row]
        body_d[live] += np.sum(step * body_R[live][:, :, 0], axis=1)
        body_p[live] += step
        body_v[live] = faster
        body_R[live] = levelled[row] @ body_R[live] @ turned[row]

    t = problem.inertial.edges[starts[:-1]]
    span = np.diff(problem.t)[keyframe]
    f = (t - problem.t[keyframe]) / span
    left_R = so3_log(np.swapaxes(body_R, 1, 2) @ states.nav.R[1:])[keyframe]
    left_p, left_v = (states.nav.p[1:] - body_p)[keyframe], (states.nav.v[1:] - body_v)[keyframe]
    F = f[:, None]
    R = R @ so3_exp(left_R * F)
    p += left_p * (3 * F**2 - 2 * F**3) + left_v * span[:, None] * (F**3 - F**2)
    v += left_p * (6 * F - 6 * F**2) / span[:, None] + left_v * (3 * F**2 - 2 * F)
    left_d = (np.diff(states.odo[:, 0]) - body_d)[keyframe]
    left_speed = np.sum((states.nav.v[1:] - body_v) * states.nav.R[1:, :, 0], axis=1)[keyframe]
    distance = states.odo[keyframe, 0] + d + left_d * (3 * f**2 - 2 * f**3) + left_speed * span * (f**3 - f**2)
    rate = increments.rotation / dt - states.bias[keyframe, 3:]

    last = states.nav[len(states) - 1 :]
    return DenseMotion(
        np.append(t, problem.t[-1]),
        Nav(np.concatenate([R, last.R]), np.concatenate([p, last.p]), np.concatenate([v, last.v])),
        np.append(distance, states.odo[-1, 0]),
        np.concatenate([rate, rate[-1:]]),
        np.append(keyframe, n - 1),
        np.append(f, 1.0),
    )

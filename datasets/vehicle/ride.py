"""A vehicle's ride along a line: its pose and its motion as exact functions of time.

The designed line at ``s(t)`` has a heading ``psi``, and ``h = (cos psi, sin psi, 0)`` is forward, ``l`` horizontally
left of it and ``u`` up. The body's reference point is at ``p = P(s) + y l + z u``, and its roll, pitch and yaw are the
designed ones plus three deviations (:mod:`trackfg.datasets.vehicle.body_motion`; a perfect follower of the line has
none). With ``v = ds/dt``, ``a = dv/dt``, ``gamma`` the line's angle of gradient, ``psi' = kappa v`` and a prime for
d/dt, the velocity and the acceleration have along h, l and u the components

    V = (v cos gamma - y psi', y', v sin gamma + z'),
    A = (V_h' - V_l psi', V_l' + V_h psi', V_u'),
    V_h' = a cos gamma - v sin gamma gamma' - y' psi' - y psi'',  psi'' = dkappa/ds v^2 + kappa a,
    V_l' = y'',  V_u' = a sin gamma + v cos gamma gamma' + z'',

and with ``phi, theta, psi`` now roll, pitch and yaw of the body

    omega = ( phi' - psi' sin theta,
              theta' cos phi + psi' cos theta sin phi,
              -theta' sin phi + psi' cos theta cos phi ).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np

from trackfg.datasets.line.line import Line
from trackfg.datasets.vehicle.body_motion import BodyMotion
from trackfg.datasets.vehicle.motion import DrivenMotion
from trackfg.numerics import rotations
from trackfg.numerics.arrays import Array
from trackfg.numerics.key_figures import Outlined

_SMOOTH_1PM = 1e-12
"""Curvature that jumps by less is continuous but for rounding."""


@dataclass(frozen=True)
class Kinematics:
    """The motion at times (n,): designed heading (n,), attitude and its rates, V and A along h, l and u (n, 3)."""

    heading: Array
    rpy: Array
    rpy_rates: Array
    velocity: Array
    acceleration: Array

    @cached_property
    def body_from_level(self) -> Array:
        """Return the rotation that maps components along h, l and u to body axes. Shape (n, 3, 3)."""
        roll, pitch, yaw = self.rpy.T
        return np.swapaxes(rotations.matrix_from_rpy(roll, pitch, yaw - self.heading), -1, -2)

    @cached_property
    def velocity_in_n(self) -> Array:
        """Return velocity in n, m/s. Shape (n, 3)."""
        return _to_n(self.heading, self.velocity)

    @cached_property
    def acceleration_in_n(self) -> Array:
        """Return acceleration in n, m/s^2. Shape (n, 3)."""
        return _to_n(self.heading, self.acceleration)

    @cached_property
    def body_rate(self) -> Array:
        """Return angular rate relative to n, in body axes, rad/s. Shape (n, 3)."""
        return _body_rate(self.rpy, self.rpy_rates)


@dataclass(frozen=True, repr=False)
class Ride(Outlined):
    """``motion`` along ``line``, the body deviating from it by ``body``. Times may have any shape (...).

    Chainage is ``chainage_origin_m + direction s``. The origin of ENU is where the vehicle is at t = 0.
    """

    line: Line
    motion: DrivenMotion
    chainage_origin_m: float = 0.0
    direction: Literal[1, -1] = 1
    body: BodyMotion | None = None

    def rpy(self, t: Array) -> Array:
        """Return roll, pitch, yaw of the body, rad. Shape (..., 3)."""
        designed = self.line.rpy(self.motion.distance(t))
        return designed if self.body is None else designed + self.body.at(t)[..., 2:]

    def rotation(self, t: Array) -> Array:
        """Return ``R_nb``. Shape (..., 3, 3)."""
        return rotations.matrix_from_rpy(*np.moveaxis(self.rpy(t), -1, 0))

    def body_rate(self, t: Array) -> Array:
        """Return angular rate relative to the navigation frame, in body axes, rad/s. Shape (..., 3)."""
        return _body_rate(self.rpy(t), self._rpy_rates(t))

    def position(self, t: Array) -> Array:
        """Return east, north, up of the reference point, m. Shape (..., 3)."""
        return self._place(t) - self.origin

    def velocity(self, t: Array) -> Array:
        """Return velocity of the reference point in n, m/s. Shape (..., 3)."""
        return self.kinematics(np.ravel(t)).velocity_in_n.reshape(*np.shape(t), 3)

    def acceleration(self, t: Array) -> Array:
        """Return acceleration of the reference point in n, m/s^2. Shape (..., 3)."""
        return self.kinematics(np.ravel(t)).acceleration_in_n.reshape(*np.shape(t), 3)

    def speed_along_body(self, t: Array) -> Array:
        """Return the velocity's component along the body's x axis, m/s, negative backwards. Shape (...)."""
        moment = self.kinematics(np.ravel(t))
        return np.asarray(np.einsum("ni,ni->n", moment.body_from_level[:, 0], moment.velocity).reshape(np.shape(t)))

    def chainage(self, s: Array) -> Array:
        """Return chainage of the place ``s``, m."""
        return self.chainage_origin_m + self.direction * s

    @cached_property
    def origin(self) -> Array:
        """Return where ENU has its origin, in the line's own coordinates, m. Shape (3,)."""
        return self._place(np.zeros(()))

    def kinks_s(self) -> Array:
        """Return every time at which a derivative of the pose jumps: motion, line, knots of the body's splines.
        Sorted.
        """
        passages, _ = self.motion.times_at(self.line.knots)
        body_knots = [] if self.body is None else [self.body.knots_s]
        return np.unique(np.concatenate([self.motion.breaks_s, passages, *body_knots]))

    def velocity_jumps(self) -> tuple[Array, Array]:
        """Return times (j,) at which the velocity jumps, and by how much along h, m/s (j,).

        Where the line's curvature jumps, so do the turning of its axes and the velocity of what is beside it.
        """
        curvature = self.line.curvature
        inner, steps = curvature.x[1:-1], np.diff(curvature.x)[:-1]
        left_limit = np.zeros(len(inner))
        for coefficients in curvature.c[:, :-1]:
            left_limit = left_limit * steps + coefficients
        jump = curvature(inner) - left_limit
        sudden = np.abs(jump) > _SMOOTH_1PM
        times, which = self.motion.times_at(inner[sudden])
        left = np.zeros(len(times)) if self.body is None else self.body.at(times)[:, 0]
        return times, -left * np.abs(self.motion.speed(times)) * jump[sudden][which]

    def kinematics(self, t: Array) -> Kinematics:
        """Return everything at once at times (n,); at a kink, what follows it."""
        s, v, a = (function(t) for function in (self.motion.distance, self.motion.speed, self.motion.acceleration))
        rpy, slopes = self.line.rpy(s), self.line.rpy_slopes(s)
        gamma, curvature, rates = -rpy[:, 1], slopes[:, 2], slopes * v[:, None]
        heading, turn, climb = rpy[:, 2], rates[:, 2], -rates[:, 1]
        along, up = np.cos(gamma), np.sin(gamma)
        forward, rise = v * along, v * up
        change = np.column_stack([a * along - rise * climb, np.zeros_like(v), a * up + forward * climb])
        velocity = np.column_stack([forward, np.zeros_like(v), rise])
        if self.body is not None:
            off, off_rate, off_change = (self.body.at(t, nu) for nu in range(3))
            rpy, rates = rpy + off[:, 2:], rates + off_rate[:, 2:]
            turn_change = self.line.curvature(s, 1) * v * v + curvature * a
            velocity[:, 0] -= off[:, 0] * turn
            velocity[:, 1:] += off_rate[:, :2]
            change[:, 0] -= off_rate[:, 0] * turn + off[:, 0] * turn_change
            change[:, 1:] += off_change[:, :2]
        change[:, 0] -= velocity[:, 1] * turn
        change[:, 1] += velocity[:, 0] * turn
        return Kinematics(heading, rpy, rates, velocity, change)

    def _place(self, t: Array) -> Array:
        s = self.motion.distance(t)
        designed = self.line.position(s)
        if self.body is None:
            return designed
        heading = self.line.yaw(s)
        left, up = np.moveaxis(self.body.at(t)[..., :2], -1, 0)
        return np.asarray(designed + np.stack([-left * np.sin(heading), left * np.cos(heading), up], axis=-1))

    def _rpy_rates(self, t: Array) -> Array:
        designed = self.line.rpy_slopes(self.motion.distance(t)) * np.asarray(self.motion.speed(t))[..., None]
        return np.asarray(designed if self.body is None else designed + self.body.at(t, 1)[..., 2:])


def _body_rate(rpy: Array, rates: Array) -> Array:
    roll, pitch, _ = np.moveaxis(rpy, -1, 0)
    d_roll, d_pitch, d_yaw = np.moveaxis(rates, -1, 0)
    return np.stack(
        [
            d_roll - d_yaw * np.sin(pitch),
            d_pitch * np.cos(roll) + d_yaw * np.cos(pitch) * np.sin(roll),
            -d_pitch * np.sin(roll) + d_yaw * np.cos(pitch) * np.cos(roll),
        ],
        axis=-1,
    )


def _to_n(heading: Array, vector: Array) -> Array:
    """Turn components along h, l and u to n. Shapes (n,), (n, 3) to (n, 3)."""
    c, s = np.cos(heading), np.sin(heading)
    forward, left, up = vector.T
    return np.column_stack([c * forward - s * left, s * forward + c * left, up])

"""Vehicles: each turns a track and a motion into the motion of the body that carries the sensors.

Its result is a deviation from the designed line at ``s(t)`` (:mod:`trackfg.datasets.vehicle.body_motion`), ``s`` being
the arc length below the reference point, which is on the body's middle plane at the height of the rails; x is forward.

A body on springs is where it would be without springs, its chords exact in space, plus what the linear systems of
:mod:`trackfg.datasets.vehicle.suspension` add to the same chords. They are set up in the level frame under the middle
of the car, which moves along the designed line, so that besides the wheelsets there act, with ``v``, ``kappa``,
``gamma`` and ``psi`` of the designed line there and ``phi`` the track's mean roll under a body or frame of mass ``m``
at ``x``,

    lateral  -m (kappa v^2 + x psi'' + g phi),   yaw  -I psi'',   vertical  -m d(v sin gamma)/dt,

and the moment that leans the body by the cant deficiency ``kappa v^2 / g + phi``.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from trackfg.datasets.line.line import Line
from trackfg.datasets.line.track import SimulatedTrack
from trackfg.datasets.vehicle.body_motion import BodyMotion, through
from trackfg.datasets.vehicle.motion import DrivenMotion
from trackfg.datasets.vehicle.suspension import Suspension
from trackfg.datasets.vehicle.wheelsets import Wheelsets, chord
from trackfg.numerics import units
from trackfg.numerics.arrays import Array

_MEAN = np.array([[0.25, 0.25, 0.25, 0.25], [0.5, 0.5, 0.0, 0.0], [0.0, 0.0, 0.5, 0.5]])
"""From the four wheelsets' places to those of the body, the front and the rear frame of a car without springs."""

_RISE = np.array([0.5, 0.5, -0.5, -0.5])
"""From the four wheelsets' places to the slope of the body, times the distance of the pivots."""


class Vehicle(Protocol):
    """Anything that carries an IMU. ``rigid``: the IMU is fixed to what follows the track, not on springs."""

    @property
    def rigid(self) -> bool:
        """Return whether there are no springs between the track and the body."""

    def body_motion(self, track: SimulatedTrack, motion: DrivenMotion, edges: Array) -> BodyMotion:
        """Return the body's motion while the IMU samples: ``edges`` (n + 1,) are those of its intervals, s."""


@dataclass(frozen=True)
class Rigid:
    """A frame on two wheelsets ``wheelbase_m`` apart, without springs: a trolley; 0 is a wheelset or an axle box."""

    wheelbase_m: float = 0.0

    @property
    def rigid(self) -> bool:
        """Return True: there are no springs."""
        return True

    def body_motion(self, track: SimulatedTrack, motion: DrivenMotion, edges: Array) -> BodyMotion:
        """The frame sits on its wheelsets: at their mean, along their chord, with the mean of their rolls."""
        s, half_m = motion.distance(edges), 0.5 * self.wheelbase_m
        wheelsets = Wheelsets(track, s, self.wheelbase_m)
        pose = chord(wheelsets.at(half_m), wheelsets.at(-half_m)) if half_m else wheelsets.tangent()
        return through(edges, _deviation(track.line, s, pose))


@dataclass(frozen=True)
class CarBody:
    """The body of a coach, its reference point midway between the pivots. ``edges`` are to be evenly spaced."""

    suspension: Suspension = field(default_factory=Suspension)

    @property
    def rigid(self) -> bool:
        """Return False: it is on two stages of springs."""
        return False

    def body_motion(self, track: SimulatedTrack, motion: DrivenMotion, edges: Array) -> BodyMotion:
        """Return the chord of the bogies' middles, and the springs' part."""
        s = motion.distance(edges)
        wheelsets = Wheelsets(track, s, self.suspension.axles_m[0])
        axles = [wheelsets.at(offset) for offset in self.suspension.axles_m]
        pose = chord(chord(*axles[:2]), chord(*axles[2:]))
        sprung = _springs(track.line, motion, edges, s, axles, self.suspension)
        return through(edges, _deviation(track.line, s, pose) + sprung)


def _deviation(line: Line, s: Array, pose: Array) -> Array:
    """Return the columns of a body's motion from its pose in the level frame (n, 6). Shape (n, 5)."""
    deviation = pose[:, 1:].copy()
    deviation[:, 2:4] -= line.rpy(s)[:, :2]
    return deviation


def _springs(
    line: Line, motion: DrivenMotion, edges: Array, s: Array, axles: list[Array], suspension: Suspension
) -> Array:
    """Return what the springs add to the body's chord, columns of a body's motion. Shape (n, 5).

    ``s`` is below the middle of the car, ``axles`` are the four wheelsets in the level frame there, each (n, 4).
    """
    dt = float(edges[-1] - edges[0]) / (len(edges) - 1)
    if np.abs(np.diff(edges) - dt).max() > 1e-6 * dt:
        raise ValueError("a vehicle on springs needs edges evenly spaced in time")
    left, up, roll = (np.column_stack([axle[:, column] for axle in axles]) for column in (1, 2, 3))
    v, a = motion.speed(edges), motion.acceleration(edges)
    curvature, gamma = line.curvature(s), line.grade(s)
    turn = np.asarray(curvature * v * v)
    yawing = line.curvature(s, 1) * v * v + curvature * a
    climbing = a * np.sin(gamma) + v * v * np.cos(gamma) * line.grade(s, 1)
    g, mean_roll = units.STANDARD_GRAVITY, roll @ _MEAN.T

    mass = suspension.lateral.mass
    arm = suspension.half_pivot_m * np.array([0.0, 0.0, 1.0, 0.0, -1.0, 0.0])
    moved, turned = np.array([1, 0, 1, 0, 1, 0]), np.array([0, 1, 0, 1, 0, 1])
    tilted = np.zeros((6, 3))
    tilted[[0, 2, 4], range(3)] = g
    lateral_force = -mass[:, None] * np.column_stack([moved, turned + arm, tilted])
    lateral_signals = np.column_stack([turn, yawing, mean_roll])
    lean = np.array([[suspension.lean_moment], [0.0], [0.0]])
    vertical_force = -suspension.vertical.mass[:, None] * moved[:, None]

    lateral = suspension.lateral.response(left, lateral_signals, lateral_force, dt, [0, 1])
    vertical = suspension.vertical.response(up, climbing[:, None], vertical_force, dt, [0, 1])
    rolled = suspension.roll.response(roll, (turn / g + mean_roll[:, 0])[:, None], lean, dt, [0])
    chords = np.stack([_MEAN[0], _RISE / (2.0 * suspension.half_pivot_m)])
    lateral -= left @ chords.T
    vertical -= up @ chords.T
    return np.column_stack(
        [lateral[:, 0], vertical[:, 0], rolled[:, 0] - mean_roll[:, 0], -vertical[:, 1], lateral[:, 1]]
    )

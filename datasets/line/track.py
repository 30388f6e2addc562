"""The track as it lies: the designed line with its irregularities.

With the designed point ``p(s)``, heading ``psi``, curvature ``kappa`` and gradient angle ``gamma``, the centre line is

    c = p + level e_up + alignment e_left,   e_left = (-sin psi, cos psi, 0),

and its derivative by ``s``, in axes turned to the designed heading (forward, left, up),

    t = (cos gamma - alignment kappa, alignment', sin gamma + level').

The x axis of the track's attitude lies along ``t``:

    roll = asin((cant + cross_level) / base),  pitch = -atan2(t_up, sqrt(t_forward^2 + t_left^2)),
    yaw = psi + delta,  delta = atan2(t_left, t_forward).

Both rails are on the axle, the y axis of ``Rz(yaw) Ry(pitch) Rx(roll)`` through the centre line: their tops at half the
cross-level base, their running edges at half the gauge as it is there.

``s`` stays the arc length along the *designed* line; the path is longer by the factor ``|t|``, some 1e-6.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np

from trackfg.datasets.line.irregularities import Irregularities
from trackfg.datasets.line.line import Line
from trackfg.numerics.arrays import Array
from trackfg.numerics.key_figures import Outlined

Side = Literal["left", "right"]
_SIGN: dict[Side, float] = {"left": 1.0, "right": -1.0}
"""Side of the rail: left positive."""


@dataclass(frozen=True, repr=False)
class SimulatedTrack(Outlined):
    """``line`` with its ``irregularities``; ``gauge_m`` is the nominal gauge. Functions take any array of ``s``."""

    line: Line
    irregularities: Irregularities
    gauge_m: float

    def at(self, s: Array) -> Places:
        """Return the track at places ``s`` (...): what several of its functions there share is evaluated once."""
        return Places(self, s)

    def centre(self, s: Array) -> Array:
        """Return east, north and up of the centre line, m. Shape (...) to (..., 3)."""
        return self.at(s).centre

    def rpy(self, s: Array) -> Array:
        """Return roll, pitch and yaw of the track, rad. Shape (...) to (..., 3)."""
        return self.at(s).rpy

    def rpy_slopes(self, s: Array) -> Array:
        """Return derivatives of :meth:`rpy` by ``s``, rad/m; at a kink of the line, those to its right. (...) to (...,
        3).
        """
        return self.at(s).rpy_slopes

    def cross_level(self, s: Array) -> Array:
        """Return height of the left rail over the right one on the cross-level base, m. Shape (...) to (...)."""
        return self.at(s).cross_level

    def rail(self, s: Array, side: Side, line: Literal["top", "edge"] = "top") -> Array:
        """Return east, north and up of a rail's top or running edge, m. Shape (...) to (..., 3)."""
        return self.at(s).rail(side, line)

    def heading_deviations(self, s: Array) -> Array:
        """Return how far the paths of the centre line, the left and the right running edge turn from the designed
        heading.

        Positive to the left, rad; small, so that they can be integrated over any distance. Shape (...) to (..., 3).
        """
        places = self.at(s)
        tangent = np.stack(places.tangent, axis=-1)
        delta = np.arctan2(tangent[..., 1], tangent[..., 0])
        roll, pitch, _ = _columns(places.rpy)
        axle = _axle(roll, pitch, delta)
        axle_slope = _axle_slope(roll, pitch, delta, places.rpy_slopes)
        gauge, gauge_slope = places.gauge[..., None], places.irregular_slopes[..., 3, None]
        half = 0.5 * (gauge_slope * axle + gauge * axle_slope)
        paths = np.stack([tangent, tangent + half, tangent - half], axis=-2)
        return np.asarray(np.arctan2(paths[..., 1], paths[..., 0]))

    def tangent(self, s: Array) -> tuple[Array, Array, Array]:
        """Return ``t``, the derivative of the centre line: forward, left, up of the designed heading. Shapes (...)."""
        return self.at(s).tangent

    def reversed(self) -> SimulatedTrack:
        """Return the same track to who comes from its other end; its ENU has its origin there."""
        return SimulatedTrack(self.line.reversed(), self.irregularities.reversed(), self.gauge_m)


class Places:
    """A track at places ``s`` (...): irregularities, which take the most time, and what follows are evaluated once."""

    def __init__(self, track: SimulatedTrack, s: Array) -> None:
        self._track, self._s = track, s

    @cached_property
    def irregular(self) -> Array:
        """Return level, alignment, cross-level and gauge off the designed ones, m. Shape (..., 4)."""
        return self._track.irregularities.at(self._s)

    @cached_property
    def irregular_slopes(self) -> Array:
        """Return the derivatives of :attr:`irregular` by ``s``, m/m. Shape (..., 4)."""
        return self._track.irregularities.at(self._s, 1)

    @cached_property
    def tangent(self) -> tuple[Array, Array, Array]:
        """Return the components of ``t``. Shapes (...)."""
        d_level, d_alignment, _, _ = _columns(self.irregular_slopes)
        forward = np.cos(self._gamma) - self.irregular[..., 1] * self._curvature
        return forward, d_alignment, np.sin(self._gamma) + d_level

    @cached_property
    def centre(self) -> Array:
        """Return east, north and up of the centre line, m. Shape (..., 3)."""
        level, alignment, _, _ = _columns(self.irregular)
        yaw = self._track.line.yaw(self._s)
        off = np.stack([-alignment * np.sin(yaw), alignment * np.cos(yaw), level], axis=-1)
        return np.asarray(self._track.line.position(self._s) + off)

    def rail(self, side: Side, line: Literal["top", "edge"] = "top") -> Array:
        """Return east, north and up of a rail's top or running edge, m. Shape (..., 3)."""
        width = self._track.line.cross_level_base_m if line == "top" else self.gauge[..., None]
        return self.centre + 0.5 * _SIGN[side] * width * self._across

    @property
    def cross_level(self) -> Array:
        """Return height of the left rail over the right one on the cross-level base, m. Shape (...)."""
        return np.asarray(self._track.line.cross_level_base_m * self.roll_sine)

    @cached_property
    def roll_sine(self) -> Array:
        """Return the sine of the roll. Shape (...)."""
        line = self._track.line
        return np.asarray((line.cant(self._s) + self.irregular[..., 2]) / line.cross_level_base_m)

    @cached_property
    def gauge(self) -> Array:
        """Return the gauge as it is, m. Shape (...)."""
        return np.asarray(self._track.gauge_m + self.irregular[..., 3])

    @cached_property
    def rpy(self) -> Array:
        """Return roll, pitch and yaw, rad. Shape (..., 3)."""
        forward, left, up = self.tangent
        pitch = -np.arctan2(up, np.hypot(forward, left))
        yaw = self._track.line.yaw(self._s) + np.arctan2(left, forward)
        return np.stack([np.arcsin(self.roll_sine), pitch, yaw], axis=-1)

    @cached_property
    def rpy_slopes(self) -> Array:
        """Return the derivatives of :attr:`rpy` by ``s``, rad/m. Shape (..., 3)."""
        line = self._track.line
        forward, left, up = self.tangent
        d_forward, d_left, d_up = self._tangent_slopes()
        flat = np.hypot(forward, left)
        d_flat = (forward * d_forward + left * d_left) / flat
        d_delta = (d_left * forward - left * d_forward) / flat**2
        d_pitch = -(d_up * flat - up * d_flat) / (flat**2 + up**2)
        d_roll_sine = (line.cant(self._s, 1) + self.irregular_slopes[..., 2]) / line.cross_level_base_m
        d_roll = d_roll_sine / np.sqrt(1.0 - self.roll_sine**2)
        return np.stack([d_roll, d_pitch, self._curvature + d_delta], axis=-1)

    def _tangent_slopes(self) -> tuple[Array, Array, Array]:
        """Return derivatives of the components of :attr:`tangent`. Shapes (...)."""
        line, gamma = self._track.line, self._gamma
        d_gamma = line.grade(self._s, 1)
        alignment, d_alignment = self.irregular[..., 1], self.irregular_slopes[..., 1]
        dd_level, dd_alignment, _, _ = _columns(self._track.irregularities.at(self._s, 2))
        bend = d_alignment * self._curvature + alignment * line.curvature(self._s, 1)
        return -np.sin(gamma) * d_gamma - bend, dd_alignment, np.cos(gamma) * d_gamma + dd_level

    @cached_property
    def _across(self) -> Array:
        """Return the axle's direction. Shape (..., 3)."""
        return _axle(*_columns(self.rpy))

    @cached_property
    def _gamma(self) -> Array:
        return self._track.line.grade(self._s)

    @cached_property
    def _curvature(self) -> Array:
        return self._track.line.curvature(self._s)


def _columns(table: Array) -> Array:
    return np.moveaxis(table, -1, 0)


def _axle(roll: Array, pitch: Array, yaw: Array) -> Array:
    """Return the y axis of Rz(yaw) Ry(pitch) Rx(roll). Shapes (...) to (..., 3)."""
    return _turned(np.sin(pitch) * np.sin(roll), np.cos(roll), np.cos(pitch) * np.sin(roll), yaw)


def _axle_slope(roll: Array, pitch: Array, yaw: Array, rpy_slopes: Array) -> Array:
    """Return derivative of :func:`_axle` in fixed axes that ``yaw`` is measured from. Shapes (...), (..., 3) to (...,
    3).
    """
    d_roll, d_pitch, d_yaw = _columns(rpy_slopes)
    x, y = np.sin(pitch) * np.sin(roll), np.cos(roll)
    d_x = np.sin(pitch) * np.cos(roll) * d_roll + np.cos(pitch) * np.sin(roll) * d_pitch
    d_y = -np.sin(roll) * d_roll
    d_z = np.cos(pitch) * np.cos(roll) * d_roll - np.sin(pitch) * np.sin(roll) * d_pitch
    return _turned(d_x - y * d_yaw, d_y + x * d_yaw, d_z, yaw)


def _turned(x: Array, y: Array, z: Array, yaw: Array) -> Array:
    return np.stack([x * np.cos(yaw) - y * np.sin(yaw), x * np.sin(yaw) + y * np.cos(yaw), z], axis=-1)

"""Wheelsets lie about the designed line under the middle of their vehicle, and chords between such points.

Everything is in the *level frame at s*: origin at the designed point ``P(s)``, axes forward along the horizontal of the
designed heading, left of it, and up. A wheelset at the offset ``d`` is at the track's centre line at ``s + d`` in space
(curvature and gradient of the line and irregularities included) and has the track's roll there. What sits on two points
has its middle halfway between them, the mean of their rolls, and its x axis along the chord from one to the other.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from trackfg.datasets.line.track import SimulatedTrack
from trackfg.numerics.arrays import Array

_CELL_M = 1.0
"""Longest cell of the cubics through the designed line, m; the comment below says how exact they are."""


class Wheelsets:
    """The track near the places ``s`` (n,), for offsets within ``reach_m``."""

    def __init__(self, track: SimulatedTrack, s: Array, reach_m: float) -> None:
        self._track = track
        self._s = s
        line = track.line
        low, high = float(np.min(s)) - reach_m - _CELL_M, float(np.max(s)) + reach_m + _CELL_M
        regular = np.arange(np.floor(low), np.ceil(high) + _CELL_M, _CELL_M)
        edges = np.union1d(regular, line.knots[(line.knots > low) & (line.knots < high)])
        gamma, yaw = line.grade(edges), line.yaw(edges)
        tangent = np.column_stack([np.cos(gamma) * np.cos(yaw), np.cos(gamma) * np.sin(yaw), np.sin(gamma)])
        # Exact to 1e-8 m on a radius of 100 m, and much faster than integrating the line for every place.
        self._designed = CubicHermiteSpline(edges, line.position(edges), tangent)

    @cached_property
    def heading(self) -> Array:
        """Return the designed heading at ``s``, rad. Shape (n,)."""
        return self._track.line.yaw(self._s)

    @cached_property
    def _origin(self) -> Array:
        return np.asarray(self._designed(self._s))

    def at(self, offset_m: float) -> Array:
        """Return forward, left, up, m, and roll, rad, of the wheelset at ``s + offset_m``. Shape (n, 4)."""
        line, s = self._track.line, self._s + offset_m
        level, alignment, cross_level, _ = self._track.irregularities.at(s).T
        east, north, up = (self._designed(s) - self._origin).T
        cosine, sine = np.cos(self.heading), np.sin(self.heading)
        turned = line.yaw(s) - self.heading
        return np.column_stack(
            [
                cosine * east + sine * north - alignment * np.sin(turned),
                cosine * north - sine * east + alignment * np.cos(turned),
                up + level,
                np.arcsin((line.cant(s) + cross_level) / line.cross_level_base_m),
            ]
        )

    def tangent(self) -> Array:
        """Return pose of what follows the track's centre line in one point: as :func:`chord`, of length 0. Shape (n,
        6).
        """
        return np.column_stack([self.at(0.0), *_along(*self._track.tangent(self._s))])


def chord(front: Array, rear: Array) -> Array:
    """Return pose of what sits on two points (n, 4 or more): forward, left, up, roll, pitch, yaw. Shape (n, 6)."""
    forward, left, up = (front - rear)[:, :3].T
    return np.column_stack([0.5 * (front + rear)[:, :4], *_along(forward, left, up)])


def _along(forward: Array, left: Array, up: Array) -> tuple[Array, Array]:
    """Return pitch and yaw of a vector."""
    return -np.arctan2(up, np.hypot(forward, left)), np.arctan2(left, forward)

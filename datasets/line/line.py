"""A railway line as functions of the arc length ``s`` along it.

Three piecewise polynomials describe the track:

* ``curvature``: ``kappa(s) = dyaw/ds``, 1/m, positive to the left: straights and circles joined by transitions
  (:mod:`trackfg.datasets.line.alignment`);
* ``cant``: the height of the left rail over the right one, m, over the distance ``cross_level_base_m``: so a curve to
  the left, its outer rail raised, has a negative one;
* ``grade``: the angle ``gamma(s)`` of the track above the horizontal, rad: constant gradients joined by circular
  vertical curves, on which ``gamma`` is linear.

``s`` is the length along the curve in space, so that

    d(east, north, up)/ds = (cos gamma cos yaw, cos gamma sin yaw, sin gamma),
    roll = asin(cant / base),  pitch = -gamma,  yaw = yaw_0 + integral of kappa.

Yaw is exact; positions are Gauss-Legendre integrals over cells within which everything is smooth (error below 1e-9 m
over 100 km, checked against closed forms).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.interpolate import PPoly

from trackfg.datasets.line.polynomials import mirrored
from trackfg.numerics.arrays import Array
from trackfg.numerics.key_figures import Outlined
from trackfg.recording.line_kilometrage import LineKilometrage

_CELL_M = 10.0
"""Longest cell that the position is integrated over at once, m."""
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(6)
"""Gauss-Legendre rule of 6 points, exact up to degree 11."""


@dataclass(frozen=True, repr=False)
class Line(Outlined):
    """A line from ``s = 0`` to ``length_m``; every function accepts any array of ``s`` and is vectorised.

    ``limit_from_m`` (m,) and ``limit_mps`` (m,) are the speed limits, each from its place to the next one's;
    ``stations_m`` are stopping places. The line starts at the origin of ENU with heading ``start_yaw_rad``.
    """

    curvature: PPoly
    cant: PPoly
    grade: PPoly
    length_m: float
    cross_level_base_m: float
    limit_from_m: Array
    limit_mps: Array
    stations_m: Array
    start_yaw_rad: float = 0.0

    @cached_property
    def knots(self) -> Array:
        """Return where any of the three functions has a kink, sorted. Shape (k,)."""
        inside = np.concatenate([self.curvature.x, self.cant.x, self.grade.x])
        return np.unique(np.clip(inside, 0.0, self.length_m))

    def rpy(self, s: Array) -> Array:
        """Return roll, pitch and yaw of the track at ``s``, rad. Shape (...) to (..., 3)."""
        return np.stack([np.arcsin(self.cant(s) / self.cross_level_base_m), -self.grade(s), self.yaw(s)], axis=-1)

    def rpy_slopes(self, s: Array) -> Array:
        """Return derivatives of :meth:`rpy` by ``s``, rad/m; at a kink, those to its right. Shape (...) to (..., 3)."""
        sine = self.cant(s) / self.cross_level_base_m
        roll_slope = self.cant(s, 1) / self.cross_level_base_m / np.sqrt(1.0 - sine * sine)
        return np.stack([roll_slope, -self.grade(s, 1), self.curvature(s)], axis=-1)

    def yaw(self, s: Array) -> Array:
        """Return heading, counter-clockwise from east, not wrapped, rad."""
        return np.asarray(self._turn(s) + self.start_yaw_rad)

    def position(self, s: Array) -> Array:
        """Return east, north and up, m. Shape (...) to (..., 3)."""
        cell_edges, positions = self._cells
        s = np.asarray(s, dtype=np.float64)
        cell = np.clip(np.searchsorted(cell_edges, s, side="right") - 1, 0, len(cell_edges) - 1)
        return positions[cell] + self._integrated_tangent(cell_edges[cell], s)

    def reversed(self) -> Line:
        """Return the same track travelled from its other end: ``s' = length - s``, at its own origin.

        Left and right, uphill and downhill change places, so curvature, cant and gradient change sign, and the heading
        turns round: ``R'(s') = R(s) Rz(pi)`` and ``p'(s') = p(s) - p(length)``. Where a function jumps, it has at the
        jump itself the value of the other side.
        """
        limit_until = np.append(self.limit_from_m[1:], self.length_m)
        return Line(
            curvature=_negative(mirrored(self.curvature, self.length_m)),
            cant=_negative(mirrored(self.cant, self.length_m)),
            grade=_negative(mirrored(self.grade, self.length_m)),
            length_m=self.length_m,
            cross_level_base_m=self.cross_level_base_m,
            limit_from_m=self.length_m - limit_until[::-1],
            limit_mps=self.limit_mps[::-1],
            stations_m=self.length_m - self.stations_m[::-1],
            start_yaw_rad=float(self.yaw(np.array(self.length_m))) + np.pi,
        )

    @cached_property
    def _turn(self) -> PPoly:
        return self.curvature.antiderivative()

    @cached_property
    def _cells(self) -> tuple[Array, Array]:
        """Return edges of cells at most ``_CELL_M`` long that no kink falls inside, and the position at each."""
        regular = np.arange(0.0, self.length_m, _CELL_M)
        edges = np.unique(np.concatenate([regular, self.knots, [0.0, self.length_m]]))
        steps = self._integrated_tangent(edges[:-1], edges[1:])
        return edges, np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)])

    def _integrated_tangent(self, start: Array, end: Array) -> Array:
        """Return the vector from ``start`` to ``end`` along the line. Shapes (...) to (..., 3)."""
        half = 0.5 * (end - start)
        s = 0.5 * (start + end) + np.multiply.outer(_NODES, half)
        gamma, yaw = self.grade(s), self.yaw(s)
        along = np.cos(gamma)
        tangent = np.stack([along * np.cos(yaw), along * np.sin(yaw), np.sin(gamma)])
        return np.moveaxis(np.sum(np.multiply.outer(_WEIGHTS, half) * tangent, axis=1), 0, -1)


@dataclass(frozen=True)
class GivenLine:
    """A line for a scenario to run on, where it would draw one. ``remarks``: what a person should know about it."""

    name: str
    line: Line
    gauge_m: float
    chainage_origin_m: float = 0.0
    remarks: tuple[str, ...] = ()
    kilometrage: LineKilometrage | None = None


def _negative(function: PPoly) -> PPoly:
    return PPoly(-function.c, function.x, extrapolate=True)


def piecewise_linear(s: Array, values: Array) -> PPoly:
    """Return the continuous function through the points (s, values), as a polynomial of degree 1 per interval. Shapes
    (n,).
    """
    slopes = np.diff(values) / np.diff(s)
    return PPoly(np.stack([slopes, values[:-1]]), s, extrapolate=True)

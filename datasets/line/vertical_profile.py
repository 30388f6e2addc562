"""The heights of a line over its plan: constant gradients joined by vertical curves.

``p`` is the length along the plan (the horizontal projection), ``g = dz/dp`` the gradient, ``gamma = atan g``, and
``ds = sqrt(1 + g^2) dp`` the length along the line in space. A vertical curve is

* a circle of radius R: ``sin gamma`` is linear in p, and ``gamma`` in s; it touches both gradients at
  ``R tan(|gamma_2 - gamma_1| / 2)`` from their intersection;
* or a parabola of plan length L: ``g`` is linear in p; it touches them at L/2 in plan.

Between two of its points both shapes rise like a chord: by ``tan`` of the mean ``gamma``, or by the mean ``g``.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from trackfg.numerics.arrays import Array

STEEPEST = 0.5
"""dz/dp; beyond it a file has its units wrong."""

_TOUCHING_M = 1e-3
"""Curves that overlap by less are taken to touch: files round to millimetres."""

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(12)
"""Gauss-Legendre rule of 12 points, exact up to degree 23."""


@dataclass(frozen=True)
class Vertex:
    """A point where two gradients meet, and the curve that rounds it: a circle of ``radius_m``, a parabola of
    ``length_m``, or neither. ``name`` is for messages."""

    plan_m: float
    height_m: float
    name: str
    radius_m: float | None = None
    length_m: float | None = None


@dataclass(frozen=True)
class ProfilePiece:
    """A part of the profile of one shape, from ``plan_m`` over ``length_m`` of plan; ``height_m`` is that of its
    start. A constant gradient is a parabola with equal ends."""

    plan_m: float
    length_m: float
    height_m: float
    start: float
    end: float
    circular: bool = False

    @property
    def straight(self) -> bool:
        """Return whether the gradient is constant."""
        return self.start == self.end

    def gradient(self, q: Array) -> Array:
        """Return ``dz/dp`` at ``q`` from the piece's start. Shape (...)."""
        u = np.asarray(q) / self.length_m
        if self.circular:
            ends = np.sin(np.arctan([self.start, self.end]))
            sine = ends[0] + (ends[1] - ends[0]) * u
            return np.asarray(sine / np.sqrt(1.0 - sine * sine))
        return np.asarray(self.start + (self.end - self.start) * u)

    def height(self, q: Array) -> Array:
        """Return height at ``q`` from the piece's start, m. Shape (...)."""
        g = self.gradient(q)
        chord = np.tan(0.5 * (np.arctan(self.start) + np.arctan(g))) if self.circular else 0.5 * (self.start + g)
        return np.asarray(self.height_m + q * chord)

    def arc(self, q: Array) -> Array:
        """Return length in space from the piece's start to ``q``, m. Shape (...)."""
        half = 0.5 * np.asarray(q)[..., None]
        return np.asarray(np.sum(half * _WEIGHTS * np.hypot(1.0, self.gradient(half * (1.0 + _NODES))), axis=-1))

    def plan_at(self, arc: Array) -> Array:
        """Return the inverse of :meth:`arc`, by Newton's method. Shape (...)."""
        q = np.asarray(arc) * np.cos(np.arctan(0.5 * (self.start + self.end)))
        for _ in range(8):
            q = q - (self.arc(q) - arc) / np.hypot(1.0, self.gradient(q))
        return np.asarray(q)

    def cut(self, start_m: float, end_m: float) -> ProfilePiece:
        """Return the part of it between two places of the plan, which for a constant gradient may lie outside."""
        q = np.array([start_m, end_m]) - self.plan_m
        start, end = self.gradient(q)
        height = float(self.height(q[0]))
        return ProfilePiece(start_m, end_m - start_m, height, float(start), float(end), self.circular)


def profile(vertices: Sequence[Vertex], plan_length_m: float) -> tuple[ProfilePiece, ...]:
    """Return the profile through ``vertices`` over the plan from 0 to ``plan_length_m``.

    The first and last gradients go on beyond the first and last vertex. Raises ``ValueError`` for fewer than two
    vertices, vertices not in order, a gradient above 500 permille, a curve at the first or last vertex, and curves that
    overlap.
    """
    if len(vertices) < 2:
        raise ValueError(f"{len(vertices)} vertices: expected at least 2")
    plan = np.array([vertex.plan_m for vertex in vertices])
    height = np.array([vertex.height_m for vertex in vertices])
    for previous, following in itertools.pairwise(vertices):
        if following.plan_m <= previous.plan_m:
            raise ValueError(f"{following.name} is not beyond {previous.name}: expected increasing stations")
    for vertex in (vertices[0], vertices[-1]):
        if vertex.radius_m is not None or vertex.length_m is not None:
            raise ValueError(
                f"{vertex.name} is a curve at an end of the profile: expected gradients on both sides of it"
            )
    gradients = np.diff(height) / np.diff(plan)
    steep = int(np.argmax(np.abs(gradients)))
    if abs(gradients[steep]) > STEEPEST:
        where = f"from {vertices[steep].name} to {vertices[steep + 1].name}"
        problem = f"the gradient {where} is {1e3 * gradients[steep]:g} permille"
        raise ValueError(f"{problem}: expected at most {1e3 * STEEPEST:g}")

    pieces: list[ProfilePiece] = []
    place = plan[0]
    if place > 0.0:
        pieces.append(_gradient(plan[0], height[0], float(gradients[0])).cut(0.0, place))
    for i, vertex in enumerate(vertices[1:-1], start=1):
        g1, g2 = float(gradients[i - 1]), float(gradients[i])
        start, end = vertex.plan_m + _reach(vertex, g1, g2)
        if start < place - _TOUCHING_M:
            what = "the profile begins" if place == plan[0] else "the curve before it ends"
            problem = f"{vertex.name} begins {place - start:.3f} m before {what}"
            raise ValueError(f"{problem}: expected vertical curves that do not overlap")
        if start > place:
            pieces.append(_gradient(plan[i - 1], height[i - 1], g1).cut(place, start))
            place = start
        if end > place and g1 != g2:
            z = height[i] + g1 * (place - plan[i])
            pieces.append(ProfilePiece(place, end - place, z, g1, g2, circular=vertex.radius_m is not None))
            place = end
    if place > plan[-1] + _TOUCHING_M:
        raise ValueError(
            f"{vertices[-2].name} ends {place - plan[-1]:.3f} m beyond the last vertex: expected it before"
        )
    last = max(plan_length_m, plan[-1])
    if last > place:
        pieces.append(_gradient(plan[-1], height[-1], float(gradients[-1])).cut(place, last))
    inside = [piece for piece in pieces if piece.plan_m < plan_length_m and piece.plan_m + piece.length_m > 0.0]
    return tuple(
        piece.cut(max(piece.plan_m, 0.0), min(piece.plan_m + piece.length_m, plan_length_m)) for piece in inside
    )


def _reach(vertex: Vertex, g1: float, g2: float) -> Array:
    """Return where the curve begins and ends in plan, relative to its vertex."""
    if vertex.radius_m is not None:
        gamma = np.arctan([g1, g2])
        tangent = vertex.radius_m * np.tan(0.5 * np.abs(gamma[1] - gamma[0]))
        return np.asarray(np.array([-1.0, 1.0]) * tangent * np.cos(gamma))
    return np.array([-0.5, 0.5]) * (vertex.length_m or 0.0)


def _gradient(plan_m: float, height_m: float, gradient: float) -> ProfilePiece:
    return ProfilePiece(float(plan_m), 1.0, float(height_m), gradient, gradient)

"""An alignment given over its plan, and the same as functions of arc length in space.

Design offices lay lines out in plan: stations, curvature and cant go by the length ``p`` of the horizontal projection,
heights come on top. A :class:`Line` goes by the length ``s`` along the curve in space. With ``gamma`` the angle of the
gradient,

    dp/ds = cos gamma,   dyaw/ds = kappa_plan(p(s)) cos gamma(s).

On constant gradients ``p`` is linear in ``s`` and everything converts exactly; so does the angle of a circular vertical
curve. The rest is interpolated to 1e-13 of its largest value.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.interpolate import PPoly

from trackfg.datasets.line.line import Line
from trackfg.datasets.line.polynomials import Pieces, interpolated, joined, restricted, substituted
from trackfg.datasets.line.vertical_profile import ProfilePiece
from trackfg.numerics.arrays import Array

_SAME_PLACE_M = 1e-9
"""Ends of pieces that differ by less are one, m: rounding."""


@dataclass(frozen=True)
class PlanAlignment:
    """``curvature`` (1/m, left positive) and ``cant`` (m, left rail higher positive) over the plan from 0 to
    ``length_m``, and the ``profile`` over the same."""

    curvature: PPoly
    cant: PPoly
    profile: tuple[ProfilePiece, ...]
    length_m: float

    def plan_at(self, s: Array) -> Array:
        """Return length along the plan at the length ``s`` in space, m. Shape (...)."""
        return np.asarray(self._in_space["plan"](s))

    def space_at(self, plan_m: Array) -> Array:
        """Return length in space at the length ``plan_m`` along the plan, m. Shape (...)."""
        return np.asarray(self._in_space["space"](plan_m))

    def line(self, *, cross_level_base_m: float, start_yaw_rad: float, speed_limit_mps: float) -> Line:
        """Return the line in space, without stations and with one speed limit."""
        functions = self._in_space
        return Line(
            curvature=functions["curvature"],
            cant=functions["cant"],
            grade=functions["grade"],
            length_m=float(functions["plan"].x[-1]),
            cross_level_base_m=cross_level_base_m,
            limit_from_m=np.zeros(1),
            limit_mps=np.array([speed_limit_mps]),
            stations_m=np.zeros(0),
            start_yaw_rad=start_yaw_rad,
        )

    @cached_property
    def _in_space(self) -> dict[str, PPoly]:
        edges = np.concatenate([self.curvature.x, self.cant.x, [piece.plan_m for piece in self.profile]])
        edges = np.unique(np.clip(edges, 0.0, self.length_m))
        edges = edges[np.append(True, np.diff(edges) > _SAME_PLACE_M)]
        edges[-1] = self.length_m
        curvature, cant = restricted(self.curvature, edges), restricted(self.cant, edges)
        starts = np.array([piece.plan_m for piece in self.profile])
        which = np.searchsorted(starts, 0.5 * (edges[1:] + edges[:-1]), side="right") - 1

        parts: dict[str, list[Pieces]] = {name: [] for name in ("curvature", "cant", "grade", "plan", "space")}
        place = 0.0
        for i, (start, end) in enumerate(itertools.pairwise(edges)):
            cell = self.profile[which[i]].cut(float(start), float(end))
            convert = _on_gradient if cell.straight else _on_curve
            pieces = convert(cell, curvature[:, i], cant[:, i], place)
            for name, piece in pieces.items():
                parts[name].append(piece)
            place = float(pieces["plan"][0][-1])
        return {name: joined(pieces) for name, pieces in parts.items()}


def _on_gradient(cell: ProfilePiece, curvature: Array, cant: Array, place: float) -> dict[str, Pieces]:
    cosine = 1.0 / np.hypot(1.0, cell.start)
    space = np.array([place, place + cell.length_m / cosine])
    plan = np.array([cell.plan_m, cell.plan_m + cell.length_m])
    zero, scale = np.zeros(1), np.array([cosine])
    return {
        "curvature": (space, cosine * substituted(curvature[:, None], zero, scale)),
        "cant": (space, substituted(cant[:, None], zero, scale)),
        "grade": (space, np.array([[np.arctan(cell.start)]])),
        "plan": (space, np.array([[cosine], [cell.plan_m]])),
        "space": (plan, np.array([[1.0 / cosine], [place]])),
    }


def _on_curve(cell: ProfilePiece, curvature: Array, cant: Array, place: float) -> dict[str, Pieces]:
    arc = float(cell.arc(np.array(cell.length_m)))

    def curvature_at(s: Array) -> Array:
        q = cell.plan_at(s)
        return np.asarray(np.polyval(curvature, q) / np.hypot(1.0, cell.gradient(q)))

    def moved(pieces: Pieces, by: float) -> Pieces:
        return by + pieces[0], pieces[1]

    if cell.circular:
        gamma = np.arctan([cell.start, cell.end])
        grade = np.array([0.0, arc]), np.array([[(gamma[1] - gamma[0]) / arc], [gamma[0]]])
    else:
        grade = interpolated(lambda s: np.arctan(cell.gradient(cell.plan_at(s))), 0.0, arc)
    in_space = {
        "curvature": interpolated(curvature_at, 0.0, arc),
        "cant": interpolated(lambda s: np.asarray(np.polyval(cant, cell.plan_at(s))), 0.0, arc),
        "grade": grade,
        "plan": interpolated(lambda s: cell.plan_m + cell.plan_at(s), 0.0, arc),
    }
    space = interpolated(lambda q: place + cell.arc(q), 0.0, cell.length_m)
    return {**{name: moved(pieces, place) for name, pieces in in_space.items()}, "space": moved(space, cell.plan_m)}

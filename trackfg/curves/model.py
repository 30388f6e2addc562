"""The designed curvature and cant of a stretch of track, and what cells of a profile see of them.

A :class:`CurveChain` is a row of constant levels (straights, of curvature and cant 0, and circles) with a transition
from each to the next. So curvature is the sum of a start level and of rises, each ``change x f((x - b) / L)``
(:mod:`trackfg.curves.transition_laws`), and cant likewise, by the same laws at the same places.

A profile's curvature is the heading's change over a base; summed over the rows of a cell as long as the base it is the
change of the heading's *average* from one cell to the next, and cross-level is averaged over the same cells. Both are
second differences, over the cells' edges, of integrals of the chain: ``G = int int curvature`` and ``P = int cant``,

    turn_k = (G(e_k+2) - 2 G(e_k+1) + G(e_k)) / cell,    tilt_k = (P(e'_k+2) - 2 P(e'_k+1) + P(e'_k)) / cell,

where ``e' = e + cell/2``. Both are free of any constant: of the start heading and of the sensor's roll offset.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from trackfg.curves.transition_laws import TransitionLaw, rise
from trackfg.numerics.arrays import Array

WIDEST_RADIUS_M = 10_000.0
"""Curves wider than this, m, are taken for straight: their versine over 10 m is below 1.25 mm, as those of
irregularities are."""
_SHORTEST_M = 1e-3
"""Least length of a transition, m: the division by it stays finite."""


@dataclass(frozen=True)
class CurveChain:
    """A row of ``m`` levels with ``m - 1`` transitions between them.

    Transition i leads from ``places[begin[i]]`` to ``places[end[i]]``.

    Points that coincide share a place: both ends of a transition of no length, or the end of one and the beginning of
    the next where no constant stretch lies between. ``places`` (p,) m; ``curvature`` (m,) 1/m, left positive, and
    ``cant`` (m,) mm, left rail higher, are 0 where ``straight``.
    """

    straight: tuple[bool, ...]
    begin: tuple[int, ...]
    end: tuple[int, ...]
    laws: tuple[TransitionLaw, ...]
    places: Array
    curvature: Array
    cant: Array

    @cached_property
    def curved(self) -> np.ndarray:
        """The indices of the levels that are not straight."""
        return np.flatnonzero(~np.array(self.straight))

    @property
    def parameters(self) -> Array:
        """The places, then the curvatures and the cants of the curved levels. Shape (p + 2 c,)."""
        return np.concatenate([self.places, self.curvature[self.curved], self.cant[self.curved]])

    def with_parameters(self, x: Array) -> CurveChain:
        """Return the same chain with other numbers; the cants stay if they are not among them."""
        p, c = len(self.places), len(self.curved)
        curvature, cant = self.curvature.copy(), self.cant.copy()
        curvature[self.curved] = x[p : p + c]
        if len(x) > p + c:
            cant[self.curved] = x[p + c :]
        return replace(self, places=x[:p].copy(), curvature=curvature, cant=cant)

    @property
    def points(self) -> Array:
        """The places where transitions begin and end, in order. Shape (2 m - 2,)."""
        return np.asarray(self.places[self.nodes])

    @property
    def nodes(self) -> np.ndarray:
        """The index of the place of each point. Shape (2 m - 2,)."""
        return np.array([self.begin, self.end], dtype=np.int64).T.ravel()

    def curvature_at(self, x: Array) -> Array:
        """Return the curvature at places (n,), 1/m."""
        levels = self.curvature
        out = np.full(len(x), levels[0])
        for i, law in enumerate(self.laws):
            b, e = self.places[self.begin[i]], self.places[self.end[i]]
            out += (levels[i + 1] - levels[i]) * rise(law, (x - b) / max(e - b, _SHORTEST_M))[0]
        return out


def turns(chain: CurveChain, edges: Array) -> tuple[Array, Array]:
    """Return the turn of each cell, rad, and its derivatives by places and curvatures.

    Edges (n + 2,) to (n,) and (n, p + c).
    """
    return _seen(chain, edges, chain.curvature, 2)


def tilts(chain: CurveChain, edges: Array) -> tuple[Array, Array]:
    """Return increments of cross-level, mm, and their derivatives by places and cants.

    Edges (n + 2,) to (n,) and (n, p + c).
    """
    return _seen(chain, edges, chain.cant, 1)


def step_turns(places: Array, edges: Array) -> Array:
    """Return the turns that a step of curvature of 1 1/m at each of ``places`` (k,) would make. Shape (n, k)."""
    beyond = np.maximum(edges - places[:, None], 0.0)
    return _second_difference(0.5 * beyond**2, edges).T


def _seen(chain: CurveChain, edges: Array, levels: Array, order: int) -> tuple[Array, Array]:
    p, curved = len(chain.places), chain.curved
    row = {int(level): p + k for k, level in enumerate(curved)}
    x = edges - edges[0]
    total = np.zeros(len(edges))
    slopes = np.zeros((p + len(curved), len(edges)))
    if order == 2:
        total += 0.5 * levels[0] * x**2
        if 0 in row:
            slopes[row[0]] += 0.5 * x**2
    begin, end = chain.places[list(chain.begin)], chain.places[list(chain.end)]
    for law in dict.fromkeys(chain.laws):
        transitions = [i for i, other in enumerate(chain.laws) if other == law]
        changes = np.diff(levels)[transitions]
        shapes, by_begin, by_end = _integrals(law, edges, begin[transitions], end[transitions], order)
        total += changes @ shapes
        by_begin *= changes[:, None]
        by_end *= changes[:, None]
        for k, i in enumerate(transitions):
            slopes[chain.begin[i]] += by_begin[k]
            slopes[chain.end[i]] += by_end[k]
            if i + 1 in row:
                slopes[row[i + 1]] += shapes[k]
            if i in row:
                slopes[row[i]] -= shapes[k]
    return _second_difference(total, edges), _second_difference(slopes, edges).T


def _integrals(law: TransitionLaw, x: Array, begin: Array, end: Array, order: int) -> tuple[Array, Array, Array]:
    """Return rises from begins to ends (t,), integrated ``order`` times, and the derivatives by both.

    Each (t, n).
    """
    turned = end < begin  # on the way to a solution; as good as the other way round
    b = np.minimum(begin, end)[:, None]
    length = np.maximum(np.abs(end - begin), _SHORTEST_M)[:, None]
    u = (x - b) / length
    f, first, second = rise(law, u)
    if order == 2:
        shape, by_late = length**2 * second, length * (2.0 * second - u * first)
        by_early = -length * first - by_late
    else:
        shape, by_late = length * first, first - u * f
        by_early = -f - by_late
    if turned.any():
        by_early[turned], by_late[turned] = by_late[turned], by_early[turned]
    return shape, by_early, by_late


def _second_difference(values: Array, edges: Array) -> Array:
    """Return second differences along the last axis: shape (..., n + 2) to (..., n)."""
    steps = values[..., 1:] - values[..., :-1]
    return np.asarray((steps[..., 1:] - steps[..., :-1]) / (edges[1] - edges[0]))

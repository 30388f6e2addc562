"""Elements of an alignment: how curvature, cant or another quantity goes from one value to the next.

An element leads a quantity from ``start`` to ``end`` over ``length_m``; with ``u = s / length``, the value is
``start + (end - start) f(u)``:

* ``constant``: ``start = end``; straights and circles.
* ``linear``: ``f = u``; of curvature, the clothoid.
* ``half-sine``: ``f = (1 - cos(pi u)) / 2``; steepest in the middle, ``pi/2`` times as steep as ``linear``.
* ``sine``: ``f = u - sin(2 pi u) / (2 pi)``.
* ``bloss``: ``f = 3 u^2 - 2 u^3``.
* ``helmert``: two parabolas, ``f = 2 u^2`` and, from the middle on, ``1 - 2 (1 - u)^2``.
* ``cubic-parabola``, for curvature only: ``y'' = c x`` over the tangent where ``y'' = 0``, from ``y'' = start`` to
  ``y'' = end``. From a straight to radius R over the abscissa X this is ``y = x^3 / (6 R X)``. The length is that along
  the curve. The curvature ``y'' / (1 + y'^2)^(3/2)`` ends a little below ``1/R``, by the share ``(3/2) y'^2``; that
  jump is the curve's own. It exists while ``|y'| <= 1/sqrt(5)`` (24.1 degrees), where its curvature is greatest: so not
  between two nearly equal curvatures, for ``y'`` is about ``k^2 length / (2 |end - start|)`` where it is k.

Every law but the last turns by ``length (start + end) / 2``. ``linear``, ``bloss`` and ``helmert`` are polynomials and
kept exactly; the others are interpolated to 1e-13 of their largest value.

Sources: see docs/line-files.md.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from scipy.interpolate import PPoly
from scipy.optimize import brentq

from trackfg.datasets.line.polynomials import Pieces, interpolated, joined
from trackfg.numerics.arrays import Array

Law = Literal["constant", "linear", "half-sine", "sine", "bloss", "helmert", "cubic-parabola"]

SMALLEST_RADIUS_M = 10.0
"""Sharper curves than a tramway's are taken for faults of a file."""

LONGEST_M = 2e6
"""Longer lines are, too."""

_STEEPEST = 1.0 / np.sqrt(5.0)
"""The slope y' at which the curvature of a cubic parabola is greatest."""

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(24)
"""Gauss-Legendre rule of 24 points, exact up to degree 47."""


@dataclass(frozen=True)
class Element:
    """A quantity from ``start`` to ``end``, in its own unit (1/m for curvature, m for cant).

    Raises ``ValueError`` for a length that is not positive, values that are not finite, a ``constant`` that changes,
    and a cubic parabola too steep to exist.
    """

    law: Law
    length_m: float
    start: float
    end: float

    def __post_init__(self) -> None:
        if self.law not in get_args(Law):
            raise ValueError(f"the law is {self.law!r}: expected one of {', '.join(get_args(Law))}")
        if not (np.isfinite(self.length_m) and self.length_m > 0):
            raise ValueError(f"the length is {self.length_m:g} m: expected one above 0")
        if not (np.isfinite(self.start) and np.isfinite(self.end)):
            raise ValueError(f"it leads from {self.start} to {self.end}: expected finite values")
        if self.law == "constant" and self.start != self.end:
            raise ValueError(f"a constant element leads from {self.start:g} to {self.end:g}: expected one value")
        if self.law == "cubic-parabola" and self.start != self.end:
            _cubic_rate(self)


def piecewise(elements: Sequence[Element]) -> PPoly:
    """Return the elements one after another, from ``s = 0``, as a function of arc length."""
    edges = np.concatenate([[0.0], np.cumsum([element.length_m for element in elements])])
    return joined([_pieces(element, *ends) for element, *ends in zip(elements, edges[:-1], edges[1:], strict=True)])


def ramp_law(law: Law) -> Law:
    """Return the law of the cant over a transition with this law of curvature: the same; ``linear`` for a cubic
    parabola.
    """
    return "linear" if law == "cubic-parabola" else law


def _pieces(element: Element, start_m: float, end_m: float) -> Pieces:
    length, start, change = end_m - start_m, element.start, element.end - element.start
    whole = np.array([start_m, end_m])
    match element.law:
        case _ if change == 0.0:
            return whole, np.array([[start]])
        case "linear":
            return whole, np.array([[change / length], [start]])
        case "bloss":
            return whole, np.array([[-2 * change / length**3], [3 * change / length**2], [0.0], [start]])
        case "helmert":
            edges = np.array([start_m, start_m + 0.5 * length, end_m])
            bend, slope = 2 * change / length**2, 2 * change / length
            return edges, np.array([[bend, -bend], [0.0, slope], [start, start + 0.5 * change]])
        case "cubic-parabola":
            edges, coefficients = interpolated(_cubic_parabola(element), 0.0, length)
        case law:
            rise = _RISES[law]
            edges, coefficients = interpolated(lambda s: start + change * rise(s / length), 0.0, length)
    # Interpolated from zero and then moved: far along a line, s itself has too few digits.
    return np.append(start_m + edges[:-1], end_m), coefficients


_RISES: dict[str, Callable[[Array], Array]] = {
    "half-sine": lambda u: np.sin(0.5 * np.pi * u) ** 2,
    "sine": lambda u: u - np.sin(2 * np.pi * u) / (2 * np.pi),
}


def _cubic_rate(element: Element) -> float:
    """Return the ``|c|`` of ``y'' = c x`` for which the curve is as long as it should be, 1/m^2.

    With ``k = y'' = c x`` as variable, ``c length`` is the integral of ``sqrt(1 + (k^2 / 2c)^2)`` over k.
    """
    low, high = sorted((element.start, element.end))
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    k2 = (middle + half * _NODES) ** 2

    def excess(rate: float) -> float:
        return rate * element.length_m - half * float(_WEIGHTS @ np.hypot(1.0, k2 / (2.0 * rate)))

    gentlest = max(low * low, high * high) / (2.0 * _STEEPEST)
    if excess(gentlest) > 0.0:
        raise ValueError(
            f"a cubic parabola {element.length_m:g} m long from {element.start:g} to {element.end:g} 1/m "
            "would be steeper than 24.1 degrees: expected it shorter, its radii greater or further apart"
        )
    # Up to that slope the square root stays below 1.1.
    sharpest = 1.1 * 2.0 * half / element.length_m
    return float(brentq(excess, gentlest, sharpest, xtol=1e-300, rtol=4 * np.finfo(float).eps))


def _cubic_parabola(element: Element) -> Callable[[Array], Array]:
    """Return curvature of a cubic parabola by the arc length from its start."""
    side = np.sign(element.end - element.start)
    rate = _cubic_rate(element)
    x_start = side * element.start / rate

    def arc(x: Array) -> Array:
        half = 0.5 * (x - x_start)[..., None]
        at = x_start + half * (1.0 + _NODES)
        return np.asarray(np.sum(half * _WEIGHTS * np.hypot(1.0, 0.5 * rate * at * at), axis=-1))

    def curvature(s: Array) -> Array:
        x = x_start + s
        for _ in range(8):  # Newton; the arc's slope is within 10 % of one, so five steps reach rounding
            x = x - (arc(x) - s) / np.hypot(1.0, 0.5 * rate * x * x)
        return np.asarray(side * rate * x / np.hypot(1.0, 0.5 * rate * x * x) ** 3)

    return curvature

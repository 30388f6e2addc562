"""Piecewise polynomials: join them, substitute into them, and interpolate what is not a polynomial.

Coefficients are laid out as in :class:`scipy.interpolate.PPoly`: shape (k, m), highest power first, one column per
interval, in powers of the distance from the interval's left edge.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.polynomial import chebyshev
from scipy.interpolate import PPoly

from trackfg.numerics.arrays import Array

Pieces = tuple[Array, Array]
"""Edges (m + 1,) and coefficients (k, m)."""

_DEGREE = 9
"""Degree of the polynomials."""
_RELATIVE_TOLERANCE = 1e-13
"""How well they have to fit between the nodes, of the largest value."""
_ROUNDING = 1e-16
"""The same in the function's own unit, where all values are about zero."""
_MOST_PIECES = 256
"""Pieces that an interval may be cut into until they do."""


def joined(parts: Sequence[Pieces]) -> PPoly:
    """Return one function from parts that follow each other; lower degrees are padded with zeros."""
    order = max(len(coefficients) for _, coefficients in parts)
    edges = np.concatenate([parts[0][0][:1], *(edges[1:] for edges, _ in parts)])
    joint, first = np.zeros((order, len(edges) - 1)), 0
    for _, coefficients in parts:
        last = first + coefficients.shape[1]
        joint[order - len(coefficients) :, first:last] = coefficients
        first = last
    return PPoly(joint, edges, extrapolate=True)


def substituted(coefficients: Array, offset: Array, scale: Array) -> Array:
    """Return the coefficients of ``p(offset + scale t)`` in powers of ``t``. Shapes (k, m), (m,), (m,) to (k, m)."""
    out = np.zeros_like(coefficients)
    for row in coefficients:
        # Horner: out <- out * (offset + scale t) + row.
        raised = np.zeros_like(out)
        raised[:-1] = out[1:] * scale
        out = raised + out * offset
        out[-1] += row
    return out


def mirrored(function: PPoly, length: float) -> PPoly:
    """Return the function ``g(s) = f(length - s)``, with exactly mirrored intervals."""
    widths = np.diff(function.x)
    coefficients = substituted(function.c, widths, np.full(len(widths), -1.0))
    return PPoly(coefficients[:, ::-1], length - function.x[::-1], extrapolate=True)


def restricted(function: PPoly, edges: Array) -> Array:
    """Return the coefficients of ``function`` on finer intervals. Shape (m + 1,) to (k, m).

    The middle of an interval decides which polynomial holds on it, so that an edge may miss a break by rounding.
    """
    middle = 0.5 * (edges[1:] + edges[:-1])
    index = np.clip(np.searchsorted(function.x, middle, side="right") - 1, 0, function.c.shape[1] - 1)
    return substituted(function.c[:, index], edges[:-1] - function.x[index], np.ones(len(index)))


def interpolated(function: Callable[[Array], Array], start: float, end: float) -> Pieces:
    """Return a smooth function on [start, end] as polynomials of degree 9 through Chebyshev nodes.

    The interval is halved until no value between nodes is off by more than 1e-13 of the largest one, or 1e-16 where
    all but vanish. Raises ``ValueError`` for a function that is not smooth.
    """
    pieces = 1
    while pieces <= _MOST_PIECES:
        edges = np.linspace(start, end, pieces + 1)
        half = 0.5 * np.diff(edges)
        centre = 0.5 * (edges[1:] + edges[:-1])
        values = function(centre + half * _NODES[:, None])
        spectrum = _TO_CHEBYSHEV @ values
        off = chebyshev.chebval(_BETWEEN, spectrum).T - function(centre + half * _BETWEEN[:, None])
        if np.max(np.abs(off)) <= _RELATIVE_TOLERANCE * np.max(np.abs(values)) + _ROUNDING:
            centred = np.stack([chebyshev.cheb2poly(np.append(column, 0.0))[: _DEGREE + 1] for column in spectrum.T])
            return edges, substituted(centred.T[::-1], np.full(pieces, -1.0), 1.0 / half)
        pieces *= 2
    raise ValueError(f"not smooth between {start} and {end}")


_NODES: Array = chebyshev.chebpts1(_DEGREE + 1)
_BETWEEN: Array = np.concatenate([[-1.0], 0.5 * (_NODES[1:] + _NODES[:-1]), [1.0]])
_TO_CHEBYSHEV: Array = np.linalg.inv(np.asarray(chebyshev.chebvander(_NODES, _DEGREE), dtype=np.float64))

"""Quintic splines through profiles with holes."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from trackfg.numerics.arrays import Array

_DEGREE = 5
"""Quintic: curvature is then a cubic, smooth over waves of 3 m."""


def spline_through(x: Array, y: Array) -> Callable[[Array], Array]:
    """Return ``y`` (n, ...) over ascending, evenly spaced ``x`` (n,) as a quintic spline through the rows that are
    finite.

    It takes places of any shape, to which that of a row is added; NaN outside of the finite rows, in gaps between them,
    and everywhere if they are fewer than six.
    """
    known = np.isfinite(y.reshape(len(x), -1)).all(axis=1)
    x, y = x[known], y[known]
    if len(x) <= _DEGREE:
        return lambda places: np.full((*places.shape, *y.shape[1:]), np.nan)
    from scipy.interpolate import make_interp_spline  # late: 0.1 s

    gap = np.diff(x) > 1.5 * np.diff(x).min()
    spline = make_interp_spline(x, y, k=_DEGREE)

    def at(places: Array) -> Array:
        out = np.full((*places.shape, *y.shape[1:]), np.nan)
        with np.errstate(invalid="ignore"):
            inside = (places >= x[0]) & (places <= x[-1])
        inside[inside] = ~gap[np.clip(np.searchsorted(x, places[inside], side="right") - 1, 0, len(gap) - 1)]
        out[inside] = spline(places[inside])
        return out

    return at


def spline_at(x: Array, y: Array, places: Array) -> Array:
    """Return :func:`spline_through` at ``places``."""
    return spline_through(x, y)(places)

"""Integrals of sampled values."""

from __future__ import annotations

import numpy as np

from trackfg.numerics.arrays import Array


def trapezoid_integral(t: Array, values: Array) -> Array:
    """Return the integral of values (n,) at t (n,) from the first on, by the trapezoid rule."""
    total = np.zeros(len(values))
    steps = total[1:]
    np.add(values[1:], values[:-1], out=steps)
    steps *= 0.5 * np.diff(t)
    np.cumsum(steps, out=steps)
    return total


def means_around(at: Array, t: Array, integral: Array, width: float) -> Array:
    """Return means over ``width`` around each place ``at`` (m,) of what has the ``integral`` (n, d) at ``t`` (n,).

    Near both ends of ``t`` they are over what there is of the width. Shape (m, d).
    """
    first, last = (np.clip(at + half, t[0], t[-1]) for half in (-0.5 * width, 0.5 * width))
    columns = [np.interp(last, t, column) - np.interp(first, t, column) for column in integral.T]
    return np.stack(columns, axis=1) / (last - first)[:, None]

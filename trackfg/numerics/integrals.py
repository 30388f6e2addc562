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

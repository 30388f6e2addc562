"""The cubic between two places with given velocities: Hermite's weights.

``p(f) = w0 p0 + w1 p1 + u0 v0 + u1 v1`` at the fraction f of an interval of T seconds has the values p0, p1 and the
slopes v0, v1 at its ends.
"""

from __future__ import annotations

from trackfg.numerics.arrays import Array


def hermite_weights(f: Array, T: Array) -> tuple[Array, Array, Array, Array]:
    """Return ``(w0, w1, u0, u1)`` at fractions f of intervals T, of any shapes that fit."""
    f2 = f * f
    f3 = f2 * f
    w1 = 3.0 * f2 - 2.0 * f3
    return 1.0 - w1, w1, T * (f - 2.0 * f2 + f3), T * (f3 - f2)


def hermite_rates(f: Array, T: Array) -> tuple[Array, Array, Array, Array]:
    """Return the derivatives of :func:`hermite_weights` by time."""
    f2 = f * f
    w1 = 6.0 * (f - f2) / T
    return -w1, w1, 1.0 - 4.0 * f + 3.0 * f2, 3.0 * f2 - 2.0 * f

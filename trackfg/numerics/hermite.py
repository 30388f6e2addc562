"""The cubic between two places with given velocities: Hermite's weights.

``p(f) = w0 p0 + w1 p1 + u0 v0 + u1 v1`` at the fraction f of an interval of T seconds has the values p0, p1 and the
slopes v0, v1 at its ends. Cubics through many places are a spline where their velocities are chosen so.
"""

from __future__ import annotations

import numpy as np

from trackfg.numerics.arrays import Array
from trackfg.numerics.kernels import compiled_kernels, kernel_argument


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


def hermite_at(t: Array, times: Array, places: Array, velocities: Array) -> Array:
    """Return the cubics between ``places`` (..., n) with ``velocities`` (..., n) at ascending ``times`` (n,), at ``t``
    (m,): shape (..., m).
    """
    if compiled_kernels():
        from trackfg.numerics import compiled

        shape, n = places.shape[:-1], len(times)
        out = np.empty((*shape, len(t)))
        along, slopes = (kernel_argument(values).reshape(-1, n) for values in (places, velocities))
        compiled.hermite_at(kernel_argument(t), kernel_argument(times), along, slopes, out.reshape(-1, len(t)))
        return out
    i = np.clip(np.searchsorted(times, t, side="right") - 1, 0, len(times) - 2)
    T = times[i + 1] - times[i]
    w0, w1, u0, u1 = hermite_weights((t - times[i]) / T, T)
    weighted = ((places, i, w0), (places, i + 1, w1), (velocities, i, u0), (velocities, i + 1, u1))
    return np.asarray(sum(values.take(at, axis=-1) * weight for values, at, weight in weighted))


def spline_velocities(times: Array, places: Array) -> Array:
    """Return the velocities with which cubics through ``places`` (..., n) at ascending ``times`` (n,), four or more,
    are a cubic spline: shape (..., n).

    Accelerations are continuous where two cubics meet, the first two cubics are one, and so are the last two ("not a
    knot"; de Boor, *A Practical Guide to Splines* (1978), ch. IV).
    """
    from scipy.linalg import solve_banded  # late: most operators of the geometry work without

    T = np.diff(times)
    mean = np.diff(places) / T
    first, last = T[0] + T[1], T[-1] + T[-2]
    band = np.zeros((3, len(times)))
    band[0, 1], band[0, 2:] = first, T[:-1]
    band[1, 0], band[1, 1:-1], band[1, -1] = T[1], 2.0 * (T[:-1] + T[1:]), T[-2]
    band[2, :-2], band[2, -2] = T[1:], last
    right = np.empty(places.shape)
    right[..., 1:-1] = 3.0 * (T[1:] * mean[..., :-1] + T[:-1] * mean[..., 1:])
    right[..., 0] = ((T[0] + 2.0 * first) * T[1] * mean[..., 0] + T[0] ** 2 * mean[..., 1]) / first
    right[..., -1] = ((T[-1] + 2.0 * last) * T[-2] * mean[..., -1] + T[-1] ** 2 * mean[..., -2]) / last
    solved = solve_banded((1, 1), band, right.reshape(-1, len(times)).T, overwrite_ab=True, check_finite=False)
    return np.asarray(solved.T.reshape(places.shape))

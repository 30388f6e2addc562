"""The residual shift between a run and the map, fitted to their difference.

A run laid ``e`` m wrong differs from the map by ``-e`` times the slope of the map's profile, everywhere alike, while
noise and changes of the track do not go with the slope. So the shift is a least-squares fit along the line,

    minimise  sum_q sum_i w (after_q(x_i + e(x_i)) - before_q(x_i))^2 / sigma_q^2  +  sum_k (e_k / sigma_e)^2,

``e`` linear between knots 50 m apart, ``sigma_e`` its prior sigma, but 5 cm at least; by Gauss-Newton steps, with
Huber's weights, so that a changed place has little weight. Profiles with sharp features everywhere and no slow errors
take part.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import solveh_banded

from trackfg.mapping.changes.overlay import Overlay
from trackfg.numerics.arrays import Array

ALIGNED_BY = ("twist_mm", "versine_level_mm", "versine_alignment_mm")
"""Columns that the shift is fitted to."""

_KNOTS_M = 50.0
"""Distance of the knots, m: chainage errors change over hundreds of metres."""
_INDEPENDENT_M = 2.5
"""Errors this far apart count as independent: half of the shortest base that they are seen over."""
_LEAST_SD_M = 0.05
"""Recognition knows the middles of its sections better, but not what a wheel did between them."""
_HUBER = 2.0
"""Width of Huber's loss, sigmas."""
_STEPS = 4
"""Gauss-Newton steps."""


def residual_shift(over: Overlay, sigma: dict[str, Array]) -> tuple[Array, Array]:
    """Return the shift, m, by which the run is to be read ahead of each cell, and its sigma. Shapes (n,).

    ``sigma``: of the difference, for each of :data:`ALIGNED_BY`.
    """
    n = len(over.chainage)
    if n < 2:
        return np.zeros(n), over.shift_sd_m
    at = (over.chainage - over.chainage[0]) / _KNOTS_M
    knots = int(at[-1]) + 2
    k = np.minimum(at.astype(np.int64), knots - 2)
    f = at - k
    prior_sd = np.maximum(np.interp(np.arange(knots), at, over.shift_sd_m), _LEAST_SD_M)
    share = over.step_m / _INDEPENDENT_M
    shift = np.zeros(n)
    for step in range(_STEPS):
        information, right = np.zeros(n), np.zeros(n)
        for name in ALIGNED_BY:
            map_values = over.before(name)
            slope = np.gradient(map_values, over.step_m)
            change = over.after_at(name, shift) - map_values
            weight = share / sigma[name] ** 2
            if step > 0:
                weight = weight * np.minimum(1.0, _HUBER * sigma[name] / np.maximum(np.abs(change), 1e-12))
            known = np.isfinite(change) & np.isfinite(slope) & np.isfinite(weight)
            information += np.where(known, weight * slope**2, 0.0)
            right += np.where(known, weight * slope * (slope * shift - change), 0.0)
        diagonal = _gathered(k, information * (1 - f) ** 2, information * f**2)
        diagonal += prior_sd**-2.0
        beside = np.bincount(k, information * f * (1 - f), knots)[:-1].astype(np.float64)
        vector = _gathered(k, right * (1 - f), right * f)
        solution = solveh_banded(np.stack([np.r_[0.0, beside], diagonal]), vector)
        shift = solution[k] * (1 - f) + solution[k + 1] * f
    sd = np.sqrt(_inverse_diagonal(diagonal, beside))
    return shift, sd[k] * (1 - f) + sd[k + 1] * f


def _gathered(k: np.ndarray, at_knot: Array, ahead: Array) -> Array:
    """Return sums over the cells of ``at_knot`` at their knots ``k`` and of ``ahead`` at the next knots."""
    knots = int(k.max()) + 2
    sums = np.bincount(k, at_knot, knots) + np.bincount(k + 1, ahead, knots)
    return sums.astype(np.float64)


def _inverse_diagonal(diagonal: Array, beside: Array) -> Array:
    """Return the diagonal of the inverse of a symmetric tridiagonal matrix.

    It is ``1 / (p + q - a)`` with the pivots p and q of eliminating the matrix from either end and its diagonal a.
    """
    pivots = []
    for a, b in ((diagonal, beside), (diagonal[::-1], beside[::-1])):
        pivot = a.copy()
        for i in range(1, len(a)):
            pivot[i] -= b[i - 1] ** 2 / pivot[i - 1]
        pivots.append(pivot)
    return np.asarray(1.0 / (pivots[0] + pivots[1][::-1] - diagonal))

"""Curvature over a base ``b``: the change of the heading over it, ``(heading(x + b/2) - heading(x - b/2)) / b``.

Its response to the heading is ``2 i sin(W b/2) / b``; to the curvature itself it is ``sin(W b/2) / (W b/2)``, the
moving average over the base. From the lateral profile ``u`` the heading is the central difference over ``2 h``, hence
the response

    -2 sin(W b/2) sin(W h) / (b h)      to u.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from trackfg.frames import Array
from trackfg.geometry.grid import steps, wave_number, weighted_neighbours


def curvature(heading_rad: ArrayLike, step_m: float, base_m: float = 10.0) -> Array:
    """Curvature, 1/m, positive to the left, of headings (..., n) that are positive to the left and not wrapped.

    NaN within half a base of an end. Raises ``BadInputError`` where half the base is no whole multiple of ``step_m``.
    """
    half = steps(base_m / 2.0, step_m, "half of base_m")
    return weighted_neighbours(heading_rad, {half: 1.0 / base_m, -half: -1.0 / base_m})


def curvature_response(wavelength_m: ArrayLike, base_m: float = 10.0) -> np.ndarray:
    """Complex response of :func:`curvature` to the heading, 1/m."""
    return np.asarray(2j * np.sin(wave_number(wavelength_m) * base_m / 2.0) / base_m)


def curvature_of_lateral(u: ArrayLike, step_m: float, base_m: float = 10.0) -> Array:
    """Curvature, 1/m, of lateral positions (..., n) in m, positive to the left; NaN within ``b/2 + h`` of an end.

    Raises ``BadInputError`` where half the base is no whole multiple of ``step_m``.
    """
    half = steps(base_m / 2.0, step_m, "half of base_m")
    weight = 1.0 / (2.0 * step_m * base_m)
    weights = {half + 1: weight, -half - 1: weight}
    for offset in (half - 1, 1 - half):  # both fall on 0 where the base is two steps
        weights[offset] = weights.get(offset, 0.0) - weight
    return weighted_neighbours(u, weights)


def curvature_of_lateral_response(wavelength_m: ArrayLike, step_m: float, base_m: float = 10.0) -> Array:
    """Response of :func:`curvature_of_lateral`, real, 1/m^2."""
    W = wave_number(wavelength_m)
    return np.asarray(-2.0 * np.sin(W * base_m / 2.0) * np.sin(W * step_m) / (base_m * step_m))

"""Curvature over a base ``b``: the change of the heading over it, ``(heading(x + b/2) - heading(x - b/2)) / b``.

Its response to the heading is ``2 i sin(W b/2) / b``; to the curvature itself it is ``sin(W b/2) / (W b/2)``, the
moving average over the base.

Where there is no heading but the lateral profile ``u``, whose readings have noise of their own, the heading is the
slope of the cubic that fits ``u`` best within 1 m to either side (Savitzky and Golay, 1964).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from trackfg.errors import BadInputError
from trackfg.geometry.grid import slope_over, slope_response, steps, wave_number, weighted_neighbours
from trackfg.numerics.arrays import Array


def curvature(heading_rad: ArrayLike, step_m: float, base_m: float = 10.0) -> Array:
    """Return curvature, 1/m, positive to the left, of headings (..., n) that are positive to the left and not wrapped.

    NaN within half a base of an end. Raises ``BadInputError`` where half the base is no whole multiple of ``step_m``.
    """
    return slope_over(heading_rad, step_m, base_m)


def curvature_response(wavelength_m: ArrayLike, base_m: float = 10.0) -> np.ndarray:
    """Return complex response of :func:`curvature` to the heading, 1/m."""
    return slope_response(wavelength_m, base_m)


def heading_of_lateral(u: ArrayLike, step_m: float, half_m: float = 1.0) -> Array:
    """Return heading, rad, of lateral positions (..., n) in m; NaN within ``half_m`` of an end.

    Raises ``BadInputError`` where ``half_m`` is no whole multiple of ``step_m``, or of fewer than two steps.
    """
    return weighted_neighbours(u, dict(_slope_weights(step_m, half_m)))


def heading_of_lateral_response(wavelength_m: ArrayLike, step_m: float, half_m: float = 1.0) -> np.ndarray:
    """Return complex response of :func:`heading_of_lateral` to u, 1/m."""
    W = wave_number(wavelength_m)
    return np.asarray(sum(weight * np.exp(1j * W * k * step_m) for k, weight in _slope_weights(step_m, half_m)))


def heading_noise(step_m: float, half_m: float = 1.0) -> float:
    """Return sigma of the heading, rad, for independent errors of 1 m in u."""
    return float(np.sqrt(sum(weight**2 for _, weight in _slope_weights(step_m, half_m))))


def heading_walk(step_m: float, half_m: float = 1.0) -> float:
    """Return sigma of the heading, rad, for errors of u that walk at random, by 1 m per root of a metre."""
    weights = np.array([weight for _, weight in _slope_weights(step_m, half_m)])
    return float(np.sqrt(step_m * np.sum(np.cumsum(weights) ** 2)))


def _slope_weights(step_m: float, half_m: float) -> list[tuple[int, float]]:
    """Return weights of the neighbours in the slope, at the middle, of the cubic fitted by least squares."""
    half = steps(half_m, step_m, "half_m")
    if half < 2:
        raise BadInputError(f"half_m is {half_m:g} m; expected two steps of {step_m:g} m or more")
    k = np.arange(-half, half + 1)
    slope = np.linalg.pinv(np.vander(k * step_m, 4, increasing=True))[1]
    return list(zip(k.tolist(), slope.tolist(), strict=True))

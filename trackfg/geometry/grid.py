"""Uniform profiles: lengths in steps, weighted sums of a few neighbours, and their responses."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from trackfg.errors import BadInputError
from trackfg.numerics.arrays import Array

_TOLERANCE = 1e-6
"""Of a step: how far a length may be from a whole number of steps."""


def steps(length_m: float, step_m: float, what: str) -> int:
    """Return a length as a whole number of steps, at least one. Raises ``BadInputError`` that names ``what`` it is."""
    if not (np.isfinite(step_m) and step_m > 0.0):
        raise BadInputError(f"step_m is {step_m!r}; expected a length above 0")
    count = round(length_m / step_m) if np.isfinite(length_m) else 0
    if count < 1 or abs(length_m / step_m - count) > _TOLERANCE:
        raise BadInputError(f"{what} is {length_m:g} m; expected a whole multiple of the step of {step_m:g} m")
    return count


def weighted_neighbours(y: ArrayLike, weights: Mapping[int, float]) -> Array:
    """Return ``sum_k weights[k] y[..., i + k]``, NaN where a neighbour is beyond an end. Shape (..., n) to the same."""
    y = np.asarray(y, dtype=np.float64)
    n = y.shape[-1]
    first, stop = max(0, -min(weights)), n - max(0, *weights)
    out = np.full(y.shape, np.nan)
    if first >= stop:
        return out
    inside = out[..., first:stop]
    inside[...] = 0.0
    for offset, weight in weights.items():
        inside += weight * y[..., first + offset : stop + offset]
    return out


def slope_over(y: ArrayLike, step_m: float, base_m: float) -> Array:
    """Return ``(y(x + b/2) - y(x - b/2)) / b`` of y (..., n) over a base b, NaN within half of it of an end.

    Raises ``BadInputError`` where half the base is no whole multiple of the step.
    """
    half = steps(base_m / 2.0, step_m, "half of base_m")
    return weighted_neighbours(y, {half: 1.0 / base_m, -half: -1.0 / base_m})


def slope_response(wavelength_m: ArrayLike, base_m: float) -> np.ndarray:
    """Return complex response of :func:`slope_over`, ``2 i sin(W b/2) / b``, 1/m."""
    return np.asarray(2j * np.sin(wave_number(wavelength_m) * base_m / 2.0) / base_m)


def window_sums(y: Array, count: int) -> Array:
    """Return sums of ``count`` neighbours by repeated doubling: as exact as adding them one by one, and a NaN stays
    where it is (a difference of cumulative sums would keep neither promise). Shape (..., n) to (..., n - count + 1).
    """
    length = y.shape[-1] - count + 1
    if length < 1:
        return np.empty((*y.shape[:-1], 0))
    total = np.zeros((*y.shape[:-1], length))
    block, width, done = y, 1, 0  # block[i] is the sum of `width` values from i on
    while True:
        if count & width:
            total += block[..., done : done + length]
            done += width
        if done == count:
            return total
        block = block[..., :-width] + block[..., width:]
        width *= 2


def wave_number(wavelength_m: ArrayLike) -> Array:
    """Return ``W = 2 pi / wavelength``, rad/m; zero for an infinite wavelength."""
    return np.asarray(2.0 * np.pi / np.asarray(wavelength_m, dtype=np.float64))

"""Versines: the offset of the track from a chord, for any chord.

For a chord from ``p`` behind the measuring point to ``q`` ahead of it,

    v(x) = y(x) - (q y(x - p) + p y(x + q)) / (p + q),

with the response ``H = 1 - (q exp(-i W p) + p exp(i W q)) / (p + q)``; for a symmetrical chord of length ``L`` this is
``1 - cos(pi L / wavelength)``, with zeros at ``L/2``, ``L/4``, ... . On a circle of curvature ``k`` (positive to the
left) ``v = -k p q / 2``: the 10 m chord reads 12500/R mm, negative in a left-hand curve.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from trackfg.geometry.grid import steps, wave_number, weighted_neighbours
from trackfg.numerics.arrays import Array


def versine(y: ArrayLike, step_m: float, behind_m: float = 5.0, ahead_m: float = 5.0) -> Array:
    """Return versines of a profile (..., n), in its unit; NaN where the chord does not fit.

    Raises ``BadInputError`` where ``behind_m`` or ``ahead_m`` is no whole multiple of ``step_m``.
    """
    p, q = steps(behind_m, step_m, "behind_m"), steps(ahead_m, step_m, "ahead_m")
    return weighted_neighbours(y, {0: 1.0, -p: -q / (p + q), q: -p / (p + q)})


def versine_response(wavelength_m: ArrayLike, behind_m: float = 5.0, ahead_m: float = 5.0) -> np.ndarray:
    """Return complex response of :func:`versine`; its argument says how far an asymmetrical chord shifts a wave."""
    W = wave_number(wavelength_m)
    chord = behind_m + ahead_m
    ends = ahead_m * np.exp(-1j * W * behind_m) + behind_m * np.exp(1j * W * ahead_m)
    return np.asarray(1.0 - ends / chord)


def uniformity_deviation(versines: ArrayLike, step_m: float, chord_m: float) -> Array:
    """Return versines less the mean of nine a quarter chord apart, their uniformity (49 CFR 213.327(a)).

    ``versines`` (..., n) are those of the symmetrical chord ``chord_m``; NaN within a chord of an end. Raises
    ``BadInputError`` where a quarter of the chord is no whole multiple of ``step_m``.
    """
    quarter = steps(chord_m / 4.0, step_m, "a quarter of chord_m")
    return weighted_neighbours(versines, {k * quarter: (k == 0) - 1.0 / 9.0 for k in range(-4, 5)})


def uniformity_deviation_response(wavelength_m: ArrayLike, chord_m: float) -> Array:
    """Return response of :func:`uniformity_deviation` to versines, real: ``1 - (1 + 2 sum_k cos(k W chord/4))/9``."""
    phase = wave_number(wavelength_m)[..., None] * chord_m / 4.0 * np.arange(1, 5)
    return np.asarray(1.0 - (1.0 + 2.0 * np.cos(phase).sum(axis=-1)) / 9.0)

"""The part of a versine that the designed curve explains, to be taken off: what remains is the irregularity.

Where the design is known, its versine is the curvature weighted with the chord's triangle (``y'' = k``),

    v(x) = - integral over -p..q of w(t) k(x + t) dt,
    w(t) = q (p + t) / (p + q) behind (t < 0),  p (q - t) / (p + q) ahead,

evaluated exactly for a curvature that is straight between the steps. Where it is not known, a running median followed
by a moving average follows curves and transitions but not a single fault shorter than half the window.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from trackfg.geometry.grid import steps, wave_number, window_sums
from trackfg.geometry.moving_average import moving_average
from trackfg.numerics.arrays import Array
from trackfg.numerics.convolution import convolve_inside


def design_versine(curvature_1pm: ArrayLike, step_m: float, behind_m: float = 5.0, ahead_m: float = 5.0) -> Array:
    """Return versines, m, of a design with curvatures (..., n), 1/m; NaN where the chord and a step do not fit.

    Raises ``BadInputError`` where ``behind_m`` or ``ahead_m`` is no whole multiple of ``step_m``.
    """
    p, q = steps(behind_m, step_m, "behind_m"), steps(ahead_m, step_m, "ahead_m")
    places = np.arange(-p - 1, q + 2)
    triangle = np.maximum(np.minimum(q * (p + places), p * (q - places)), 0) / (p + q) * step_m
    # The integral of two functions that are straight between the steps: (1, 4, 1)/6 of their products.
    weights = -step_m * np.convolve(triangle, [1.0, 4.0, 1.0], mode="same") / 6.0
    curvature = np.asarray(curvature_1pm, dtype=np.float64)
    out = np.full(curvature.shape, np.nan)
    if curvature.shape[-1] >= len(places):
        holes = np.isnan(curvature)
        inside = convolve_inside(np.where(holes, 0.0, curvature), weights[::-1])
        if holes.any():
            inside[window_sums(holes.astype(np.float64), len(places)) > 0.0] = np.nan
        out[..., p + 1 : curvature.shape[-1] - q - 1] = inside
    return out


def design_versine_response(wavelength_m: ArrayLike, behind_m: float = 5.0, ahead_m: float = 5.0) -> np.ndarray:
    """Return complex response of :func:`design_versine` to the curvature, m^2, for short steps.

    That of the versine over that of ``y'' = -W^2 y``; ``-p q / 2``, a circle's, for an infinite wavelength.
    """
    W = wave_number(wavelength_m)
    safe = np.where(W == 0.0, 1.0, W)
    p, q = behind_m, ahead_m
    versine = 1.0 - (q * np.exp(-1j * safe * p) + p * np.exp(1j * safe * q)) / (p + q)
    return np.asarray(np.where(W == 0.0, -0.5 * p * q, -versine / safe**2))


def running_design_versine(
    versines: ArrayLike, step_m: float, median_m: float = 60.0, average_m: float = 20.0
) -> Array:
    """Return an estimate of the design's versines from the measured ones (..., n) alone, in their unit.

    Running median over ``median_m``, then moving average over ``average_m``; NaN within half of both of an end or a
    hole. A fault that fills less than half of the median's window leaves no trace; transitions much shorter than it are
    rounded. Not linear, so without a response; 0.05 s per 100 000 values. Raises ``BadInputError`` where half a window
    is no whole multiple of ``step_m``.
    """
    from scipy.ndimage import maximum_filter1d, median_filter  # late: most of the package works without

    half = steps(median_m / 2.0, step_m, "half of median_m")
    v = np.asarray(versines, dtype=np.float64)
    holes = np.isnan(v)
    filled = np.where(holes, 0.0, v)
    median = np.empty_like(v)
    for row in np.ndindex(v.shape[:-1]):  # the filter of one dimension is six times as fast as that of more
        median[row] = median_filter(filled[row], size=2 * half + 1)
    near = maximum_filter1d(holes, 2 * half + 1, axis=-1) if holes.any() else holes
    near[..., :half] = True
    near[..., max(v.shape[-1] - half, 0) :] = True
    median[near] = np.nan
    return moving_average(median, step_m, average_m)

"""Baselines: the moving average of a profile, and cascades of moving averages.

Japanese track recording cars show level less its 24 m moving average, and alignment less a double one, 24 m then 18 m
(the cascade is how "24 m-18 m double moving average" is read here). The mean over a window of length ``M = N h`` counts
the two samples at its ends half, so that the window is exactly ``M`` long and centred:

    sampled:      sin(W M/2) / (N tan(W h/2))          as realised
    continuous:   sin(W M/2) / (W M/2)                 limit of small steps; 24 m at 0.25 m: equal to 1e-3 above 8 m
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from trackfg.geometry.grid import steps, wave_number, window_sums
from trackfg.numerics.arrays import Array

LEVEL_WINDOWS_M = (24.0,)
"""Window of the level's baseline, m (Suto, Tsubokawa and Yoshida, 2020)."""
ALIGNMENT_WINDOWS_M = (24.0, 18.0)
"""Windows of the alignment's baseline, one after the other, m (the same source)."""


def moving_average(y: ArrayLike, step_m: float, window_m: float) -> Array:
    """Return centred mean over ``window_m``. Shape (..., n) to the same, NaN within half a window of an end or a hole.

    Raises ``BadInputError`` where half the window is no whole multiple of ``step_m``.
    """
    half = steps(window_m / 2.0, step_m, "half of window_m")
    y = np.asarray(y, dtype=np.float64)
    out = np.full(y.shape, np.nan)
    sums = window_sums(y, 2 * half + 1)
    if sums.shape[-1]:
        sums -= 0.5 * (y[..., : -2 * half] + y[..., 2 * half :])
        out[..., half:-half] = sums / (2 * half)
    return out


def remove_baseline(y: ArrayLike, step_m: float, windows_m: Sequence[float] = LEVEL_WINDOWS_M) -> Array:
    """Return ``y`` (..., n) less its baseline, the moving averages over ``windows_m`` one after another."""
    y = np.asarray(y, dtype=np.float64)
    baseline = y
    for window in windows_m:
        baseline = moving_average(baseline, step_m, window)
    return np.asarray(y - baseline)


def moving_average_response(wavelength_m: ArrayLike, window_m: float, step_m: float | None = None) -> Array:
    """Return response of :func:`moving_average`, real: as realised with ``step_m``, the continuous one without."""
    W = wave_number(wavelength_m)
    if step_m is None:
        return np.asarray(np.sinc(W * window_m / (2.0 * np.pi)))
    count = 2 * steps(window_m / 2.0, step_m, "half of window_m")
    safe = np.where(W == 0.0, 1.0, W)
    ratio = np.sin(safe * window_m / 2.0) / (count * np.tan(safe * step_m / 2.0))
    return np.asarray(np.where(W == 0.0, 1.0, ratio))


def baseline_removed_response(
    wavelength_m: ArrayLike, windows_m: Sequence[float] = LEVEL_WINDOWS_M, step_m: float | None = None
) -> Array:
    """Return response of :func:`remove_baseline`, real: one less the product of the averages' responses."""
    baseline = np.ones(np.shape(wavelength_m))
    for window in windows_m:
        baseline = baseline * moving_average_response(wavelength_m, window, step_m)
    return np.asarray(1.0 - baseline)

"""Gradient over a base ``g``: ``(z(x + g/2) - z(x - g/2)) / g``, with the response ``2 i sin(W g/2) / g`` to the
height; to the slope ``dz/dx`` itself it is ``sin(W g/2) / (W g/2)``, the moving average over the base.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from trackfg.geometry.grid import slope_over, slope_response
from trackfg.numerics.arrays import Array


def gradient(z: ArrayLike, step_m: float, base_m: float = 25.0) -> Array:
    """Return gradient, m/m, positive uphill, of heights (..., n) in m; NaN within half a base of an end.

    Raises ``BadInputError`` where half the base is no whole multiple of ``step_m``.
    """
    return slope_over(z, step_m, base_m)


def gradient_response(wavelength_m: ArrayLike, base_m: float = 25.0) -> np.ndarray:
    """Return complex response of :func:`gradient` to the height, 1/m."""
    return slope_response(wavelength_m, base_m)

"""Twist over a base ``B``: ``T(x) = CL(x) - CL(x - B)`` of the cross-level, with the response ``1 - exp(-i W B)``,
whose magnitude ``2 |sin(pi B / wavelength)|`` is zero at ``B``, ``B/2``, ...
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from trackfg.geometry.grid import steps, wave_number, weighted_neighbours
from trackfg.numerics.arrays import Array


def twist(cross_level: ArrayLike, step_m: float, base_m: float = 5.0) -> Array:
    """Return twist, in the unit of ``cross_level`` (..., n); NaN within a base of the beginning.

    Raises ``BadInputError`` where ``base_m`` is no whole multiple of ``step_m``.
    """
    return weighted_neighbours(cross_level, {0: 1.0, -steps(base_m, step_m, "base_m"): -1.0})


def twist_response(wavelength_m: ArrayLike, base_m: float = 5.0) -> np.ndarray:
    """Return complex response of :func:`twist`."""
    return np.asarray(1.0 - np.exp(-1j * wave_number(wavelength_m) * base_m))

"""Twist over a base ``B``: the cross-level at one end of the base less that at the end of lower chainage.

    behind:  T(x) = CL(x) - CL(x - B)            response  1 - exp(-i W B)
    centre:  T(x) = CL(x + B/2) - CL(x - B/2)              2i sin(W B / 2)
    ahead:   T(x) = CL(x + B) - CL(x)                      exp(i W B) - 1

All have the magnitude ``2 |sin(pi B / wavelength)|``, zero at ``B``, ``B/2``, ...; they differ in the place of the base
that the value is written at.
"""

from __future__ import annotations

from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from trackfg.geometry.grid import steps, wave_number, weighted_neighbours
from trackfg.numerics.arrays import Array

Anchor = Literal["behind", "centre", "ahead"]
"""Where the base lies, seen from the place that the twist is written at, facing increasing chainage."""
ANCHORS: tuple[Anchor, ...] = get_args(Anchor)


def twist(cross_level: ArrayLike, step_m: float, base_m: float = 5.0, anchor: Anchor = "behind") -> Array:
    """Return twist, in the unit of ``cross_level`` (..., n); NaN where the base reaches beyond an end.

    Raises ``BadInputError`` where ``base_m``, or half of it for a centred base, is no whole multiple of ``step_m``.
    """
    if anchor == "centre":
        half = steps(base_m / 2.0, step_m, "half of base_m")
        return weighted_neighbours(cross_level, {half: 1.0, -half: -1.0})
    base = steps(base_m, step_m, "base_m")
    ends = {0: 1.0, -base: -1.0} if anchor == "behind" else {base: 1.0, 0: -1.0}
    return weighted_neighbours(cross_level, ends)


def twist_response(wavelength_m: ArrayLike, base_m: float = 5.0, anchor: Anchor = "behind") -> np.ndarray:
    """Return complex response of :func:`twist`."""
    behind = {"behind": 1.0, "centre": 0.5, "ahead": 0.0}[anchor]
    W = wave_number(wavelength_m)
    return np.asarray(np.exp(1j * W * (1.0 - behind) * base_m) - np.exp(-1j * W * behind * base_m))

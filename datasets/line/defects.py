"""Isolated defects of a track: a dip, a kink, a twist, as smooth functions of the arc length.

With ``x`` the distance from the defect's middle in units of its length ``L``,

* dip and kink are the bump ``b(x) = (1 - 4 x^2)^3`` on ``|x| < 1/2``, of height 1 and twice continuously
  differentiable: a dip lowers the rail by ``size b``, a kink moves it to the left by ``size b``;
* a twist is ``size t(x)`` of cross-level, ``t(x) = S(x + 1/2) - S(x + 3/2)/2 - S(x - 1/2)/2`` with the step
  ``S(x) = x^3 (10 - 15 x + 6 x^2)`` from 0 to 1: from 0 down to -1/2, up to +1/2 over the length ``L`` in the middle,
  and back to 0. So the twist over the base ``L`` reaches ``size``, and the track beyond is as it was.

What happens to one rail is half of it to the centre line and all of it to cross-level or gauge.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from trackfg.numerics.arrays import Array

SHORTEST_M = 1.5
"""The shortest defect: shorter ones fall between the knots of the irregularities."""


@dataclass(frozen=True)
class Defect:
    """A defect ``length_m`` long with its middle at ``at_m``.

    ``size_m`` is the depth of a dip, the deviation to the left of a kink, the rise of cross-level (left over right) of
    a twist; negative ones are the opposite. A twist on one rail lifts and lowers that rail alone; on both, it turns
    the track about its centre line.
    """

    kind: Literal["dip", "kink", "twist"]
    at_m: float
    size_m: float
    length_m: float
    rail: Literal["left", "right", "both"] = "both"

    def __post_init__(self) -> None:
        if self.length_m < SHORTEST_M:
            raise ValueError(f"a defect is at least {SHORTEST_M} m long, not {self.length_m}")

    @property
    def extent_m(self) -> tuple[float, float]:
        """Return the first and last place that it touches."""
        half = (1.5 if self.kind == "twist" else 0.5) * self.length_m
        return self.at_m - half, self.at_m + half

    def deviations(self, s: Array) -> Array:
        """Return what it adds to level, alignment, cross-level and gauge at ``s``, m. Shape (n,) to (n, 4)."""
        x = (s - self.at_m) / self.length_m
        level, alignment, cross_level, gauge = np.zeros((4, *np.shape(s)))
        sign = {"left": 1.0, "right": -1.0, "both": 0.0}[self.rail]
        share = 0.5 if sign else 1.0
        if self.kind == "twist":
            cross_level = self.size_m * (_step(x + 0.5) - 0.5 * _step(x + 1.5) - 0.5 * _step(x - 0.5))
            level = 0.5 * sign * cross_level
        elif self.kind == "dip":
            level = -share * self.size_m * _bump(x)
            cross_level = -sign * self.size_m * _bump(x)
        else:
            alignment = share * self.size_m * _bump(x)
            gauge = sign * self.size_m * _bump(x)
        return np.stack([level, alignment, cross_level, gauge], axis=-1)


def _bump(x: Array) -> Array:
    return np.clip(1.0 - 4.0 * x * x, 0.0, None) ** 3


def _step(x: Array) -> Array:
    x = np.clip(x, 0.0, 1.0)
    return np.asarray(x**3 * (10.0 - 15.0 * x + 6.0 * x * x))

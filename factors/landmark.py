"""The vehicle passed a known piece of track: a landmark."""

from __future__ import annotations

import numpy as np

from trackfg.factors.factor_type import FactorType
from trackfg.factors.family import Family
from trackfg.factors.linear import Slot
from trackfg.factors.loss import Loss
from trackfg.factors.states import Kind, Odo
from trackfg.numerics.arrays import Array


def _passed(first: Odo, second: Odo, fraction: Array, distance: Array) -> tuple[Array, tuple[Array, ...]]:
    f = fraction[:, 0]
    d_first, d_second = np.zeros((2, len(first), 1, Kind.ODO.dim))
    d_first[:, 0, Odo.DISTANCE], d_second[:, 0, Odo.DISTANCE] = 1.0 - f, f
    residual = (1.0 - f) * first.distance + f * second.distance - distance[:, 0]
    return residual[:, None], (d_first, d_second)


def landmark(first: np.ndarray, fraction: Array, distance: Array, sigma: Array, loss: Loss | None) -> Family:
    """A place of a map was passed between keyframe ``first`` (m,) and the next, at the share ``fraction`` of the time.

    Residual (m): ``(1 - f) D_k + f D_k+1 - d``; ``d`` (m,) is the place's distance in the sense of running, less what
    the distance at that time is beyond the straight line between the keyframes. sigma (m, 1): of recognising it.
    """
    slots = (Slot(Kind.ODO, first), Slot(Kind.ODO, first + 1))
    data = {"fraction": fraction[:, None], "distance": distance[:, None]}
    return Family(FactorType.LANDMARK, _passed, slots, data, sigma, loss)

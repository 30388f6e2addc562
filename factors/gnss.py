"""GNSS positions have a lever arm and a time offset."""

from __future__ import annotations

import numpy as np

from trackfg.factors.factor_type import FactorType
from trackfg.factors.family import Family
from trackfg.factors.linear import Slot
from trackfg.factors.loss import Loss
from trackfg.factors.states import Kind, Nav
from trackfg.numerics.arrays import Array
from trackfg.numerics.rotations import skew


def _position(
    nav: Nav, clock: Array, position: Array, lever_arm: Array, delay: Array, declared: Array
) -> tuple[Array, tuple[Array, ...]]:
    del declared  # the residual does not depend on it
    late = delay + clock[:, 2:]
    residual = nav.p + np.einsum("mij,mj->mi", nav.R, lever_arm) + nav.v * late - position
    d_nav = np.concatenate([-nav.R @ skew(lever_arm), nav.R, nav.R * late[:, :, None]], axis=2)
    d_clock = np.zeros((len(nav), 3, 3))
    d_clock[:, :, 2] = nav.v
    return residual, (d_nav, d_clock)


def gnss_position(
    index: np.ndarray, position: Array, lever_arm: Array, delay: Array, sigma: Array, loss: Loss | None
) -> Family:
    """The antenna is where the receiver says.

    Residual (m, in n): ``p + R l + v (dt + T) - z``; ``z`` (m, 3) is the measured position, ``l`` (3,) the antenna seen
    from the IMU in body axes, ``dt`` (m,) the seconds from the keyframe to the measurement's stamp and ``T`` the
    receiver's clock offset, the seconds to add to its stamps. sigma (m, 3), which stays beside the measurements as
    ``declared`` where residuals change it.
    """
    data = {"position": position, "lever_arm": np.tile(lever_arm, (len(index), 1)), "delay": delay[:, None]}
    data["declared"] = sigma
    slots = (Slot(Kind.NAV, index), Slot(Kind.CLOCK, np.zeros_like(index)))
    return Family(FactorType.GNSS_POSITION, _position, slots, data, sigma, loss)

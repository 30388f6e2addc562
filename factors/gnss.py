"""GNSS positions with lever arm and time offset."""

from __future__ import annotations

import numpy as np

from trackfg.factors.family import Family, Loss, Slot
from trackfg.factors.states import Kind, Nav
from trackfg.frames import Array, skew


def _position(nav: Nav, measured: Array, lever_arm: Array, delay: Array) -> tuple[Array, tuple[Array, ...]]:
    residual = nav.p + np.einsum("mij,mj->mi", nav.R, lever_arm) + nav.v * delay - measured
    d_nav = np.concatenate([-nav.R @ skew(lever_arm), nav.R, nav.R * delay[:, :, None]], axis=2)
    return residual, (d_nav,)


def gnss_position(
    index: np.ndarray, measured: Array, lever_arm: Array, delay: Array, sigma: Array, loss: Loss | None
) -> Family:
    """The antenna is where the receiver says.

    Residual (m, in n): ``p + R l + v dt - z``; ``z`` (m, 3) is the measured position, ``l`` (3,) the antenna seen from the
    IMU in body axes, ``dt`` (m,) the seconds from the keyframe to the measurement. sigma (m, 3).
    """
    data = (measured, np.tile(lever_arm, (len(index), 1)), delay[:, None])
    return Family("GNSS position", _position, (Slot(Kind.NAV, index),), data, sigma, loss)

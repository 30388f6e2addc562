"""The accelerometer measures which way is down: gravity tilt."""

from __future__ import annotations

import numpy as np

from trackfg.factors.factor_type import FactorType
from trackfg.factors.family import Family
from trackfg.factors.linear import Slot
from trackfg.factors.states import Kind, Nav
from trackfg.numerics.arrays import Array
from trackfg.numerics.rotations import skew


def _tilt(nav: Nav, bias: Array, specific_force: Array, gravity: Array) -> tuple[Array, tuple[Array, ...]]:
    up = nav.R[:, 2, :] * gravity
    d_nav = np.concatenate([skew(up), np.zeros((len(up), 3, 6))], axis=2)
    d_bias = np.zeros((len(up), 3, 6))
    d_bias[:, :, :3] = np.eye(3)
    return up + bias[:, :3] - specific_force, (d_nav, d_bias)


def gravity_tilt(index: np.ndarray, specific_force: Array, gravity: float, sigma: Array) -> Family:
    """The mean specific force, less its kinematic part, is gravity's reaction plus the accelerometer bias.

    Residual (m/s^2): ``R' (0, 0, g) + b_a - f``, with ``f`` (m, 3) the specific force in body axes after subtracting
    ``dv/dt + w x v``. sigma (m, 3), m/s^2, must cover the kinematic part that was not known.

    The samples behind ``f`` must not be preintegrated as well: this factor belongs to graphs in which the inertial
    factors give the accelerometer no weight (runs on which nothing measures speed).
    """
    data = {"specific_force": specific_force, "gravity": np.full(len(index), gravity)[:, None]}
    return Family(FactorType.GRAVITY_TILT, _tilt, (Slot(Kind.NAV, index), Slot(Kind.BIAS, index)), data, sigma)

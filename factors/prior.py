"""A prior tells what is known of a variable before any measurement."""

from __future__ import annotations

import numpy as np

from trackfg.factors.factor_type import FactorType
from trackfg.factors.family import Family
from trackfg.factors.linear import Slot
from trackfg.factors.states import Kind, Nav, Odo, vectors
from trackfg.numerics.arrays import Array
from trackfg.numerics.rotations import so3_log, so3_right_jacobian_inverse


def _vector(value: Odo | Array, mean: Array) -> tuple[Array, tuple[Array, ...]]:
    return vectors(value) - mean, (np.tile(np.eye(mean.shape[1]), (len(mean), 1, 1)),)


def prior(kind: Kind, index: np.ndarray, mean: Array, sigma: Array) -> Family:
    """A vector variable is near ``mean`` (m, dim). Residual: value less mean. sigma (m, dim)."""
    return Family(FactorType[f"PRIOR_{kind.name}"], _vector, (Slot(kind, index),), {"mean": mean}, sigma)


def _nav(nav: Nav, R: Array, p: Array, v: Array) -> tuple[Array, tuple[Array, ...]]:
    turn = so3_log(nav.R @ np.swapaxes(R, 1, 2))
    jacobian = np.zeros((len(nav), 9, 9))
    # Log(R R0') with R Exp(d) = Exp(R d) R: a left perturbation, Jl^-1(v) = Jr^-1(-v).
    jacobian[:, :3, :3] = so3_right_jacobian_inverse(-turn) @ nav.R
    jacobian[:, 3:6, 3:6] = nav.R
    jacobian[:, 6:, 6:] = nav.R
    return np.concatenate([turn, nav.p - p, nav.v - v], axis=1), (jacobian,)


def nav_prior(index: np.ndarray, mean: Nav, sigma: Array) -> Family:
    """Attitude, position and velocity are near ``mean``.

    Residual: ``Log(R R0')`` (rad; its third component is the yaw error, about n's vertical), ``p - p0`` (m) and
    ``v - v0`` (m/s), all in n. sigma (m, 9).
    """
    data = {"R": mean.R, "p": mean.p, "v": mean.v}
    return Family(FactorType.PRIOR_NAV, _nav, (Slot(Kind.NAV, index),), data, sigma)

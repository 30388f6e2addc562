"""A prior is what is known of a variable before any measurement."""

from __future__ import annotations

import numpy as np

from trackfg.factors.factor_type import FactorType
from trackfg.factors.family import Family
from trackfg.factors.linear import Slot
from trackfg.factors.motion import mount_axes, mount_matrix
from trackfg.factors.states import Kind, Nav, Odo, vectors
from trackfg.numerics.arrays import Array
from trackfg.numerics.rotations import skew, so3_log, so3_right_jacobian_inverse


def _vector(value: Odo | Array, mean: Array) -> tuple[Array, tuple[Array, ...]]:
    return vectors(value) - mean, (np.tile(np.eye(mean.shape[1]), (len(mean), 1, 1)),)


def prior(kind: Kind, index: np.ndarray, mean: Array, sigma: Array) -> Family:
    """A vector variable is near ``mean`` (m, dim). Residual: value less mean. sigma (m, dim)."""
    return Family(FactorType[f"PRIOR_{kind.name}"], _vector, (Slot(kind, index),), {"mean": mean}, sigma)


def _nav(nav: Nav, mount: Array, R: Array, p: Array, v: Array, lever_arm: Array) -> tuple[Array, tuple[Array, ...]]:
    turn = so3_log(nav.R @ mount_matrix(mount) @ np.swapaxes(R, 1, 2))
    d_nav, d_mount = np.zeros((len(nav), 9, 9)), np.zeros((len(nav), 9, Kind.MOUNT.dim))
    # Log(R R_bt R0') with R Exp(d) = Exp(R d) R: a left perturbation, Jl^-1(v) = Jr^-1(-v).
    by_turn = so3_right_jacobian_inverse(-turn) @ nav.R
    d_nav[:, :3, :3], d_mount[:, :3, :2] = by_turn, by_turn @ mount_axes(mount)
    d_nav[:, 3:6, :3] = nav.R @ skew(lever_arm)
    d_nav[:, 3:6, 3:6] = nav.R
    d_nav[:, 6:, 6:] = nav.R
    at_reference = nav.p - np.einsum("mij,mj->mi", nav.R, lever_arm)
    return np.concatenate([turn, at_reference - p, nav.v - v], axis=1), (d_nav, d_mount)


def nav_prior(index: np.ndarray, mean: Nav, sigma: Array, lever_arm: Array) -> Family:
    """Attitude of travel, position of the vehicle's reference point and velocity are near ``mean``.

    Residual: ``Log(R R_bt R0')`` (rad; its third component is the error of the heading, about n's vertical),
    ``p - R l - p0`` (m) and ``v - v0`` (m/s), all in n. ``lever_arm`` l (3,) leads from the reference point to the
    sensor, in body axes, m: how the sensor leans at the start is not known, where the reference point is, defines the
    frame. sigma (m, 9).
    """
    data = {"R": mean.R, "p": mean.p, "v": mean.v, "lever_arm": np.tile(lever_arm, (len(mean), 1))}
    slots = (Slot(Kind.NAV, index), Slot(Kind.MOUNT, np.zeros_like(index)))
    return Family(FactorType.PRIOR_NAV, _nav, slots, data, sigma)

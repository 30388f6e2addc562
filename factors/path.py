"""A vehicle that follows the track moves where it points all the way from one keyframe to the next.

``non_holonomic`` says so at an instant; this factor says it over a whole interval. With ``Delta(s)`` the attitude along
the interval relative to its start, from the gyro, and ``f`` the direction of travel in body axes, the displacement in
starting axes is parallel to

    c = integral over the interval of Delta(s) f ds / length.

The gyro's error is seen at the end, ``e = Log(Delta_T' R_k' R_k+1)``, and spread in proportion to time, as a constant
bias would be, so ``c = C f + K (e x f)`` with ``C = mean of Delta`` and ``K = mean of (t/T) Delta`` over the length.
What is left of the gyro's white noise is then a Brownian bridge, independent of what the inertial factor uses, so the
gyro is counted once: its part of the sideways displacement has the variance ``N^2 length^2 T / 12``.

The gyro's calibration W (:mod:`trackfg.factors.bias`) errs by ``W w``, whose mean over the interval is in e too. But
while the rate changes, the gyro is ahead of a steady turn by a vector, of mean q over the length, so ``C (f x W q)`` is
added to c. Without it the factor would take axes that are not square for a direction of travel: where a vehicle rolls
into cant, a sensor whose pitch axis senses 1 % of the roll rate looks like one that points 0.01 rad aside.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trackfg.factors.bias import OF_GYRO_RATE
from trackfg.factors.factor_type import FactorType
from trackfg.factors.family import Family, in_kernel, linear_rows
from trackfg.factors.linear import Slot
from trackfg.factors.loss import Loss
from trackfg.factors.motion import mount_derivative, mount_matrix, tracking_point
from trackfg.factors.states import Kind, Nav
from trackfg.numerics.arrays import Array
from trackfg.numerics.kernels import compiled_kernels, kernel_argument
from trackfg.numerics.rotations import skew, so3_log, so3_right_jacobian_inverse

LEAST_TURN = 1e-6
"""Turns below this have no axis but for rounding, rad."""


class _Turned(NamedTuple):
    """The gyro's rotation over each interval, its means C and K over the length, (m, 3, 3) each, and q (m, 3)."""

    turn: Array
    mean: Array
    mean_by_time: Array
    ahead: Array


@in_kernel(linear_rows("path", "turn", "mean", "mean_by_time", "ahead", "lever_arm"))
def _path(
    first: Nav, second: Nav, mount: Array, imu: Array, lever_arm: Array, **turned: Array
) -> tuple[Array, tuple[Array, ...]]:
    turn, mean, mean_by_time, ahead = _Turned(**turned)
    relative = np.swapaxes(first.R, 1, 2) @ second.R
    from_track = lever_arm - tracking_point(mount)
    chord = (second.p - np.einsum("mij,mj->mi", second.R, from_track)) - (
        first.p - np.einsum("mij,mj->mi", first.R, from_track)
    )
    u = np.einsum("mji,mj->mi", first.R, chord)
    e = so3_log(np.swapaxes(turn, 1, 2) @ relative)
    R_bt, d_R_bt = mount_matrix(mount), mount_derivative(mount)
    f, d_f = R_bt[:, :, 0], np.swapaxes(d_R_bt[:, :, :, 0], 1, 2)
    d_c_by_e = -mean_by_time @ skew(f)
    d_c_by_w = mean @ skew(f)
    W = imu[:, OF_GYRO_RATE].reshape(-1, 3, 3)
    cross_axis_rate = np.einsum("mij,mj->mi", W, ahead)
    c = np.einsum("mij,mj->mi", mean, f) + np.einsum("mij,mj->mi", d_c_by_e, e)
    c += np.einsum("mij,mj->mi", d_c_by_w, cross_axis_rate)
    slope = c[:, 1:] / c[:, :1]
    residual = u[:, 1:] - slope * u[:, :1]

    def across(derivative: Array) -> Array:
        """Return rows 2 and 3 less ``slope`` times row 1."""
        return np.asarray(derivative[:, 1:] - slope[:, :, None] * derivative[:, :1])

    inverse = so3_right_jacobian_inverse(e)
    share = (u[:, 0] / c[:, 0])[:, None, None]
    by_e = -share * across(d_c_by_e @ inverse)
    arm = skew(from_track)
    m = len(u)
    d_first, d_second = np.zeros((m, 2, 9)), np.zeros((m, 2, 9))
    d_first[:, :, :3] = across(skew(u) - arm) - by_e @ np.swapaxes(relative, 1, 2)
    d_first[:, :, 3:6] = across(np.broadcast_to(-np.eye(3), (m, 3, 3)))
    d_second[:, :, :3] = across(relative @ arm) + by_e
    d_second[:, :, 3:6] = across(relative)
    d_angles = -share * across((mean + mean_by_time @ skew(e) - mean @ skew(cross_axis_rate)) @ d_f)
    d_mount = np.concatenate([d_angles, across(relative - np.eye(3))], axis=2)
    d_imu = np.zeros((m, 2, Kind.IMU.dim))
    d_imu[:, :, OF_GYRO_RATE] = np.einsum("mri,mj->mrij", -share * across(d_c_by_w), ahead).reshape(m, 2, 9)
    return residual, (d_first, d_second, d_mount, d_imu)


def _ahead_of_a_steady_turn(turn: Array, mean: Array, mean_by_time: Array) -> Array:
    """Return the mean over the length of the gyro's turn less a steady one of the same end, q (m, 3), rad.

    A steady turn by v has the mean ``v x mean of (t/T)``, and K leaves its axis as it is but for that mean.
    """
    if compiled_kernels():
        from trackfg.numerics import compiled

        ahead, turned = np.empty((len(turn), 3)), kernel_argument(turn)
        compiled.ahead_of_a_steady_turn(turned, kernel_argument(mean), kernel_argument(mean_by_time), LEAST_TURN, ahead)
        return ahead
    v = so3_log(turn)
    square = np.sum(v * v, axis=1)
    by_axis = np.einsum("mi,mij,mj->m", v, mean_by_time, v)
    turns = square > LEAST_TURN**2
    part = np.where(turns, by_axis / np.where(turns, square, 1.0), np.trace(mean_by_time, axis1=1, axis2=2) / 3.0)
    return np.asarray(so3_log(mean) - part[:, None] * v)


def follows_path(
    first: np.ndarray, turn: Array, mean: Array, mean_by_time: Array, lever_arm: Array, sigma: Array, loss: Loss | None
) -> Family:
    """The point that follows the track moves where the vehicle points, from keyframe k to k + 1.

    Residual (m): rows 2 and 3 of ``R_k' (q_k+1 - q_k)`` less ``c`` scaled to the same first row; ``q = p - R (l - x)``,
    x the place of that point from the vehicle reference point, which ``MOUNT`` holds. ``IMU`` holds W.
    ``turn`` (m, 3, 3) is the gyro's rotation over the interval, ``mean`` and ``mean_by_time`` (m, 3, 3) are C and K,
    ``lever_arm`` (3,) m. sigma (m, 2), m.
    """
    zeros = np.zeros_like(first)
    slots = (Slot(Kind.NAV, first), Slot(Kind.NAV, first + 1), Slot(Kind.MOUNT, zeros), Slot(Kind.IMU, zeros))
    turned = _Turned(turn, mean, mean_by_time, _ahead_of_a_steady_turn(turn, mean, mean_by_time))
    data = {**turned._asdict(), "lever_arm": lever_arm[None].repeat(len(first), axis=0)}
    return Family(FactorType.PATH, _path, slots, data, sigma, loss)

"""A vehicle on rails moves along its own axis, or not at all.

``nonholonomic`` follows Dissanayake et al., "The aiding of a low-cost strapdown inertial measurement unit using vehicle
model constraints", IEEE Trans. Robotics and Automation 17 (2001), with lever arm and mounting angles.
"""

from __future__ import annotations

import numpy as np

from trackfg.factors.factor_type import FactorType
from trackfg.factors.family import Family, in_kernel, linear_rows
from trackfg.factors.linear import Slot
from trackfg.factors.loss import Loss
from trackfg.factors.states import Kind, Nav
from trackfg.numerics.arrays import Array
from trackfg.numerics.rotations import matrices, skew, so3_log, so3_right_jacobian_inverse

TRACKING_POINT = slice(2, 5)
"""The place in ``MOUNT``, the first of the shared variables, of the point that follows the track."""


def tracking_point(mount: Array) -> Array:
    """Return where the point that follows the track is, from the vehicle reference point, m. (m, 5) to (m, 3)."""
    return mount[:, TRACKING_POINT]


def mount_matrix(mount: Array) -> Array:
    """Return ``R_bt = Rz(yaw) Ry(pitch)``, travel axes to body axes. (m, 5) to (m, 3, 3)."""
    cp, sp, cy, sy, zero = _turns(mount)
    return matrices([cy * cp, -sy, cy * sp, sy * cp, cy, sy * sp, -sp, zero, cp])


def mount_derivative(mount: Array) -> Array:
    """Return the derivative of :func:`mount_matrix` by the mounting. (m, 5) to (m, 2, 3, 3)."""
    cp, sp, cy, sy, zero = _turns(mount)
    derivative = np.empty((len(mount), 2, 3, 3))
    derivative[:, 0] = matrices([-cy * sp, zero, cy * cp, -sy * sp, zero, sy * cp, -cp, zero, -sp])
    derivative[:, 1] = matrices([-sy * cp, -cy, -sy * sp, cy * cp, -sy, cy * sp, zero, zero, zero])
    return derivative


def mount_axes(mount: Array) -> Array:
    """Return the axes, in body axes, about which the travel axes turn with pitch and yaw. (m, 5) to (m, 3, 2)."""
    _, _, cy, sy, zero = _turns(mount)
    return np.stack([np.stack([-sy, cy, zero], axis=1), np.stack([zero, zero, zero + 1.0], axis=1)], axis=2)


def _turns(mount: Array) -> tuple[Array, ...]:
    pitch, yaw = mount[:, 0], mount[:, 1]
    return np.cos(pitch), np.sin(pitch), np.cos(yaw), np.sin(yaw), np.zeros(len(mount))


@in_kernel(linear_rows("non_holonomic", "angular_rate", "lever_arm", "speed", "growth"))
def _sideways(
    nav: Nav, mount: Array, angular_rate: Array, lever_arm: Array, speed: Array, growth: Array
) -> tuple[Array, tuple[Array, ...]]:
    body = nav.own_velocity
    on_track = body - np.cross(angular_rate, lever_arm - tracking_point(mount))
    R_bt, d_R_bt = mount_matrix(mount), mount_derivative(mount)
    travel = np.einsum("mji,mj->mi", R_bt, on_track)
    axes = np.swapaxes(R_bt, 1, 2)
    zero = np.zeros((len(body), 3, 3))
    d_nav = axes @ np.concatenate([skew(body), zero, zero + np.eye(3)], axis=2)
    d_mount = np.concatenate([np.einsum("mcji,mj->mic", d_R_bt, on_track), axes @ skew(angular_rate)], axis=2)
    ahead, sideways = travel[:, :1], travel[:, 1:]
    scale = 1.0 / (1.0 + growth * (np.abs(ahead) - speed[:, None]))
    by_ahead = -(scale**2) * growth * np.sign(ahead) * sideways

    def scaled(derivative: Array) -> Array:
        return np.asarray(scale[:, :, None] * derivative[:, 1:] + by_ahead[:, :, None] * derivative[:, :1])

    return scale * sideways, (scaled(d_nav), scaled(d_mount))


def non_holonomic(
    index: np.ndarray,
    angular_rate: Array,
    lever_arm: Array,
    speed: Array,
    growth: Array,
    sigma: Array,
    loss: Loss | None,
) -> Family:
    """The point that follows the track has no lateral and no vertical velocity.

    With the velocity on the track ``u = R_bt' (R' v - w x (l - c))``, the residuals (m/s) are

        u_2 / (1 + g_2 (|u_1| - speed)),   u_3 / (1 + g_3 (|u_1| - speed)),

    positive to the left and upwards; ``l`` (3,) is the IMU's position in the vehicle, m, ``c`` the place of that point
    from the same reference, which ``MOUNT`` holds, and ``w`` (m, 3) the body's angular rate at the keyframe, rad/s,
    bias removed: the gyro's remaining error times the lever arm is far below any sigma used here. sigma (m, 2), m/s, is
    that at ``speed`` (m,), m/s, and grows with the speed by ``growth`` g (m, 2) of itself, s/m.

    It grows since a body turns against its path, by b, and moves sideways by ``b u_1`` then. With a sigma of a known
    speed instead of the state's own, a slower motion would have smaller residuals: n of them would pull the logarithm
    of the speed by n times its variance, which in a run of an hour is several of its sigmas.
    """
    data = {
        "angular_rate": angular_rate,
        "lever_arm": lever_arm[None].repeat(len(index), axis=0),
        "speed": speed,
        "growth": growth,
    }
    slots = (Slot(Kind.NAV, index), Slot(Kind.MOUNT, np.zeros_like(index)))
    return Family(FactorType.NON_HOLONOMIC, _sideways, slots, data, sigma, loss)


@in_kernel(linear_rows("at_rest"))
def _velocity(nav: Nav) -> tuple[Array, tuple[Array, ...]]:
    jacobian = np.concatenate([np.zeros((len(nav), 3, 6)), nav.R], axis=2)
    return nav.v, (jacobian,)


def at_rest(index: np.ndarray, sigma_mps: float, loss: Loss | None) -> Family:
    """The velocity at a keyframe is zero. Residual: ``v`` in n, m/s."""
    sigma = np.full((len(index), 3), sigma_mps)
    return Family(FactorType.AT_REST, _velocity, (Slot(Kind.NAV, index),), {}, sigma, loss)


@in_kernel(linear_rows("standstill"))
def _displacement(first: Nav, second: Nav) -> tuple[Array, tuple[Array, ...]]:
    relative = np.swapaxes(first.R, 1, 2) @ second.R
    turn = so3_log(relative)
    shift = np.einsum("mji,mj->mi", first.R, second.p - first.p)
    inverse = so3_right_jacobian_inverse(turn)
    m = len(turn)
    d_first, d_second = np.zeros((m, 6, 9)), np.zeros((m, 6, 9))
    d_first[:, :3, :3] = -inverse @ np.swapaxes(relative, 1, 2)
    d_first[:, 3:, :3] = skew(shift)
    d_first[:, 3:, 3:6] = -np.eye(3)
    d_second[:, :3, :3] = inverse
    d_second[:, 3:, 3:6] = relative
    return np.concatenate([turn, shift], axis=1), (d_first, d_second)


def stays(first: np.ndarray, turn_sigma_rad: float, shift_sigma_m: float, loss: Loss | None) -> Family:
    """The body neither turns nor shifts between keyframe k and k + 1, both in one standstill.

    Residual: ``Log(R_k' R_k+1)``, rad, and ``R_k' (p_k+1 - p_k)``, m. It says that the vehicle is still and uses no
    sensor sample, so the preintegrated ones are counted once.
    """
    sigma = np.tile(np.repeat([turn_sigma_rad, shift_sigma_m], 3), (len(first), 1))
    slots = (Slot(Kind.NAV, first), Slot(Kind.NAV, first + 1))
    return Family(FactorType.STANDSTILL, _displacement, slots, {}, sigma, loss)

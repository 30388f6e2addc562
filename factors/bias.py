"""The inertial sensor's biases walk, and it answers to turning, to acceleration and to vibration.

The bias that an inertial factor sees is that of its interval: the sensor's own, which walks, and what scale factors,
axes that are not quite square and a gyro that responds to accelerations add at the interval's mean rate w and mean
specific force f (P. D. Groves, *Principles of GNSS, Inertial, and Multisensor Integrated Navigation Systems*, 2nd ed.
(2013), 4.4). An accelerometer whose response is not quite linear turns vibration along an axis, of power P, into a
bias. The Earth turns about the horizontal axes of n by e (2,) more than is modelled. The gyro measures that, and the
accelerometer its Coriolis acceleration at the velocity v in n; in body axes both change with the heading. With the
shared calibration c made of A (3, 3), W (3, 3) and G (3, 2), row by row, the rectification k (3,), and e,

    accelerometer:  own + A (f_x, f_y, f_z - g) + k P, axis by axis, + 2 R_nb' ((e_x, e_y, 0) x v)
    gyro:           own + W w + G (f_x, f_y) + R_nb' (e_x, e_y, 0).

What the sensor measures of standard gravity g along z does not change, nor what it does of the Earth about the
vertical: it is a bias. In a canted curve the force along z differs from g by up to 0.1 m/s^2. That shows the speed, as
f_y does, and with the scale along z taken for known it would determine the wheel's too well. What the gyro measures of
it, 2e-5 rad/s of a sensor of a few euros, is less than its bias walks over such a curve.
"""

from __future__ import annotations

import numpy as np

from trackfg.factors.factor_type import FactorType
from trackfg.factors.family import Family, in_kernel, linear_rows
from trackfg.factors.linear import Slot
from trackfg.factors.states import Kind
from trackfg.numerics.arrays import Array
from trackfg.numerics.rotations import skew
from trackfg.numerics.units import STANDARD_GRAVITY

OF_ACCELEROMETER, OF_GYRO = slice(0, 9), slice(9, 24)
"""What the accelerometer adds (A) and what the gyro does (W and G), in the calibration."""

OF_GYRO_RATE = slice(9, 18)
"""What the gyro adds of rates (W), row by row, in the calibration."""

RECTIFICATION = slice(24, 27)
"""The coefficients k in the calibration."""

EARTH = slice(27, 29)
"""The Earth's rate e in the calibration."""


def response_terms(force: Array, rate: Array, power: Array, attitude: Array, velocity: Array) -> Array:
    """Return the derivative (m, 6, dim) of the added bias by the calibration.

    It is that for mean forces and rates (m, 3), for the power of the vibration along each axis (m, 3), (m/s^2)^2, for
    attitudes ``R_nb`` (m, 3, 3), and for velocities in n (m, 3).
    """
    out = np.zeros((len(rate), 6, Kind.IMU.dim))
    beyond_gravity = force - [0.0, 0.0, STANDARD_GRAVITY]
    for axis in range(3):
        out[:, axis, 3 * axis : 3 * axis + 3] = beyond_gravity
        out[:, 3 + axis, 9 + 3 * axis : 12 + 3 * axis] = rate
        out[:, 3 + axis, 18 + 2 * axis : 20 + 2 * axis] = force[:, :2]
        out[:, axis, RECTIFICATION.start + axis] = power[:, axis]
    in_body = np.swapaxes(attitude, 1, 2)
    out[:, 3:, EARTH] = in_body[:, :, :2]
    out[:, :3, EARTH] = -2.0 * (in_body @ skew(velocity))[:, :, :2]
    return out


def response_sigmas(
    accel_scale: float, gyro_scale: float, misalignment: float, g_sensitivity: float, rectification: float, earth: float
) -> Array:
    """Return prior sigmas: of A and W scales on the diagonal, else misalignment (rad); of G, k and e."""
    A, W = (np.where(np.eye(3) > 0, scale, misalignment) for scale in (accel_scale, gyro_scale))
    rest = np.repeat([g_sensitivity, rectification, earth], [6, 3, 2])
    return np.concatenate([A.ravel(), W.ravel(), rest])


@in_kernel(linear_rows("bias_walk", "change"))
def _walk(first: Array, second: Array, calibration: Array, change: Array) -> tuple[Array, tuple[Array, ...]]:
    residual = second - first - np.einsum("mij,mj->mi", change, calibration)
    same = np.tile(np.eye(6), (len(first), 1, 1))
    return residual, (-same, same, -change)


def bias_walk(first: np.ndarray, change: Array, sigma: Array) -> Family:
    """The sensor's own biases walk.

    Residual: ``b_k+1 - b_k`` less what the calibration explains, accelerometer (m/s^2), then gyro (rad/s). ``change``
    (m, 6, dim) is how :func:`response_terms` change from interval k to k + 1. sigma (m, 6).
    """
    slots = (Slot(Kind.BIAS, first), Slot(Kind.BIAS, first + 1), Slot(Kind.IMU, np.zeros_like(first)))
    return Family(FactorType.BIAS_WALK, _walk, slots, {"change": change}, sigma)

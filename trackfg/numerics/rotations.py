"""Rotations and frames, written over arrays.

Frames: the body frame b is FLU at the vehicle reference point (x forward, y left, z up); the navigation frame n is
ENU-like and level wherever the vehicle is: z points up along the local plumb line, so n turns as the vehicle travels
over the round Earth (:func:`~trackfg.numerics.geodesy.transport_rate`), but never about z. ``R_nb`` maps body to
navigation and ``R_nb = Rz(yaw) Ry(pitch) Rx(roll)``. Roll is positive with the left side up, pitch is positive
nose-down, yaw is positive to the left.

Rotation vectors are in rad. Every function accepts any number of leading dimensions.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from trackfg.numerics.arrays import Array


def matrices(entries: Sequence[Array]) -> Array:
    """Return 3 x 3 matrices from their nine entries (...), row by row. Shape (..., 3, 3)."""
    return _filled(entries, (3, 3))


def _filled(entries: Sequence[Array], shape: tuple[int, ...]) -> Array:
    """Return ``np.stack`` along new last axes; for the few rows of a stream ten times as fast."""
    out = np.empty((*entries[0].shape, len(entries)))
    for k, entry in enumerate(entries):
        out[..., k] = entry
    return out.reshape(*entries[0].shape, *shape)


def matrices_times(R: Array, x: Array) -> Array:
    """Return ``R @ x`` of many matrices (m, 3, 3) and one vector (3,) or matrix (3, 3): one product of all their rows
    takes a tenth of the time of m small ones.
    """
    return np.asarray(R.reshape(-1, 3) @ x).reshape(len(R), 3, *x.shape[1:])


def cross(a: Array, b: Array) -> Array:
    """Return ``np.cross`` of vectors (m, 3), for the few rows of a stream three times as fast."""
    (ax, ay, az), (bx, by, bz) = a.T, b.T
    return _filled([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], (3,))


def skew(v: Array) -> Array:
    """Return the matrix ``[v]x`` with ``[v]x u = v x u``. Shape (..., 3) to (..., 3, 3)."""
    out = np.zeros((*v.shape, 3))
    out[..., 0, 1], out[..., 0, 2] = -v[..., 2], v[..., 1]
    out[..., 1, 0], out[..., 1, 2] = v[..., 2], -v[..., 0]
    out[..., 2, 0], out[..., 2, 1] = -v[..., 1], v[..., 0]
    return out


def so3_exp(v: Array) -> Array:
    """Return the rotation matrix of the rotation vector ``v`` (Rodrigues' formula). Shape (..., 3) to (..., 3, 3)."""
    x, y, z = v[..., 0], v[..., 1], v[..., 2]
    angle2 = x * x + y * y + z * z
    angle = np.sqrt(angle2)
    small = angle < 1e-4
    safe = np.where(small, 1.0, angle)
    a = np.where(small, 1.0 - angle2 / 6.0, np.sin(safe) / safe)
    b = np.where(small, 0.5 - angle2 / 24.0, (1.0 - np.cos(safe)) / (safe * safe))
    # Written out: for small matrices this is four times faster than forming [v]x and its square.
    ax, ay, az, bx, by = a * x, a * y, a * z, b * x, b * y
    out = np.empty((*v.shape, 3))
    out[..., 0, 0] = 1.0 - by * y - b * z * z
    out[..., 0, 1] = bx * y - az
    out[..., 0, 2] = bx * z + ay
    out[..., 1, 0] = bx * y + az
    out[..., 1, 1] = 1.0 - bx * x - b * z * z
    out[..., 1, 2] = by * z - ax
    out[..., 2, 0] = bx * z - ay
    out[..., 2, 1] = by * z + ax
    out[..., 2, 2] = 1.0 - bx * x - by * y
    return out


def so3_log(R: Array) -> Array:
    """Return the rotation vector of ``R``, angle in [0, pi). Inverse of :func:`so3_exp`. Shape (..., 3, 3) to (...,
    3).
    """
    return np.moveaxis(quaternion_log(_quaternion(R)), 0, -1)


def quaternion(R: Array) -> Array:
    """Return the unit quaternion (w, x, y, z) of ``R`` with w >= 0. Shape (..., 3, 3) to (..., 4)."""
    q = np.moveaxis(_quaternion(R), 0, -1)
    q = q / np.sqrt(np.sum(q * q, axis=-1, keepdims=True))
    upper: Array = np.where(q[..., :1] < 0, -q, q)
    return upper


def _quaternion(R: Array) -> Array:
    """Return a quaternion of ``R`` of any length and sign, components first (Shepperd's method)."""
    m00, m11, m22 = R[..., 0, 0], R[..., 1, 1], R[..., 2, 2]
    x, y, z = R[..., 2, 1] - R[..., 1, 2], R[..., 0, 2] - R[..., 2, 0], R[..., 1, 0] - R[..., 0, 1]
    trace = m00 + m11 + m22
    squares = (1 + trace, 1 + 2 * m00 - trace, 1 + 2 * m11 - trace, 1 + 2 * m22 - trace)
    out = np.empty((4, *trace.shape))
    if (trace > 0).all():  # no turn is large
        out[0], out[1], out[2], out[3] = squares[0], x, y, z
        return out
    xy, xz, yz = R[..., 1, 0] + R[..., 0, 1], R[..., 0, 2] + R[..., 2, 0], R[..., 2, 1] + R[..., 1, 2]
    rows = [squares[0], x, y, z, x, squares[1], xy, xz, y, xy, squares[2], yz, z, xz, yz, squares[3]]
    best = np.argmax(_filled(squares, (4,)), axis=-1)[..., None, None]
    out[:] = np.moveaxis(np.take_along_axis(_filled(rows, (4, 4)), best, axis=-2)[..., 0, :], -1, 0)
    return out


def quaternion_exp(v: Array) -> Array:
    """Return the unit quaternions (w, x, y, z) of rotation vectors, components first. Shape (3, m) to (4, m)."""
    angle = np.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
    out = np.empty((4, v.shape[1]))
    np.cos(0.5 * angle, out=out[0])
    np.multiply(v, np.sin(0.5 * angle) / np.where(angle > 0.0, angle, 1.0), out=out[1:])
    return out


def quaternion_log(q: Array) -> Array:
    """Return the rotation vectors of quaternions of any length, angle in [0, pi], components first. Shape (4, ...) to
    (3, ...).
    """
    norm, along = np.sqrt(q[1] * q[1] + q[2] * q[2] + q[3] * q[3]), np.abs(q[0])
    small = norm < 1e-8 * along
    angle = 2.0 * np.arctan2(norm, along)
    factor = np.where(small, 2.0 / np.where(small, along, 1.0), angle / np.where(small, 1.0, norm))
    return np.asarray(np.copysign(factor, q[0]) * q[1:])


def quaternion_product(p: Array, q: Array) -> Array:
    """Return the quaternions of ``R(p) R(q)``, components first. Shapes (4, m)."""
    out = np.empty(np.broadcast_shapes(p.shape, q.shape))
    out[0] = p[0] * q[0] - p[1] * q[1] - p[2] * q[2] - p[3] * q[3]
    out[1] = p[0] * q[1] + p[1] * q[0] + p[2] * q[3] - p[3] * q[2]
    out[2] = p[0] * q[2] - p[1] * q[3] + p[2] * q[0] + p[3] * q[1]
    out[3] = p[0] * q[3] + p[1] * q[2] - p[2] * q[1] + p[3] * q[0]
    return out


def matrix_from_quaternion(q: Array) -> Array:
    """Return the rotation matrices of unit quaternions, components first. Shape (4, m) to (m, 3, 3)."""
    return matrices(entries_from_quaternion(q))


def entries_from_quaternion(q: Array) -> tuple[Array, ...]:
    """Return the nine entries (m,) of :func:`matrix_from_quaternion`, row by row."""
    w, x, y, z = q
    x2, y2, z2 = 2.0 * x, 2.0 * y, 2.0 * z
    xx, yy, zz, xy, xz, yz = x * x2, y * y2, z * z2, x * y2, x * z2, y * z2
    wx, wy, wz = w * x2, w * y2, w * z2
    first = 1.0 - yy - zz, xy - wz, xz + wy
    second = xy + wz, 1.0 - xx - zz, yz - wx
    return *first, *second, xz - wy, yz + wx, 1.0 - xx - yy


def matrix_from_rpy(roll: Array, pitch: Array, yaw: Array) -> Array:
    """Return ``R_nb = Rz(yaw) Ry(pitch) Rx(roll)``. Shape (...) each to (..., 3, 3)."""
    roll, pitch, yaw = np.broadcast_arrays(*(np.asarray(a, dtype=np.float64) for a in (roll, pitch, yaw)))
    cr, sr, cp, sp, cy, sy = np.cos(roll), np.sin(roll), np.cos(pitch), np.sin(pitch), np.cos(yaw), np.sin(yaw)
    first = cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr
    second = sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr
    return matrices([*first, *second, -sp, cp * sr, cp * cr])


def rpy_from_matrix(R: Array) -> Array:
    """Return (roll, pitch, yaw) of ``R_nb``, yaw in (-pi, pi]. Shape (..., 3, 3) to (..., 3)."""
    roll = np.arctan2(R[..., 2, 1], R[..., 2, 2])
    pitch = np.arcsin(np.clip(-R[..., 2, 0], -1.0, 1.0))
    yaw = np.arctan2(R[..., 1, 0], R[..., 0, 0])
    return _filled([roll, pitch, yaw], (3,))


def euler_rates(rpy: Array) -> Array:
    """Return the matrices that make angular rates in body axes the rates of roll, pitch and yaw. Shape (n, 3) to (n,
    3, 3).
    """
    roll, pitch = rpy[:, 0], rpy[:, 1]
    sin_r, cos_r, cos_p, tan_p = np.sin(roll), np.cos(roll), np.cos(pitch), np.tan(pitch)
    zero = np.zeros(len(rpy))
    first = zero + 1.0, sin_r * tan_p, cos_r * tan_p
    return matrices([*first, zero, cos_r, -sin_r, zero, sin_r / cos_p, cos_r / cos_p])


def body_rates(rpy: Array) -> Array:
    """Return the matrices that make rates of roll, pitch and yaw angular rates in body axes. Shape (n, 3) to (n, 3,
    3).
    """
    roll, pitch = rpy[:, 0], rpy[:, 1]
    sin_r, cos_r, sin_p, cos_p = np.sin(roll), np.cos(roll), np.sin(pitch), np.cos(pitch)
    zero = np.zeros(len(rpy))
    return matrices([zero + 1.0, zero, -sin_p, zero, cos_r, sin_r * cos_p, zero, -sin_r, cos_r * cos_p])


def axes_matrix(axes: str) -> Array:
    """Return the signed permutation that maps sensor columns to FLU, from a string such as ``"RFU"``.

    Letter i says where column i points: F or B, L or R, U or D. Raises ``ValueError`` unless the three letters name
    three different axes of a right-handed or left-handed triad (a left-handed one is accepted here: each column is
    turned on its own; whether it makes sense for a gyro is for the caller to judge).
    """
    directions = {"F": (0, 1.0), "B": (0, -1.0), "L": (1, 1.0), "R": (1, -1.0), "U": (2, 1.0), "D": (2, -1.0)}
    out = np.zeros((3, 3))
    if len(axes) != 3 or any(letter not in directions for letter in axes):
        raise ValueError(f"axes {axes!r}: expected three letters, one of F/B, one of L/R, one of U/D")
    for column, letter in enumerate(axes):
        row, sign = directions[letter]
        out[row, column] = sign
    if abs(abs(np.linalg.det(out)) - 1.0) > 1e-9:
        raise ValueError(f"axes {axes!r}: expected one of F/B, one of L/R and one of U/D, each once")
    return out


def so3_right_jacobian_inverse(v: Array) -> Array:
    """Return ``Jr(v)^-1``, with ``Log(Exp(v) Exp(d)) = v + Jr(v)^-1 d`` to first order. Shape (..., 3) to (..., 3, 3).

    Chirikjian, "Stochastic Models, Information Theory, and Lie Groups", vol. 2, eq. 10.86 (right-hand form).
    """
    angle2 = np.sum(v * v, axis=-1)[..., None, None]
    angle = np.sqrt(angle2)
    small = angle < 1e-3
    safe = np.where(small, 1.0, angle)
    c = np.where(
        small,
        1.0 / 12.0 + angle2 / 720.0,
        1.0 / (safe * safe) - (1.0 + np.cos(safe)) / (2.0 * safe * np.sin(safe)),
    )
    K = skew(v)
    return np.eye(3) + 0.5 * K + c * (K @ K)

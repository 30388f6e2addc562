"""An IMU that integrates: each sample is the average over its interval; :mod:`trackfg.datasets.imu_errors` adds errors.

Noise-free samples over ``[t_k, t_{k+1}]``, ``dt`` long, with ``w`` the Earth's rate in n (zero without a latitude),
``r`` the lever arm and ``omega`` the body rate relative to n:

    gyro  = Log(R_k^T Exp(w dt) R_{k+1}) / dt, so that composing Exp(gyro dt) gives the attitude back exactly;
    accel = mean of f,  f = R^T (a - g) + omega' x r + omega x (omega x r) + 2 R^T w x (v + omega x r)

in body axes. The mean is a two-point Gauss integral over parts within which nothing jumps; the mean of ``omega' x r``
is ``(omega_{k+1} - omega_k) x r / dt``, right even where the rate itself jumps.
"""

from __future__ import annotations

import numpy as np

from trackfg import frames, units
from trackfg.datasets.ride import Ride
from trackfg.description import Vector3
from trackfg.frames import Array

_CHUNK = 100_000
_GAUSS = 0.5 / np.sqrt(3.0)


def ideal_samples(
    ride: Ride, edges: Array, latitude_deg: float | None, lever_arm_m: Vector3 = (0.0, 0.0, 0.0)
) -> tuple[Array, Array]:
    """Noise-free angular rates and specific forces (n, 3) over the intervals between ``edges`` (n + 1,)."""
    kinks = ride.kinks_s()
    parts = [
        _ideal_chunk(ride, edges[start : start + _CHUNK + 1], kinks, latitude_deg, np.array(lever_arm_m))
        for start in range(0, len(edges) - 1, _CHUNK)
    ]
    return np.concatenate([gyro for gyro, _ in parts]), np.concatenate([accel for _, accel in parts])


def gravity(latitude_deg: float | None) -> float:
    """What the world uses for gravity, m/s^2: the ellipsoid's at the latitude, the standard one without a latitude."""
    return units.STANDARD_GRAVITY if latitude_deg is None else frames.normal_gravity(latitude_deg)


def _ideal_chunk(
    ride: Ride, edges: Array, kinks: Array, latitude_deg: float | None, lever_arm: Array
) -> tuple[Array, Array]:
    dt = np.diff(edges)[:, None]
    earth = np.zeros(3) if latitude_deg is None else frames.earth_rate_enu(latitude_deg)
    R = ride.rotation(edges)
    turning = _frame_rate(ride, 0.5 * (edges[1:] + edges[:-1]), earth)
    after = frames.so3_exp(turning * dt) @ R[1:]
    gyro = frames.so3_log(np.swapaxes(R[:-1], 1, 2) @ after) / dt

    nodes = np.union1d(edges, kinks[(kinks > edges[0]) & (kinks < edges[-1])])
    lengths = np.diff(nodes)
    middles = 0.5 * (nodes[1:] + nodes[:-1])
    g = gravity(latitude_deg)
    integral = np.zeros((len(lengths), 3))
    for side in (-_GAUSS, _GAUSS):
        integral += 0.5 * lengths[:, None] * _specific_force(ride, middles + side * lengths, g, earth, lever_arm)
    accel = np.add.reduceat(integral, np.searchsorted(nodes, edges[:-1])) / dt
    if lever_arm.any():
        accel += np.cross(np.diff(ride.body_rate(edges), axis=0), lever_arm) / dt
    return gyro, accel


def _specific_force(ride: Ride, t: Array, g: float, earth: Array, lever_arm: Array) -> Array:
    """Specific force at the lever arm less ``omega' x r``, body axes. Shape (n,) to (n, 3)."""
    v, omega, rpy = ride.motion.speed(t), ride.body_rate(t), ride.rpy(t)
    roll, pitch = rpy[:, 0], rpy[:, 1]
    up = np.column_stack([-np.sin(pitch), np.cos(pitch) * np.sin(roll), np.cos(pitch) * np.cos(roll)])
    force = g * up + np.column_stack([ride.motion.acceleration(t), v * omega[:, 2], -v * omega[:, 1]])
    swing = np.cross(omega, lever_arm)
    if lever_arm.any():
        force += np.cross(omega, swing)
    velocity = swing + np.column_stack([v, np.zeros_like(v), np.zeros_like(v)])
    coriolis = earth + _frame_rate(ride, t, earth)
    force += np.cross(np.einsum("ni,nij->nj", coriolis, frames.matrix_from_rpy(*rpy.T)), velocity)
    return np.asarray(force)


def _frame_rate(ride: Ride, t: Array, earth: Array) -> Array:
    """How the level frame n turns, rad/s in n: with the Earth, and over its curvature. Shape (n, 3)."""
    forward = frames.matrix_from_rpy(*ride.rpy(t).T)[:, :, 0]
    return earth + frames.transport_rate(forward * ride.motion.speed(t)[:, None])

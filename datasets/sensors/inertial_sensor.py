"""An IMU that integrates: each sample is the average over its interval; :mod:`trackfg.datasets.sensors.imu_errors` adds
errors.

Noise-free samples over ``[t_k, t_{k+1}]``, ``dt`` long, with ``w`` the rate at which the level frame n turns (with the
Earth, zero without a latitude, and over its curvature), ``r`` the lever arm and ``omega`` the body rate relative to n:

    gyro  = Log(R_k^T Exp(mean w dt) R_{k+1}) / dt, so that composing Exp(gyro dt) gives the attitude back exactly;
    accel = mean of f,  f = R^T (a - g) + omega' x r + omega x (omega x r) + R^T (w + Earth's rate) x (v + omega x r)

in body axes. The means are two-point Gauss integrals over parts within which nothing jumps; the mean of ``omega' x r``
is ``(omega_{k+1} - omega_k) x r / dt``, right even where the rate itself jumps, and where the velocity jumps its step
over ``dt`` is added.
"""

from __future__ import annotations

import numpy as np

from trackfg.datasets.vehicle.ride import Kinematics, Ride
from trackfg.numerics import geodesy, rotations, units
from trackfg.numerics.arrays import Array
from trackfg.recording.description import Vector3

_CHUNK = 20_000
"""Samples at a time: few enough for the processor's cache, and enough that calls are not what takes the time."""
_GAUSS = 0.5 / np.sqrt(3.0)


def ideal_samples(
    ride: Ride, edges: Array, latitude_deg: float | None, lever_arm_m: Vector3 = (0.0, 0.0, 0.0)
) -> tuple[Array, Array]:
    """Return noise-free angular rates and specific forces (n, 3) over the intervals between ``edges`` (n + 1,)."""
    kinks = ride.kinks_s()
    parts = [
        _ideal_chunk(ride, edges[start : start + _CHUNK + 1], kinks, latitude_deg, np.array(lever_arm_m))
        for start in range(0, len(edges) - 1, _CHUNK)
    ]
    gyro, accel = (np.concatenate(arrays) for arrays in zip(*parts, strict=True))
    return gyro, accel + _knocks(ride, edges)


def gravity(latitude_deg: float | None) -> float:
    """Return what the world uses for gravity, m/s^2: the ellipsoid's at the latitude, the standard one without a
    latitude.
    """
    return units.STANDARD_GRAVITY if latitude_deg is None else geodesy.normal_gravity(latitude_deg)


def _ideal_chunk(
    ride: Ride, edges: Array, kinks: Array, latitude_deg: float | None, lever_arm: Array
) -> tuple[Array, Array]:
    dt = np.diff(edges)[:, None]
    earth = np.zeros(3) if latitude_deg is None else geodesy.earth_rate_enu(latitude_deg)
    inside = kinks[np.searchsorted(kinks, edges[0], side="right") : np.searchsorted(kinks, edges[-1])]
    nodes = np.union1d(edges, inside)
    lengths = np.diff(nodes)
    first = np.searchsorted(nodes, edges[:-1])

    def mean(values: Array) -> Array:
        """Return the mean over each interval of values (2 per part, 3) at the Gauss points."""
        integral = 0.5 * lengths[:, None] * (values[::2] + values[1::2])
        return np.asarray(np.add.reduceat(integral, first) / dt)

    middles = 0.5 * (nodes[1:] + nodes[:-1])
    moment = ride.kinematics(np.stack([middles - _GAUSS * lengths, middles + _GAUSS * lengths], axis=-1).ravel())
    turning = earth + mean(geodesy.transport_rate(moment.velocity_in_n))
    accel = mean(_specific_force(moment, gravity(latitude_deg), earth, lever_arm))
    if lever_arm.any():
        accel += np.cross(np.diff(ride.body_rate(edges), axis=0), lever_arm) / dt
    R = ride.rotation(edges)
    end_R = rotations.so3_exp(turning * dt) @ R[1:]
    gyro = rotations.so3_log(np.swapaxes(R[:-1], 1, 2) @ end_R) / dt
    return gyro, accel


def _specific_force(moment: Kinematics, g: float, earth: Array, lever_arm: Array) -> Array:
    """Return the specific force at the lever arm less ``omega' x r``, body axes. Shape (n, 3)."""
    c, s = np.cos(moment.heading), np.sin(moment.heading)
    earth_level = np.column_stack([c * earth[0] + s * earth[1], c * earth[1] - s * earth[0], np.full_like(c, earth[2])])
    coriolis = 2.0 * earth_level + geodesy.transport_rate(moment.velocity)
    force = moment.acceleration + np.cross(coriolis, moment.velocity)
    force[:, 2] += g
    force = _turned(moment.body_from_level, force)
    if lever_arm.any():
        swing = np.cross(moment.body_rate, lever_arm)
        force += np.cross(moment.body_rate + _turned(moment.body_from_level, coriolis), swing)
    return force


def _knocks(ride: Ride, edges: Array) -> Array:
    """Return what jumps of the velocity add to the means, body axes. Shape (n, 3)."""
    knocks = np.zeros((len(edges) - 1, 3))
    times, jumps = ride.velocity_jumps()
    during = (times > edges[0]) & (times < edges[-1])
    times, jumps = times[during], jumps[during]
    interval = np.searchsorted(edges, times, side="right") - 1
    forward = ride.kinematics(times).body_from_level[:, :, 0]
    np.add.at(knocks, interval, forward * (jumps / np.diff(edges)[interval])[:, None])
    return knocks


def _turned(R: Array, vectors: Array) -> Array:
    return np.asarray((R @ vectors[:, :, None])[:, :, 0])

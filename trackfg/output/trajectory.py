"""The trajectory table: the states in a user's terms, each quantity with its posterior sigma."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pandas as pd

from trackfg.factors.motion import TRACKING_POINT, mount_axes, mount_matrix, tracking_point
from trackfg.factors.states import KEYFRAME_DIM, SHARED_DIM, Kind, Odo, States, offset_in_keyframe
from trackfg.graph.run_context import RunContext
from trackfg.numerics.arrays import Array
from trackfg.numerics.float_table import float_table
from trackfg.numerics.kernels import compiled_kernels, kernel_argument
from trackfg.numerics.rotations import cross, euler_rates, matrices_times, rpy_from_matrix, skew
from trackfg.output.dense_motion import DenseMotion
from trackfg.solver.covariance import Covariance

QUANTITIES = ("chainage_m", "east_m", "north_m", "up_m", "speed_mps", "roll_rad", "pitch_rad", "yaw_rad")

_COLUMNS = tuple(column for name in QUANTITIES for column in (name, f"{name}_sd"))
"""Quantities and their sigmas, in the order of the table."""

_POINT = slice(KEYFRAME_DIM + TRACKING_POINT.start, KEYFRAME_DIM + TRACKING_POINT.stop)
"""The place of the point that follows the track, among a keyframe's and the shared variables."""


def trajectory_table(run: RunContext, motion: DenseMotion, states: States, covariance: Covariance) -> pd.DataFrame:
    """Return the table of :func:`trajectory_columns`."""
    return float_table(trajectory_columns(run, motion, states, covariance))


def trajectory_columns(
    run: RunContext, motion: DenseMotion, states: States, covariance: Covariance
) -> dict[str, Array]:
    """Return one row per entry of ``motion``: time, the quantities of the vehicle, and their sigmas.

    East, north and up are those of the vehicle reference point; chainage and speed those of the point that follows the
    track, so that one is the other's derivative: wherever the sensor sits, a pitching body does not change them.
    Sigmas are those of the keyframes on either side, their variances interpolated in time, and what the white ``noise``
    of the inertial samples adds in between: to speed and attitude a Brownian bridge, to place and chainage that bridge
    integrated and pinned in slope too; and what their speeds' errors do to the cubic between. The speed has also the
    noise of the row's own body rate, at its lever arm, and what is unknown of that. Yaw is in (-pi, pi].
    """
    spread = _spread(states, covariance, run.lever_arm, run.mount_roll_sd)
    rows = _by_kernel if compiled_kernels() else _by_arrays
    columns = rows(run, motion, states, covariance, spread).T
    return {"t_s": motion.t, **dict(zip(_COLUMNS, columns, strict=True))}


class _Spread(NamedTuple):
    """The ``variance`` (n, 8) of the quantities at keyframes, and the covariance of the speed with the point that
    follows the track, ``with_point`` (n, 3).
    """

    variance: Array
    with_point: Array


def _by_arrays(run: RunContext, motion: DenseMotion, states: States, covariance: Covariance, spread: _Spread) -> Array:
    """Return the quantities of the rows and their sigmas, in turns, shape (m, 16), from those of the keyframes."""
    variance, with_point = spread
    R_bt = mount_matrix(states.mount)[0]
    nav = motion.nav
    rpy = rpy_from_matrix(matrices_times(nav.R, R_bt))
    lever_arm, noise = run.lever_arm, run.noise
    p = nav.p - matrices_times(nav.R, lever_arm)
    arm = lever_arm - tracking_point(states.mount)[0]
    on_track = nav.own_velocity - cross(motion.gyro, arm[None])
    forward = R_bt[:, 0]
    columns = [run.direction * motion.distance, *p.T, on_track @ forward, *rpy.T]
    k, f = motion.keyframe, motion.fraction[:, None]
    span, h = (run.t[1:] - run.t[:-1])[k], motion.fraction
    bridge = span * h * (1.0 - h)
    between = variance[k] * (1.0 - f) + variance[k + 1] * f
    swing = (span * h * (1.0 - h)) ** 2 * ((1.0 - h) ** 2 * variance[k, 4] + h**2 * variance[k + 1, 4])
    accel, gyro = np.mean(noise.accel**2, axis=1)[k], noise.gyro[k] ** 2
    between[:, :4] += (accel * bridge**3 / 3.0 + swing)[:, None]
    between[:, 4] += accel * bridge + gyro @ (skew(arm) @ forward) ** 2 / motion.gyro_span
    swung = cross(forward[None], motion.gyro)
    between[:, 4] += np.einsum("mi,ij,mj->m", swung, covariance.of_shared[TRACKING_POINT, TRACKING_POINT], swung)
    between[:, 4] += 2.0 * np.sum((with_point[k] * (1.0 - f) + with_point[k + 1] * f) * swung, axis=1)
    between[:, 5:8] += gyro * bridge[:, None]
    return np.stack([np.column_stack(columns), np.sqrt(between)], axis=2).reshape(len(motion.t), -1)


def _by_kernel(run: RunContext, motion: DenseMotion, states: States, covariance: Covariance, spread: _Spread) -> Array:
    """Do as :func:`_by_arrays`, in ``kernels/quantities.cpp``."""
    from trackfg.numerics import compiled

    nav, out = motion.nav, np.empty((len(motion.t), len(_COLUMNS)))
    moves = (nav.R, nav.p, nav.v, motion.gyro, motion.distance, motion.fraction, motion.gyro_span)
    inputs = (run.t, run.noise.accel, run.noise.gyro, *spread)
    of_point = covariance.of_shared[TRACKING_POINT, TRACKING_POINT]
    compiled.trajectory_rows(
        tuple(map(kernel_argument, moves)),
        tuple(map(kernel_argument, inputs)),
        *(kernel_argument(states.mount[0]), kernel_argument(run.lever_arm), float(run.direction)),
        *(kernel_argument(of_point), np.ascontiguousarray(motion.keyframe, dtype=np.int64), out),
    )
    return out


def keyframe_variances(states: States, covariance: Covariance, lever_arm: Array, mount_roll_sd: float = 0.0) -> Array:
    """Return variances of the quantities at the keyframes, shape (n, 8), in the order of :data:`QUANTITIES`.

    ``mount_roll_sd``, rad, is the uncertainty of the mounting's roll: it adds to that of the vehicle's roll.
    """
    return _spread(states, covariance, lever_arm, mount_roll_sd).variance


def _spread(states: States, covariance: Covariance, lever_arm: Array, mount_roll_sd: float) -> _Spread:
    spread = _spread_by_kernel if compiled_kernels() else _spread_by_arrays
    variance, with_point = spread(states, covariance, lever_arm)
    variance[:, QUANTITIES.index("roll_rad")] += mount_roll_sd**2
    return _Spread(variance, with_point)


def _spread_by_arrays(states: States, covariance: Covariance, lever_arm: Array) -> _Spread:
    J = keyframe_jacobian(states, lever_arm)[:, :, : _POINT.stop]  # no quantity depends on what is behind
    propagated = covariance.propagated(J)
    return _Spread(np.asarray(np.sum(propagated * J, axis=2)), propagated[:, QUANTITIES.index("speed_mps"), _POINT])


def _spread_by_kernel(states: States, covariance: Covariance, lever_arm: Array) -> _Spread:
    """Do as :func:`_spread_by_arrays`, in ``kernels/quantities.cpp``, where no zero of a derivative is multiplied."""
    from trackfg.numerics import compiled

    spread = _Spread(np.empty((len(states), len(QUANTITIES))), np.empty((len(states), 3)))
    R, v, mount, arm = map(kernel_argument, (states.nav.R, states.nav.v, states.mount[0], lever_arm))
    of_keyframes, of_shared = map(kernel_argument, (covariance.of_keyframes, covariance.of_shared))
    compiled.quantity_variances(R, v, mount, arm, of_keyframes, of_shared, spread.variance, spread.with_point)
    return spread


def keyframe_jacobian(states: States, lever_arm: Array) -> Array:
    """Return the derivatives of :data:`QUANTITIES` by the stacked tangent of a keyframe and the shared variables: (n,
    8, d).
    """
    nav, mount, n = states.nav, states.mount, len(states)
    if compiled_kernels():
        from trackfg.numerics import compiled

        J = np.empty((n, len(QUANTITIES), KEYFRAME_DIM + SHARED_DIM))
        R, v, of_mount, arm = map(kernel_argument, (nav.R, nav.v, mount[0], lever_arm))
        compiled.quantities(R, v, of_mount, arm, J)
        return J
    odo, at = offset_in_keyframe(Kind.ODO), offset_in_keyframe(Kind.NAV)
    turn, shift, faster = slice(at, at + 3), slice(at + 3, at + 6), slice(at + 6, at + 9)
    mounting = slice(KEYFRAME_DIM, KEYFRAME_DIM + 2)
    R_bt = mount_matrix(mount)[0]
    rpy = rpy_from_matrix(nav.R @ R_bt)

    J = np.zeros((n, len(QUANTITIES), KEYFRAME_DIM + SHARED_DIM))
    J[:, 0, odo + Odo.DISTANCE] = 1.0
    J[:, 1:4, turn] = nav.R @ skew(lever_arm)
    J[:, 1:4, shift] = nav.R
    forward = R_bt[:, 0]
    J[:, 4, turn] = np.einsum("i,nij->nj", forward, skew(nav.own_velocity))
    J[:, 4, faster] = forward

    euler = euler_rates(rpy)
    by_mount = R_bt.T @ mount_axes(mount)[0]
    J[:, 5:8, turn] = euler @ R_bt.T
    J[:, 5:8, mounting] = euler @ by_mount
    return J

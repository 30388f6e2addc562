"""The force balance: the specific force that angular rates and speed imply, compared in a band of seconds.

A body that moves with the velocity v along its x axis e_x has the specific force

    f = dv/dt e_x + v w x e_x + g u,   du/dt = u x w,

u being the upward direction in body axes, on the right-hand side the mean one, but for what the slow part of
f_x - dv/dt shows of its x component: grades change along a line, and curves turn by a radian. If each rate is a mixture
of what the gyro's columns y_j show, w_i = sum_j P_ij y_j, then f is linear in P:

    f = dv/dt e_x + sum_ij P_ij T_ij,   T_ij = v y_j (e_i x e_x) + g int (u x e_i) y_j dt.

All terms are band-passed alike: constant biases of force and integrated rate, slow gradients, vibration and pulses are
left out. What a constant gyro bias leaves in the lateral and the vertical equation is proportional to v, and is
projected out of all terms there.

A sensor that is tilted, or whose accelerometer has a bias, errs in u and in e_x by small constants. Their products with
the largest motions are the same in form for every P, up to the column y_j about the vertical: with the angle turned in
all three equations, with the tach's acceleration too, and with v y_j along and upwards (:meth:`ForceBalance.by_tilt`).
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from trackfg.checks.diagnosis_clock import tach_acceleration
from trackfg.numerics.arrays import Array
from trackfg.numerics.spans import median_interval
from trackfg.numerics.units import STANDARD_GRAVITY
from trackfg.sensors.averages import Motion, averaged, band_passed

_STEP_S = 0.25
"""Intervals of the averages, s: a quarter of the shortest period that passes the band."""
_SHORT_S, _LONG_S = 1.0, 6.0
"""Standard deviations of the band's two Gaussian averages, s: slower than vibration and springs, faster than the drift
of integrated rates; curves, transitions, stops and starts of rail and road vehicles lie between."""
_BLOCK_S = 10.0
"""Length of a block, s: longer than the band's memory, so that blocks are evidence nearly independent of each other."""
FEWEST_BLOCKS = 5
"""With fewer blocks their scatter is not estimated."""


@dataclass(frozen=True)
class ForceBalance:
    """The terms of the force balance by equation (x, y, z), in the band, at n times in blocks.

    ``force`` (3, n), m/s^2; ``terms`` (3, 3, 3, n): equation, i, j of T_ij; ``acceleration`` (n,) is the tach's;
    ``turned`` (3, n), rad, and ``moving`` (3, n), m/s^2, are the integral of each column and its product with the
    speed; ``block`` (n,): the index of each time's block; blocks begin with the IMU's record.
    """

    force: Array
    terms: Array
    acceleration: Array
    turned: Array
    moving: Array
    block: NDArray[np.int64]

    def block_sums(self, values: Array) -> Array:
        """Return sums over blocks of values (..., n). Shape (..., blocks)."""
        first = np.flatnonzero(np.diff(self.block, prepend=-1))
        return np.asarray(np.add.reduceat(values, first, axis=-1), dtype=np.float64)

    @property
    def whole_blocks(self) -> NDArray[np.int64]:
        """The blocks without a part missing."""
        counts = np.bincount(self.block)
        return np.flatnonzero(counts == counts.max())

    def by_tilt(self, equation: int, vertical: int) -> Array:
        """Return an orthonormal basis (n, k) of what small tilts leave in an equation, if column ``vertical`` is z."""
        columns = self.tilt_columns(equation, vertical)
        sizes = [max(float(np.linalg.norm(column)), 1e-12) for column in columns]
        basis, _ = np.linalg.qr(np.stack([column / size for column, size in zip(columns, sizes, strict=True)], axis=1))
        return np.asarray(basis)

    def tilt_columns(self, equation: int, vertical: int) -> list[Array]:
        """Return what small tilts multiply in an equation, each (n,): the tach's acceleration first."""
        columns = [self.acceleration, self.turned[vertical]]
        if equation != 1:  # across, the product with the speed is what is looked for
            columns.append(self.moving[vertical])
        return columns

    def predicted(self, P: Array) -> Array:
        """Return what the gyro implies of the force if its columns are mixed by ``P`` (3, 3). Shape (3, n)."""
        return np.asarray(np.tensordot(P, self.terms, axes=((0, 1), (1, 2))), dtype=np.float64)


def force_balance(imu: pd.DataFrame, tach: pd.DataFrame, *, speed_scale: float = 1.0) -> ForceBalance | None:
    """Return the balance of an ``imu`` table and a ``tach`` table on its clock; None for less than five blocks.

    ``speed_scale``: what the tach's speed is multiplied by; negative where it counts backwards.
    """
    motion = averaged(imu, tach, _STEP_S)
    if motion is None or motion.t_s.size * motion.step_s < FEWEST_BLOCKS * _BLOCK_S or not motion.valid.any():
        return None
    short_s = max(_SHORT_S, median_interval(tach["t_s"].to_numpy()))
    speed = speed_scale * motion.speed
    up = np.median(motion.accel[motion.valid], axis=0)
    up = up / max(float(np.linalg.norm(up)), 1e-9)

    def banded(values: Array) -> Array:
        return band_passed(values, motion.valid, motion.step_s, short_s, _LONG_S)

    rate = motion.gyro - np.median(motion.gyro[motion.valid], axis=0)
    acceleration = speed_scale * tach_acceleration(motion)
    upwards = np.tile(up, (len(rate), 1))
    upwards[:, 0] = _slow(motion.accel[:, 0] - acceleration, motion) / STANDARD_GRAVITY

    def turned_by(rates: Array) -> Array:
        return np.asarray(motion.step_s * (np.cumsum(rates, axis=-1) - 0.5 * rates))

    moving = np.array([banded(column) for column in (speed[:, None] * rate).T])
    turned = np.array([banded(turned_by(column)) for column in rate.T])
    axes = np.eye(3)
    inward, tilt = np.cross(axes, axes[0]), STANDARD_GRAVITY * np.cross(upwards[:, None], axes)
    terms = inward.T[:, :, None, None] * moving
    for equation, i, j in itertools.product(range(3), repeat=3):
        if i != equation:
            terms[equation, i, j] += banded(turned_by(tilt[:, i, equation] * rate[:, j]))
    force = np.array([banded(column) for column in motion.accel.T])
    acceleration = banded(acceleration)
    steady = banded(speed)
    steady /= max(float(np.linalg.norm(steady)), 1e-9)
    force[1:] -= (force[1:] @ steady)[..., None] * steady
    terms[1:] -= (terms[1:] @ steady)[..., None] * steady
    block = ((motion.t_s - float(imu["t_s"].iloc[0])) // _BLOCK_S).astype(np.int64)
    return ForceBalance(force, terms, acceleration, turned, moving, block)


def _slow(values: Array, motion: Motion) -> Array:
    """Return ``values`` (n,) of the motion's intervals averaged over :data:`_LONG_S`, those without data bridged."""
    index = np.arange(values.size)
    bridged = np.interp(index, index[motion.valid], values[motion.valid])
    return np.asarray(gaussian_filter1d(bridged, _LONG_S / motion.step_s))

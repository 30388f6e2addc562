"""Specific force against what tach and gyro imply of it: scales, signs and columns.

*Forward:* where another axis follows the tach's acceleration better than the declared one, it is tried as the forward
axis of both sensors, with the tach's lag that fits it; it is taken where the horizontal force that is left unexplained
refuses the declared one (:func:`trackfg.checks.diagnosis_gyro.is_refused`). Backwards is where the slope is negative.

*Columns:* which column of the gyro belongs to which axis of the accelerometer, no reflection can show: mirrored forces
and rates (which are pseudovectors) satisfy the same equations. One wrong sign of the lateral force looks like wrong
signs of roll and yaw rate; of two such explanations the one that edits one sensor, and fewer columns, is given.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from trackfg.checks.diagnosis_axes import AxesEstimate
from trackfg.checks.diagnosis_clock import ClockOffset, estimate_clock_offset, on_imu_clock
from trackfg.checks.diagnosis_gyro import estimate_gyro_columns, is_refused, unexplained
from trackfg.checks.diagnosis_speed import Angle, Slope, forward_slope, lateral_slope, turned_aside
from trackfg.checks.force_balance import FEWEST_BLOCKS, ForceBalance, force_balance
from trackfg.numerics.arrays import Array
from trackfg.recording.model import IMU_COLUMNS, Recording

Signs = tuple[tuple[int, ...], ...]
"""A signed permutation (3, 3) by rows, ready for JSON."""

_DECLARED: Signs = ((1, 0, 0), (0, 1, 0), (0, 0, 1))
_MIRROR = np.diag([1.0, -1.0, 1.0])
_CORRELATION = 0.5
"""A slope with less says nothing about a sign."""
_SURE_CORRELATION = 0.8
"""A slope that is to be put right before the columns are judged has at least this correlation."""


@dataclass(frozen=True)
class ForceFit:
    """``forward`` and ``lateral``: slopes of :mod:`trackfg.checks.diagnosis_speed`. ``accel`` and ``gyro``: the
    vehicle's axes from the declared ones, by what the data show. ``contradiction``: the power of force that the
    declared columns leave unexplained over what the best ones leave. ``pitch`` and ``yaw``: how far the sensor points
    below the direction of travel and to the left of it, as it is declared; None where the columns are wrong, too.
    """

    forward: Slope | None
    lateral: Slope | None
    contradiction: float
    accel: Signs
    gyro: Signs
    pitch: Angle | None = None
    yaw: Angle | None = None

    @property
    def axes_are_wrong(self) -> bool:
        """Return whether both sensors are turned against what is declared, and agree."""
        return self.accel == self.gyro != _DECLARED

    @property
    def columns_are_wrong(self) -> bool:
        """Return whether gyro and accelerometer contradict each other as they are declared."""
        return self.accel != self.gyro


def fit_force(recording: Recording, axes: AxesEstimate, clock: ClockOffset | None) -> ForceFit | None:
    """Compare specific force with what tach and gyro imply; None without a tach and for too short a time.

    ``clock``: the tach's, by the forward axis as declared. Speeds that are surely scaled wrongly are put right before
    columns are judged.
    """
    facing = _facing_forward(recording, axes, clock)
    if facing is None:
        return None
    turn, balance = facing.turn, facing.balance
    rough = forward_slope(balance, np.zeros((3, 3))), lateral_slope(balance, np.eye(3))
    sure = [slope.value for slope in rough if slope is not None and _is_surely_scaled(slope)]
    scaled = balance if not sure else force_balance(facing.imu, facing.tach, speed_scale=sure[0]) or balance
    gyro_columns = estimate_gyro_columns(scaled)
    accel, gyro = _fewest_edits(turn, gyro_columns.matrix @ turn) if gyro_columns.is_wrong else (turn, turn)
    as_declared = np.array_equal(turn, np.eye(3)) and not gyro_columns.is_wrong
    pitch, yaw = turned_aside(scaled) if as_declared else (None, None)
    return ForceFit(
        forward_slope(balance, gyro_columns.matrix),
        lateral_slope(scaled, gyro_columns.matrix),
        gyro_columns.contradiction,
        _by_rows(accel),
        _by_rows(gyro),
        pitch,
        yaw,
    )


@dataclass(frozen=True)
class _Facing:
    """A recording with the x axis of both sensors forward after a ``turn`` (3, 3), with its force balance and the power
    of horizontal force that the best columns leave, by whole blocks.
    """

    turn: Array
    imu: pd.DataFrame
    tach: pd.DataFrame
    balance: ForceBalance
    power: pd.Series


def _facing_forward(recording: Recording, axes: AxesEstimate, clock: ClockOffset | None) -> _Facing | None:
    """Return the recording as declared; turned as proposed where what is declared is refused."""
    declared = _facing(recording, np.eye(3), clock)
    if declared is None or axes.proposed == axes.declared:
        return declared
    turned = _turned(recording, axes.turn)
    proposed = _facing(turned, axes.turn, estimate_clock_offset(turned))
    if proposed is None:
        return declared
    if axes.best_forward == "-x":
        slope = forward_slope(declared.balance, np.zeros((3, 3)))
        is_backwards = slope is not None and slope.high < 0.0 and slope.correlation < -_CORRELATION
        return proposed if is_backwards else declared
    shared = declared.power.index.intersection(proposed.power.index)
    residual_power, other = (facing.power[shared].to_numpy() for facing in (declared, proposed))
    return proposed if shared.size >= FEWEST_BLOCKS and is_refused(residual_power, other) else declared


def _turned(recording: Recording, turn: Array) -> Recording:
    imu = recording.imu.copy()
    for columns in (IMU_COLUMNS[1:4], IMU_COLUMNS[4:7]):
        imu[list(columns)] = recording.imu[list(columns)].to_numpy() @ turn.T
    return replace(recording, imu=imu)


def _facing(recording: Recording, turn: Array, clock: ClockOffset | None) -> _Facing | None:
    if recording.tach is None:
        return None
    tach = on_imu_clock(recording.tach, clock)
    balance = force_balance(recording.imu, tach)
    if balance is None:
        return None
    power = unexplained(balance)[:, :2].sum(axis=1)
    by_block = pd.Series(power[int(np.argmin(power.sum(axis=1)))], index=np.unique(balance.block))
    return _Facing(turn, recording.imu, tach, balance, by_block[balance.whole_blocks])


def _is_surely_scaled(slope: Slope) -> bool:
    return slope.correlation > _SURE_CORRELATION and slope.excludes(0.5, 2.0)


def _fewest_edits(accel: Array, gyro: Array) -> tuple[Array, Array]:
    """Return the explanation or its mirror image, whichever edits fewer sensors and columns."""

    def edits(pair: tuple[Array, Array]) -> tuple[int, int]:
        columns = [int(np.any(matrix != np.eye(3), axis=1).sum()) for matrix in pair]
        return int(np.count_nonzero(columns)), sum(columns)

    return min((accel, gyro), (_MIRROR @ accel, -_MIRROR @ gyro), key=edits)


def _by_rows(matrix: Array) -> Signs:
    return tuple(tuple(round(value) for value in row) for row in matrix.tolist())

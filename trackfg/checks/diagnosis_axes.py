"""Gravity and the tach, or else a receiver's speeds or positions, show which way the IMU's columns point.

* Up: at rest and on average, specific force points up.
* Forward: ``f_x = dv/dt - g sin(pitch)`` correlates with the tach's acceleration; backwards, the sign is negative.
  Without a tach it is that of the receiver's own speeds, else of the positions, along chords of some seconds: the band
  is slower then. An axis is shown where it correlates surely better than the other one across gravity.
* Left: ``f_y = v w_z + g sin(roll)`` and ``d roll/dt = w_x`` give ``f_y = v w_z + g int w_x dt``, with cant or without.
  The slope of f_y on the right-hand side is 1; it is negative where gyro and accelerometer disagree in sign, and pi/180
  (180/pi) where the gyro is in deg/s (rad/s) but declared otherwise.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
import pandas as pd

from trackfg.checks.diagnosis_clock import lagged_correlation, tach_acceleration
from trackfg.checks.diagnosis_positions import path_along, path_of
from trackfg.numerics import rotations
from trackfg.numerics.arrays import Array
from trackfg.numerics.units import STANDARD_GRAVITY
from trackfg.recording.model import IMU_COLUMNS
from trackfg.sensors.averages import Motion, averaged, band_passed

_STEP_S = 0.25
"""Step of the averages that are compared, s: the band holds nothing faster."""
_SHORT_S, _LONG_S = 0.6, 6.0
"""Standard deviations of the two averages between which the band lies, s: vibration is faster, gradients are slower."""
_MIN_ACCELERATION = 0.01
"""m/s^2, rms in the band: below it the motion does not show which axis points forward."""
_MIN_LATERAL = 0.005
"""m/s^2, rms in the band: below it the run has no curves that show a slope."""
_MIN_CORRELATION = 0.5
"""An axis is shown from this correlation on: then a quarter of its force's power is the acceleration's."""


class Comparison(NamedTuple):
    """Settings of the comparison of acceleration with forces: the averages' standard deviations, longest lag, least
    time, s.
    """

    short_s: float
    long_s: float
    max_lag_s: float
    least_s: float


BY_TACH = Comparison(_SHORT_S, _LONG_S, max_lag_s=20.0, least_s=10.0)
BY_RECEIVER = Comparison(2.0, 12.0, max_lag_s=3.0, least_s=120.0)
"""Chords of positions last 4 s, and a receiver is late by up to 2 s. In five records of 600 s and more, one of them a
car's, other axes than the forward one correlate by less than 0.3."""
_SURE = 2.0
"""Sigmas by which Fisher's transforms of the correlations of two axes differ where one of them is shown."""

AXES = tuple(
    "".join(letters)
    for pairs in itertools.permutations(("FB", "LR", "UD"))
    for letters in itertools.product(*pairs)
    if np.linalg.det(rotations.axes_matrix("".join(letters))) > 0
)
"""The 24 right-handed triads."""


ForwardBy = Literal["tach", "receiver", "positions"]


@dataclass(frozen=True)
class AxesEstimate:
    """``proposed`` is the axes string that the data suggest; equal to ``declared`` where they agree with it.

    ``up`` is the direction of gravity's reaction in the declared vehicle axes, ``tilt_deg`` its angle from vertical,
    ``magnitude_mps2`` the median specific force. ``forward_correlation`` is that of the declared forward axis with the
    acceleration of what ``forward_by`` names, ``best_forward`` the axis (``"+x"`` ... ``"-z"``, declared) with the
    highest one; None where no acceleration is shown. ``shown_by``: whether ``proposed`` is due to gravity alone, or to
    motion as well. ``lateral_correlation`` and ``gyro_slope`` are those of the third relation.
    """

    declared: str
    proposed: str
    up: tuple[float, float, float]
    tilt_deg: float
    magnitude_mps2: float
    forward_by: ForwardBy | None = None
    forward_correlation: float | None = None
    best_forward: str | None = None
    best_forward_correlation: float | None = None
    shown_by: Literal["gravity", "motion"] = "gravity"
    lateral_correlation: float | None = None
    gyro_slope: float | None = None

    @property
    def turn(self) -> Array:
        """The rotation (3, 3) from the declared to the proposed axes."""
        return rotations.axes_matrix(self.proposed) @ rotations.axes_matrix(self.declared).T


def estimate_axes(
    imu: pd.DataFrame,
    tach: pd.DataFrame | None,
    declared: str,
    gnss: pd.DataFrame | None = None,
    speeds: pd.DataFrame | None = None,
) -> AxesEstimate:
    """Return the estimate of the axes of the ``imu`` table, which was read with ``imu.axes = declared``.

    ``speeds`` of a receiver count without a ``tach``, and its positions ``gnss`` without either.
    """
    up = mean_specific_force(imu)
    magnitude = float(np.linalg.norm(up))
    up = up / magnitude if magnitude > 0 else np.array([0.0, 0.0, 1.0])
    motion = None if tach is None else averaged(imu, tach, _STEP_S)
    by: ForwardBy = "tach"
    correlations = None if motion is None else forward_correlations(motion)
    if tach is None:
        by, correlations = _by_receiver(imu, gnss, speeds)
    forward = None if correlations is None else _forward_axis(correlations, up, by, np.ptp(imu["t_s"]))
    lateral = None if motion is None else lateral_balance(motion)
    shown = forward is not None and forward.is_shown
    return AxesEstimate(
        declared=declared,
        proposed=propose_axes(declared, up, forward.direction if forward is not None and shown else None),
        up=(float(up[0]), float(up[1]), float(up[2])),
        tilt_deg=float(np.degrees(np.arccos(np.clip(up[2], -1.0, 1.0)))),
        magnitude_mps2=magnitude,
        forward_by=None if forward is None else by,
        forward_correlation=None if correlations is None else float(correlations[0]),
        best_forward=None if forward is None else forward.name,
        best_forward_correlation=None if forward is None else forward.correlation,
        shown_by="motion" if shown else "gravity",
        lateral_correlation=None if lateral is None else lateral[1],
        gyro_slope=None if lateral is None else lateral[0],
    )


class _ForwardAxis(NamedTuple):
    """The axis across gravity with the highest ``correlation``: its ``name`` (``"+x"``) and ``direction`` (3,).

    ``is_shown``: whether the correlation is high enough, and surely higher than that of the other axis.
    """

    name: str
    direction: Array
    correlation: float
    is_shown: bool


def _forward_axis(correlations: Array, up: Array, by: ForwardBy, duration_s: float) -> _ForwardAxis:
    """Return the axis that points forward, by the correlations (3,) of all axes with the acceleration."""
    vertical = int(np.argmax(np.abs(up)))
    level = np.where(np.arange(3) == vertical, 0.0, correlations)
    axis = int(np.argmax(np.abs(level)))
    correlation = float(abs(level[axis]))
    other = float(np.delete(np.abs(level), [axis, vertical])[0])
    is_sure = by == "tach" or _is_sure(correlation, other, duration_s)
    name = f"{'-+'[int(level[axis] > 0)]}{'xyz'[axis]}"
    direction = np.sign(level[axis]) * np.eye(3)[axis]
    return _ForwardAxis(name, direction, correlation, correlation >= _MIN_CORRELATION and is_sure)


def _by_receiver(
    imu: pd.DataFrame, gnss: pd.DataFrame | None, speeds: pd.DataFrame | None
) -> tuple[ForwardBy, Array | None]:
    """Return what of a receiver shows the acceleration, and the correlations of all axes with it; None without any."""
    if speeds is not None and len(speeds) > 1:
        correlations = _along_path(imu, path_of(speeds))
        if correlations is not None:
            return "receiver", correlations
    if gnss is not None:
        return "positions", _along_path(imu, path_along(gnss, imu["t_s"].to_numpy()))
    return "receiver", None


def _along_path(imu: pd.DataFrame, path: pd.DataFrame | None) -> Array | None:
    """Return the correlation of each axis with the acceleration along a receiver's path; None where it shows none."""
    motion = None if path is None else averaged(imu, path, _STEP_S)
    return None if motion is None else forward_correlations(motion, BY_RECEIVER)


def _is_sure(correlation: float, other: float, duration_s: float) -> bool:
    """Return whether a correlation is surely greater than another one.

    Averages of standard deviation s are as many independent ones as there are times of 2 sqrt(pi) s; Fisher's transform
    of a correlation of n has the variance 1 / (n - 3).
    """
    count = duration_s / (2.0 * np.sqrt(np.pi) * BY_RECEIVER.short_s)
    beyond = np.arctanh(min(correlation, 1.0 - 1e-9)) - np.arctanh(min(other, 1.0 - 1e-9))
    return bool(count > 3.0 and beyond > _SURE * np.sqrt(2.0 / (count - 3.0)))


def mean_specific_force(imu: pd.DataFrame) -> Array:
    """Return the median over the recording of specific force averaged over about half a second, m/s^2, (3,)."""
    return np.asarray(np.median(specific_force_blocks(imu), axis=0), dtype=np.float64)


def specific_force_blocks(imu: pd.DataFrame) -> Array:
    """Return specific force averaged over blocks of about half a second, m/s^2, (b, 3)."""
    accel = imu[list(IMU_COLUMNS[4:7])].to_numpy()
    interval = float(np.median(np.diff(imu["t_s"])))
    size = max(1, round(min(0.5 / max(interval, np.finfo(np.float64).tiny), accel.shape[0] // 4)))
    return np.asarray(accel[: accel.shape[0] // size * size].reshape(-1, size, 3).mean(axis=1), dtype=np.float64)


def levelling_deg(up: Array) -> tuple[float, float]:
    """Return the roll and the pitch (``mount_rpy_deg``, degrees) that turn the direction ``up`` (3,) up."""
    roll, pitch = np.arctan2(up[1], up[2]), -np.arcsin(np.clip(up[0], -1.0, 1.0))
    return float(np.degrees(roll)), float(np.degrees(pitch))


def propose_axes(declared: str, up: Array, forward: Array | None) -> str:
    """Return the axes string nearest to ``declared`` that turns ``up`` up and, if given, ``forward`` forward.

    Both are directions in the vehicle axes as declared. Of the right-handed triads the one with the best fit is
    taken; among equals, the one that keeps most letters, F before L.
    """
    A = rotations.axes_matrix(declared)
    vertical = np.sign(up) * (np.abs(up) == np.abs(up).max())

    def merit(axes: str) -> tuple[float, ...]:
        turn = rotations.axes_matrix(axes) @ A.T
        fit = float((turn @ vertical)[2]) + (0.0 if forward is None else float((turn @ forward)[0]))
        kept = [a == b for a, b in zip(axes, declared, strict=True)]
        return fit, sum(kept), sum(k for k, letter in zip(kept, declared, strict=True) if letter in "FB")

    best = max(AXES, key=merit)
    agrees = merit(declared)[0] >= merit(best)[0]
    return declared if agrees else best


def forward_correlations(motion: Motion, how: Comparison = BY_TACH) -> Array | None:
    """Return the correlation, highest in magnitude over the lags, of each axis with the acceleration, (3,).

    None where the motion shows no acceleration, or is too short.
    """
    if motion.speed.size * motion.step_s < how.least_s:
        return None
    acceleration = band_passed(tach_acceleration(motion), motion.valid, motion.step_s, how.short_s, how.long_s)
    if np.sqrt(np.mean(acceleration**2)) < _MIN_ACCELERATION:
        return None
    best = []
    for force in motion.accel.T:
        filtered = band_passed(force, motion.valid, motion.step_s, how.short_s, how.long_s)
        _, correlation = lagged_correlation(acceleration, filtered, how.max_lag_s / motion.step_s)
        best.append(correlation[np.argmax(np.abs(correlation))])
    return np.array(best)


def lateral_balance(motion: Motion) -> tuple[float, float] | None:
    """Return slope and correlation of ``f_y`` against ``v w_z + g int w_x dt``, both band-passed.

    What a constant bias of w_z adds is proportional to v, and projected out of both; that of w_x does not pass the
    band. The slope is the ratio of their standard deviations with the sign of the correlation: unlike a regression it
    is biased alike by noise on either side. None where there are no curves to see.
    """
    if not motion.valid.any():
        return None
    rate = motion.gyro - np.median(motion.gyro[motion.valid], axis=0)
    kinematic = motion.speed * rate[:, 2] + STANDARD_GRAVITY * motion.step_s * np.cumsum(rate[:, 0])
    expected, measured, speed = (
        band_passed(values, motion.valid, motion.step_s, _SHORT_S, _LONG_S)
        for values in (kinematic, motion.accel[:, 1], motion.speed)
    )
    if (power := float(speed @ speed)) > 0.0:
        expected, measured = (values - speed * (speed @ values) / power for values in (expected, measured))
    sd_expected, sd_measured = (float(np.sqrt(np.mean(x**2))) for x in (expected, measured))
    if sd_measured < _MIN_LATERAL or sd_expected == 0.0:
        return None
    correlation = float(np.mean(expected * measured) / (sd_expected * sd_measured))
    return float(np.copysign(sd_measured / sd_expected, correlation)), correlation

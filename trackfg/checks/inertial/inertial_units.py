"""Units and axes of the IMU that cannot be: by gravity, and by angular rates and curves."""

from __future__ import annotations

import numpy as np
import pandas as pd

from trackfg.checks import diagnosis_axes
from trackfg.checks.columns import too_fast_hint
from trackfg.checks.limits import CheckLimits
from trackfg.numerics.units import STANDARD_GRAVITY, to_si
from trackfg.recording.canonical import imu_rotation
from trackfg.recording.description import Imu
from trackfg.recording.findings import Finding, Level
from trackfg.sensors.averages import Motion


def gravity_findings(imu: Imu, table: pd.DataFrame, toml: str, limits: CheckLimits) -> list[Finding]:
    """Return what is wrong with the magnitude, or else with the direction, of the median specific force."""
    force = diagnosis_axes.mean_specific_force(table)
    magnitude = float(np.linalg.norm(force))
    g = STANDARD_GRAVITY
    columns = ", ".join(imu.accel)
    if abs(magnitude - g) > limits.gravity_error_mps2:
        message = f"the median specific force is {magnitude:.4g} m/s^2 as declared ({imu.accel_unit})"
        hint = "check imu.accel and imu.accel_unit"
        if magnitude < _LEFT_OF_GRAVITY * g or not _is_steady(table):
            hint = "gravity seems to have been removed: record specific force, as the sensor gives it"
        elif imu.accel_unit == "m/s^2" and abs(magnitude * g - g) < limits.gravity_error_mps2:
            hint = 'the data look like g: set imu.accel_unit = "g"'
        elif imu.accel_unit == "g" and abs(magnitude / g - g) < limits.gravity_error_mps2:
            hint = 'the data look like m/s^2: set imu.accel_unit = "m/s^2"'
        elif 0.8 < magnitude / (1000.0 * to_si("acceleration", imu.accel_unit)) < 1.2:
            hint = 'the data look like milli-g: divide them by 1000 and set imu.accel_unit = "g"'
        expected = f"{g:.2f} m/s^2 within {limits.gravity_error_mps2:g}"
        return [Finding("error", "accel-unit", message, file=imu.file, column=columns, expected=expected, hint=hint)]
    up = force / magnitude
    tilt = float(np.degrees(np.arccos(np.clip(up[2], -1.0, 1.0))))
    if tilt <= limits.tilt_warning_deg:
        return []
    expected = "+1 g on the upward axis at rest"
    if tilt <= limits.tilt_error_deg or abs(up).max() < np.cos(np.radians(limits.tilt_error_deg)):
        roll, pitch = diagnosis_axes.levelling_deg(up)
        message = f"gravity is {tilt:.0f} deg off the vertical of the declared axes"
        hint = f"if the sensor is mounted so, turn imu.mount_rpy_deg by roll {roll:.1f}, pitch {pitch:.1f} deg"
        level: Level = "warning" if tilt <= limits.tilt_error_deg else "error"
        return [Finding(level, "gravity-tilt", message, file=toml, column="imu.axes", expected=expected, hint=hint)]
    sensor = imu_rotation(imu).T @ force
    i = int(np.argmax(np.abs(sensor)))
    message = (
        f"gravity is on the wrong axis or sign: column {imu.accel[i]!r}, declared {imu.axes[i]}, "
        f"holds {sensor[i]:+.2f} m/s^2, so it points {'up' if sensor[i] > 0 else 'down'}"
    )
    hint = f'set imu.axes = "{diagnosis_axes.propose_axes(imu.axes, up, None)}" if the other columns are right'
    return [Finding("error", "gravity-axis", message, file=imu.file, column=imu.accel[i], expected=expected, hint=hint)]


_LEFT_OF_GRAVITY = 0.05
"""Less than this part of gravity is none: the smallest unit that is taken for another is g, 0.1 of m/s^2."""
_STEADY_RANGE = 0.5
"""Gravity makes the magnitude of specific force vary by less than half of itself (quantiles 5 to 95 %), in any unit: no
vehicle accelerates like that. What is left where it was removed varies by more than itself."""


def _is_steady(table: pd.DataFrame) -> bool:
    """Return whether the magnitude of specific force hardly varies."""
    magnitude = np.linalg.norm(diagnosis_axes.specific_force_blocks(table), axis=1)
    low, middle, high = np.quantile(magnitude, [0.05, 0.5, 0.95])
    return bool(high - low < _STEADY_RANGE * middle)


def gyro_findings(imu: Imu, motion: Motion, limits: CheckLimits) -> list[Finding]:
    """Return findings for angular rates that no vehicle has, or that do not fit the lateral specific force."""
    columns = ", ".join(imu.gyro)
    other = "deg/s" if imu.gyro_unit == "rad/s" else "rad/s"
    to_other = f'the data look like {other}: set imu.gyro_unit = "{other}"'

    def wrong(message: str, expected: str, hint: str = to_other) -> list[Finding]:
        return [Finding("error", "gyro-unit", message, file=imu.file, column=columns, expected=expected, hint=hint)]

    if not motion.valid.any():
        return []
    rate = float(np.quantile(np.abs(motion.gyro[motion.valid]).max(axis=1), 0.995))
    if rate > limits.rate_error_radps:
        return wrong(
            f"angular rates of {rate:.3g} rad/s as declared ({imu.gyro_unit}), held for half a second",
            f"at most {limits.rate_error_radps:g} rad/s",
            too_fast_hint(imu),
        )
    if np.isnan(motion.speed).any() or np.quantile(np.abs(motion.speed), 0.99) > limits.speed_error_mps:
        return []  # a speed that no vehicle has says nothing of the gyro
    lateral = float(np.quantile(np.abs(motion.speed * motion.gyro[:, 2])[motion.valid], 0.995))
    if lateral > limits.lateral_error_mps2:
        return wrong(
            f"speed times yaw rate is {lateral:.3g} m/s^2 as declared ({imu.gyro_unit})",
            f"at most {limits.lateral_error_mps2:g} m/s^2",
            too_fast_hint(imu),
        )
    balance = diagnosis_axes.lateral_balance(motion)
    if balance is None or abs(balance[1]) < max(0.7, limits.axis_correlation):
        return []
    slope = abs(balance[0])
    is_other = slope < 1 / 20 if imu.gyro_unit == "rad/s" else slope > 20
    if not is_other:
        return []
    return wrong(
        f"lateral specific force is {slope:.3g} times what the gyro implies as declared ({imu.gyro_unit})", "1"
    )

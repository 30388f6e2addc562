"""Channels of the IMU that are numbers and yet no measurements: stuck, repeated, cut off at the end of the range, or
beyond any.
"""

from __future__ import annotations

import numpy as np
import pandas as pd

from trackfg.checks.limits import CheckLimits
from trackfg.numerics.arrays import Array
from trackfg.numerics.robust import robust_sd
from trackfg.numerics.spans import true_runs
from trackfg.recording.canonical import imu_rotation
from trackfg.recording.description import Imu
from trackfg.recording.findings import Finding
from trackfg.recording.model import IMU_COLUMNS

_MIN_PLATEAU = 3
_FAR = 6.0
"""A plateau is saturation if it is this many robust standard deviations from the median."""


def findings(imu: Imu, table: pd.DataFrame, limits: CheckLimits) -> list[Finding]:
    """Warnings about the sensor's own columns (``table`` is in body axes and is turned back)."""
    t = table["t_s"].to_numpy()
    values = table[list(IMU_COLUMNS[1:])].to_numpy()
    R = imu_rotation(imu)
    sensor = np.hstack([values[:, :3] @ R, values[:, 3:] @ R])
    found = _repeated(imu, t, sensor, limits)
    for name, channel in zip((*imu.gyro, *imu.accel), sensor.T, strict=True):
        found += _stuck(imu, name, t, channel, limits) or _saturated(imu, name, t, channel)
    for names, channels, most, unit in (
        (imu.gyro, sensor[:, :3], limits.possible_rate_radps, "rad/s"),
        (imu.accel, sensor[:, 3:], limits.possible_force_mps2, "m/s^2"),
    ):
        for name, channel in zip(names, channels.T, strict=True):
            found += _impossible(imu, name, t, channel, most, unit)
    return found


def _repeated(imu: Imu, t: Array, sensor: Array, limits: CheckLimits) -> list[Finding]:
    """Rows in which all six channels stay the same: a logger that fills gaps with the last sample."""
    same = (np.diff(sensor, axis=0) == 0.0).all(axis=1) & (sensor[1:] != 0.0).any(axis=1)
    share = float(np.mean(same))
    start, length = _longest_run(same)
    seconds = float(t[start + length] - t[start]) if length else 0.0
    if seconds < limits.imu_gap_warning_s and share < 0.1:
        return []
    message = (
        f"all six channels repeat the row before in {share:.1%} of the rows, at worst for {seconds:.3g} s from here"
    )
    hint = "remove the repeated rows: a gap is bridged honestly, invented samples are not"
    return [
        Finding(
            "warning",
            "rows-repeated",
            message,
            file=imu.file,
            row=start + 1,
            time_s=float(t[start]),
            expected="samples",
            hint=hint,
        )
    ]


def _stuck(imu: Imu, name: str, t: Array, channel: Array, limits: CheckLimits) -> list[Finding]:
    start, length = _longest_run(np.diff(channel) == 0.0)
    if length == 0 or t[start + length] - t[start] < limits.stuck_s:
        return []
    whole = length == channel.size - 1
    message = "constant over the whole recording" if whole else f"constant for {t[start + length] - t[start]:.4g} s"
    hint = "check the sensor and the logger's resolution"
    expected = "a signal with noise"
    return [
        Finding(
            "warning",
            "stuck-channel",
            message,
            file=imu.file,
            column=name,
            row=start + 1,
            time_s=float(t[start]),
            expected=expected,
            hint=hint,
        )
    ]


def _saturated(imu: Imu, name: str, t: Array, channel: Array) -> list[Finding]:
    """Several rows in succession at exactly the highest or lowest value, far from the usual ones."""
    middle = float(np.median(channel))
    spread = robust_sd(channel - middle)
    for end in (float(channel.min()), float(channel.max())):
        at_end = channel == end
        _, length = _longest_run(at_end)
        if length >= _MIN_PLATEAU and abs(end - middle) > _FAR * spread > 0.0:
            i = int(np.argmax(at_end))
            message = f"stays at its extreme {end:.6g} (SI) in {np.count_nonzero(at_end)} rows: saturated"
            hint = "use a wider range; until then the rows near these are not to be trusted"
            return [
                Finding(
                    "warning",
                    "saturated-channel",
                    message,
                    file=imu.file,
                    column=name,
                    row=i + 1,
                    time_s=float(t[i]),
                    hint=hint,
                )
            ]
    return []


def _impossible(imu: Imu, name: str, t: Array, channel: Array, most: float, unit: str) -> list[Finding]:
    beyond = np.abs(channel) > most
    if not beyond.any():
        return []
    i, count = int(beyond.argmax()), int(np.count_nonzero(beyond))
    message = f"{channel[i]:.6g} {unit}" + (f", and {count - 1} more such values" if count > 1 else "")
    hint = "remove the rows: a short gap is bridged"
    expected = f"at most {most:g} {unit}"
    return [
        Finding(
            "warning",
            "impossible-value",
            message,
            file=imu.file,
            column=name,
            row=i + 1,
            time_s=float(t[i]),
            expected=expected,
            hint=hint,
        )
    ]


def _longest_run(mask: np.ndarray) -> tuple[int, int]:
    """Start and length of the longest run of True; length 0 if there is none."""
    runs = true_runs(mask)
    if len(runs) == 0:
        return 0, 0
    lengths = runs[:, 1] - runs[:, 0]
    i = int(np.argmax(lengths))
    return int(runs[i, 0]), int(lengths[i])

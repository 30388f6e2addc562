"""IMU channels are warned of that are stuck, repeated, interpolated, cut off or beyond any value.

What is stuck, interpolated or cut off at the end of the range is what batch and stream drop
(:mod:`trackfg.checks.inertial.imu_faults`). A channel that is constant for long is warned of even where values repeat
so often by chance that the detector does not judge it.
"""

from __future__ import annotations

import numpy as np
import pandas as pd

from trackfg.checks.columns import ColumnPlace
from trackfg.checks.inertial.imu_faults import ImuFaultDetector
from trackfg.checks.inertial.interpolated_rows import interpolated_times
from trackfg.checks.inertial.repeated_rows import repeated_rows
from trackfg.checks.limits import CheckLimits
from trackfg.numerics.arrays import Array
from trackfg.numerics.spans import true_runs
from trackfg.recording.description import Imu
from trackfg.recording.findings import Finding
from trackfg.recording.model import IMU_COLUMNS


def findings(imu: Imu, table: pd.DataFrame, limits: CheckLimits) -> list[Finding]:
    """Return warnings about the sensor's own columns (``table`` is in body axes and is turned back)."""
    rows = table[list(IMU_COLUMNS)].to_numpy()
    detector = ImuFaultDetector.of(imu, limits, is_canonical=True)
    faults = [fault for fault in detector.taken(rows)[1] if fault.code == "stuck-channel"]
    t, sensor = rows[:, 0], detector.in_sensor_axes(rows)[:, 1:]
    report = [*_repeated(imu, t, sensor, limits), *_interpolated(imu, rows)]
    same = np.diff(sensor, axis=0) == 0.0
    same &= ~same.all(axis=1)[:, None]  # which are repeated rows
    for c, name in enumerate((*imu.gyro, *imu.accel)):
        times = np.concatenate([np.zeros(0), *(fault.t for fault in faults if name in fault.columns)])
        report += _plateau(imu, name, t, sensor[:, c], (same[:, c], np.isin(t, times)), limits)
    for names, channels, most, unit in (
        (imu.gyro, sensor[:, :3], limits.possible_rate_radps, "rad/s"),
        (imu.accel, sensor[:, 3:], limits.possible_force_mps2, "m/s^2"),
    ):
        for name, channel in zip(names, channels.T, strict=True):
            report += _impossible(imu, name, t, channel, most, unit)
    return report


def _repeated(imu: Imu, t: Array, sensor: Array, limits: CheckLimits) -> list[Finding]:
    """Return the finding of rows in which all six channels stay the same: a logger repeats the last sample in gaps."""
    same = (np.diff(sensor, axis=0) == 0.0).all(axis=1) & (sensor[1:] != 0.0).any(axis=1)
    share = float(np.mean(same))
    start, end = max(true_runs(same).tolist(), key=lambda run: run[1] - run[0], default=(0, 0))
    seconds = float(t[end] - t[start])
    if seconds < limits.imu_gap_warning_s and share < 0.1:
        return []
    message = (
        f"all six channels repeat the row before in {share:.1%} of the rows, at worst for {seconds:.3g} s from here"
    )
    hint = "remove the repeated rows: a gap is bridged honestly, invented samples are not"
    if repeated_rows(list(sensor.T)).any():
        hint = "log the sensor's own rows: these repeat samples of a slower one, and are left out"
    return [ColumnPlace(imu.file, None, t).at_row(start, "rows-repeated", message, "samples", hint, "warning")]


def _interpolated(imu: Imu, rows: Array) -> list[Finding]:
    """Return the finding of rows (n, 7) by which a hole was filled."""
    t = interpolated_times(imu, [rows])
    if not t.size:
        return []
    row = int(np.searchsorted(rows[:, 0], t[0]))
    message = f"{len(t)} rows in which all six channels lie on straight lines, first here: holes were filled"
    hint = "remove the rows: a gap is bridged honestly, invented samples are not; the smoother does without them"
    place = ColumnPlace(imu.file, None, rows[:, 0])
    return [place.at_row(row, "rows-interpolated", message, "samples", hint, "warning")]


def _plateau(
    imu: Imu, name: str, t: Array, channel: Array, masks: tuple[np.ndarray, np.ndarray], limits: CheckLimits
) -> list[Finding]:
    """Return the finding of the longest plateau that is dropped, or lasts for ``limits.stuck_s``.

    ``masks``: which rows equal the next one (n - 1,), and which are dropped (n,). A plateau at the highest or lowest
    value of the channel is one at the end of its range.
    """
    same, dropped = masks
    runs, drop_count = true_runs(same), np.concatenate([[0], np.cumsum(dropped)])
    seconds = t[runs[:, 1]] - t[runs[:, 0]]
    runs = runs[(seconds >= limits.stuck_s) | (drop_count[runs[:, 1] + 1] > drop_count[runs[:, 0] + 1])]
    if len(runs) == 0:
        return []
    start, end = runs[np.argmax(t[runs[:, 1]] - t[runs[:, 0]])].tolist()
    level, whole = float(channel[start]), end - start == channel.size - 1
    if level in (channel.min(), channel.max()) and not whole:
        at_end = channel == level
        start, code, expected = int(np.argmax(at_end)), "saturated-channel", None
        message = f"stays at its extreme {level:.6g} (SI) in {np.count_nonzero(at_end)} rows: saturated"
        hint = "use a wider range; until then the smoother does without these rows"
    else:
        code, expected = "stuck-channel", "a signal with noise"
        message = "constant over the whole recording" if whole else f"constant for {t[end] - t[start]:.4g} s"
        hint = "check the sensor and the logger's resolution"
    return [ColumnPlace(imu.file, name, t).at_row(start, code, message, expected, hint, "warning")]


def _impossible(imu: Imu, name: str, t: Array, channel: Array, most: float, unit: str) -> list[Finding]:
    beyond = np.abs(channel) > most
    if not beyond.any():
        return []
    i, count = int(beyond.argmax()), int(np.count_nonzero(beyond))
    message = f"{channel[i]:.6g} {unit}" + (f", and {count - 1} more such values" if count > 1 else "")
    hint = "remove the rows: a short gap is bridged"
    place, expected = ColumnPlace(imu.file, name, t), f"at most {most:g} {unit}"
    return [place.at_row(i, "impossible-value", message, expected, hint, "warning")]

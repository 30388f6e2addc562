"""Rows of the IMU further apart, or closer together, than those of any sensor: their times are in another unit."""

from __future__ import annotations

from trackfg.checks.limits import CheckLimits
from trackfg.numerics.units import known_units, to_si
from trackfg.recording.findings import Finding

_FASTEST_S = 2e-4
"""No unit is proposed in which rows would be closer together, s: of two that fit, the slower rate is a sensor's."""


def interval_finding(
    interval_s: float, file: str, column: str, limits: CheckLimits, unit: str | None = None
) -> Finding | None:
    """Return an error where the IMU's rows have a median interval (s) that no sensor has; None where it is possible.

    ``unit`` is the declared one of the times, None where they are in s and cannot be declared otherwise.
    """
    low, high = limits.imu_interval_s
    if low <= interval_s <= high or not interval_s > 0.0:
        return None
    raw = interval_s / to_si("time", unit or "s")
    hint = "check the column of the times" if unit is None else "check the time column and imu.time_unit"
    other = next((name for name in known_units("time") if _FASTEST_S <= raw * to_si("time", name) <= high), None)
    if other is not None:
        factor = to_si("time", other)
        what = f"multiply the times by {factor:g}" if unit is None else f'set imu.time_unit = "{other}"'
        hint = f"the times look like {other}: {what}, and the sensor has {1.0 / (raw * factor):.4g} rows a second"
    message = f"rows are {interval_s:.4g} s apart (median), {1.0 / interval_s:.4g} a second"
    return Finding(
        "error", "time-unit", message, file=file, column=column, expected=f"{low:g} to {high:g} s", hint=hint
    )

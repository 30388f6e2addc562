"""Sizes that no vehicle and no track has: speeds, wheels, gauges and displacements, and the units that explain them."""

from __future__ import annotations

import numpy as np
import pandas as pd

from trackfg.checks.columns import ColumnPlace
from trackfg.checks.limits import CheckLimits
from trackfg.numerics.arrays import Array
from trackfg.recording.description import GnssSpeed, Laser, Speed, Tach
from trackfg.recording.findings import Finding, Level, Section

GAUGE_M = (0.3, 4.0)
"""Gauges from the narrowest of park railways to wider than any crane's, m."""
WHEEL_M = (0.05, 2.0)
"""Diameters of wheels from a measuring wheel's to those of the largest steam engines, m."""

_UNIT_TOLERANCE = 0.1
"""A ratio this near to that of two units is taken for it: wheel and sensor are never scaled as wrongly otherwise."""

_BURST_S = 0.1
"""Rows that follow each other sooner, s, may have been stamped late and all at once."""


def is_ratio_of_units(scale: float, ratio: float) -> bool:
    """Return whether a measured ``scale``, of any sign, is the ``ratio`` of two units."""
    return bool(abs(np.log(abs(scale) / ratio)) < _UNIT_TOLERANCE)


def unusual_size(level: Level, code: str, size_m: float, usual_m: tuple[float, float], key: Section) -> list[Finding]:
    """Return a finding where a size is outside of a usual range, both m; the hint is for millimetres."""
    low, high = usual_m
    if low <= size_m <= high:
        return []
    hint = f"write {size_m / 1000:g}" if 1000 * low <= size_m <= 1000 * high else None
    expected = f"{low:g} to {high:g} m"
    return [Finding(level, code, f"is {size_m:g} m", file=key.file, column=key.name, expected=expected, hint=hint)]


def speed_findings(
    code: str, speed: Array, part: Tach | Speed | GnssSpeed, hint: str, limits: CheckLimits
) -> list[Finding]:
    """Return a finding where one in a hundred speeds (n,), m/s, is beyond any vehicle."""
    fastest = float(np.quantile(np.abs(speed), 0.99)) if speed.size else 0.0
    if fastest <= limits.speed_error_mps:
        return []
    message, expected = f"speeds of {fastest:.4g} m/s as declared", f"at most {limits.speed_error_mps:g} m/s"
    return [Finding("error", code, message, file=part.file, column=part.column, expected=expected, hint=hint)]


def tach_findings(tach: Tach, section: Section, table: pd.DataFrame, limits: CheckLimits) -> list[Finding]:
    """Return findings for speeds that no vehicle has, and a wheel of no usual size."""
    t, distance = table["t_s"].to_numpy(), table["distance_m"].to_numpy()
    span = max(1, int(np.searchsorted(t, t[0] + 1.0)))
    speed = np.abs(distance[span:] - distance[:-span]) / (t[span:] - t[:-span])
    hint = (
        f"check {section.name}.wheel_diameter_m (in m) and {section.name}.pulses_per_rev"
        if tach.kind == "pulses"
        else f"check {section.name}.kind and {section.name}.unit"
    )
    findings = speed_findings("tach-unit", speed, tach, hint, limits) or _tach_jumps(tach, t, distance, limits)
    if tach.wheel_diameter_m is not None:
        key = Section(section.file, f"{section.name}.wheel_diameter_m")
        findings += unusual_size("warning", "wheel-diameter", tach.wheel_diameter_m, WHEEL_M, key)
    return findings


def _tach_jumps(tach: Tach, t: Array, distance: Array, limits: CheckLimits) -> list[Finding]:
    """Return a finding for steps from row to row that no wheel makes, as where a counter wraps or is reset."""
    if tach.kind == "speed":
        return []
    steps, since = np.diff(distance, prepend=distance[0]), np.diff(t, prepend=t[0])
    jumps = np.abs(steps) > limits.speed_error_mps * np.maximum(since, _BURST_S)
    message = f"the tach jumps by {steps[np.argmax(jumps)]:.4g} m from the row before"
    hint = (
        "a counter that wraps must be unwrapped first, as trackfg import does, with wraps_at in the mapping where it "
        "finds no modulus"
    )
    expected = f"at most {limits.speed_error_mps:g} m/s"
    return ColumnPlace(tach.file, tach.column, t).at_first(jumps, "tach-jump", message, expected, hint, "warning")


def laser_findings(laser: Laser, section: Section, table: pd.DataFrame, limits: CheckLimits) -> list[Finding]:
    """Return a finding for a unit off by 1000: too large to be true, or moving less than a hundredth of its noise."""
    displacement = table["displacement_m"].to_numpy()
    largest = float(np.quantile(np.abs(displacement), 0.9))
    low, high = np.quantile(displacement, [0.05, 0.95])
    if largest > limits.laser_range_m:
        message = f"displacements of {largest:.4g} m as declared ({laser.unit})"
        hint = 'the data look like mm: set unit = "mm"' if laser.unit == "m" else "divide the data by 1000"
        expected = f"at most {limits.laser_range_m:g} m"
    elif 0.0 < high - low < 0.05 * laser.sd_m and laser.unit == "mm" and largest * 1000.0 <= limits.laser_range_m:
        message = f"the displacement varies by {high - low:.3g} m as declared (mm), far below its sigma"
        hint = 'the data look like m: set unit = "m"'
        expected = f"a variation above {laser.sd_m:g} m"
    else:
        return []
    message += f" ({section.name}.unit)"
    return [Finding("error", "laser-unit", message, file=laser.file, column=laser.column, expected=expected, hint=hint)]

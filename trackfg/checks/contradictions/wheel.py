"""Contradictions of the wheel: its clock, its sense, its silence, and its size."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from trackfg.checks.contradictions.description_warning import description_warning
from trackfg.checks.diagnosis import Estimates
from trackfg.checks.diagnosis_clock import ClockOffset
from trackfg.checks.diagnosis_force import ForceFit
from trackfg.checks.diagnosis_silence import SilentSpan
from trackfg.checks.diagnosis_speed import SURE_CORRELATION
from trackfg.checks.diagnosis_wheel import WheelScale
from trackfg.checks.limits import CheckLimits
from trackfg.checks.sizes import is_ratio_of_units
from trackfg.numerics.units import KMH
from trackfg.recording.description import Tach
from trackfg.recording.findings import Finding

_FEWEST_STRETCHES = 3
"""Stretches between fixes from which on a scale that no wheel has is reported."""


def clock_findings(tach: Tach | None, offset: ClockOffset | None) -> list[Finding]:
    """Return a finding for a clock of the tach that is ahead of the IMU's, or behind it."""
    if offset is None or tach is None or not offset.is_sure:
        return []
    message = f"the tach's clock is off by {offset.offset_s:+.3f} s (sd {offset.sd_s:.3f} s)"
    hint = f"set tach.time_offset_s = {tach.time_offset_s + offset.offset_s:.3f}, or have it estimated"
    return [description_warning("clock-offset", message, "tach.time_offset_s", "0", hint)]


def speed_findings(tach: Tach | None, force: ForceFit | None, limits: CheckLimits) -> list[Finding]:
    """Return findings for speeds that are scaled wrongly, by the force that acceleration and curves need."""
    if tach is None or force is None:
        return []
    forward, lateral, findings = force.forward, force.lateral, []
    low, high = 1.0 / limits.speed_scale, limits.speed_scale
    if forward is not None and forward.correlation >= limits.axis_correlation and forward.excludes(low, high):
        message = (
            f"forward force is {forward.value:.3g} times the tach's acceleration "
            f"(surely {forward.low:.3g} to {forward.high:.3g})"
        )
        key, hint = _rescaled(tach, forward.value)
        findings.append(description_warning("speed-scale", message, key, "1", hint))
    if lateral is not None and abs(lateral.correlation) >= SURE_CORRELATION and lateral.excludes(0.5, 2.0):
        message = f"lateral specific force is {lateral.value:.3g} times what speed and gyro imply"
        hint = "check the units and scales of gyro, accelerometer and tach"
        findings.append(description_warning("gyro-scale", message, "imu.gyro_unit", "about 1", hint))
    return findings


def _rescaled(tach: Tach, scale: float) -> tuple[str, str]:
    """Return the key and the edit that multiply the tach's distance by ``scale``."""
    for unit, other, ratio in (("m/s", "km/h", KMH), ("km/h", "m/s", 1.0 / KMH), ("m", "mm", 1e-3), ("mm", "m", 1e3)):
        if tach.unit == unit and is_ratio_of_units(scale, ratio):
            return "tach.unit", f'the data look like {other}: set tach.unit = "{other}"'
    if tach.kind == "pulses" and tach.wheel_diameter_m is not None:
        diameter = tach.wheel_diameter_m * scale
        return "tach.wheel_diameter_m", f"set tach.wheel_diameter_m = {diameter:.4g}, or check tach.pulses_per_rev"
    return "tach.unit", f"check tach.unit; distances must be multiplied by {scale:.4g}"


def silence_findings(tach: Tach | None, spans: Sequence[SilentSpan]) -> list[Finding]:
    """Return one finding for the longest span of each kind."""
    findings = []
    remove = "remove these rows, or [tach]: a wheel that stands still reads as a slide"
    for kind, code, what, hint in (
        ("constant", "tach-silent", "stays at one value", remove),
        ("absent", "tach-absent", "has no rows", None),
    ):
        of_kind = [span for span in spans if span.kind == kind]
        if tach is None or not of_kind:
            continue
        longest = max(of_kind, key=lambda span: span.seconds)
        message = f"{what} from t = {longest.start_s:.6g} to {longest.end_s:.6g} s, while the IMU moves"
        if len(of_kind) > 1:
            message += f" ({len(of_kind)} such spans)"
        about = Finding("warning", code, message, file=tach.file, column=tach.column, expected="motion", hint=hint)
        findings.append(replace(about, time_s=longest.start_s))
    return findings


def curves_findings(tach: Tach | None, estimates: Estimates, limits: CheckLimits) -> list[Finding]:
    """Return a finding for a wheel that is off by some percent, by the force of curves, where neither fixes nor GNSS
    determine its scale.
    """
    force, low, high = estimates.force, 1.0 / limits.lateral_scale, limits.lateral_scale
    if tach is None or force is None or estimates.wheel_scale_fixes or estimates.wheel_scale_gnss:
        return []
    lateral, forward = force.lateral, force.forward
    if lateral is None or lateral.correlation < SURE_CORRELATION or not lateral.excludes(low, high):
        return []
    if forward is None or forward.excludes(1.0 / limits.speed_scale, limits.speed_scale) or lateral.excludes(0.5, 2.0):
        return []  # the tach's unit or the gyro's
    message = (
        f"lateral force in curves is {lateral.value:.3f} times what speed and gyro imply "
        f"(surely {lateral.low:.3f} to {lateral.high:.3f})"
    )
    key, hint = _rescaled(tach, lateral.value)
    hint = f"{hint}; or check the gyro's scale"
    return [description_warning("curve-scale", message, key, f"1 within {100.0 * (high - 1.0):.0f} %", hint)]


def scale_findings(
    tach: Tach | None, wheel: WheelScale | None, force: ForceFit | None, limits: CheckLimits
) -> list[Finding]:
    """Return a finding for a wheel whose scale is not the declared one, by fixes or positions."""
    if wheel is None or tach is None or abs(wheel.scale - 1.0) < 3.0 * float(np.hypot(tach.scale_sd, wheel.sd)):
        return []
    if not 0.5 < wheel.scale < 2.0 and wheel.samples < _FEWEST_STRETCHES:  # fixes of one place, passed again
        return []
    forward = None if force is None else force.forward
    is_tach = forward is None or forward.excludes(1.0 / limits.speed_scale, limits.speed_scale)
    if not is_tach and wheel.source == "fixes" and not 0.5 < wheel.scale < 2.0:
        message = f"chainage grows by {wheel.scale:.4g} m for each m of the tach, whose speeds fit the accelerometer"
        what = "km: multiply them by 1000" if is_ratio_of_units(wheel.scale, 1e-3) else "another unit"
        return [
            description_warning(
                "fix-unit", message, "fixes.chainage", "1", f"chainages are in m; these look like {what}"
            )
        ]
    message = f"true distance is {wheel.scale:.5f} (sd {wheel.sd:.5f}) of the tach's, by {wheel.source}"
    if abs(np.log(wheel.scale)) > np.log(limits.speed_scale) and tach.kind != "pulses":
        key, hint = _rescaled(tach, wheel.scale)
    else:
        key, hint = "tach.scale_sd", f"check tach.unit, or set tach.scale_sd = {abs(wheel.scale - 1.0):.2g}"
    if tach.kind == "pulses" and tach.wheel_diameter_m is not None:
        key = "tach.wheel_diameter_m"
        hint = f"set tach.wheel_diameter_m = {tach.wheel_diameter_m * wheel.scale:.4f}"
    return [description_warning("wheel-scale", message, key, f"1 within {3.0 * tach.scale_sd:.3g}", hint)]

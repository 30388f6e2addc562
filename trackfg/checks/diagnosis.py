"""What a recording says about itself, compared with what its description declares.

Each estimate is a function over tables in a module of its own (:mod:`trackfg.checks.diagnosis_axes`, ``_clock``,
``_rest``, ``_wheel``), with its method there; :func:`diagnose` runs them all and turns disagreement into findings.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from trackfg.checks.diagnosis_axes import AxesEstimate, estimate_axes
from trackfg.checks.diagnosis_clock import ClockOffset, estimate_clock_offset
from trackfg.checks.diagnosis_rest import NoiseDensity, StaticBias, noise_density, static_bias
from trackfg.checks.diagnosis_wheel import WheelScale, scale_from_fixes, scale_from_gnss
from trackfg.checks.limits import CheckLimits
from trackfg.recording.findings import Finding
from trackfg.recording.model import Recording
from trackfg.sensors.standstills import find_standstills
from trackfg.sensors.tach_rows import tach_quantum_m

__all__ = [
    "AxesEstimate",
    "ClockOffset",
    "Estimates",
    "NoiseDensity",
    "StaticBias",
    "WheelScale",
    "diagnose",
    "estimate_axes",
    "estimate_clock_offset",
    "estimates_of",
    "noise_density",
    "scale_from_fixes",
    "scale_from_gnss",
    "static_bias",
    "tach_quantum_m",
]

_TOML = "recording.toml"


@dataclass(frozen=True)
class Estimates:
    """Everything that can be estimated; None where the recording does not show it."""

    duration_s: float
    imu_rate_hz: float
    tach_rate_hz: float | None
    tach_quantum_m: float | None
    nominal_distance_m: float | None
    standstills: int
    standstill_s: float
    axes: AxesEstimate
    clock_offset: ClockOffset | None
    static_bias: StaticBias | None
    noise_density: NoiseDensity | None
    wheel_scale_fixes: WheelScale | None
    wheel_scale_gnss: WheelScale | None

    def as_dict(self) -> dict[str, Any]:
        """Nested, ready for JSON, without what could not be estimated."""
        return {key: _without_none(value) for key, value in asdict(self).items() if value is not None}


def _without_none(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _without_none(item) for key, item in value.items() if item is not None}
    return list(value) if isinstance(value, tuple) else value


def diagnose(recording: Recording, limits: CheckLimits | None = None) -> tuple[Estimates, list[Finding]]:
    """Estimate everything, and compare it with the description."""
    estimates = estimates_of(recording)
    return estimates, compare(recording, estimates, limits or CheckLimits())


def estimates_of(recording: Recording) -> Estimates:
    """Estimate everything."""
    t, tach = recording.imu["t_s"].to_numpy(), recording.tach
    standstills = find_standstills(recording, min_duration_s=3.0)
    fixes, gnss = recording.fixes, recording.gnss
    return Estimates(
        duration_s=float(t[-1] - t[0]),
        imu_rate_hz=float(1.0 / np.median(np.diff(t))),
        tach_rate_hz=None if tach is None else float(1.0 / np.median(np.diff(tach["t_s"]))),
        tach_quantum_m=None if tach is None else tach_quantum_m(tach),
        nominal_distance_m=None if tach is None else float(np.abs(np.diff(tach["distance_m"])).sum()),
        standstills=int(standstills.shape[0]),
        standstill_s=float(np.sum(standstills[:, 1] - standstills[:, 0])),
        axes=estimate_axes(recording.imu, tach, recording.description.imu.axes),
        clock_offset=estimate_clock_offset(recording),
        static_bias=static_bias(recording, standstills),
        noise_density=noise_density(recording, standstills),
        wheel_scale_fixes=None if tach is None or fixes is None else scale_from_fixes(tach, fixes),
        wheel_scale_gnss=None if tach is None or gnss is None else scale_from_gnss(tach, gnss),
    )


def compare(recording: Recording, estimates: Estimates, limits: CheckLimits) -> list[Finding]:
    """Where the estimates contradict the description."""
    return [
        *_axes(estimates.axes, limits),
        *_clock(recording, estimates.clock_offset),
        *_bias(recording, estimates.static_bias),
        *_noise(estimates.noise_density, limits),
        *_wheel(recording, estimates.wheel_scale_fixes),
        *_wheel(recording, estimates.wheel_scale_gnss),
    ]


def _axes(axes: AxesEstimate, limits: CheckLimits) -> list[Finding]:
    found = []
    strong = axes.best_forward_correlation is not None and axes.best_forward_correlation >= limits.axis_correlation
    if strong and axes.best_forward != "+x" and axes.proposed != axes.declared:
        message = (
            f"with {axes.declared!r} the axis that follows the tach's acceleration is {axes.best_forward} "
            f"(correlation {axes.best_forward_correlation:.2f}; forward {axes.forward_correlation:.2f})"
        )
        hint = f'set imu.axes = "{axes.proposed}", or reverse the vehicle frame if the run was backwards'
        found.append(
            Finding("warning", "forward-axis", message, file=_TOML, column="imu.axes", expected="+x", hint=hint)
        )
    slope, correlation = axes.gyro_slope, axes.lateral_correlation
    if slope is None or correlation is None or abs(correlation) < limits.axis_correlation:
        return found
    if slope < 0 and not (strong and axes.best_forward != "+x"):
        message = f"lateral specific force falls where speed x yaw rate grows (correlation {correlation:.2f})"
        hint = "check the signs of the gyro's columns, and of imu.axes: gyro and accelerometer share it"
        found.append(
            Finding("warning", "gyro-sign", message, file=_TOML, column="imu.axes", expected="it to grow", hint=hint)
        )
    if abs(correlation) > 0.8 and not 0.5 < abs(slope) < 2.0:
        message = f"lateral specific force is {abs(slope):.3g} times what speed and gyro imply"
        hint = "check the units and scales of gyro, accelerometer and tach"
        found.append(
            Finding("warning", "gyro-scale", message, file=_TOML, column="imu.gyro_unit", expected="about 1", hint=hint)
        )
    return found


def _clock(recording: Recording, offset: ClockOffset | None) -> list[Finding]:
    tach = recording.description.tach
    if offset is None or tach is None or abs(offset.offset_s) < max(0.02, 4.0 * offset.sd_s):
        return []
    message = f"the tach's clock is off by {offset.offset_s:+.3f} s (sd {offset.sd_s:.3f} s)"
    hint = f"set tach.time_offset_s = {tach.time_offset_s + offset.offset_s:.3f}, or have it estimated"
    return [
        Finding("warning", "clock-offset", message, file=_TOML, column="tach.time_offset_s", expected="0", hint=hint)
    ]


def _bias(recording: Recording, bias: StaticBias | None) -> list[Finding]:
    if bias is None:
        return []
    noise = recording.description.imu.noise
    found = []
    gyro = float(np.max(np.abs(bias.gyro_radps)))
    if gyro > 4.0 * noise.gyro_bias_sd + 1e-4:
        message = f"the gyro shows {gyro:.3g} rad/s at rest, declared sigma {noise.gyro_bias_sd:.3g}"
        hint = f"set gyro_bias_sd = {gyro:.2g}"
        found.append(Finding("warning", "gyro-bias", message, file=_TOML, column="imu.noise.gyro_bias_sd", hint=hint))
    accel = abs(bias.accel_excess_mps2)
    if accel > 4.0 * float(np.hypot(noise.accel_bias_sd, bias.accel_excess_sd_mps2)):
        message = (
            f"specific force at rest is off gravity by {accel:.3g} m/s^2, declared sigma {noise.accel_bias_sd:.3g}"
        )
        hint = f"set accel_bias_sd = {accel:.2g}, or calibrate the accelerometer's scale"
        found.append(Finding("warning", "accel-bias", message, file=_TOML, column="imu.noise.accel_bias_sd", hint=hint))
    return found


def _noise(noise: NoiseDensity | None, limits: CheckLimits) -> list[Finding]:
    """More noise than declared makes every sigma too small; less is information only: motion adds vibration."""
    if noise is None:
        return []
    found = []
    for name, value, ratio in (
        ("gyro_white", noise.gyro_white, noise.gyro_ratio),
        ("accel_white", noise.accel_white, noise.accel_ratio),
    ):
        key = f"imu.noise.{name}"
        if ratio > limits.noise_ratio_warning:
            message = f"the noise at rest is {value:.3g}, {ratio:.1f} times what is declared"
            found.append(
                Finding(
                    "warning", "noise-low", message, file=_TOML, column=key, hint=f"set {name} = {value:.2g} or more"
                )
            )
        elif ratio < 1.0 / limits.noise_ratio_warning:
            message = f"the noise at rest is {value:.3g}, {ratio:.2g} of what is declared"
            found.append(Finding("info", "noise-high", message, file=_TOML, column=key))
    return found


def _wheel(recording: Recording, wheel: WheelScale | None) -> list[Finding]:
    tach = recording.description.tach
    if wheel is None or tach is None or abs(wheel.scale - 1.0) < 3.0 * float(np.hypot(tach.scale_sd, wheel.sd)):
        return []
    message = f"true distance is {wheel.scale:.5f} (sd {wheel.sd:.5f}) of the tach's, by {wheel.source}"
    key, hint = "tach.scale_sd", f"check tach.unit, or set tach.scale_sd = {abs(wheel.scale - 1.0):.2g}"
    if tach.kind == "pulses" and tach.wheel_diameter_m is not None:
        key = "tach.wheel_diameter_m"
        hint = f"set tach.wheel_diameter_m = {tach.wheel_diameter_m * wheel.scale:.4f}"
    expected = f"1 within {3.0 * tach.scale_sd:.3g}"
    return [Finding("warning", "wheel-scale", message, file=_TOML, column=key, expected=expected, hint=hint)]

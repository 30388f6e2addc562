"""Contradictions of the inertial sensor: its axes, columns and mounting, its clocks, filters, bias and noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from trackfg.checks.columns import ColumnPlace
from trackfg.checks.contradictions.description_warning import TOML, description_warning
from trackfg.checks.diagnosis_axes import AxesEstimate
from trackfg.checks.diagnosis_force import ForceFit, Signs
from trackfg.checks.diagnosis_rest import NoiseDensity, StaticBias
from trackfg.checks.limits import CheckLimits
from trackfg.numerics import rotations
from trackfg.numerics.chainage.passes import only_falls
from trackfg.recording.description import Imu
from trackfg.recording.findings import Finding, Level
from trackfg.recording.model import Recording
from trackfg.sensors.averages import averaged
from trackfg.sensors.imu_filters.accelerometer_clock import AccelerometerClock
from trackfg.sensors.imu_filters.bandwidth import SHORTEST_D1_M, Bandwidths
from trackfg.sensors.sampling_rate import rate_stretches

_COLUMN_CODES = {"accel": ("accel-sign", "accel-columns"), "gyro": ("gyro-sign", "gyro-columns")}

_USUAL_TOP = 95.0
"""Percentile of the speed up to which waves of the track are to be seen."""


def axes_findings(recording: Recording, axes: AxesEstimate, force: ForceFit | None) -> list[Finding]:
    """Return a finding for another axis than forward; a tach that never rises is rather of the other sense than all
    axes are backwards.
    """
    if axes.forward_correlation is None or axes.best_forward_correlation is None:
        return []
    if axes.forward_by == "tach":
        is_wrong = force is not None and force.axes_are_wrong
    else:
        is_wrong = axes.shown_by == "motion" and axes.best_forward != "+x"
    if not is_wrong:
        return []
    tach, described = recording.tach, recording.description.tach
    if (
        axes.best_forward == "-x"
        and tach is not None
        and described is not None
        and only_falls(tach["distance_m"].to_numpy())
    ):
        message = (
            "the tach only falls, and the accelerometer measures -1 times its acceleration "
            f"(correlation {axes.best_forward_correlation:.2f}): it counts in the other sense"
        )
        hint = "negate the column; trackfg smooth does so. Or reverse the vehicle frame if the run was backwards"
        expected = "a tach that rises where the vehicle moves forwards"
        about = Finding("warning", "tach-factor", message, file=described.file, column=described.column)
        return [replace(about, expected=expected, hint=hint)]
    message = (
        f"with {axes.declared!r} the axis that follows the acceleration of the {axes.forward_by} is "
        f"{axes.best_forward} (correlation {axes.best_forward_correlation:.2f}; forward {axes.forward_correlation:.2f})"
    )
    hint = f'set imu.axes = "{axes.proposed}", or reverse the vehicle frame if the run was backwards'
    return [description_warning("forward-axis", message, "imu.axes", "+x", hint)]


def columns_findings(imu: Imu, force: ForceFit | None) -> list[Finding]:
    """Return findings for columns that are exchanged or have the wrong sign, by sensor."""
    if force is None or not force.columns_are_wrong:
        return []
    findings = []
    for sensor, names, signs in (("accel", imu.accel, force.accel), ("gyro", imu.gyro, force.gyro)):
        P = _in_sensor_axes(imu, signs)
        order, negated = np.abs(P).argmax(axis=1), P.sum(axis=1) < 0.0
        moved = [names[i] for i in range(3) if order[i] != i]
        turned = [names[j] for j, is_negated in zip(order, negated, strict=True) if is_negated]
        if not moved and not turned:
            continue
        faults, edits = [], []
        if moved:
            faults.append(f"{_listed(moved)} are in the wrong order")
            wanted = ", ".join(f'"{names[j]}"' for j in order)
            edits.append(f"set imu.{sensor} = [{wanted}]")
        if turned:
            faults.append(f"{_listed(turned)} {'has' if len(turned) == 1 else 'have'} the wrong sign")
            edits.append(f"negate {_listed(turned)}")
        message = (
            f"the specific force that tach and gyro imply is {force.contradiction:.3g} times further off than if "
            f"{' and '.join(faults)} (power of the difference)"
        )
        code, columns = _COLUMN_CODES[sensor][int(bool(moved))], ", ".join(moved or turned)
        expected, hint = "gyro and accelerometer in one right-handed triad, as imu.axes", " and ".join(edits)
        findings.append(Finding("warning", code, message, file=imu.file, column=columns, expected=expected, hint=hint))
    return findings


def _in_sensor_axes(imu: Imu, signs: Signs) -> np.ndarray:
    """Return the signed permutation of a sensor's columns for one of the vehicle's axes, both (3, 3)."""
    axes = rotations.axes_matrix(imu.axes)
    return np.asarray(axes.T @ np.array(signs) @ axes)


def _listed(names: Sequence[str]) -> str:
    return ("column " if len(names) == 1 else "columns ") + " and ".join(repr(name) for name in names)


def mounting_findings(force: ForceFit | None, limits: CheckLimits) -> list[Finding]:
    """Return a finding for a sensor that is turned against the direction of travel, by the accelerations that it
    measures.
    """
    if force is None:
        return []
    turns = (("pitch", force.pitch, ("below", "above")), ("yaw", force.yaw, ("to the left of", "to the right of")))
    findings = []
    for name, angle, ways in turns:
        if angle is None or not angle.exceeds(limits.mounting_deg):
            continue
        size, way = f"{abs(angle.value_deg):.1f} deg (sd {angle.sd_deg:.1f} deg)", ways[int(angle.value_deg < 0.0)]
        message = f"the sensor points {size} {way} the direction of travel, by the accelerations that it measures"
        hint = f"turn imu.mount_rpy_deg by {name} {angle.value_deg:.1f} deg, or have it estimated"
        findings.append(
            description_warning("mounting", message, "imu.mount_rpy_deg", f"within {limits.mounting_deg:g} deg", hint)
        )
    return findings


def accelerometer_findings(imu: Imu, clock: AccelerometerClock | None) -> list[Finding]:
    """Return a finding where the accelerometer's samples are surely later or earlier than the gyro's."""
    if clock is None or not clock.is_sure:
        return []
    columns, hint = ", ".join(imu.accel), "filter both alike; trackfg smooth moves the samples, a stream does not"
    about = Finding("warning", "accelerometer-clock", clock.sentence, file=imu.file, column=columns)
    return [replace(about, expected="both of one time", hint=hint)]


def bandwidths_findings(recording: Recording, bandwidths: Bandwidths | None) -> list[Finding]:
    """Return findings for samples of less bandwidth than their rate: a warning where a sensor that follows the track
    loses waves of it.
    """
    if bandwidths is None:
        return []
    imu, tach = recording.description.imu, recording.tach
    speed = 0.0
    if imu.rigid and tach is not None and (motion := averaged(recording.imu, tach, 1.0)) is not None:
        speed = float(np.percentile(np.abs(motion.speed), _USUAL_TOP))
    findings = []
    for columns, hz in ((imu.gyro, bandwidths.gyro_hz), (imu.accel, bandwidths.accel_hz)):
        if hz is None:
            continue
        message = f"samples hold little above {hz:.2g} Hz: they were filtered, averaged or interpolated"
        missing = f"at {speed:.0f} m/s waves of the track shorter than {speed / hz:.1f} m are missing: "
        is_lost = speed > SHORTEST_D1_M * hz
        hint = (missing if is_lost else "") + "log samples of the sensor's own rate, with a filter near half of it"
        level: Level = "warning" if is_lost else "info"
        findings.append(Finding(level, "imu-bandwidth", message, file=imu.file, column=", ".join(columns), hint=hint))
    return findings


def rates_findings(recording: Recording) -> list[Finding]:
    """Say that the rate of the IMU's samples changes, and where first."""
    t, imu = recording.imu["t_s"].to_numpy(), recording.description.imu
    steps = np.diff(t)
    stretches = rate_stretches(steps)
    if len(stretches) < 2:
        return []
    rates = [f"{1.0 / np.median(steps[first:end]):.3g}" for first, end in stretches]
    shown = " to ".join(rates[:3]) + (" and so on" if len(rates) > 3 else "")
    message = f"the rate changes from {shown} samples a second; each part has the noise of its own rate"
    row = stretches[1][0]
    return [ColumnPlace(imu.file, imu.time, t).at_row(row, "rate-changes", message, None, None, "info")]


def bias_findings(recording: Recording, bias: StaticBias | None) -> list[Finding]:
    """Return findings for biases at rest that are larger than declared."""
    if bias is None:
        return []
    noise = recording.description.imu.noise
    findings = []
    gyro = float(np.max(np.abs(bias.gyro_radps)))
    if gyro > 4.0 * noise.gyro_bias_sd + 1e-4:
        message = f"the gyro shows {gyro:.3g} rad/s at rest, declared sigma {noise.gyro_bias_sd:.3g}"
        hint = f"set gyro_bias_sd = {gyro:.2g}"
        findings.append(description_warning("gyro-bias", message, "imu.noise.gyro_bias_sd", hint=hint))
    accel = abs(bias.accel_excess_mps2)
    if accel > 4.0 * float(np.hypot(noise.accel_bias_sd, bias.accel_excess_sd_mps2)):
        message = (
            f"specific force at rest is off gravity by {accel:.3g} m/s^2, declared sigma {noise.accel_bias_sd:.3g}"
        )
        hint = f"set accel_bias_sd = {accel:.2g}, or calibrate the accelerometer's scale"
        findings.append(description_warning("accel-bias", message, "imu.noise.accel_bias_sd", hint=hint))
    return findings


def noise_findings(noise: NoiseDensity | None, limits: CheckLimits) -> list[Finding]:
    """Return findings for noise: more than declared makes every sigma too small; less is information only: motion adds
    vibration.
    """
    if noise is None:
        return []
    findings = []
    for name, value, ratio in (
        ("gyro_white", noise.gyro_white, noise.gyro_ratio),
        ("accel_white", noise.accel_white, noise.accel_ratio),
    ):
        key = f"imu.noise.{name}"
        if ratio > limits.noise_ratio_warning:
            message = f"the noise at rest is {value:.3g}, {ratio:.1f} times what is declared or assumed"
            findings.append(description_warning("noise-low", message, key, hint=f"set {name} = {value:.2g} or more"))
        elif ratio < 1.0 / limits.noise_ratio_warning:
            message = f"the noise at rest is {value:.3g}, {ratio:.2g} of what is declared or assumed"
            hint = f"set {name} = {value:.2g}, unless it stands for vibration in motion: sigmas are wider by it"
            findings.append(Finding("info", "noise-high", message, file=TOML, column=key, hint=hint))
    return findings

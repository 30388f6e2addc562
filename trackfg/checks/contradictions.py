"""The estimates of a recording that contradict its description become findings that name the cause and the edit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from trackfg.checks.columns import FEWEST_ROWS, ColumnPlace
from trackfg.checks.diagnosis import Estimates, estimates_of
from trackfg.checks.diagnosis_axes import AxesEstimate
from trackfg.checks.diagnosis_clock import ClockOffset
from trackfg.checks.diagnosis_force import ForceFit, Signs
from trackfg.checks.diagnosis_positions import PositionFit
from trackfg.checks.diagnosis_rest import NoiseDensity, StaticBias
from trackfg.checks.diagnosis_silence import SilentSpan
from trackfg.checks.diagnosis_speed import Slope
from trackfg.checks.diagnosis_wheel import WheelScale
from trackfg.checks.inertial import imu_channels
from trackfg.checks.inertial.imu_faults import without_imu_faults
from trackfg.checks.inertial.repeated_rows import without_repeated_rows
from trackfg.checks.limits import CheckLimits
from trackfg.checks.receiver_speeds import receiver_speed_findings
from trackfg.checks.sizes import is_ratio_of_units
from trackfg.numerics import rotations
from trackfg.numerics.chainage.passes import only_falls
from trackfg.numerics.units import KMH
from trackfg.recording.antenna import with_antenna_named
from trackfg.recording.description import Imu, Tach
from trackfg.recording.findings import Finding, Level
from trackfg.recording.model import Recording
from trackfg.recording.unmeasured_rows import unmeasured_in
from trackfg.sensors.averages import averaged
from trackfg.sensors.imu_filters.accelerometer_clock import AccelerometerClock
from trackfg.sensors.imu_filters.bandwidth import SHORTEST_D1_M, Bandwidths
from trackfg.sensors.sampling_rate import rate_stretches
from trackfg.sensors.tach import with_sense

_TOML = "recording.toml"


def diagnose(recording: Recording, limits: CheckLimits | None = None) -> tuple[Estimates, list[Finding]]:
    """Estimate everything, and return it with whatever it shows to be wrong or doubtful.

    Estimates are made without the rows of the IMU that the smoother drops, unless it would drop most: then a unit is
    wrong, say, and the estimates are to show it. A tach of fewer than two rows, as a part of a run may have, says
    nothing.
    """
    limits = limits or CheckLimits()
    if recording.tach is not None and len(recording.tach) < FEWEST_ROWS["tach"]:
        recording = replace(recording, tach=None)
    measured = without_repeated_rows(recording)
    sound = without_imu_faults(measured, limits)
    sound = sound if 2 * len(sound.imu) > len(measured.imu) else measured
    estimates = estimates_of(sound)
    channels = imu_channels.findings(recording.description.imu, recording.imu, limits)
    return estimates, [*channels, *contradictions(sound, estimates, limits)]


def contradictions(recording: Recording, estimates: Estimates, limits: CheckLimits) -> list[Finding]:
    """Return where the estimates contradict the description."""
    description, force = recording.description, estimates.force
    mirrored = _mirrored(recording, estimates.positions, force)
    # Exchanged degrees have chords of another length: what these say of clock and wheel follows from the exchange.
    distorted = bool(mirrored) and description.gnss is not None and description.gnss.frame == "geodetic"
    return [
        *_axes(recording, estimates.axes, force),
        *_columns(description.imu, force),
        *mirrored,
        *_turns(recording, estimates.positions.course),
        *_mounting(force, limits),
        *_clock(description.tach, estimates.clock_offset),
        *_accelerometer(description.imu, estimates.accelerometer_clock),
        *_bandwidths(recording, estimates.bandwidths),
        *_rates(recording),
        *_bias(recording, estimates.static_bias),
        *_noise(estimates.noise_density, limits),
        *_speed(description.tach, force, limits),
        *_curves(description.tach, estimates, limits),
        *_silence(description.tach, estimates.silent_spans),
        *_wheel(description.tach, estimates.wheel_scale_fixes, force, limits),
        *_wheel(description.tach, None if distorted else estimates.wheel_scale_gnss, force, limits),
        *with_antenna_named([] if distorted else _gnss(recording, estimates.positions, limits), description.gnss),
        *receiver_speed_findings(description.gnss_speed, None if distorted else estimates.receiver_speed_scale, limits),
        *(finding for _, finding in unmeasured_in(recording).values()),
        *_fixes(recording, estimates.positions, limits),
        *_fix_order(recording),
    ]


def _warning(code: str, message: str, column: str, expected: str | None = None, hint: str | None = None) -> Finding:
    """Return a warning about a key of the description."""
    return Finding("warning", code, message, file=_TOML, column=column, expected=expected, hint=hint)


def _axes(recording: Recording, axes: AxesEstimate, force: ForceFit | None) -> list[Finding]:
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
    return [_warning("forward-axis", message, "imu.axes", "+x", hint)]


_COLUMN_CODES = {"accel": ("accel-sign", "accel-columns"), "gyro": ("gyro-sign", "gyro-columns")}


def _columns(imu: Imu, force: ForceFit | None) -> list[Finding]:
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


def _mounting(force: ForceFit | None, limits: CheckLimits) -> list[Finding]:
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
        findings.append(_warning("mounting", message, "imu.mount_rpy_deg", f"within {limits.mounting_deg:g} deg", hint))
    return findings


def _clock(tach: Tach | None, offset: ClockOffset | None) -> list[Finding]:
    if offset is None or tach is None or not offset.is_sure:
        return []
    message = f"the tach's clock is off by {offset.offset_s:+.3f} s (sd {offset.sd_s:.3f} s)"
    hint = f"set tach.time_offset_s = {tach.time_offset_s + offset.offset_s:.3f}, or have it estimated"
    return [_warning("clock-offset", message, "tach.time_offset_s", "0", hint)]


def _accelerometer(imu: Imu, clock: AccelerometerClock | None) -> list[Finding]:
    """Return a finding where the accelerometer's samples are surely later or earlier than the gyro's."""
    if clock is None or not clock.is_sure:
        return []
    columns, hint = ", ".join(imu.accel), "filter both alike; trackfg smooth moves the samples, a stream does not"
    about = Finding("warning", "accelerometer-clock", clock.sentence, file=imu.file, column=columns)
    return [replace(about, expected="both of one time", hint=hint)]


_USUAL_TOP = 95.0
"""Percentile of the speed up to which waves of the track are to be seen."""


def _bandwidths(recording: Recording, bandwidths: Bandwidths | None) -> list[Finding]:
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


def _rates(recording: Recording) -> list[Finding]:
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


def _bias(recording: Recording, bias: StaticBias | None) -> list[Finding]:
    if bias is None:
        return []
    noise = recording.description.imu.noise
    findings = []
    gyro = float(np.max(np.abs(bias.gyro_radps)))
    if gyro > 4.0 * noise.gyro_bias_sd + 1e-4:
        message = f"the gyro shows {gyro:.3g} rad/s at rest, declared sigma {noise.gyro_bias_sd:.3g}"
        hint = f"set gyro_bias_sd = {gyro:.2g}"
        findings.append(_warning("gyro-bias", message, "imu.noise.gyro_bias_sd", hint=hint))
    accel = abs(bias.accel_excess_mps2)
    if accel > 4.0 * float(np.hypot(noise.accel_bias_sd, bias.accel_excess_sd_mps2)):
        message = (
            f"specific force at rest is off gravity by {accel:.3g} m/s^2, declared sigma {noise.accel_bias_sd:.3g}"
        )
        hint = f"set accel_bias_sd = {accel:.2g}, or calibrate the accelerometer's scale"
        findings.append(_warning("accel-bias", message, "imu.noise.accel_bias_sd", hint=hint))
    return findings


def _noise(noise: NoiseDensity | None, limits: CheckLimits) -> list[Finding]:
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
            findings.append(_warning("noise-low", message, key, hint=f"set {name} = {value:.2g} or more"))
        elif ratio < 1.0 / limits.noise_ratio_warning:
            message = f"the noise at rest is {value:.3g}, {ratio:.2g} of what is declared or assumed"
            hint = f"set {name} = {value:.2g}, unless it stands for vibration in motion: sigmas are wider by it"
            findings.append(Finding("info", "noise-high", message, file=_TOML, column=key, hint=hint))
    return findings


def _speed(tach: Tach | None, force: ForceFit | None, limits: CheckLimits) -> list[Finding]:
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
        findings.append(_warning("speed-scale", message, key, "1", hint))
    if lateral is not None and abs(lateral.correlation) >= _SURE_CORRELATION and lateral.excludes(0.5, 2.0):
        message = f"lateral specific force is {lateral.value:.3g} times what speed and gyro imply"
        hint = "check the units and scales of gyro, accelerometer and tach"
        findings.append(_warning("gyro-scale", message, "imu.gyro_unit", "about 1", hint))
    return findings


_FEWEST_STRETCHES = 3
"""Stretches between fixes from which on a scale that no wheel has is reported."""

_SURE_CORRELATION = 0.8
"""Lateral force has causes of its own (springs, rails): its slope says something from this correlation on."""


def _rescaled(tach: Tach, scale: float) -> tuple[str, str]:
    """Return the key and the edit that multiply the tach's distance by ``scale``."""
    for unit, other, ratio in (("m/s", "km/h", KMH), ("km/h", "m/s", 1.0 / KMH), ("m", "mm", 1e-3), ("mm", "m", 1e3)):
        if tach.unit == unit and is_ratio_of_units(scale, ratio):
            return "tach.unit", f'the data look like {other}: set tach.unit = "{other}"'
    if tach.kind == "pulses" and tach.wheel_diameter_m is not None:
        diameter = tach.wheel_diameter_m * scale
        return "tach.wheel_diameter_m", f"set tach.wheel_diameter_m = {diameter:.4g}, or check tach.pulses_per_rev"
    return "tach.unit", f"check tach.unit; distances must be multiplied by {scale:.4g}"


def _silence(tach: Tach | None, spans: Sequence[SilentSpan]) -> list[Finding]:
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


def _curves(tach: Tach | None, estimates: Estimates, limits: CheckLimits) -> list[Finding]:
    """Return a finding for a wheel that is off by some percent, by the force of curves, where neither fixes nor GNSS
    determine its scale.
    """
    force, low, high = estimates.force, 1.0 / limits.lateral_scale, limits.lateral_scale
    if tach is None or force is None or estimates.wheel_scale_fixes or estimates.wheel_scale_gnss:
        return []
    lateral, forward = force.lateral, force.forward
    if lateral is None or lateral.correlation < _SURE_CORRELATION or not lateral.excludes(low, high):
        return []
    if forward is None or forward.excludes(1.0 / limits.speed_scale, limits.speed_scale) or lateral.excludes(0.5, 2.0):
        return []  # the tach's unit or the gyro's
    message = (
        f"lateral force in curves is {lateral.value:.3f} times what speed and gyro imply "
        f"(surely {lateral.low:.3f} to {lateral.high:.3f})"
    )
    key, hint = _rescaled(tach, lateral.value)
    hint = f"{hint}; or check the gyro's scale"
    return [_warning("curve-scale", message, key, f"1 within {100.0 * (high - 1.0):.0f} %", hint)]


def _wheel(tach: Tach | None, wheel: WheelScale | None, force: ForceFit | None, limits: CheckLimits) -> list[Finding]:
    if wheel is None or tach is None or abs(wheel.scale - 1.0) < 3.0 * float(np.hypot(tach.scale_sd, wheel.sd)):
        return []
    if not 0.5 < wheel.scale < 2.0 and wheel.samples < _FEWEST_STRETCHES:  # fixes of one place, passed again
        return []
    forward = None if force is None else force.forward
    is_tach = forward is None or forward.excludes(1.0 / limits.speed_scale, limits.speed_scale)
    if not is_tach and wheel.source == "fixes" and not 0.5 < wheel.scale < 2.0:
        message = f"chainage grows by {wheel.scale:.4g} m for each m of the tach, whose speeds fit the accelerometer"
        what = "km: multiply them by 1000" if is_ratio_of_units(wheel.scale, 1e-3) else "another unit"
        return [_warning("fix-unit", message, "fixes.chainage", "1", f"chainages are in m; these look like {what}")]
    message = f"true distance is {wheel.scale:.5f} (sd {wheel.sd:.5f}) of the tach's, by {wheel.source}"
    if abs(np.log(wheel.scale)) > np.log(limits.speed_scale) and tach.kind != "pulses":
        key, hint = _rescaled(tach, wheel.scale)
    else:
        key, hint = "tach.scale_sd", f"check tach.unit, or set tach.scale_sd = {abs(wheel.scale - 1.0):.2g}"
    if tach.kind == "pulses" and tach.wheel_diameter_m is not None:
        key = "tach.wheel_diameter_m"
        hint = f"set tach.wheel_diameter_m = {tach.wheel_diameter_m * wheel.scale:.4f}"
    return [_warning("wheel-scale", message, key, f"1 within {3.0 * tach.scale_sd:.3g}", hint)]


def _gnss(recording: Recording, positions: PositionFit, limits: CheckLimits) -> list[Finding]:
    gnss, delay = recording.description.gnss, positions.gnss_delay
    if gnss is None or delay is None or not delay.is_sure(limits.delay_s):
        return []
    message = f"positions come {delay.lag_s:+.2f} s (sd {delay.sd_s:.2f} s) after the motion that they show"
    hint = f"set gnss.time_offset_s = {gnss.time_offset_s - delay.lag_s:.2f}"
    return [_warning("gnss-delay", message, "gnss.time_offset_s", "0", hint)]


def _mirrored(recording: Recording, positions: PositionFit, force: ForceFit | None) -> list[Finding]:
    """Return a finding for a path of positions that turns against the gyro, whose columns are right: two axes of it are
    exchanged.
    """
    gnss, course = recording.description.gnss, positions.course
    gyro_is_wrong = force is not None and force.columns_are_wrong
    if gnss is None or course is None or gyro_is_wrong:
        return []
    if not (course.correlation < -_SURE_CORRELATION and course.high < 0.0):
        return []
    message = f"the path of the positions turns left where the gyro turns right (slope {course.value:.2f})"
    first, second, height = gnss.position
    hint = f'set gnss.position = ["{second}", "{first}", "{height}"], or negate the gyro'
    return [_warning("gnss-mirrored", message, "gnss.position", "1", hint)]


def _turns(recording: Recording, course: Slope | None) -> list[Finding]:
    """Return where the gyro's scale is not that of the positions; with a wheel lateral force shows it."""
    if recording.tach is not None or course is None:
        return []
    if abs(course.correlation) < _SURE_CORRELATION or not course.excludes(0.5, 2.0):
        return []
    imu = recording.description.imu
    message = f"the path of the positions turns {abs(course.value):.3g} times as far as the gyro shows"
    other, ratio = ("deg/s", np.radians(1.0)) if imu.gyro_unit == "rad/s" else ("rad/s", np.degrees(1.0))
    hint = "check the unit and the scale of the gyro"
    if is_ratio_of_units(course.value, ratio):
        hint = f'the data look like {other}: set imu.gyro_unit = "{other}"'
    return [_warning("gyro-scale", message, "imu.gyro_unit", "about 1", hint)]


def _fixes(recording: Recording, positions: PositionFit, limits: CheckLimits) -> list[Finding]:
    fixes, delay = recording.description.fixes, positions.fix_delay
    if fixes is None or delay is None or not delay.is_sure or abs(delay.delay_s) <= limits.delay_s:
        return []
    message = f"fixes come {delay.delay_s:+.2f} s (sd {delay.sd_s:.2f} s) after the tach has passed their places"
    hint = f"set fixes.time_offset_s = {fixes.time_offset_s - delay.delay_s:.2f}"
    return [_warning("fix-delay", message, "fixes.time_offset_s", "0", hint)]


def _fix_order(recording: Recording) -> list[Finding]:
    """Return a finding for fixes whose chainages run against the declared direction: most of them where it is wrong,
    few where they are.
    """
    fixes, part, tach = recording.fixes, recording.description.fixes, recording.description.tach
    if fixes is None or part is None or recording.tach is None or tach is None:
        return []
    rolled = np.interp(fixes["t_s"], recording.tach["t_s"], with_sense(recording)["distance_m"])
    moved = np.diff(rolled, prepend=rolled[:1])
    steps = recording.description.track.direction * fixes["chainage_m"].diff().to_numpy()
    least = 3.0 * fixes["chainage_sd_m"].to_numpy()
    clear = (np.abs(steps) > least) & (np.abs(moved) > least)
    against = clear & (steps * moved < 0.0)
    is_rule = 2 * np.count_nonzero(against) > np.count_nonzero(clear)
    message = f"chainage runs against track.direction = {recording.description.track.direction}"
    other, changes = (-1, "falls") if recording.description.track.direction == 1 else (1, "grows")
    where = "where the vehicle moves forwards" if tach.signed else "along this run"
    hint = f"set track.direction = {other} if chainage {changes} {where}, or sort out the mixed-up fix"
    if tach.signed:
        hint += ", or turn the tach's sign if it counts forward motion as negative"
    place = ColumnPlace(part.file, part.chainage, fixes["t_s"].to_numpy())
    code = "direction" if is_rule else "fix-order"
    return place.at_first(against, code, message, "chainages in the order of the run", hint, "warning")

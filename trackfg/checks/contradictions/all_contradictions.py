"""The estimates of a recording that contradict its description become findings that name the cause and the edit."""

from __future__ import annotations

from dataclasses import replace

from trackfg.checks.columns import FEWEST_ROWS
from trackfg.checks.contradictions.inertial_sensor import (
    accelerometer_findings,
    axes_findings,
    bandwidths_findings,
    bias_findings,
    columns_findings,
    mounting_findings,
    noise_findings,
    rates_findings,
)
from trackfg.checks.contradictions.positions import (
    fix_order_findings,
    fixes_findings,
    gnss_findings,
    mirrored_findings,
    turns_findings,
)
from trackfg.checks.contradictions.rest_throughout import rest_findings
from trackfg.checks.contradictions.wheel import (
    clock_findings,
    curves_findings,
    scale_findings,
    silence_findings,
    speed_findings,
)
from trackfg.checks.diagnosis import Estimates, estimates_of
from trackfg.checks.inertial import imu_channels
from trackfg.checks.inertial.imu_faults import without_imu_faults
from trackfg.checks.inertial.repeated_rows import without_repeated_rows
from trackfg.checks.limits import CheckLimits
from trackfg.checks.receiver_speeds import receiver_speed_findings
from trackfg.recording.antenna import with_antenna_named
from trackfg.recording.findings import Finding
from trackfg.recording.model import Recording
from trackfg.recording.unmeasured_rows import unmeasured_in


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
    rest = rest_findings(sound, estimates, limits)
    return estimates, [*channels, *rest, *contradictions(sound, estimates, limits)]


def contradictions(recording: Recording, estimates: Estimates, limits: CheckLimits) -> list[Finding]:
    """Return where the estimates contradict the description."""
    description, force = recording.description, estimates.force
    mirrored = mirrored_findings(recording, estimates.positions, force)
    # Exchanged degrees have chords of another length: what these say of clock and wheel follows from the exchange.
    distorted = bool(mirrored) and description.gnss is not None and description.gnss.frame == "geodetic"
    late_gnss = [] if distorted else gnss_findings(recording, estimates.positions, limits)
    return [
        *axes_findings(recording, estimates.axes, force),
        *columns_findings(description.imu, force),
        *mirrored,
        *turns_findings(recording, estimates.positions.course),
        *mounting_findings(force, limits),
        *clock_findings(description.tach, estimates.clock_offset),
        *accelerometer_findings(description.imu, estimates.accelerometer_clock),
        *bandwidths_findings(recording, estimates.bandwidths),
        *rates_findings(recording),
        *bias_findings(recording, estimates.static_bias),
        *noise_findings(estimates.noise_density, limits),
        *speed_findings(description.tach, force, limits),
        *curves_findings(description.tach, estimates, limits),
        *silence_findings(description.tach, estimates.silent_spans),
        *scale_findings(description.tach, estimates.wheel_scale_fixes, force, limits),
        *scale_findings(description.tach, None if distorted else estimates.wheel_scale_gnss, force, limits),
        *with_antenna_named(late_gnss, description.gnss),
        *receiver_speed_findings(description.gnss_speed, None if distorted else estimates.receiver_speed_scale, limits),
        *(finding for _, finding in unmeasured_in(recording).values()),
        *fixes_findings(recording, estimates.positions, limits),
        *fix_order_findings(recording),
    ]

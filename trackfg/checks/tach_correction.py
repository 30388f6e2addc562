"""A tach that is wrong throughout is put right before there is a graph: km/h for m/s, the other sense, seconds late.

The graph's priors are those of a tach that is described rightly: a scale to 1 %, a clock to 0.1 s. From there a factor
of 3.6 is one slip from the first interval to the last, and nothing contradicts it. But forward force is the vehicle's
acceleration, once the gyro has shown what is gravity in it: a body pitches on its springs when it brakes, and a road
climbs. Where force is surely another multiple of the tach's acceleration than one
(:func:`trackfg.checks.diagnosis_speed.forward_slope`), the tach is wrong by as much.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from trackfg.checks.diagnosis_clock import ClockOffset, estimate_clock_offset
from trackfg.checks.diagnosis_speed import forward_slope
from trackfg.checks.force_balance import force_balance
from trackfg.numerics.units import KMH, MPH
from trackfg.recording.findings import Finding
from trackfg.recording.model import Recording

_LEAST_CORRELATION = 0.8
"""Below it the slope may be off by a factor of 1.25. With slips under leaves it is 0.5 to 0.8 at short lags."""

_RIGHT = 0.15
"""A tach whose slope may be as near to 1 is right but for its scale, or a sensor's, which is left to the graph."""

_NEAR = 0.1
"""A factor as near to that of a usual mistake, in proportion, is taken for it."""

_OTHER_SENSE = "it counts in the other sense"
_ANOTHER_WHEEL = "the wheel, or the number of pulses of a turn, is another one than described"
_MISTAKES = {
    1.0: "",
    KMH: "its values look like km/h, and are taken for m/s",
    1.0 / KMH: "its values look like m/s, and are taken for km/h",
    MPH: "its values look like mph, and are taken for m/s",
    1e-3: "its values look like mm, and are taken for m",
    1e3: "its values look like m, and are taken for mm",
}
"""Usual mistakes by the factor that corrects them."""

_LATEST_S = 5.0
"""A tach that seems to be later is none of this run's, s."""

_CLEARLY_LATE_S = 0.2
"""A clock is moved beforehand where it is off by more, s: two sigmas of what the graph takes it for."""

_CLEAR_SIGMAS = 4.0
"""And where it is off by so many sigmas."""


@dataclass(frozen=True)
class TachCorrection:
    """The correction of a tach: its distance was multiplied by ``factor``, and ``clock_s`` added to its times."""

    factor: float = 1.0
    clock_s: float = 0.0
    findings: tuple[Finding, ...] = ()


def corrected_tach(recording: Recording) -> tuple[Recording, TachCorrection]:
    """Return the recording with a tach that agrees with the accelerometer, and what was done to it for that."""
    tach, described = recording.tach, recording.description.tach
    if tach is None or described is None or len(tach) < 2:
        return recording, TachCorrection()
    findings, clock_s = [], 0.0
    offset = estimate_clock_offset(recording, _LATEST_S)
    if offset is not None and _is_clear(offset):
        clock_s = offset.offset_s
        recording = replace(recording, tach=tach.assign(t_s=tach["t_s"] + clock_s))
        findings.append(_late(clock_s, described.time_offset_s))
    factor = force_per_acceleration(recording)
    if factor is None or abs(factor - 1.0) < _RIGHT or (factor < 0.0 and not described.signed):
        return recording, TachCorrection(1.0, clock_s, tuple(findings))
    named, why = _mistake(factor)
    findings.append(_wrong(named, why))
    assert recording.tach is not None
    table = recording.tach.assign(distance_m=named * recording.tach["distance_m"])
    # What is left of the factor is the wheel's scale: known as well as the slope, or as described.
    scale_sd = max(described.scale_sd, _NEAR / 2.0)
    description = recording.description.model_copy(update={"tach": described.model_copy(update={"scale_sd": scale_sd})})
    recording = replace(recording, tach=table, description=description)
    return recording, TachCorrection(named, clock_s, tuple(findings))


def _is_clear(offset: ClockOffset) -> bool:
    """Return whether the tach is surely off in time, and does not slip: slips come before what they make of a speed."""
    apart = abs(offset.offset_s) > max(_CLEARLY_LATE_S, _CLEAR_SIGMAS * offset.sd_s)
    return apart and abs(offset.correlation) > _LEAST_CORRELATION


def _mistake(factor: float) -> tuple[float, str]:
    """Return the factor of a usual mistake near to one that was found, or that one, and what is wrong."""
    sense, size = float(np.sign(factor)), abs(factor)
    named = min(_MISTAKES, key=lambda known: abs(size / known - 1.0))
    size, why = (named, _MISTAKES[named]) if abs(size / named - 1.0) < _NEAR else (size, _ANOTHER_WHEEL)
    reasons = (*((_OTHER_SENSE,) if sense < 0.0 else ()), *((why,) if why else ()))
    return sense * size, "; ".join(reasons)


def force_per_acceleration(recording: Recording) -> float | None:
    """Return k, the slope of force on the tach's acceleration, 1 if it may be near 1; None if nothing determines it."""
    assert recording.tach is not None
    balance = force_balance(recording.imu, recording.tach)
    slope = None if balance is None else forward_slope(balance, np.eye(3))
    if slope is None or abs(slope.correlation) < _LEAST_CORRELATION:
        return None
    may_be_right = slope.value > 0.0 and not slope.excludes(1.0 / (1.0 + _RIGHT), 1.0 + _RIGHT)
    return 1.0 if may_be_right else slope.value


def _late(clock_s: float, declared_s: float) -> Finding:
    message = f"the tach is {abs(clock_s):.2f} s {'early' if clock_s > 0.0 else 'late'} against the accelerometer"
    hint = f"it was moved; to have it so beforehand, set tach.time_offset_s = {declared_s + clock_s:.2f}"
    return Finding("warning", "tach-clock", message, hint=hint)


def _wrong(factor: float, why: str) -> Finding:
    message = f"the accelerometer measures {factor:.3g} times the tach's acceleration: {why}"
    hint = f"its distance was multiplied by {factor:.4g}; correct [tach] in recording.toml"
    return Finding("warning", "tach-factor", message, hint=hint)

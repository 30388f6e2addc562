"""Axes, and units that the source does not state, are settled by gravity, curves and the tach's acceleration."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from trackfg.checks.diagnosis import estimates_of
from trackfg.checks.diagnosis_axes import AXES, levelling_deg
from trackfg.checks.limits import CheckLimits
from trackfg.files.temporary_folder import temporary_folder
from trackfg.interchange.importing.columns.written_units import Quantity, factor_of
from trackfg.interchange.importing.conversion import write_imported
from trackfg.interchange.importing.mapping import mapping_of
from trackfg.interchange.importing.proposals.questions import Ask, Proposal, Question, asked, asked_unit
from trackfg.interchange.importing.source_table import SourceTable
from trackfg.numerics import rotations
from trackfg.numerics.spans import median_interval

if TYPE_CHECKING:
    from trackfg.checks.diagnosis import Estimates
    from trackfg.recording.model import Recording

_CANDIDATES: dict[str, tuple[Quantity, tuple[str, ...]]] = {
    "tach.unit": ("speed", ("m/s", "km/h", "mph", "mm/s", "cm/s", "0.1 km/h", "0.01 km/h")),
    "gnss_speed.unit": ("speed", ("m/s", "km/h", "kn", "mph", "mm/s", "cm/s")),
    "imu.gyro_unit": ("angular rate", ("rad/s", "deg/s", "mrad/s", "mdeg/s")),
}
"""Units among which the force decides, where the source states none; buses of vehicles count tenths and hundredths of
km/h. It cannot distinguish a knot from a mile per hour,
since gradients and a sensor's tilt falsify it by some percent: a wheel's speed is in neither knots nor feet per second.
For a receiver's speed its positions decide."""
_ANGLES = ("rad", "deg")
"""Units of a gyro's increments."""
_LENGTHS = ("m", "km", "ft", "mm", "cm", "mi")
_MOST_EMPTY = 10
"""Times the samples at their usual interval: a longer span is nearly all a gap, where a clock has jumped. Then only
the gravity of one part is asked: motion would be compared over all of that time."""
_FITS = 1.25
"""A unit fits a slope that is off by less than this factor: half a step between the nearest units, km/h and mph, is
1.27."""


def settle_by_force(proposal: Proposal, tables: Sequence[SourceTable], ask: Ask) -> None:
    """Set the axes that the data show, and ask where they do not show them clearly; likewise units that are assumed."""
    imu = proposal.sections["imu"]
    if "axes" in imu and not proposal.assumed and not {"fixes", "balises"} & proposal.sections.keys():
        return
    recording = _recording(proposal, tables)
    _direction(proposal, recording)
    estimates = estimates_of(recording)
    if "axes" not in imu:
        _axes(proposal, estimates, recording, ask)
        if _counts_the_other_way(proposal, ask):
            recording = _recording(proposal, tables)
            estimates = estimates_of(recording)
            _axes(proposal, estimates, recording, ask)
        if imu["axes"] != estimates.axes.declared:
            estimates = estimates_of(_recording(proposal, tables))  # units show on the right axes only
        _level(proposal, estimates)
    if _settle_speed(proposal, estimates):
        estimates = estimates_of(_recording(proposal, tables))
    _settle_rate(proposal, estimates)
    if (scale := estimates.receiver_speed_scale) is not None:
        by = "wheel is" if recording.gnss is None else "positions are"
        _rescale(proposal, "gnss_speed.unit", scale.scale, f"the {by} as fast")
    for key, text in proposal.assumed.items():
        section, _, name = key.partition(".")
        part = proposal.sections[section]
        part[name] = asked_unit(ask, key, text, part[name], _candidates(key, part)[0])


def _recording(proposal: Proposal, tables: Sequence[SourceTable]) -> Recording:
    with temporary_folder() as folder:
        mapping = mapping_of(proposal.sections, "proposed mapping")
        made = write_imported(tables, mapping, folder / "r", run_id="proposal")
        recording = made.loaded.recording
    assert recording is not None  # write_imported raises where it is not readable
    t = recording.imu["t_s"].to_numpy()
    if np.ptp(t) > _MOST_EMPTY * t.size * median_interval(t):
        parts = np.split(np.arange(t.size), np.flatnonzero(np.diff(t) > CheckLimits().imu_gap_error_s) + 1)
        longest = max(parts, key=len)
        return replace(recording, imu=recording.imu.iloc[longest].reset_index(drop=True), tach=None, gnss=None)
    return recording


def _direction(proposal: Proposal, recording: Recording) -> None:
    """State that the run goes against the chainages, where those of its fixes, or else of its balises, fall."""
    name, places = ("balises", recording.balises) if recording.fixes is None else ("fixes", recording.fixes)
    steps = np.empty(0) if places is None else np.diff(places["chainage_m"].dropna())
    if steps.size and (steps < 0.0).all() and "track" in proposal.sections:
        proposal.sections["track"].setdefault("direction", -1)
        proposal.reasons["track.direction"] = f"the chainages of the {name} fall"


def _axes(proposal: Proposal, estimates: Estimates, recording: Recording, ask: Ask) -> None:
    imu, axes = proposal.sections["imu"], estimates.axes
    correlation = axes.best_forward_correlation
    if correlation is not None and axes.shown_by == "motion":
        imu["axes"] = axes.proposed
        shown = f"gravity and the acceleration of the {axes.forward_by} show it"
        proposal.reasons["imu.axes"] = f"{shown} (correlation {correlation:.2f})"
        return
    up = recording.accel.mean(axis=0)
    vertical = int(np.argmax(np.abs(up)))
    default = next(axes for axes in AXES if axes[vertical] == ("U" if up[vertical] > 0 else "D") and "F" in axes)
    text = "Where do x, y, z point: forward F or back B, left L or right R, up U or down D"
    expected = "a right-handed triad such as FLU"
    question = Question("imu.axes", text, default, accepts=lambda answer: answer.upper() in AXES, expected=expected)
    imu["axes"] = asked(ask, question).upper()
    proposal.reasons["imu.axes"] = "gravity shows which axis is vertical; the others were answered"


def _level(proposal: Proposal, estimates: Estimates) -> None:
    """State the tilt of a sensor that lies along no axis, as a phone in a cup holder does."""
    imu, axes = proposal.sections["imu"], estimates.axes
    up = rotations.axes_matrix(imu["axes"]) @ rotations.axes_matrix(axes.declared).T @ np.array(axes.up)
    if up[2] < math.cos(math.radians(CheckLimits().tilt_warning_deg)):
        roll, pitch = levelling_deg(up)
        imu["mount_rpy_deg"] = [round(roll, 1), round(pitch, 1), 0.0]
        proposal.reasons["imu.mount_rpy_deg"] = "deg of roll, pitch and yaw: gravity shows it"


def _counts_the_other_way(proposal: Proposal, ask: Ask) -> bool:
    """Ask whether an accelerometer that reads down as up, and braking as accelerating, does so by its signs.

    Apple's phones count the force of gravity itself. Mirrored forces and rates satisfy the same equations, so that only
    its owner knows. Turn its signs where it is so, forget the axes, and return that.
    """
    imu = proposal.sections["imu"]
    if not {"B", "D"} <= set(imu["axes"]) or "imu.axes" not in proposal.reasons or imu["accel_unit"].startswith("-"):
        return False
    text = "At rest the accelerometer reads -1 g upwards: is it upside down, or are its signs the other way round?"
    if ask(Question("imu.accel_signs", text, "upside down", ("upside down", "other signs"))) == "upside down":
        return False
    imu["accel_unit"] = f"-1 {imu['accel_unit']}"
    del imu["axes"]
    return True


def _settle_speed(proposal: Proposal, estimates: Estimates) -> bool:
    """Set the unit of a tach that states none by the force that its acceleration needs; return whether that changed."""
    slope = None if estimates.force is None else estimates.force.forward
    if slope is None or slope.correlation < CheckLimits().axis_correlation:
        return False
    return _rescale(proposal, "tach.unit", slope.value, "forward force fits its acceleration")


def _settle_rate(proposal: Proposal, estimates: Estimates) -> None:
    """Set the unit of a gyro that states none by the lateral force that speed and yaw rate need, or else by curves."""
    slopes = {
        "lateral force fits speed and yaw rate": None if estimates.force is None else estimates.force.lateral,
        "the positions turn as it does": estimates.positions.course,
    }
    for reason, slope in slopes.items():
        if slope is not None and abs(slope.correlation) >= CheckLimits().axis_correlation:
            _rescale(proposal, "imu.gyro_unit", abs(slope.value), reason)


def _candidates(key: str, part: dict[str, Any]) -> tuple[Quantity, tuple[str, ...]]:
    if part.get("kind") == "distance":
        return "length", _LENGTHS
    if key == "imu.gyro_unit" and factor_of(part["gyro_unit"], "angle") is not None:
        return "angle", _ANGLES
    return _CANDIDATES[key]


def _rescale(proposal: Proposal, key: str, slope: float, reason: str) -> bool:
    """Set an assumed unit to the one in which values are ``slope`` times as large; return whether it is another one.

    Where no unit fits it stays assumed.
    """
    section, _, name = key.partition(".")
    if key not in proposal.assumed:
        return False
    part = proposal.sections[section]
    quantity, units = _candidates(key, part)
    old_unit = part[name]
    now = factor_of(old_unit, quantity)
    assert now is not None
    off = {unit: abs(math.log((factor_of(unit, quantity) or now) / now / slope)) for unit in (old_unit, *units)}
    unit = min(off, key=lambda unit: off[unit])
    if off[unit] > math.log(_FITS):
        return False
    del proposal.assumed[key]
    proposal.reasons[key] = f"{reason} in {unit}"
    part[name] = unit
    return bool(unit != old_unit)

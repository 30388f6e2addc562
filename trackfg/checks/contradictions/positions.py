"""Contradictions of positions: of satellites and of fixes."""

from __future__ import annotations

import numpy as np

from trackfg.checks.columns import ColumnPlace
from trackfg.checks.contradictions.description_warning import description_warning
from trackfg.checks.diagnosis_force import ForceFit
from trackfg.checks.diagnosis_positions import PositionFit
from trackfg.checks.diagnosis_speed import SURE_CORRELATION, Slope
from trackfg.checks.limits import CheckLimits
from trackfg.checks.sizes import is_ratio_of_units
from trackfg.recording.findings import Finding
from trackfg.recording.model import Recording
from trackfg.sensors.tach import with_sense


def gnss_findings(recording: Recording, positions: PositionFit, limits: CheckLimits) -> list[Finding]:
    """Return a finding for positions that come late or early."""
    gnss, delay = recording.description.gnss, positions.gnss_delay
    if gnss is None or delay is None or not delay.is_sure(limits.delay_s):
        return []
    message = f"positions come {delay.lag_s:+.2f} s (sd {delay.sd_s:.2f} s) after the motion that they show"
    hint = f"set gnss.time_offset_s = {gnss.time_offset_s - delay.lag_s:.2f}"
    return [description_warning("gnss-delay", message, "gnss.time_offset_s", "0", hint)]


def mirrored_findings(recording: Recording, positions: PositionFit, force: ForceFit | None) -> list[Finding]:
    """Return a finding for a path of positions that turns against the gyro, whose columns are right: two axes of it are
    exchanged.
    """
    gnss, course = recording.description.gnss, positions.course
    gyro_is_wrong = force is not None and force.columns_are_wrong
    if gnss is None or course is None or gyro_is_wrong:
        return []
    if not (course.correlation < -SURE_CORRELATION and course.high < 0.0):
        return []
    message = f"the path of the positions turns left where the gyro turns right (slope {course.value:.2f})"
    first, second, height = gnss.position
    hint = f'set gnss.position = ["{second}", "{first}", "{height}"], or negate the gyro'
    return [description_warning("gnss-mirrored", message, "gnss.position", "1", hint)]


def turns_findings(recording: Recording, course: Slope | None) -> list[Finding]:
    """Return where the gyro's scale is not that of the positions; with a wheel lateral force shows it."""
    if recording.tach is not None or course is None:
        return []
    if abs(course.correlation) < SURE_CORRELATION or not course.excludes(0.5, 2.0):
        return []
    imu = recording.description.imu
    message = f"the path of the positions turns {abs(course.value):.3g} times as far as the gyro shows"
    other, ratio = ("deg/s", np.radians(1.0)) if imu.gyro_unit == "rad/s" else ("rad/s", np.degrees(1.0))
    hint = "check the unit and the scale of the gyro"
    if is_ratio_of_units(course.value, ratio):
        hint = f'the data look like {other}: set imu.gyro_unit = "{other}"'
    return [description_warning("gyro-scale", message, "imu.gyro_unit", "about 1", hint)]


def fixes_findings(recording: Recording, positions: PositionFit, limits: CheckLimits) -> list[Finding]:
    """Return a finding for fixes that come late or early."""
    fixes, delay = recording.description.fixes, positions.fix_delay
    if fixes is None or delay is None or not delay.is_sure or abs(delay.delay_s) <= limits.delay_s:
        return []
    message = f"fixes come {delay.delay_s:+.2f} s (sd {delay.sd_s:.2f} s) after the tach has passed their places"
    hint = f"set fixes.time_offset_s = {fixes.time_offset_s - delay.delay_s:.2f}"
    return [description_warning("fix-delay", message, "fixes.time_offset_s", "0", hint)]


def fix_order_findings(recording: Recording) -> list[Finding]:
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

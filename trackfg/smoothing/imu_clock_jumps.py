"""A hole in the stamps of the IMU is a gap, or its clock was set ahead while it went on.

Where only the IMU's clock was set, the tach's was not. Accelerations show the offset between the two clocks
(:mod:`trackfg.checks.diagnosis_clock`) on either side of the hole; without a tach the path shows that of a GNSS
receiver (:mod:`trackfg.sensors.gnss_clock`). Over a gap it stays the same; where the IMU's clock was set by L it
changes by L, and no sample is missing. What neither side shows clearly is taken for a gap.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from trackfg.checks.diagnosis_clock import ClockOffset, estimate_clock_offset
from trackfg.numerics.arrays import Array
from trackfg.numerics.spans import median_interval
from trackfg.recording.findings import Finding
from trackfg.recording.model import Recording
from trackfg.sensors.gnss_clock import GnssClock, gnss_clock

_LEAST_S = 0.5
"""Shorter holes are not looked into, s: the offset of two clocks shows to some tenths of a second."""
_MOST = 20
"""So many holes, the longest ones: a record with more has gaps, not a clock that is set."""
_SIDE_S = 300.0
"""So much of the record on either side of a hole is compared, s."""
_BEYOND_S = {"tach": 1.0, "gnss": 3.0}
"""So much further than the hole the offset is sought, s, to both sides: that of a path has a wider minimum."""
_SIGMAS = 4.0
"""Agreement, in sigmas of the change of the offset."""
_APART_S = {"tach": 0.15, "gnss": 1.0}
"""The same, s: what the offset wanders within minutes, and what its sigma leaves out. By the path it erred by up to
0.6 s in ten runs of ten minutes through street canyons, more than four of its sigmas."""


class ImuClockJump(NamedTuple):
    """The IMU's clock was set ahead ``by_s`` after the sample at ``after_s``, s on the clock as recorded."""

    after_s: float
    by_s: float


def imu_clock_jumps(recording: Recording) -> tuple[ImuClockJump, ...]:
    """Return where the IMU's clock was set ahead, in order of time; nothing without tach and GNSS."""
    name = _other_clock(recording)
    if name is None:
        return ()
    t = recording.imu["t_s"].to_numpy()
    interval, steps = median_interval(t), np.diff(t)
    longest = np.argsort(-steps, kind="stable")[:_MOST]
    holes = np.sort(longest[steps[longest] > interval + _LEAST_S])
    jumps, ahead, begin = [], 0.0, t[0]
    for number, i in enumerate(holes):
        by = float(steps[i]) - interval
        end = t[holes[number + 1]] if number + 1 < len(holes) else t[-1]
        earlier = _offset(recording, name, max(begin, t[i] - _SIDE_S), t[i], ahead, 0.0)
        later = _offset(recording, name, t[i + 1], min(end, t[i + 1] + _SIDE_S), ahead, by)
        begin = t[i + 1]
        if earlier is not None and later is not None and _changes_by(by, earlier, later, _APART_S[name]):
            jumps.append(ImuClockJump(float(t[i]), by))
            ahead += by
    return tuple(jumps)


def without_imu_clock_jumps(recording: Recording) -> Recording:
    """Return the recording with the IMU on the clock it began with, and a finding for each jump taken out."""
    jumps = imu_clock_jumps(recording)
    if not jumps:
        return recording
    t = recording.imu["t_s"].to_numpy()
    ahead: Array = np.zeros(len(t))
    for jump in jumps:
        ahead += jump.by_s * (t > jump.after_s)
    other = {"tach": "the tachometer's", "gnss": "that of GNSS"}[_other_clock(recording) or "tach"]
    findings = tuple(
        Finding(
            "warning",
            "imu-clock-jump",
            f"the IMU's clock jumps ahead by {jump.by_s:.2f} s against {other}; it was set back from there on",
            time_s=jump.after_s,
            hint="let one clock stamp all sensors, and do not set it while recording",
        )
        for jump in jumps
    )
    return replace(recording, imu=recording.imu.assign(t_s=t - ahead), findings=(*recording.findings, *findings))


def _other_clock(recording: Recording) -> str | None:
    """Return the table whose clock shows whether the IMU's was set; None where there is none."""
    return next((name for name in ("tach", "gnss") if name in recording.tables), None)


def _offset(
    recording: Recording, name: str, begin: float, end: float, ahead: float, by: float
) -> ClockOffset | GnssClock | None:
    """Return what brings the times of a table to the IMU's from begin to end, s on the IMU's clock.

    That is already ``ahead`` of the other, and perhaps ``by`` more.
    """
    imu, other = recording.imu, recording.tables[name]
    part = imu[imu["t_s"].between(begin, end)]
    part = part.assign(t_s=part["t_s"] - ahead - 0.5 * by)
    reach = 0.5 * by + _BEYOND_S[name]
    inside = other["t_s"].between(part["t_s"].iloc[0] - reach, part["t_s"].iloc[-1] + reach)
    rows = other[inside].reset_index(drop=True)
    if len(part) < 2 or len(rows) < 2:
        return None
    estimate: ClockOffset | GnssClock | None
    if name == "tach":
        estimate = estimate_clock_offset(replace(recording, imu=part, tach=rows), reach)
    else:
        estimate = gnss_clock(replace(recording, imu=part, gnss=rows), reach)
    return None if estimate is None else replace(estimate, offset_s=estimate.offset_s + 0.5 * by)


def _changes_by(by: float, earlier: ClockOffset | GnssClock, later: ClockOffset | GnssClock, apart_s: float) -> bool:
    """Return whether the offset changes by as much as the hole, and not by nothing."""
    allowed = max(_SIGMAS * float(np.hypot(earlier.sd_s, later.sd_s)), apart_s)
    change = later.offset_s - earlier.offset_s
    return abs(change - by) < allowed < abs(change)

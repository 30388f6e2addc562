"""A hole in the stamps of the IMU is a gap, or its clock was set ahead while it went on.

Where only the IMU's clock was set, those of tach and GNSS were not. The accelerations that IMU and tach show on either
side of the hole distinguish both hypotheses (:mod:`trackfg.checks.clock_change`). Without a tach the minutes around the
hole are smoothed with each, and the IMU's clock was set if that explains the measurements better by far: the difference
of the sums of squares, over their level, is that of a likelihood ratio. What is not clear is taken for a gap.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pandas as pd

from trackfg.checks.clock_change import LEAST_S, SIDE_S, offset_before, was_set
from trackfg.config import SmoothConfig
from trackfg.errors import TrackfgError
from trackfg.graph.build import build_problem
from trackfg.numerics.arrays import Array
from trackfg.numerics.spans import median_interval
from trackfg.recording.findings import Finding
from trackfg.recording.model import Recording
from trackfg.solver.gauss_newton import solve

_MOST = 20
"""So many holes, the longest ones: a record with more has gaps, not a clock that is set."""
_AROUND_S = 120.0
"""So much of the record on either side of a hole is smoothed, s."""

_BETTER = 16.0
"""Difference of the sums of squares, over their level, from which on the clock was set: four sigmas. In simulated runs
it was 24 to 11,000 where a clock was set by 0.6 to 3 s, and below -200 over gaps."""


class ImuClockJump(NamedTuple):
    """The IMU's clock was set ahead ``by_s`` after the sample at ``after_s``, s on the clock as recorded."""

    after_s: float
    by_s: float


def imu_clock_jumps(recording: Recording, config: SmoothConfig) -> tuple[ImuClockJump, ...]:
    """Return where the IMU's clock was set ahead, in order of time; nothing without tach and GNSS."""
    if recording.tach is None and recording.gnss is None:
        return ()
    t = recording.imu["t_s"].to_numpy()
    interval, steps = median_interval(t), np.diff(t)
    longest = np.argsort(-steps, kind="stable")[:_MOST]
    holes = np.sort(longest[steps[longest] > interval + LEAST_S])
    edges = np.concatenate([[-1], holes, [len(t) - 1]])
    jumps, clock = [], t.copy()
    for first, i, last in zip(edges[:-2] + 1, edges[1:-1], edges[2:], strict=True):
        by = float(steps[i]) - interval
        imu = recording.imu.assign(t_s=clock)
        if recording.tach is None:
            is_jump = _explains_better(recording, imu, i, by, config)
        else:
            first = max(first, np.searchsorted(clock, clock[i] - SIDE_S))
            last = min(last, np.searchsorted(clock, clock[i + 1] + SIDE_S, side="right") - 1)
            earlier, later = imu.iloc[first : i + 1], imu.iloc[i + 1 : last + 1]
            offset = offset_before(earlier, recording.tach)
            is_jump = offset is not None and was_set(later, recording.tach, offset, by)
        if is_jump:
            jumps.append(ImuClockJump(float(t[i]), by))
            clock[i + 1 :] -= by
    return tuple(jumps)


def without_imu_clock_jumps(recording: Recording, config: SmoothConfig) -> Recording:
    """Return the recording with the IMU on the clock it began with, and a finding for each jump taken out."""
    jumps = imu_clock_jumps(recording, config)
    if not jumps:
        return recording
    t = recording.imu["t_s"].to_numpy()
    ahead: Array = np.zeros(len(t))
    for jump in jumps:
        ahead += jump.by_s * (t > jump.after_s)
    other = "GNSS" if recording.tach is None else "the tachometer"
    findings = tuple(
        Finding(
            "warning",
            "imu-clock-jump",
            f"the IMU's clock jumps ahead by {jump.by_s:.2f} s against that of {other}; it was set back from there on",
            time_s=jump.after_s,
            hint="let one clock stamp all sensors, and do not set it while recording",
        )
        for jump in jumps
    )
    return replace(recording, imu=recording.imu.assign(t_s=t - ahead), findings=(*recording.findings, *findings))


def _explains_better(recording: Recording, imu: pd.DataFrame, i: int, by: float, config: SmoothConfig) -> bool:
    """Return whether the minutes around the hole after sample i are explained better by a clock that was set.

    Longer holes than these minutes are gaps.
    """
    hole_s = float(imu["t_s"].iloc[i])
    part, gnss = (
        table[table["t_s"].between(hole_s - _AROUND_S, hole_s + by + _AROUND_S)].reset_index(drop=True)
        for table in (imu, recording.tables["gnss"])
    )
    if by > _AROUND_S or gnss.empty:
        return False
    gap = replace(recording, imu=part, gnss=gnss, fixes=None, others={})
    as_set = replace(gap, imu=part.assign(t_s=part["t_s"] - by * (part["t_s"] > hole_s)))
    try:
        of_gap, of_set = (solve(build_problem(hypothesis, config), config.solver) for hypothesis in (gap, as_set))
    except TrackfgError:  # so little of the run that it cannot be smoothed
        return False
    if not (of_gap.converged and of_set.converged):  # costs away from a minimum say nothing of a hypothesis
        return False
    level = max(1.0, 2.0 * of_set.cost / max(of_set.degrees_of_freedom, 1))
    return bool(2.0 * (of_gap.cost - of_set.cost) > _BETTER * level)

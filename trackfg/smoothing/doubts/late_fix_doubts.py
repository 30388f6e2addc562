"""Fixes that are late place the vehicle too far back, and no residual says so.

A reader on a bus or a serial line is late by tenths of a second, and the chainage off by what the vehicle moves
meanwhile. All fixes err alike where speeds are alike: none contradicts another. What changes with the speed shows the
delay (:func:`trackfg.checks.diagnosis_positions.delay_of`): on the way that the smoothed speed makes, of which the
creep under force is known best; or on that of the wheel alone, since a graph may explain late fixes by creep.

Stamps in whole seconds, or tenths, were rounded up, down or to the next one: fixes scatter then by what the vehicle
moves in a step g, which shows, and are all late or early by g/2 besides, or not at all, which does not. Where they
scatter by more than declared the chainage is unsure by the mean square of these three, ``g^2 / 6``.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
import pandas as pd

from trackfg.checks.diagnosis_positions import FixDelay, FixPassages, delay_of
from trackfg.factors.motion import mount_matrix
from trackfg.factors.odometry import SPEED_OFFSET
from trackfg.factors.states import Kind
from trackfg.numerics.arrays import Array
from trackfg.numerics.integrals import trapezoid_integral
from trackfg.output.trajectory import QUANTITIES, keyframe_variances
from trackfg.results.verdict import Doubt
from trackfg.smoothing.doubts.usual_sigmas import LEAST_WIDENING
from trackfg.smoothing.fixes.wrong_fixes import level_in_use
from trackfg.smoothing.reassessment import SolvedRun

_STEPS_S = (1.0, 0.5, 0.2, 0.1, 0.05)
"""Steps to which stamps are rounded, s."""

_FEWEST_STAMPS, _STAMPS_SD_S = 5, 1e-4
"""Of so many stamps all are near a step by chance in 1 of 4e9 runs: near is 0.1 ms, of steps of 50 ms at least."""


def late_fix_doubts(run: SolvedRun, fixes: pd.DataFrame | None) -> list[Doubt]:
    """Return the doubt of the chainage where the ``fixes`` that placed it are surely late."""
    if fixes is None:
        return []
    states, t = run.solution.states, run.problem.t
    speed = states.nav.own_velocity @ mount_matrix(states.mount)[0, :, 0]
    variance = keyframe_variances(states, run.covariance, run.problem.run.lever_arm)[:, QUANTITIES.index("chainage_m")]
    at, chainage, sd = fixes[["t_s", "chainage_m", "chainage_sd_m"]].to_numpy().T
    inside = (at > t[0]) & (at < t[-1])
    passed, chainage, sd = at[inside], chainage[inside], sd[inside]
    passages = FixPassages(
        passed, np.interp(passed, t, trapezoid_integral(t, speed)), np.interp(passed, t, speed), chainage, sd
    )
    creep_sd = float(np.sqrt(np.diagonal(run.covariance.of(Kind.WHEEL)[0])[SPEED_OFFSET - 2 : SPEED_OFFSET].max()))
    delays = [delay_of(passages, creep_sd)]
    if run.problem.wheel is not None:
        rolled = run.problem.wheel.at(passed - states.clock[0, 0])
        delays.append(delay_of(passages._replace(distance=rolled)))
    delay = next((estimate for estimate in delays if estimate is not None and estimate.is_sure), None)
    late = rounded_fixes(passed, lambda: level_in_use(run)) if delay is None else late_fixes(delay)
    return [] if late is None else list(late.doubts(passages.speed, np.interp(passed, t, variance)))


class LateFixes(NamedTuple):
    """Fixes that are ``late_s``, or may be, the reason and what to do."""

    late_s: float
    reason: str
    hint: str

    def doubts(self, speed: Array, variance: Array) -> Iterator[Doubt]:
        """Yield the doubt of a chainage whose ``variance`` is (n,), m^2, at fixes that were passed at a ``speed`` (n,),
        m/s.
        """
        moved = self.late_s * float(np.mean(speed))
        factor = math.sqrt(1.0 + moved**2 * float(np.mean(1.0 / variance)))
        if factor >= LEAST_WIDENING:
            yield Doubt(("chainage",), factor, self.reason, self.hint)


def late_fixes(delay: FixDelay) -> LateFixes:
    """Return fixes that are surely late, or early."""
    return LateFixes(delay.delay_s, late_in_words(delay), f"add {-delay.delay_s:.2f} to fixes.time_offset_s")


def rounded_fixes(t: Array, level: Callable[[], float]) -> LateFixes | None:
    """Return fixes with stamps (n,), s, that are rounded, where they err by a ``level`` above 1, in declared sigmas."""
    step_s = stamp_step_s(t)
    if step_s is None or level() <= 1.0:
        return None
    reason = f"fixes are stamped to {step_s:g} s, and scatter more than declared"
    return LateFixes(step_s / math.sqrt(6.0), reason, "write their times as they were, not rounded")


def stamp_step_s(t: Array) -> float | None:
    """Return the step, s, of which all differences of stamps (n,), s, are multiples; None where they are too few, or of
    none that matters.
    """
    since = np.asarray(t - t[0] if len(t) else t)
    for step in _STEPS_S if len(since) >= _FEWEST_STAMPS else ():
        if np.abs(since - step * np.round(since / step)).max() < _STAMPS_SD_S:
            return step
    return None


def late_in_words(delay: FixDelay) -> str:
    """Say how late fixes are."""
    return f"fixes come {delay.delay_s:+.2f} s (sigma {delay.sd_s:.2f} s) after their places were passed"

"""Fixes that are late place the vehicle too far back, and no residual says so.

A reader on a bus or a serial line is late by tenths of a second, and the chainage off by what the vehicle moves
meanwhile. All fixes err alike where speeds are alike: none contradicts another. What changes with the speed shows the
delay (:func:`trackfg.checks.diagnosis_positions.delay_of`): on the way that the smoothed speed makes, of which the
creep under force is known best; or on that of the wheel alone, since a graph may explain late fixes by creep.
"""

from __future__ import annotations

import math

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
from trackfg.smoothing.reassessment import SolvedRun


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
    if delay is None:
        return []
    factor = moved_in_sigmas(delay, passages.speed, np.interp(passed, t, variance))
    if factor < LEAST_WIDENING:
        return []
    return [Doubt(("chainage",), factor, late_in_words(delay), f"add {-delay.delay_s:.2f} to fixes.time_offset_s")]


def moved_in_sigmas(delay: FixDelay, speed: Array, variance: Array) -> float:
    """Return by how much the delay of fixes, passed at a ``speed`` (n,), m/s, widens the chainage, whose ``variance``
    there is (n,), m^2.
    """
    moved = delay.delay_s * float(np.mean(speed))
    return math.sqrt(1.0 + moved**2 * float(np.mean(1.0 / variance)))


def late_in_words(delay: FixDelay) -> str:
    """Say how late fixes are."""
    return f"fixes come {delay.delay_s:+.2f} s (sigma {delay.sd_s:.2f} s) after their places were passed"

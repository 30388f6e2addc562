"""The judgement of a solved run: doubts of its sigmas become a verdict per quantity."""

from __future__ import annotations

import math

import pandas as pd

from trackfg.factors.factor_type import FactorType
from trackfg.results.verdict import QUANTITIES, Doubt, Quantity, Verdict, verdicts
from trackfg.sensors.imu_filters.bandwidth import RestSpectra
from trackfg.smoothing.doubts.axle_doubts import axle_doubts
from trackfg.smoothing.doubts.bandwidth_doubts import bandwidth_doubts
from trackfg.smoothing.doubts.clock_doubts import clock_doubts
from trackfg.smoothing.doubts.cut_doubts import cut_doubts
from trackfg.smoothing.doubts.gradient_doubts import gradient_doubts
from trackfg.smoothing.doubts.path_doubts import path_doubts
from trackfg.smoothing.doubts.residual_doubts import self_test
from trackfg.smoothing.doubts.vibration_doubts import vibration_doubts
from trackfg.smoothing.reassessment import SolvedRun

BY_ATTITUDE: tuple[Quantity, ...] = ("roll", "pitch", "yaw")
"""What an inertial sensor alone determines: attitude, yaw from the start of the run."""


def judged(run: SolvedRun, geometry: pd.DataFrame) -> tuple[Verdict, ...]:
    """Return a verdict for every quantity of a solved run; ``geometry`` is its table, with the model's sigmas."""
    if not run.solution.converged:
        return verdicts([*_of_solver(run), *run.doubts])
    tested = self_test(run)
    bandwidths = RestSpectra.of(run.problem.run.inertial, run.problem.rests).bandwidths
    motion_doubts = [*path_doubts(run), *gradient_doubts(run), *vibration_doubts(run, geometry, bandwidths)]
    motion_doubts += [
        *bandwidth_doubts(run, geometry, bandwidths),
        *axle_doubts(run, geometry),
        *cut_doubts(run),
        *clock_doubts(run),
    ]
    return verdicts([*_of_what_is_measured(run), *tested.doubts, *motion_doubts, *run.doubts], tested.checked_by)


def _of_solver(run: SolvedRun) -> list[Doubt]:
    reason = f"the solution is not a minimum: {run.solution.reason}"
    return [
        Doubt(QUANTITIES, math.inf, reason, "look at the findings and events; check units, clocks and gross errors")
    ]


def _of_what_is_measured(run: SolvedRun) -> list[Doubt]:
    if run.problem.family(FactorType.GRAVITY_TILT) is None:
        return []
    rest = tuple(quantity for quantity in QUANTITIES if quantity not in BY_ATTITUDE)
    return [Doubt(rest, math.inf, "nothing measures speed or distance", "add a tachometer, a speed sensor or GNSS")]

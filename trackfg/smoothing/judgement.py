"""What a solved run shows of its own sigmas becomes a verdict per quantity."""

from __future__ import annotations

import math

from trackfg.factors.factor_type import FactorType
from trackfg.results.verdict import QUANTITIES, Doubt, Quantity, Verdict, verdicts
from trackfg.smoothing.reassessment import SolvedRun
from trackfg.smoothing.residual_doubts import self_test

BY_ATTITUDE: tuple[Quantity, ...] = ("roll", "pitch", "yaw")
"""What an inertial sensor alone determines: attitude, yaw from the start of the run."""


def judged(run: SolvedRun) -> tuple[Verdict, ...]:
    """Return a verdict for every quantity of a solved run."""
    if not run.solution.converged:
        return verdicts([*_of_solver(run), *run.doubts])
    tested = self_test(run)
    return verdicts([*_of_what_is_measured(run), *tested.doubts, *run.doubts], tested.checked_by)


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

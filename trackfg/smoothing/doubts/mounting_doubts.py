"""A mounting is the same all the time, so that every stretch of a run has to speak for it.

Where the data contradict what is declared of a mounting (:mod:`trackfg.smoothing.wide_priors`), something else may have
pushed it away: an engine's line that sampling folds to some mHz, a body on springs. Then the residuals that are left
with the mounting that the data alone would choose still pull at it, one way for a minute and the other way afterwards,
and its sigma is too small by as much (:mod:`trackfg.solver.influence`). Those of a mounting that is there do not.

For the columns C of the mounting, with the posterior covariance P, the residuals o of their priors and the variances S
of these, the solution without these priors is off by

    d = P C (S - C'P C)^-1 o.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from trackfg.factors.factor_type import FactorType
from trackfg.factors.states import KEYFRAME_DIM, Kind, Step, offset_in_keyframe
from trackfg.numerics.arrays import Array
from trackfg.results.verdict import Doubt
from trackfg.smoothing.doubts.residual_doubts import blocks_of_time, causes_of, widening
from trackfg.smoothing.reassessment import SolvedRun
from trackfg.solver.covariance import times_covariance
from trackfg.solver.influence import Columns, GainPart, all_rows, misfits

_PRIOR = "mounting prior"
"""Its residuals are what is asked about."""

_PLACE = range(2, 5)
"""The columns of the mounting that say where the point is that follows the track."""

_HINT = (
    "look for what shakes the sensor, as an engine does whose line sampling folds; check its clock and noise figures"
)


def lasting_pull(run: SolvedRun, far: list[int]) -> Array:
    """Return how many times as much as expected residuals pull at the columns ``far`` of the mounting, (f,).

    It is 1 where more may be chance.
    """
    problem, solution = run.problem, run.solution
    n, shared = len(solution.states), solution.root.size - KEYFRAME_DIM
    columns = Columns(np.zeros((n, KEYFRAME_DIM, len(far))), np.zeros((shared, len(far))))
    index = offset_in_keyframe(Kind.MOUNT) - KEYFRAME_DIM + np.array(far)
    columns.shared[index, np.arange(len(far))] = 1.0
    prior = problem.family(FactorType.PRIOR_MOUNT)
    assert prior is not None
    moved = Columns(*times_covariance(solution.root, *columns))
    free = np.diag(prior.sigma[0, far] ** 2) - moved.shared[index]
    pull = np.linalg.solve(free, prior.residual(solution.states)[0, far])
    back = Step(-(moved.keyframes @ pull), -(moved.shared @ pull))
    rows = [
        replace(group_rows, linear=group_rows.linear.relative_to_step_start(back))
        for group_rows in all_rows(problem, solution, np.random.default_rng(0))
        if group_rows.group != _PRIOR
    ]
    gain = Columns(*(part / np.sqrt(np.diagonal(moved.shared[index])) for part in moved))
    of_columns = misfits(rows, [GainPart(0, n, gain)], blocks_of_time(problem.t), len(far))
    return np.array([widening(causes_of(of_column, {})) for of_column in of_columns])


def moving_point(pull: Mapping[int, float]) -> tuple[Doubt, ...]:
    """Return the doubt of what depends on the point that follows the track, by the pull at columns of the mounting."""
    strongest = max((pull[column] for column in _PLACE if column in pull), default=None)
    if strongest is None:
        return ()
    reason = f"errors that last pull {strongest:.2g} times as much as expected at the point that follows the track"
    return (Doubt(("alignment", "curvature"), strongest, reason, _HINT),)

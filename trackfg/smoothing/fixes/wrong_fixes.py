"""Wrong fixes are withheld: hypotheses before the first solve, and leave-one-out residuals after each.

Before, :mod:`trackfg.graph.fix_consensus` finds the fixes that agree with each other and with the wheel, and the run
starts where those say. After, each fix is held against what all other measurements predict for it. One that is wrong
on its own is withheld; a withheld one that fits is used again. Where neighbouring fixes are off as well, one way before
and the other way after, the wheel erred between them, and they stay.

Fixes in a row that are all off by much have no weight by their loss: behind a jump of the kilometrage, or on another
line, they agree with each other as well as those before do. Either set may be the right one.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from trackfg.factors.factor_type import FactorType
from trackfg.factors.family import Family, family_of
from trackfg.factors.odometry import followed_fix, withheld_fix
from trackfg.factors.states import States
from trackfg.graph.build import Problem
from trackfg.graph.fix_consensus import SAME_PLACE_M, WIDE_SHARE, Consensus, Passages, consensus, wrong_is_likelier
from trackfg.numerics.arrays import Array
from trackfg.numerics.spans import true_runs
from trackfg.recording.findings import Finding
from trackfg.results.verdict import Doubt
from trackfg.smoothing.fixes.fix_level import fix_level, most_by_wheel
from trackfg.smoothing.reassessment import Reassessment, SolvedRun, others_are_worse
from trackfg.solver.leave_one_out import left_out

_GATE_SIGMAS = 5.0
"""A fix further off than this, in sigmas of its prediction by all others, is wrong: 6e-7 of right ones are."""

_AGAIN_SIGMAS = 3.0
"""A withheld fix nearer than this is used again. Less than the gate, so that none goes to and fro."""

_ALONE = 2.0
"""A fix is wrong on its own if it is further off, in sigmas, by this factor than its neighbours: where the wheel errs
between two groups of fixes, those on both sides are off alike."""

_SETTLED = 0.15
"""Relative change of the fixes' level below which the run is not solved again."""

_FAR_OFF = 2.0
"""A level from which on it is a finding: sigmas were wrong by as much."""

_FIXES = (FactorType.ABSOLUTE_FIX, FactorType.WITHHELD_FIX)

_UNKNOWN_SD_M = 100.0
"""Sigma of the distance of one interval, m, above which the wheel says nothing of it."""

_NO_WEIGHT = 0.1
"""A fix with less of its weight than this counts for nothing: with Cauchy's loss it is 12 sigmas off."""

_FEWEST_IN_A_ROW = 2
"""So many fixes in a row without weight are a set of their own; a single one is wrong."""

_NAMED = 5
"""So many fixes are named in a finding; the events have all."""


def with_consensus(problem: Problem) -> Problem:
    """Return the problem without fixes that contradict the most, which begins where those place it."""
    fixes = _fixes(problem)
    if fixes is None or fixes.loss is None:
        return problem
    agreed = _consensus(problem, fixes)
    right = fixes.take(agreed.right)
    if not agreed.right.all():
        problem = with_fixes(problem, right, withheld_fix(fixes.take(~agreed.right)))
    return _started_at(problem, right)


def with_fixes(problem: Problem, used: Family, withheld: Family) -> Problem:
    """Return the problem with these fixes instead of its own, in order of time."""
    used, withheld = _in_order(used), _in_order(withheld)
    others = tuple(family for family in problem.families if family.type is not FactorType.ABSOLUTE_FIX)
    return replace(problem, families=(*others, used), withheld=(withheld,) if len(withheld) else ())


def wrong_fixes(run: SolvedRun) -> Reassessment:
    """Reassess which fixes are wrong and how good the others are, by what all other measurements say."""
    problem, states = run.problem, run.solution.states
    fixes, withheld = _fixes(problem), family_of(problem.withheld, FactorType.WITHHELD_FIX)
    if fixes is None or fixes.loss is None:
        return Reassessment(problem)
    old_level = level_in_use(run)
    prediction = left_out(fixes, states, run.covariance)
    predicted = prediction.covariance[:, 0, 0]
    declared_sd = fixes.sigma[:, 0] / old_level
    level = fix_level(prediction.error[:, 0], declared_sd, predicted)
    if problem.wheel is not None:
        rolled = run.declared.initial.odo.distance[fixes.slots[0].index]
        level = min(level, most_by_wheel(fixes.data["distance"][:, 0], declared_sd, rolled))
    if abs(np.log(level / old_level)) < _SETTLED or others_are_worse(run.noise_ratios, level):
        level = old_level
    rescaled = fixes.with_sigma(fixes.sigma * (level / old_level))
    wrong = _wrong_alone(fixes.slots[0].index, prediction.in_sigmas(rescaled.sigma)[:, 0])
    wrong &= _likelier_wrong(problem, rescaled, prediction.error[:, 0], predicted)
    used, aside = rescaled.take(~wrong), withheld_fix(rescaled.take(wrong))
    changed = bool(wrong.any()) or level != old_level
    if withheld is not None:
        withheld = withheld.with_sigma(withheld.sigma * (level / old_level))
        again = np.abs(left_out(withheld, states, run.covariance, used=False).in_sigmas(withheld.sigma)[:, 0])
        fits = again < _AGAIN_SIGMAS
        used, changed = used.joined(followed_fix(withheld.take(fits))), changed or bool(fits.any())
        aside = aside.joined(withheld.take(~fits))
    if changed:
        problem = with_fixes(problem, used, aside)
    findings = (*_withheld_findings(run, problem), *_level_findings(level))
    return Reassessment(problem, findings, (*_doubts(run.declared), *_other_kilometrage(problem, states)), changed)


def level_in_use(run: SolvedRun) -> float:
    """Return the level that the fixes have in the run's problem, used and withheld ones together."""

    def mean_log(problem: Problem) -> float:
        families = (*problem.families, *problem.withheld)
        sigmas = [family.sigma[:, 0] for family in families if family.type in _FIXES]
        return float(np.mean(np.log(np.concatenate(sigmas))))

    return float(np.exp(mean_log(run.problem) - mean_log(run.declared)))


def _fixes(problem: Problem) -> Family | None:
    return family_of(problem.families, FactorType.ABSOLUTE_FIX)


def _consensus(problem: Problem, fixes: Family) -> Consensus:
    """Return which fixes are right by the wheel; all, where there is nothing that measures the way between them."""
    start = family_of(problem.families, FactorType.PRIOR_ODO)
    if start is None or not np.ptp(problem.initial.odo.distance):
        return Consensus(np.ones(len(fixes), dtype=bool), (len(fixes), 0))
    return consensus(_passages(problem, fixes), float(start.sigma[0, 1]))


def _passages(problem: Problem, fixes: Family) -> Passages:
    distance, index = problem.initial.odo.distance, fixes.slots[0].index
    way = np.abs(np.diff(distance))
    wheel, tach = problem.wheel, family_of(problem.families, FactorType.TACH_DISTANCE)
    variance, unknown = np.zeros(len(way)), np.zeros(len(way), dtype=bool)
    if wheel is not None and tach is not None:
        k, sigma = tach.slots[0].index, tach.sigma[:, 0]
        unknown[k] = sigma > _UNKNOWN_SD_M
        if tach.doubtful is not None:
            unknown[k] |= tach.doubtful
        variance[k] = np.where(unknown[k], 0.0, sigma**2)
    since_start = (np.concatenate([[0.0], np.cumsum(step)])[index] for step in (variance, way, way * unknown))
    return Passages(fixes.data["distance"][:, 0], fixes.sigma[:, 0], distance[index], *since_start)


def _started_at(problem: Problem, right: Family) -> Problem:
    """Return the problem moved along the track, so that its first right fix agrees."""
    odo = problem.initial.odo
    shift = float(right.data["distance"][0, 0] - odo.distance[right.slots[0].index[0]])
    if not shift:
        return problem
    mean = family_of(problem.families, FactorType.PRIOR_ODO)
    assert mean is not None
    moved = mean.with_data(mean=type(odo)(mean.data["mean"]).moved_along(shift).array)
    families = tuple(moved if family is mean else family for family in problem.families)
    return replace(problem, initial=replace(problem.initial, odo=odo.moved_along(shift)), families=families)


def _wrong_alone(index: np.ndarray, z: Array) -> np.ndarray:
    """Return which errors (n,), in sigmas, of fixes at keyframes ``index`` are beyond the gate and stand out."""
    order = np.argsort(index, kind="stable")
    size = np.abs(z[order])
    around = np.maximum(np.append(size[1:], 0.0), np.append(0.0, size[:-1]))
    wrong = np.zeros(len(z), dtype=bool)
    wrong[order] = (size > _GATE_SIGMAS) & (size > _ALONE * around)
    return wrong


def _likelier_wrong(problem: Problem, fixes: Family, error: Array, predicted: Array) -> np.ndarray:
    """Return which fixes (n,) are likelier wrong than what predicts them, by the ``error``, m, and the ``predicted``
    variance, m^2.

    A wrong fix may be anywhere on the line. Wheel and GNSS that err unnoticed do so by a share of the way from the next
    fix, as in :mod:`trackfg.graph.fix_consensus`.
    """
    passages = _passages(problem, fixes)
    gaps = np.diff(passages.length)
    way = np.minimum(np.append(gaps, passages.line_m), np.append(passages.line_m, gaps))
    variance = predicted + fixes.sigma[:, 0] ** 2 + (WIDE_SHARE * way) ** 2
    return wrong_is_likelier(error, variance, passages.line_m)


def _in_order(fixes: Family) -> Family:
    return fixes.take(np.argsort(fixes.slots[0].index, kind="stable"))


def _withheld_findings(run: SolvedRun, problem: Problem) -> tuple[Finding, ...]:
    withheld, fixes = family_of(problem.withheld, FactorType.WITHHELD_FIX), _fixes(problem)
    if withheld is None or fixes is None:
        return ()
    off = -problem.run.direction * withheld.residual(run.solution.states)[:, 0]
    named = [f"{problem.t[k]:.1f} s ({r:+.1f} m)" for k, r in zip(withheld.slots[0].index, off, strict=True)]
    more = f" and {len(named) - _NAMED} more" if len(named) > _NAMED else ""
    verbs = ("contradicts", "was") if len(named) == 1 else ("contradict", "were")
    message = (
        f"{len(named)} of {len(named) + len(fixes)} fixes {verbs[0]} the others and {verbs[1]} withheld: at "
        f"{', '.join(named[:_NAMED])}{more}"
    )
    hint = "compare their chainages with the line's register; the events list each fix"
    return (Finding("warning", "fixes-withheld", message, hint=hint),)


def _level_findings(level: float) -> tuple[Finding, ...]:
    if level < _FAR_OFF:
        return ()
    message = f"the fixes are off by {level:.1f} times their declared sigmas"
    hint = "their sigmas were widened; declare what they are worth"
    return (Finding("warning", "fix-level", message, hint=hint),)


def _doubts(declared: Problem) -> tuple[Doubt, ...]:
    """Return the doubt where another set of fixes is about as large as the one that was followed."""
    fixes, withheld = _fixes(declared), family_of(declared.withheld, FactorType.WITHHELD_FIX)
    if fixes is None or withheld is None:
        return ()
    agreed = _consensus(declared, _in_order(fixes.joined(followed_fix(withheld))))
    if not agreed.is_undecided:
        return ()
    right, rival = agreed.votes
    reason = f"{right} fixes agree on one place and {rival} on another: either may be right"
    hint = "remove the fixes that are wrong from the recording"
    if right == 1:
        reason = f"no two of {len(agreed.right)} fixes are as far apart as the wheel rolled between them, the same way"
        hint = f"check track.direction, the tach's unit and the fixes' chainages; {hint}"
    return (Doubt(("chainage",), np.inf, reason, hint),)


def _other_kilometrage(problem: Problem, states: States) -> Iterator[Doubt]:
    """Yield the doubt where fixes in a row are in use and have no weight."""
    fixes = _fixes(problem)
    if fixes is None:
        return
    ordered = _in_order(fixes)
    for first, end in true_runs(ordered.weights(states) < _NO_WEIGHT):
        row = ordered.take(np.arange(first, end))
        places = 1 + np.count_nonzero(np.abs(np.diff(row.data["distance"][:, 0])) > SAME_PLACE_M)
        if places < _FEWEST_IN_A_ROW:
            continue
        off = -problem.run.direction * float(np.median(row.residual(states)[:, 0]))
        begin, last = (problem.t[row.slots[0].index[k]] for k in (0, -1))
        reason = f"all fixes at {begin:.0f}-{last:.0f} s are {off:+.1f} m from where the others have them"
        hint = "where the kilometrage jumps, add the jump to the chainages behind it, or smooth each part by itself"
        yield Doubt(("chainage",), np.inf, reason, hint)
        return

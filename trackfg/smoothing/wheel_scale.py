"""The wheel's scale may change: by creep that lasts, by another wheelset, by a new calibration.

The graph takes the scale for a constant but for wear, and a wheel that creeps by 1 % for a minute for one that slips:
at the price of a slip in every second of it, so that a scale in between and a bent path explain the run as well. With a
scale that walks, ``S(k+1) - S(k)`` of sigma ``q sqrt(distance)``, the inertial sensor and the positions determine where
it changes, and the sigma of a distance between two positions is that of a scale that may have changed on the way.

Whether it changes the data decide, by their likelihood with the states integrated out
(:mod:`trackfg.solver.scale_evidence`). Noise that is not known yet, and a speed signal that is off by a constant (as
one that is cut off to whole km/h and was interpolated then), are explained by changes as well. So a run is solved with
a scale that walks everywhere, and judged anew with the noise that was found; and an offset of a speed signal is a
variable before a walk is.

A scale that may walk everywhere makes every distance unsure, though creep begins and ends at a few places. So it walks
then where :mod:`trackfg.solver.scale_changes` has it change, by as much as is probable there: little at many places
where the data are indecisive, so that sigmas allow for each of them. Changes, and a walk beside them, are allowed for
by their probability: little is left of them where the noise that was found explains the data as well.

In a run with a further tach the scale is constant. The difference between the wheels shows which of them creeps. A
scale that walks would absorb that difference, and the estimate would follow the wheel that creeps.

Fixes that were withheld while the scale was a constant, and are off by no more than a wheel creeps, are used again.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from trackfg.factors.factor_type import FactorType
from trackfg.factors.family import Family, changed, family_of
from trackfg.factors.odometry import MOST_CREEP, SPEED_OFFSET, followed_fix
from trackfg.factors.states import States
from trackfg.graph.build import Problem
from trackfg.graph.priors import SET_OFFSET_SD_MPS
from trackfg.numerics.arrays import Array
from trackfg.recording.findings import Finding
from trackfg.results.verdict import Doubt
from trackfg.smoothing.fixes.wrong_fixes import with_fixes
from trackfg.smoothing.reassessment import Reassessment, SolvedRun
from trackfg.solver.scale_changes import WALKS, log_odds_of_change, variance_of_changes
from trackfg.solver.scale_evidence import CLEARLY, ScaleEvidence

_CELL_S = 10.0
"""Length of a cell, s: within such a time a wheel begins to creep, or ceases to (adhesion changes over one to a few
hundred metres)."""

_CELL_M = 10.0
"""Cells in which the vehicle moves less are one with those before, m: a metre of creep by 1 % is below any sensor."""

_MOST_CELLS = 64
"""Cells are longer in a long run: their joint covariance takes time with their number times that of keyframes."""

_OFFSET_SD_MPS = 0.14
"""Sigma of a speed signal's offset where it is free, m/s: half a step of speeds that are cut off to whole km/h."""

_MOST_CHANGE = 0.1
"""By more than this a wheel's scale does not change in a run: a worn wheel is 8 % smaller than a new one (850 and
920 mm), and the creep curve ends at 2 %. Another sensor errs then, such as a receiver that extrapolates in a tunnel."""

_NAMED = 1e-3
"""A change of the scale below this is none worth a finding."""


def wheel_scale(run: SolvedRun) -> Reassessment:
    """Reassess whether the wheel's scale changes; where a run was solved with a walk, whether it still does with the
    noise found since, and where.

    The places are judged once, since a walk at them contradicts nothing any more.
    """
    problem = run.problem
    chain = problem.family(FactorType.DISTANCE_CHAIN)
    declared = run.declared.family(FactorType.DISTANCE_CHAIN)
    has_further_wheel = problem.family(FactorType.TACH_INCREMENT) is not None
    if problem.wheel is None or chain is None or declared is None or has_further_wheel:
        return Reassessment(problem)
    faster = chain.sigma[:, 1] / declared.sigma[:, 1]
    if not np.allclose(faster, faster[0]) or _was_judged(run):
        return Reassessment(problem, _findings(run), _doubts(run))
    states, walks = run.solution.states, not np.isclose(faster[0], 1.0)
    constant, edges = chain.with_sigma(declared.sigma), _edges(problem.t, states.odo.distance)
    families, evidence = _with_likelier_offset(problem, states, constant)
    walk, judged = run.config.tach.scale_walk_per_sqrt_m, constant
    if len(edges):
        information, linear = evidence.on_changes(constant, edges)
        if walks:
            way = _declared_at(edges, constant)[1] / walk**2
            judged = _walking_at(edges, variance_of_changes(information, linear, way), constant)
        elif log_odds_of_change(information, linear) > CLEARLY:
            judged = _walking_everywhere(evidence, constant, walk)
    if (judged.sigma == chain.sigma).all() and _offset_sd(families) == _offset_sd(problem.families):
        return Reassessment(problem, _findings(run), _doubts(run))
    problem = replace(problem, families=changed(families, FactorType.DISTANCE_CHAIN, lambda _: judged))
    if not walks:
        problem = _with_fixes_again(problem, states)
    return Reassessment(problem, _findings(run), _doubts(run), changed=True, far=not walks)


def _with_likelier_offset(
    problem: Problem, states: States, constant: Family
) -> tuple[tuple[Family, ...], ScaleEvidence]:
    """Return the problem's families, and the evidence by them, with a free offset of a speed signal where the data
    show one while the scale is ``constant``.
    """
    wheel = problem.wheel
    # A speed signal whose rows show steps has a free offset already.
    may_have_offset = wheel is not None and wheel.integrates_speed and wheel.offset_sd_mps == 0.0
    families = _with_offset(problem.families, SET_OFFSET_SD_MPS) if may_have_offset else tuple(problem.families)
    evidence = ScaleEvidence.of(problem.inertial, families, states)
    if may_have_offset:
        with_offset = _with_offset(families, _OFFSET_SD_MPS)
        beside = ScaleEvidence.of(problem.inertial, with_offset, states)
        occam = np.log(_OFFSET_SD_MPS / SET_OFFSET_SD_MPS)  # the likelihoods are without the sigmas of priors
        if beside.log_likelihood(constant) - occam > evidence.log_likelihood(constant) + CLEARLY:
            return with_offset, beside
    return families, evidence


def _was_judged(run: SolvedRun) -> bool:
    """Return whether the round before has judged the same factors, or others only in how the inertial sensor's biases
    respond to its calibration, which is constant over the run.
    """
    judged, problem = run.judged_before, run.problem
    if judged is None or judged.measured is not problem.measured or len(judged.families) != len(problem.families):
        return False
    pairs = zip(judged.families, problem.families, strict=True)
    return all(old is new or old.type is new.type is FactorType.BIAS_WALK for old, new in pairs)


def _with_offset(families: Sequence[Family], sd_mps: float) -> tuple[Family, ...]:
    """Return the families with this sigma of the offset of a speed signal, m/s."""

    def with_sd(prior: Family) -> Family:
        sigma = prior.sigma.copy()
        sigma[0, SPEED_OFFSET] = sd_mps
        return prior.with_sigma(sigma)

    return changed(families, FactorType.PRIOR_WHEEL, with_sd)


def _offset_sd(families: Sequence[Family]) -> float:
    prior = family_of(families, FactorType.PRIOR_WHEEL)
    return 0.0 if prior is None else float(prior.sigma[0, SPEED_OFFSET])


def _edges(t: Array, distance: Array) -> np.ndarray:
    """Return the intervals between keyframes (n,) in which cells of the run begin, but the first one's."""
    cell_s = max(_CELL_S, (t[-1] - t[0]) / _MOST_CELLS)
    edges = np.unique(np.searchsorted(t, np.arange(t[0] + cell_s, t[-1], cell_s)) - 1)
    way = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(distance)))])
    return edges[np.diff(np.floor(way[edges] / _CELL_M), prepend=0.0) > 0.0]


def _walking_everywhere(evidence: ScaleEvidence, constant: Family, declared: float) -> Family:
    """Return the chain with the likeliest of the walks that are faster than the ``declared`` one, 1/sqrt(m)."""
    best, most = constant, -np.inf
    for walk in (walk for walk in WALKS if walk > declared):
        trial = constant.with_sigma(constant.sigma * [1.0, walk / declared])
        likelihood = evidence.log_likelihood(trial)
        if likelihood <= most:
            break
        best, most = trial, likelihood
    return best


def _walking_at(edges: np.ndarray, variance: Array, constant: Family) -> Family:
    """Return the chain with a scale that walks by a ``variance`` (c,) in the intervals closest to each of the
    ``edges``, in proportion to the way.
    """
    closest, at_edge = _declared_at(edges, constant)
    declared = constant.sigma[:, 1] ** 2
    more = declared * (variance / at_edge)[closest]
    return constant.with_sigma(np.stack([constant.sigma[:, 0], np.sqrt(declared + more)], axis=1))


def _declared_at(edges: np.ndarray, constant: Family) -> tuple[np.ndarray, Array]:
    """Return which of the ``edges`` (c,) is closest to each interval (n - 1,), and by what variance the scale walks at
    each edge (c,) if it walks as declared: in proportion to the way.
    """
    closest = np.searchsorted(0.5 * (edges[1:] + edges[:-1]), np.arange(len(constant)))
    return closest, np.bincount(closest, constant.sigma[:, 1] ** 2, len(edges)).astype(np.float64)


def _with_fixes_again(problem: Problem, states: States) -> Problem:
    """Return the problem with those withheld fixes that a wheel explains which creeps since the nearest other one."""
    used, withheld = problem.family(FactorType.ABSOLUTE_FIX), family_of(problem.withheld, FactorType.WITHHELD_FIX)
    if used is None or withheld is None:
        return problem
    at, place = used.slots[0].index, states.odo.distance
    since = np.abs(place[withheld.slots[0].index][:, None] - place[at]).min(axis=1)
    near = np.abs(withheld.residual(states)[:, 0]) < MOST_CREEP * since
    return with_fixes(problem, used.joined(followed_fix(withheld.take(near))), withheld.take(~near))


def _findings(run: SolvedRun) -> tuple[Finding, ...]:
    """Return the offset of a speed signal where it became a variable, and the change of a scale that walks."""
    return (*_offset(run), *_change(run))


def _offset(run: SolvedRun) -> Iterator[Finding]:
    if _offset_sd(run.problem.families) == _offset_sd(run.declared.families):
        return
    off = float(run.solution.states.wheel[0, SPEED_OFFSET])
    message = f"the speed signal is {abs(off):.2f} m/s too {'low' if off < 0.0 else 'high'} while the vehicle moves"
    hint = "speeds that are cut off are half a step too low; correct it in the table"
    yield Finding("warning", "speed-offset", message, hint=hint)


def _doubts(run: SolvedRun) -> tuple[Doubt, ...]:
    """Return the doubt of what a wheel's scale stands for where it changes by more than a wheel's does."""
    change = float(np.ptp(run.solution.states.odo.scale))
    if change < _MOST_CHANGE:
        return ()
    reason = f"the wheel's scale would have to change by {100.0 * change:.2g} % in the run, more than a wheel's does"
    return (Doubt(("chainage", "speed", "position"), np.inf, reason, "look for positions that were not measured"),)


def _change(run: SolvedRun) -> Iterator[Finding]:
    chain, declared = (problem.family(FactorType.DISTANCE_CHAIN) for problem in (run.problem, run.declared))
    scale = run.solution.states.odo.scale
    change = float(np.ptp(scale))
    if chain is None or declared is None or (chain.sigma == declared.sigma).all() or change < _NAMED:
        return
    # Where it changes most within a kilometre's tenth: half of that on either side.
    way = np.abs(np.diff(run.solution.states.odo.distance, prepend=run.solution.states.odo.distance[0])).cumsum()
    ahead, behind = (np.interp(way + half, way, scale) for half in (50.0, -50.0))
    at = float(run.problem.t[int(np.argmax(np.abs(ahead - behind)))])
    message = (
        f"the wheel's scale changes by {100.0 * change:.2g} % in the run, most about {at:.0f} s: creep, another wheel, "
        "or a new calibration"
    )
    yield Finding(
        "warning", "wheel-scale-varies", message, hint="sigmas allow for it; fixes closer together narrow them"
    )

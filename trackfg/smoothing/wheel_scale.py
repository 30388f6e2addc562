"""The wheel's scale may change: by creep that lasts, by another wheelset, by a new calibration.

The graph takes the scale for a constant but for wear, and a wheel that creeps by 1 % for a minute for one that slips:
at the price of a slip in every second of it, so that a scale in between and a bent path explain the run as well. With a
scale that walks, ``S(k+1) - S(k)`` of sigma ``q sqrt(distance)``, the inertial sensor and the positions determine where
it changes, and the sigma of a distance between two positions is that of a scale that may have changed on the way.

How fast it walks the data decide, by their likelihood with the states integrated out
(:mod:`trackfg.solver.scale_evidence`). Noise that is not known yet, and a speed signal that is off by a constant (as
one that is cut off to whole km/h and was interpolated then), are explained by a walk as well. So a run that has been
solved with one is judged anew with the noise that was found, and an offset of a speed signal is a variable before a
walk is.

A scale that may walk everywhere makes every distance unsure, though creep begins and ends at a few places. So where it
still walks then, spans in which a constant scale is clearly likelier are sought by halving, and the scale walks in the
others alone: also where the data are indecisive, so that sigmas allow for either.

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
from trackfg.smoothing.reassessment import Reassessment, SolvedRun
from trackfg.smoothing.wrong_fixes import with_fixes
from trackfg.solver.scale_evidence import CLEARLY, ScaleEvidence

_WALKS = (1e-5, 3e-5, 1e-4, 3e-4)
"""1/sqrt(m): from 0.03 % to 1 % in a kilometre, as creep that lasts. The first one is tried on every run, each other
where the one before is more likely than those before it: the likelihood has one maximum.
"""

_SHORTEST_S = 10.0
"""Spans are not halved below this, s: within such a time a wheel begins to creep, or ceases to (adhesion changes over
one to a few hundred metres)."""

_PARTS = 64
"""Nor are spans halved below so small a part of the run: the time of each likelihood grows with the number of
keyframes, and some 100 of them are computed at most."""

_OFFSET_SD_MPS = 0.14
"""Sigma of a speed signal's offset where it is free, m/s: half a step of speeds that are cut off to whole km/h."""

_WIDER = (3.0, 10.0)
"""By how much more a scale is let walk that walks in a few spans: a change by 2 % in 10 s at 20 m/s is 1.4e-3 per root
of a metre, five times the widest walk that is tried on the whole run."""

_NAMED = 1e-3
"""A change of the scale below this is none worth a finding."""


def wheel_scale(run: SolvedRun) -> Reassessment:
    """Reassess how much the wheel's scale walks; where a run was solved with a walk, whether it is still likelier with
    the noise found since, and in which spans.

    The spans are judged once, since a wider walk contradicts nothing any more.
    """
    problem = run.problem
    chain = problem.family(FactorType.DISTANCE_CHAIN)
    declared = run.declared.family(FactorType.DISTANCE_CHAIN)
    has_further_wheel = problem.family(FactorType.TACH_INCREMENT) is not None
    if problem.wheel is None or chain is None or declared is None or has_further_wheel:
        return Reassessment(problem)
    walks = chain.sigma[:, 1] != declared.sigma[:, 1]
    if walks.any() and not walks.all():
        return Reassessment(problem, _findings(run))
    states, per_sqrt_m = run.solution.states, run.config.tach.scale_walk_per_sqrt_m
    constant = chain.with_sigma(declared.sigma)
    # A speed signal whose rows show steps has a free offset already.
    may_have_offset = problem.wheel.integrates_speed and problem.wheel.offset_sd_mps == 0.0
    families = _with_offset(problem.families, SET_OFFSET_SD_MPS) if may_have_offset else tuple(problem.families)
    evidence = ScaleEvidence.of(problem.inertial, families, states)
    without_walk = evidence.log_likelihood(constant)
    walk = _likeliest_walk(evidence, constant, per_sqrt_m, without_walk)
    if walk > per_sqrt_m and may_have_offset:
        with_offset = _with_offset(families, _OFFSET_SD_MPS)
        beside = ScaleEvidence.of(problem.inertial, with_offset, states)
        occam = np.log(_OFFSET_SD_MPS / SET_OFFSET_SD_MPS)  # the likelihoods are without the sigmas of priors
        by_offset = beside.log_likelihood(constant)
        if by_offset - occam > without_walk + CLEARLY:
            families, evidence = with_offset, beside
            walk = _likeliest_walk(evidence, constant, per_sqrt_m, by_offset)
    judged = _walking(constant, walk / per_sqrt_m)
    if walks.all() and walk > per_sqrt_m:
        judged = _walking_where_it_changes(evidence, chain, declared, problem.t)
    if (judged.sigma == chain.sigma).all() and _offset_sd(families) == _offset_sd(problem.families):
        return Reassessment(problem, _findings(run))
    problem = replace(problem, families=changed(families, FactorType.DISTANCE_CHAIN, lambda _: judged))
    if not walks.all():
        problem = _with_fixes_again(problem, states)
    return Reassessment(problem, _findings(run), changed=True, far=not walks.all())


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


def _likeliest_walk(evidence: ScaleEvidence, constant: Family, declared: float, without_walk: float) -> float:
    """Return how fast the scale of a chain walks, 1/sqrt(m): as ``declared`` where no other walk is clearly likelier.

    ``without_walk``: the log likelihood of the chain ``constant``, which has the declared walk.
    It is one wider than the likeliest where that is clearly likelier, too: a jump is less likely by a walk than it
    happens.
    """
    best, most = declared, without_walk
    for walk in (walk for walk in _WALKS if walk > declared):
        likelihood = evidence.log_likelihood(_walking(constant, walk / declared))
        if likelihood > without_walk + CLEARLY:
            best = walk
        if likelihood <= most:
            break
        most = likelihood
    return best


def _walking(chain: Family, factor: float) -> Family:
    """Return the chain of distances with a scale that walks so many times as fast."""
    return chain.with_sigma(chain.sigma * [1.0, factor])


def _walking_where_it_changes(evidence: ScaleEvidence, chain: Family, declared: Family, t: Array) -> Family:
    """Return the chain with a scale that walks in all spans but those in which a constant one is clearly likelier.

    ``t`` (n,): times of the keyframes, s.
    """
    begins, walking = t[chain.slots[0].index], chain.sigma
    shortest = max(_SHORTEST_S, (t[-1] - t[0]) / _PARTS)
    most = evidence.log_likelihood(chain)
    spans = [(0, len(begins))]
    while spans:
        begin, end = spans.pop()
        sigma = chain.sigma.copy()
        sigma[begin:end] = declared.sigma[begin:end]
        trial = chain.with_sigma(sigma)
        likelihood = evidence.log_likelihood(trial)
        if likelihood > most + CLEARLY:
            chain, most = trial, likelihood
        elif begins[end - 1] - begins[begin] > 2.0 * shortest:
            half = int(np.searchsorted(begins, 0.5 * (begins[begin] + begins[end - 1])))
            spans += [(half, end), (begin, half)]
    walks = chain.sigma[:, 1] != declared.sigma[:, 1]
    if walks.all() or not walks.any():
        return chain
    for forwards in (False, True):
        chain = _with_its_edges(evidence, chain, walking, begins, shortest, forwards=forwards)
    walks = chain.sigma[:, 1] != declared.sigma[:, 1]
    wider = [chain.with_sigma(np.where(walks[:, None], chain.sigma * [1.0, by], chain.sigma)) for by in _WIDER]
    return max((chain, *wider), key=evidence.log_likelihood)


def _with_its_edges(
    evidence: ScaleEvidence, chain: Family, walking: Array, begins: Array, step_s: float, *, forwards: bool
) -> Family:
    """Return the chain with a scale that walks beyond the ends of each span in which it does, step by step, as long as
    one that is constant there is not clearly likelier. ``walking`` (m, 2): sigmas with which it walks.

    A change close to an end of a span that was found constant is taken up by the walk beyond it.
    """
    walks = chain.sigma[:, 1] == walking[:, 1]
    edges = np.flatnonzero(walks[:-1] & ~walks[1:]) + 1 if forwards else np.flatnonzero(~walks[:-1] & walks[1:]) + 1
    for edge in edges.tolist():
        least, reach = evidence.log_likelihood(chain) - CLEARLY, edge
        while 0 < reach < len(begins):
            further = int(np.searchsorted(begins, begins[reach] + (step_s if forwards else -step_s)))
            reach = further if forwards else min(further, reach - 1)  # one interval may be longer than a step
            rows = slice(min(edge, reach), max(edge, reach))
            sigma = chain.sigma.copy()
            sigma[rows] = walking[rows]
            trial = chain.with_sigma(sigma)
            if evidence.log_likelihood(trial) < least:
                break
            chain = trial
    return chain


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

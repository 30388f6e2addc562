"""The wheel's scale may change: by creep that lasts, by another wheelset, by a new calibration.

The graph takes the scale for a constant but for wear, and a wheel that creeps by 1 % for a minute for one that slips:
at the price of a slip in every second of it, so that a scale in between and a bent path explain the run as well. With a
scale that walks, ``S(k+1) - S(k)`` of sigma ``q sqrt(distance)``, the inertial sensor and the positions tell where it
changes, and the sigma of a distance between two positions is that of a scale that may have changed on the way.

How fast it walks the data decide, by their likelihood with the states integrated out
(:mod:`trackfg.solver.scale_evidence`). A scale that may walk everywhere makes every distance unsure, though creep
begins and ends at a few places. So where a run has been solved with one, spans in which a constant scale is clearly
likelier are sought by halving, and the scale walks in the others alone: also where the data do not tell, so that
sigmas allow for either.

Fixes that were withheld while the scale was a constant, and are off by no more than a wheel creeps, are used again.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from trackfg.factors.factor_type import FactorType
from trackfg.factors.family import Family, changed, family_of
from trackfg.factors.odometry import MOST_CREEP, followed_fix
from trackfg.factors.states import States
from trackfg.graph.build import Problem
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

_WIDER = (3.0, 10.0)
"""By how much more a scale is let walk that walks in a few spans: a change by 2 % in 10 s at 20 m/s is 1.4e-3 per root
of a metre, five times the widest walk that is tried on the whole run."""

_NAMED = 1e-3
"""A change of the scale below this is none worth a finding."""


def wheel_scale(run: SolvedRun) -> Reassessment:
    """Reassess how much the wheel's scale walks, and of a run that was solved with one that does, where.

    Each is done once, since a wider walk contradicts nothing any more.
    """
    problem = run.problem
    chain = problem.family(FactorType.DISTANCE_CHAIN)
    declared = run.declared.family(FactorType.DISTANCE_CHAIN)
    if problem.wheel is None or chain is None or declared is None:
        return Reassessment(problem)
    walks = chain.sigma[:, 1] != declared.sigma[:, 1]
    if walks.any() and not walks.all():
        return Reassessment(problem, _findings(run))
    states = run.solution.states
    evidence = ScaleEvidence.of(problem.inertial, problem.families, states)
    if walks.all():
        parted = _walking_where_it_changes(evidence, chain, declared, problem.t)
        if (parted.sigma == chain.sigma).all():
            return Reassessment(problem, _findings(run))
        families = changed(problem.families, FactorType.DISTANCE_CHAIN, lambda _: parted)
        return Reassessment(replace(problem, families=families), _findings(run), changed=True)
    per_sqrt_m = run.config.tach.scale_walk_per_sqrt_m
    constant = evidence.log_likelihood(chain)
    best, most = per_sqrt_m, constant
    for walk in (walk for walk in _WALKS if walk > per_sqrt_m):
        likelihood = evidence.log_likelihood(_walking(chain, walk / per_sqrt_m))
        if likelihood > constant + CLEARLY:
            best = walk  # one wider than the likeliest, too: a jump is less likely by a walk than it happens
        if likelihood <= most:
            break
        most = likelihood
    if best == per_sqrt_m:
        return Reassessment(problem)
    families = changed(problem.families, FactorType.DISTANCE_CHAIN, lambda one: _walking(one, best / per_sqrt_m))
    problem = _with_fixes_again(replace(problem, families=families), states)
    return Reassessment(problem, changed=True, far=True)


def _walking(chain: Family, factor: float) -> Family:
    """Return the chain of distances with a scale that walks so many times as fast."""
    return replace(chain, sigma=chain.sigma * [1.0, factor])


def _walking_where_it_changes(evidence: ScaleEvidence, chain: Family, declared: Family, t: Array) -> Family:
    """Return the chain with a scale that walks in all spans but those in which a constant one is clearly likelier.

    ``t`` (n,): times of the keyframes, s.
    """
    begins = t[chain.slots[0].index]
    most = evidence.log_likelihood(chain)
    spans = [(0, len(begins))]
    while spans:
        begin, end = spans.pop()
        sigma = chain.sigma.copy()
        sigma[begin:end] = declared.sigma[begin:end]
        trial = replace(chain, sigma=sigma)
        likelihood = evidence.log_likelihood(trial)
        if likelihood > most + CLEARLY:
            chain, most = trial, likelihood
        elif begins[end - 1] - begins[begin] > 2.0 * _SHORTEST_S:
            half = int(np.searchsorted(begins, 0.5 * (begins[begin] + begins[end - 1])))
            spans += [(half, end), (begin, half)]
    walks = chain.sigma[:, 1] != declared.sigma[:, 1]
    if walks.all() or not walks.any():
        return chain
    wider = [replace(chain, sigma=np.where(walks[:, None], chain.sigma * [1.0, by], chain.sigma)) for by in _WIDER]
    return max((chain, *wider), key=evidence.log_likelihood)


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
    """Return what the scale does, of a run in which it walks."""
    problem, scale = run.problem, run.solution.states.odo.scale
    change = float(np.ptp(scale))
    if change < _NAMED:
        return ()
    # Where it changes most within a kilometre's tenth: half of that on either side.
    way = np.abs(np.diff(run.solution.states.odo.distance, prepend=run.solution.states.odo.distance[0])).cumsum()
    after, before = (np.interp(way + half, way, scale) for half in (50.0, -50.0))
    at = float(problem.t[int(np.argmax(np.abs(after - before)))])
    message = (
        f"the wheel's scale changes by {100.0 * change:.2g} % in the run, most about {at:.0f} s: creep, another wheel, "
        "or a new calibration"
    )
    hint = "sigmas allow for it; fixes closer together narrow them"
    return (Finding("warning", "wheel-scale-varies", message, hint=hint),)

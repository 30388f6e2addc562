"""The wheel's scale may change: by creep that lasts, by another wheelset, by a new calibration.

The graph takes the scale for a constant but for wear, and a wheel that creeps by 1 % for a minute for one that slips:
at the price of a slip in every second of it, so that a scale in between and a bent path explain the run as well. With a
scale that walks, ``S(k+1) - S(k)`` of sigma ``q sqrt(distance)``, the inertial sensor and the positions tell where it
changes, and the sigma of a distance between two positions is that of a scale that may have changed on the way.

How fast it walks the data decide, by their likelihood with the states integrated out (Laplace; MacKay, "Bayesian
interpolation", Neural Computation 4, 1992): with whitened rows A, b at the solution and the step d that solves them,

    log L(q) = |R d|^2 / 2 - |b|^2 / 2 - sum of log sigma - log det R,   R' R = A' A,

one elimination for each q. The tach has its convex loss there: the switches of a wrong explanation must not speak for
it. Fixes that were withheld while the scale was a constant, and are off by no more than a wheel creeps, are used again.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from trackfg.factors.factor_type import FactorType
from trackfg.factors.family import Family, changed, family_of
from trackfg.factors.imu import linearize_imu_factors
from trackfg.factors.linear import LinearFactors
from trackfg.factors.odometry import followed_fix
from trackfg.factors.states import States
from trackfg.graph.build import Problem
from trackfg.graph.odometry import ANY_DISTANCE_SD_M
from trackfg.recording.findings import Finding
from trackfg.smoothing.reassessment import Reassessment, SolvedRun
from trackfg.smoothing.wrong_fixes import with_fixes
from trackfg.solver.elimination import eliminate
from trackfg.solver.square_root import SquareRoot

_WALKS = (1e-5, 3e-5, 1e-4, 3e-4)
"""1/sqrt(m): from 0.03 % to 1 % in a kilometre, as creep that lasts. The first one is tried on every run, each other
where the one before is more likely than those before it: the likelihood has one maximum.
"""

_CLEARLY = 3.0
"""A walk is taken if its log likelihood is larger by more than this: odds of 20 to 1."""

_CREEPS = 0.02
"""Share of the distance since the nearest fix by which a wheel that does not slip is off, at most: the top of the creep
curve (Polach, "Creep forces in simulations of traction vehicles running on adhesion limit", Wear 258, 2005).
"""

_NOISE_SIGMAS = 3.0
"""What else an interval of the wheel may be off by, in its sigmas."""

_NAMED = 1e-3
"""A change of the scale below this is none worth a finding."""


def wheel_scale(run: SolvedRun) -> Reassessment:
    """Reassess how much the wheel's scale walks: once, since a wider walk contradicts nothing any more."""
    problem = run.problem
    chain = problem.family(FactorType.DISTANCE_CHAIN)
    declared = run.declared.family(FactorType.DISTANCE_CHAIN)
    if problem.wheel is None or chain is None or declared is None:
        return Reassessment(problem)
    if (chain.sigma != declared.sigma).any():
        return Reassessment(problem, _findings(run))
    rows = _rows(run)
    per_sqrt_m = run.config.tach.scale_walk_per_sqrt_m
    constant = _log_likelihood(rows, chain, len(problem.t), run)
    best, most = per_sqrt_m, constant
    for walk in (walk for walk in _WALKS if walk > per_sqrt_m):
        likelihood = _log_likelihood(rows, _walking(chain, walk / per_sqrt_m), len(problem.t), run)
        if likelihood > constant + _CLEARLY:
            best = walk  # one wider than the likeliest, too: a jump is less likely by a walk than it happens
        if likelihood <= most:
            break
        most = likelihood
    if best == per_sqrt_m:
        return Reassessment(problem)
    families = changed(problem.families, FactorType.DISTANCE_CHAIN, lambda one: _walking(one, best / per_sqrt_m))
    problem = _with_fixes_again(replace(problem, families=families), run.solution.states)
    return Reassessment(problem, changed=True, far=True)


def _walking(chain: Family, factor: float) -> Family:
    """Return the chain of distances with a scale that walks so many times as fast."""
    return replace(chain, sigma=chain.sigma * [1.0, factor])


def _with_fixes_again(problem: Problem, states: States) -> Problem:
    """Return the problem with those withheld fixes that a wheel explains which creeps since the nearest other one."""
    used, withheld = problem.family(FactorType.ABSOLUTE_FIX), family_of(problem.withheld, FactorType.WITHHELD_FIX)
    if used is None or withheld is None:
        return problem
    at, place = used.slots[0].index, states.odo.distance
    since = np.abs(place[withheld.slots[0].index][:, None] - place[at]).min(axis=1)
    near = np.abs(withheld.residual(states)[:, 0]) < _CREEPS * since
    return with_fixes(problem, used.joined(followed_fix(withheld.take(near))), withheld.take(~near))


def _rows(run: SolvedRun) -> list[LinearFactors]:
    """Return the whitened rows of all but the chain of distances at the solution."""
    states, others = run.solution.states, []
    for family in run.problem.families:
        if family.type is FactorType.TACH_DISTANCE:
            others.append(_without_slips(family, states).convex_start())
        elif family.type is not FactorType.DISTANCE_CHAIN:
            others.append(family.convex_start())
    inertial = linearize_imu_factors(run.problem.native, run.solution.values)
    return [inertial, *(family.linearize(states) for family in others)]


def _without_slips(tach: Family, states: States) -> Family:
    """Return the tach without weight where the wheel is off by more than one that creeps: it slips there, and no walk
    of the scale is to explain that.
    """
    first = tach.slots[0].index
    way = np.abs(states.odo.distance[first + 1] - states.odo.distance[first])
    creeps = np.abs(tach.residual(states)[:, 0]) <= _CREEPS * way + _NOISE_SIGMAS * tach.sigma[:, 0]
    return replace(tach, sigma=np.where(creeps[:, None], tach.sigma, ANY_DISTANCE_SD_M))


def _log_likelihood(rows: list[LinearFactors], chain: Family, keyframes: int, run: SolvedRun) -> float:
    """Return the log likelihood with this chain, but for what does not depend on it."""
    linear = chain.linearize(run.solution.states)
    root = eliminate([*rows, linear], keyframes)
    at_solution = 0.5 * float(np.sum(linear.b**2))
    return 0.5 * root.length**2 - at_solution - float(np.log(chain.sigma).sum()) - _log_determinant(root)


def _log_determinant(root: SquareRoot) -> float:
    each = np.diagonal(root.R, axis1=1, axis2=2)
    return float(np.log(np.abs(each)).sum() + np.log(np.abs(np.diagonal(root.R_shared))).sum())


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

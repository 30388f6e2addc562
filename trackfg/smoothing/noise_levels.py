"""Noise levels are raised to what the residuals of a solution show, group by group, and where it matters over time.

A group's level squared, in units of the sigmas that were declared, is estimated by

    f^2 = (n + sum e^2) / (n + sum r),

with residuals e in these units, their redundancies r (:mod:`trackfg.solver.variance_components`), and n residuals that
agree with what is declared: the mean of an inverse gamma distribution, the conjugate prior of a variance (Gelman et
al., Bayesian Data Analysis, ch. 2). The less the rest of the graph checks a group, the less its level moves.

The inertial sensors' level is first that of the intervals nearby (shocks, a bridge, a stretch of bad track), then, of
the intervals that are left, that of the run; other groups, and the walks of the biases, have one for the run. The n
residuals of a stretch with a level of its own agree with the level of the whole run: where the graph checks a noisy
sensor little, each stretch stands out, and none would be raised by much from 1. Biases that walk faster than declared
are what a sensor that warms up shows, or one that rectifies vibration in its own way. Residuals show a gyro's walk
well, and an accelerometer's, which makes gradients wrong, hardly. Both are of one grade: where the gyro's level is
above 1, it is what is expected of the other.

No level is below 1, and what was raised comes down again once something else explains the residuals. Inertial sensors
that are better than declared show it at rest (:mod:`trackfg.sensors.imu_noise.noise_at_rest`), and levels are relative
to that. Residuals of one run show too little of it, those of wheels too: the sum of their small errors, which is what
matters, is hardly seen in them.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.special import ndtr

from trackfg.factors.factor_type import FactorType
from trackfg.factors.family import Family, changed
from trackfg.graph.build import Problem
from trackfg.numerics.arrays import Array
from trackfg.numerics.chi_square import exceeds_chance
from trackfg.recording.findings import Finding
from trackfg.sensors.imu_noise.white_noise import WhiteNoise
from trackfg.sensors.tach import Wheel
from trackfg.smoothing.reassessment import Reassessment, SolvedRun
from trackfg.solver.variance_components import GROUPS, Residuals, walk_residuals

_AGREEING = 10.0
"""Residuals that agree with what is assumed, as many as a group's prior is worth: n above."""

_ALIKE_IN_KIND = 2.0
"""The same n for the walk of the accelerometer's bias about the level of the gyro's: with it the two levels differ by a
factor of e^(1/2), 1 sigma. A sensor of a few euros (MPU-6050) has 5 and 10, held against the defaults."""

_BY_CHANCE = float(ndtr(-3.0))
"""Probability of squares as large as those of a level above 1, were it 1: that of a normal value beyond 3 sigmas."""

_NONE = 1e-3
"""Redundancy of what the rest of the graph does not check, but for rounding."""

_NEARBY = 15
"""Intervals that share a level, some 15 s in motion: a stretch of track, a braking."""

RAISED = 1.1
"""A level that would change by less stays: sigmas would hardly change."""

_NO_SUMS = np.zeros(2)

_ALIKE = 1e-9
"""Relative spread of a family's levels up to which they are one, but for rounding."""

FAR_OFF = 2.0
"""Ratio of seen to assumed or declared noise from which on it is a finding: sigmas were wrong by as much."""

_NO_NOISE = 30.0
"""A ratio beyond which noise does not explain it: a gyro declared in the wrong unit is off by 57, and shows more."""

FAMILIES = {
    FactorType.NON_HOLONOMIC: "motion",
    FactorType.PATH: "path",
    FactorType.TACH_DISTANCE: "tach",
}
"""Families with one level for the run, and the name of their group."""

_WALKS = {"accel_walk": slice(0, 3), "gyro_walk": slice(3, 6)}
"""Columns of the bias walk that have a level each."""

_NAMES = {
    "gyro": "white noise of the gyro",
    "accel": "white noise of the accelerometer",
    "accel_walk": "walk of the accelerometer's bias",
    "gyro_walk": "walk of the gyro's bias",
    "motion": "sideways motion of the vehicle",
    "path": "path between keyframes",
    "tach": "rolling of the wheel",
}
"""What the groups are, in words."""


def noise_levels(run: SolvedRun) -> Reassessment:
    """Reassess the sigmas of inertial sensors, biases, motion and wheel by their residuals."""
    problem = run.problem
    if not run.config.noise.adapt or run.is_changing:
        return Reassessment(problem, _findings(run))
    walk = walk_residuals(problem, run.solution.states, run.covariance)
    adapted = _with_inertial_levels(run, run.residuals)
    for kind, name in FAMILIES.items():
        if name in run.residuals:
            adapted = _with_level(run, adapted, kind, slice(None), run.residuals[name])
    if walk is not None:
        adapted = _with_level(run, adapted, FactorType.BIAS_WALK, _WALKS["gyro_walk"], walk)
        grade = levels(run.declared, adapted).get("gyro_walk", 1.0)
        adapted = _with_level(run, adapted, FactorType.BIAS_WALK, _WALKS["accel_walk"], walk, grade)
    return Reassessment(adapted, _findings(replace(run, problem=adapted)), changed=adapted is not problem)


def levels(declared: Problem, problem: Problem) -> dict[str, float]:
    """Return by what the sigmas of each group are larger than those that were declared, rms over the run."""
    ratio = np.sqrt(problem.run.noise.variance / declared.run.noise.variance)
    ratios = {"gyro": ratio[:, :3], "accel": ratio[:, 3:]}
    for family in problem.families:
        original = declared.family(family.type)
        if original is None or original.sigma.shape != family.sigma.shape:
            continue
        if family.type in GROUPS:
            ratios[GROUPS[family.type]] = family.sigma / original.sigma
        elif family.type is FactorType.BIAS_WALK:
            ratios |= {name: family.sigma[:, part] / original.sigma[:, part] for name, part in _WALKS.items()}
    return {name: float(np.sqrt(np.mean(factor**2))) for name, factor in ratios.items()}


def levels_seen(squares: Array | float, redundancy: Array | float, tests: float = 1.0) -> Array:
    """Return f of residuals in declared sigmas; 1 where that is not significantly more.

    Of so many independent ``tests`` the largest exceeds the limit as rarely as a single one (Bonferroni).
    """
    degrees = np.maximum(redundancy, _NONE)
    variance = (_AGREEING + squares) / (_AGREEING + degrees)
    significant = exceeds_chance(squares / degrees, degrees, _BY_CHANCE / tests) & (variance > RAISED**2)
    return np.asarray(np.where(significant, np.sqrt(variance), 1.0))


def settled(before: Array, seen: Array) -> Array:
    """Return the levels ``seen``, and those ``before`` where they would change too little."""
    return np.where(np.abs(np.log(seen / before)) < np.log(RAISED), before, seen)


def level_like(other: float, squares: float, redundancy: float) -> float:
    """Return f of residuals in declared sigmas, of which ``other`` > 1 of the same sensor is; at least 1."""
    return max(1.0, math.sqrt((_ALIKE_IN_KIND * other**2 + squares) / (_ALIKE_IN_KIND + redundancy)))


def _with_inertial_levels(run: SolvedRun, residuals: dict[str, Residuals]) -> Problem:
    """Return the run's problem with the white noise of its intervals as seen; itself where that is as it was."""
    problem, declared = run.problem, run.declared.run.noise
    level = np.sqrt(problem.run.noise.variance / declared.variance)
    new_level = level.copy()
    for columns, name in ((slice(0, 3), "gyro"), (slice(3, 6), "accel")):
        if name in residuals:
            group = residuals[name]
            new_level[group.keyframe, columns] = levels_over_time(group, level[group.keyframe, columns.start])[0][
                :, None
            ]
    moved = (settled(level, new_level) != level).any(axis=1)
    if not moved.any():
        return problem
    new_level[~moved] = level[~moved]
    noise = WhiteNoise.of_variance(declared.variance * new_level**2)
    measured = list(problem.measured)
    for k in np.flatnonzero(moved).tolist():
        noise_of_it = run.declared.measured[k].noise.scaled(*np.split(new_level[k], 2))
        measured[k] = replace(measured[k], noise=noise_of_it)
    return replace(problem, run=replace(problem.run, noise=noise), measured=tuple(measured))


def levels_over_time(
    group: Residuals, level: Array, earlier: Array = _NO_SUMS, all_earlier: Array = _NO_SUMS
) -> tuple[Array, np.ndarray]:
    """Return the level of each interval (m,): that of the intervals nearby, else that of the others in the run; and
    whether it is the latter, (m,).

    ``level`` (m,) is what it was assumed to be; ``earlier`` (2,): squares and redundancy of others in the run that have
    no level of their own, and ``all_earlier`` (2,) of all.
    """
    squares, redundancy = np.sum(group.values**2, axis=1) * level**2, np.sum(group.redundancy, axis=1)
    near, near_redundancy = (_NEARBY * uniform_filter1d(x, _NEARBY, mode="constant") for x in (squares, redundancy))
    estimate = levels_seen(near, near_redundancy, tests=max(1.0, len(squares) / _NEARBY))
    usual = estimate == 1.0
    estimate[usual] = levels_seen(earlier[0] + np.sum(squares[usual]), earlier[1] + np.sum(redundancy[usual]))
    if not usual.all():
        over_all = levels_seen(all_earlier[0] + np.sum(squares), all_earlier[1] + np.sum(redundancy))
        variance = (_AGREEING * over_all**2 + near[~usual]) / (_AGREEING + np.maximum(near_redundancy[~usual], _NONE))
        estimate[~usual] = np.sqrt(variance)
    return estimate, usual


def _with_level(
    run: SolvedRun, problem: Problem, kind: FactorType, columns: slice, group: Residuals, other: float = 1.0
) -> Problem:
    """Return the problem with some columns of a family's sigmas at the level that its residuals show.

    Sigmas that are not a multiple of the declared ones have been changed by others, and only rise. ``other`` is the
    level of the same sensor's other group, which shows its grade.
    """
    family, first = problem.family(kind), run.declared.family(kind)
    assert family is not None
    level, ours = 1.0, False
    if first is not None and first.sigma.shape == family.sigma.shape:
        ratio = family.sigma[:, columns] / first.sigma[:, columns]
        level, ours = float(ratio.flat[0]), bool(np.ptp(ratio) < _ALIKE * ratio.flat[0])
    level = level if ours else 1.0
    squares, redundancy = (float(np.sum(part[:, columns])) for part in (group.values**2, group.redundancy))
    squares *= level**2
    estimate = float(levels_seen(squares, redundancy)) if other == 1.0 else level_like(other, squares, redundancy)
    factor = estimate / level
    if abs(np.log(factor)) < np.log(RAISED):
        return problem

    def scaled(family: Family) -> Family:
        sigma = family.sigma.copy()
        sigma[:, columns] *= factor
        return family.with_sigma(sigma)

    return replace(problem, families=changed(problem.families, kind, scaled))


def _findings(run: SolvedRun) -> tuple[Finding, ...]:
    """Return what is far above its declared level."""
    return tuple(
        Finding(
            level="info",
            code="noise-level-raised",
            message=raised_level(name, level),
            hint="declare the noise that is there, or look for what causes it",
        )
        for name, level in levels(run.declared, run.problem).items()
        if name in _NAMES and level > FAR_OFF
    )


def raised_level(name: str, level: float) -> str:
    """Return the sentence that a group's noise is ``level`` times the declared one."""
    wrong = level > _NO_NOISE and name in ("gyro", "accel")
    more = "; so much may be a unit or an axis that is declared wrongly: see trackfg check" if wrong else ""
    return f"{_NAMES[name]}: residuals show {level:.1f} times what is declared, and sigmas are of that{more}"


def lowered_levels(noise: WhiteNoise, declared: tuple[float, float]) -> tuple[Finding, ...]:
    """Return which of gyro and accelerometer have in some interval a density far below their ``declared`` one."""
    least = np.sqrt(noise.variance.min(axis=0).reshape(2, 3).max(axis=1))
    return tuple(
        Finding(
            level="info",
            code="noise-level-lowered",
            message=f"{_NAMES[name]}: rests show at most {density / of:.2g} times what is declared; sigmas are of that",
            hint="declare the noise that is there: runs without rests, and other estimators, take it as declared",
        )
        for name, density, of in zip(("gyro", "accel"), least.tolist(), declared, strict=True)
        if density * FAR_OFF < of
    )


def miscounted(wheel: Wheel | None, declared: float) -> tuple[Finding, ...]:
    """Return whether the count of the wheel has errors far above the creep that is ``declared``, m in sqrt(1 m)."""
    if wheel is None or wheel.miscount < FAR_OFF * declared:
        return ()
    return (
        Finding(
            level="info",
            code="noise-level-raised",
            message=f"count of the wheel: its errors add up to {wheel.miscount:.2g} m in sqrt(1 m), "
            f"{wheel.miscount / declared:.0f} times what is declared, and sigmas are of that",
            hint="look for pulses that are missed or counted twice: a loose pick-up, a worn wheel",
        ),
    )


def noise_findings(ratios: dict[str, float]) -> tuple[Finding, ...]:
    """Return a warning for each group whose noise is far above what is assumed: its sigmas are too small."""
    return tuple(
        Finding(
            level="warning",
            code="noise-level",
            message=f"the residuals of {name!r} are {ratio:.1f} times what its sigmas lead to expect",
            hint="declare the noise that is there, or look for what causes it",
        )
        for name, ratio in ratios.items()
        if ratio > FAR_OFF
    )

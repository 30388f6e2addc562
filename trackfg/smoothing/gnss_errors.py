"""Sigmas of GNSS are reassessed by the residuals of a run's positions and speeds.

A receiver's sigmas are guesses. In the open they may be too wide, in a street canyon it is off by 5-10 m for tens of
seconds where it declares 2 m, and errors that last count once, however many positions share them.

Residuals show the level and the correlation C of the errors (:mod:`trackfg.smoothing.lasting_errors`). Sigmas become
level x sqrt(C) of the declared ones; whether a position is an outlier is still judged by the level alone.

*What does not show.* A receiver's sigma is that of a position, and no mean of many is better than what they share:
orbits, ionosphere, a calibration of its antenna. Where residuals scatter by much less than declared, what is left of
the declared variance is such an error, or the sigmas are too wide. Neither shows, so chainage and position are widened
by it.

Residuals of GNSS are large as well where it is the inertial sensors that are worse than assumed. So GNSS is not judged
while another group of residuals is further beyond its sigmas.

If the receiver was wrong, residuals stay as they were once its positions have lost weight, since all else goes on
saying the same. Where they grow far beyond the level that was seen, the positions had held what was wrong itself: dead
reckoning that bends from one side of an outage to the other, say. With less weight they would grow on, so they get no
less.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from trackfg.factors.factor_type import FactorType
from trackfg.factors.family import Family
from trackfg.factors.loss import Huber
from trackfg.numerics.arrays import Array
from trackfg.numerics.spans import true_runs
from trackfg.output.trajectory import QUANTITIES, keyframe_variances
from trackfg.recording.findings import Finding
from trackfg.results.verdict import Doubt, Quantity
from trackfg.smoothing.lasting_errors import (
    GnssErrors,
    are_far,
    errors_seen,
    have_changed,
    have_grown,
    variance_growth,
    without_outliers,
)
from trackfg.smoothing.reassessment import LEAST_CHANGE, Reassessment, SolvedRun, others_are_worse
from trackfg.solver.leave_one_out import predicted

_SCATTER = 0.5
"""Share of the declared variance below which that of the residuals is too small for errors without memory: a variance
that is declared 1.4 times too large in sigmas is usual."""

_FINDING = 2.0
"""A level, or its rms over the run, from which on it is a finding: sigmas were wrong by as much."""

FEWEST = 10
"""Positions below which there is nothing to be learnt of their errors."""

_NAMED = 3
"""So many spans are named in a finding; the report shows all."""


class _Judged(NamedTuple):
    """Measurements that are judged: the type of their factors, the name of the group, and what findings call them and
    advise.
    """

    type: FactorType
    group: str
    code: str
    name: str
    hint: str

    @property
    def held_others(self) -> Finding:
        """The finding that all else errs more."""
        message = "differ from dead reckoning, and the more the less weight they have: it is not they that err most"
        hint = "declare noise and calibration of the IMU, and scale_sd of the tach, as large as they are"
        return Finding("info", f"{self.code}-holds", f"{self.name} {message}", hint=hint)


_POSITIONS = _Judged(
    FactorType.GNSS_POSITION,
    "gnss",
    "gnss",
    "positions",
    "the sigmas were widened; declare what the receiver is worth, errors that last included, and where its antenna "
    "is (gnss.lever_arm_m)",
)
_SPEEDS = _Judged(
    FactorType.GNSS_SPEED,
    "gnss speed",
    "gnss-speed",
    "speeds",
    "the sigmas were widened; check gnss_speed.unit, and declare what the receiver's speeds are worth",
)


def gnss_errors(run: SolvedRun) -> Reassessment:
    """Reassess the sigmas of GNSS positions by their residuals."""
    return _reassessed(run, _POSITIONS)


def gnss_speed_errors(run: SolvedRun) -> Reassessment:
    """Reassess the sigmas of a receiver's speeds by their residuals."""
    return _reassessed(run, _SPEEDS)


def _reassessed(run: SolvedRun, judged: _Judged) -> Reassessment:
    problem = run.problem
    family, declared = problem.family(judged.type), run.declared.family(judged.type)
    if family is None or declared is None or family.loss is None or len(family) < FEWEST:
        return Reassessment(problem)
    ratios = run.noise_ratios
    if np.array_equal(family.sigma, declared.sigma) and others_are_worse(ratios, ratios.get(judged.group, 1.0)):
        return Reassessment(problem)
    states = run.solution.states
    t = problem.t[family.slots[0].index] + family.data["delay"][:, 0]
    residual, followed = predicted(family, states, run.covariance)
    in_sigmas = residual / declared.sigma
    level = problem.gnss_level.get(judged.type)
    if level is not None and have_grown(without_outliers(judged.type, in_sigmas, level), level):
        return Reassessment(problem, (judged.held_others,))
    variance = np.diagonal(followed, axis1=1, axis2=2) / declared.sigma**2
    used = family.sigma / declared.sigma
    errors = errors_seen(t, in_sigmas, variance, weighted=level is not None, used=used)
    least = 1.0 if run.config.position.gnss_correlation_s else 0.0
    sigma = declared.sigma * np.maximum(errors.factor, least)
    changed = have_changed(family.sigma, sigma)
    if changed:
        width = run.config.position.gnss_width / float(np.sqrt(np.median(errors.correlation)))
        again = replace(family, sigma=sigma, loss=Huber(width))
        families = tuple(again if f is family else f for f in problem.families)
        problem = replace(problem, families=families, gnss_level={**problem.gnss_level, judged.type: errors.level})
    doubts: tuple[Doubt, ...] = ()
    if judged is _POSITIONS:
        grown = float(np.median(sigma / family.sigma)) if changed else 1.0
        doubts = (*_unsettled(run, grown), *_shared_errors(run, family, declared.sigma, errors.level))
    return Reassessment(problem, _findings(t, errors, judged), doubts, changed=changed)


def _findings(t: Array, errors: GnssErrors, judged: _Judged) -> tuple[Finding, ...]:
    """Return a warning where measurements are far worse than they declare, with the worst spans."""
    size = np.sqrt(np.mean(errors.level**2, axis=1))
    if np.sqrt(np.mean(size**2)) < _FINDING:
        return ()
    spans = sorted(true_runs(are_far(errors.level)), key=lambda span: -float(size[slice(*span)].max()))
    named = [f"{t[i]:.0f}-{t[j - 1]:.0f} s ({size[i:j].max():.1f} times)" for i, j in spans[:_NAMED]]
    where = f", most at {', '.join(named)}" if named else ""
    message = f"GNSS {judged.name} err by {np.median(size):.1f} times their declared sigmas as a rule{where}"
    return (Finding("warning", f"{judged.code}-level", message, hint=judged.hint),)


def placed_by_positions(*, has_fixes: bool) -> dict[Quantity, str]:
    """Return what the positions place, with its column: the chainage, too, unless fixes do."""
    return {"position": "east_m"} if has_fixes else {"position": "east_m", "chainage": "chainage_m"}


def _unsettled(run: SolvedRun, grown: float) -> tuple[Doubt, ...]:
    """Return the doubt of what positions place whose sigmas would have to be ``grown`` times as large. It counts where
    the run is not solved again.
    """
    factor = math.sqrt(variance_growth(grown)) if grown > 1.0 else 1.0
    if factor < LEAST_CHANGE:
        return ()
    reason = f"errors of GNSS positions last so long that their sigmas would have to be {grown:.2g} times as large"
    return (Doubt(tuple(_placed(run)), factor, reason, _POSITIONS.hint),)


def _placed(run: SolvedRun) -> dict[Quantity, str]:
    return placed_by_positions(has_fixes=run.problem.family(FactorType.ABSOLUTE_FIX) is not None)


def _shared_errors(run: SolvedRun, family: Family, declared: Array, level: Array) -> tuple[Doubt, ...]:
    """Return the doubt of what positions place, where their residuals have a ``level`` (m, d) far below the
    ``declared`` sigmas (m, d), m.
    """
    shared = None if run.config.position.gnss_correlation_s else shared_error(level, declared)
    if shared is None:
        return ()
    states, at = run.solution.states, family.slots[0].index
    variances = keyframe_variances(states, run.covariance, run.problem.run.lever_arm)[at].mean(axis=0)
    return tuple(shared.doubts({of: float(variances[QUANTITIES.index(by)]) for of, by in _placed(run).items()}))


class SharedError(NamedTuple):
    """The ``variance`` of an error that positions may share, m^2, and the reason."""

    variance: float
    reason: str

    def doubts(self, variances: Mapping[Quantity, float]) -> Iterator[Doubt]:
        """Yield doubts of quantities of such ``variances``, m^2."""
        hint = "declare the sigma that the positions have, and position.gnss_correlation_s"
        for quantity, variance in variances.items():
            factor = math.sqrt(1.0 + self.variance / variance)
            if factor >= LEAST_CHANGE:
                yield Doubt((quantity,), factor, self.reason, hint)


def shared_error(level: Array, declared: Array) -> SharedError | None:
    """Return the error that positions may share, where their horizontal residuals have a ``level`` (m, d) far below the
    ``declared`` sigmas (m, d), m.
    """
    scatter = float(np.median(level[:, :2] ** 2))
    if scatter > _SCATTER:
        return None
    reason = f"GNSS positions scatter by {math.sqrt(scatter):.2g} of their declared sigmas: they may share the rest"
    return SharedError((1.0 - scatter) * float(np.median(declared[:, :2] ** 2)), reason)

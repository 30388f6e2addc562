"""Residuals of GNSS positions show the receiver's errors: how large they are, when, and how long they last.

A receiver's sigmas are guesses. In the open they may be too wide, in a street canyon it is off by 5-10 m for tens of
seconds where it declares 2 m, and errors that last count once, however many positions share them.

A solution follows errors, the more the longer they last: the residual r of an error e has the covariance
``Cov(e) - S``, S being that of the predicted position, which changes slowly. So of each product of residuals is
expected what the errors' would be, less S.

*Level.* The variance of the errors is the mean of ``r^2 + S`` within :data:`_AROUND_S` of each position, horizontally
and vertically (variance components: Foerstner 1979, as in :mod:`trackfg.solver.variance_components`). It is shrunk
towards that of the run, and that one towards what is declared. The run's is the median of these means, divided by the
median that a mean of so many squares of variance 1 has.

Errors that last a minute are large or small for as long, though their level never changes. So there are two
hypotheses, levels that change and one level with errors that last: in the second, n residuals around a position
determine its level as well as n / C independent ones do. The first has a parameter more for every span and group of
residuals; it stands where its likelihood is larger by more than their number (Akaike, IEEE Trans. Automatic Control 19
(1974)).

*Correlation.* n positions whose errors have the autocorrelation rho are worth n / C independent ones,

    C = 1 + 2 sum_k rho(k),

the sum of all lags up to the first that is not significant (Geyer, "Practical Markov chain Monte Carlo", Statistical
Science 7 (1992), the initial positive sequence), or that of the exponential which fits them, whichever is larger: a sum
that is cut off is too small. Errors last where they are large, so C is that of the positions with large levels and that
of the others, each by itself.

*What does not show.* A receiver's sigma is that of a position, and no mean of many is better than what they share:
orbits, ionosphere, a calibration of its antenna. Where residuals scatter by much less than declared, what is left of
the declared variance is such an error, or the sigmas are too wide. Neither shows, so chainage and position are widened
by it.

Residuals of GNSS are large as well where it is the inertial sensors that are worse than assumed. So GNSS is not judged
while another group of residuals is further beyond its sigmas.

A solution by wider sigmas follows more: C belongs to a larger S than that of the solution whose residuals are judged.
Where sigmas grow, S and C are computed in turns here instead of by many solutions.

Sigmas become level x sqrt(C) of the declared ones; whether a position is an outlier is still judged by the level alone.

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
from trackfg.numerics.spans import median_interval, true_runs
from trackfg.output.trajectory import QUANTITIES, keyframe_variances
from trackfg.recording.findings import Finding
from trackfg.results.verdict import Doubt, Quantity
from trackfg.smoothing.reassessment import LEAST_CHANGE, Reassessment, SolvedRun, others_are_worse
from trackfg.solver.leave_one_out import predicted

_AROUND_S = 10.0
"""Half of a span with one level, s: street canyons and stations take tens of seconds to pass."""
_AROUND_POSITIONS = 5.0
"""The same in positions, where these are sparse."""

_DECLARED_WEIGHT = 4.0
"""Residuals that the declared sigmas are worth: n of them determine a sigma to 1 / sqrt(2 n), and a receiver's is known
to 35 %, a factor of 2 being two sigmas."""
_RUN_WEIGHT = 10.0
"""Residuals that the median level of the run is worth against those around a position."""

_BOUND_SIGMAS = 3.0
"""A residual counts as no more than so many of its sigmas: outliers are the loss's part. A few of 10 sigmas would hide
from the autocorrelation that all other errors last."""

_MOST_FOLLOWED = 0.9
"""Share of an error's variance that a solution follows, at most: where it is more, residuals say nothing of it."""

_ROUNDS = 5
"""Levels and the bounds of residuals that go with them are computed in turns, so often: the bounds matter little."""

_FOLLOWS = 1.5
"""The variance of a solution grows as this power of the sigmas of its positions: as the square where dead reckoning
holds its shape, in proportion where its place walks at random, between them where its speed does (steady states of
Kalman filters)."""

_LEVELS = (0.5, 100.0)
"""Levels are kept within these: residuals say little about sigmas that are far too wide."""

_FAR = 1.5
"""Positions whose level is so much above the median one are a class of their own: in the open, levels within 10 s
scatter by a quarter."""

LONGEST_S = 120.0
"""No error is looked for that lasts longer, s: multipath of a receiver at rest repeats with the satellites, but that of
one in motion changes with the place."""

_LAGS_OF_POSITIONS = 4
"""Autocorrelations are looked at up to a lag of the number of positions over this: of longer ones there are too few
pairs (Box & Jenkins, "Time series analysis", 1970, ch. 2). Nor is an error taken to last longer."""

_SIGNIFICANT = 2.0
"""Autocorrelations below so many of their sigmas end the sum."""

_FITTED_LAGS = 3
"""Significant autocorrelations to which an exponential is fitted, at least: it has two parameters."""

_SETTLED = 0.15
"""Relative change of the sigmas, rms, below which the run is not solved again."""

_GROWN = 2.0
"""Residuals of positions with less weight, over the level seen before, from which on it is not the receiver that errs.
Levels of tens of seconds scatter by a quarter."""

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


class GnssErrors(NamedTuple):
    """The errors that are seen at each of m measurements, over the declared sigmas: ``level`` (m, d) and
    ``correlation`` C (m,).
    """

    level: Array
    correlation: Array

    @property
    def factor(self) -> Array:
        """The factor on the declared sigmas, (m, d)."""
        return np.asarray(self.level * np.sqrt(self.correlation)[:, None])


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


def _groups(residual: Array) -> tuple[slice, ...]:
    """Return the columns of horizontal and of vertical residuals; of a speed there is one column."""
    return (slice(0, 2), slice(2, 3)) if residual.shape[1] > 1 else (slice(0, 1),)


def have_changed(before: Array, now: Array) -> bool:
    """Return whether sigmas (m, 3) have changed by so much that a run is solved again."""
    return bool(np.sqrt(np.mean(np.log(now / before) ** 2)) > _SETTLED)


def without_outliers(kind: FactorType, residual: Array, level: Array) -> Array:
    """Return residuals (m, d) of speeds no larger than errors of that ``level`` (m, d) or (d,) have.

    A speed is known to 0.1 m/s, and an outlier of the vehicle's own speed is a hundred sigmas. Positions stay.
    """
    if kind is not FactorType.GNSS_SPEED:
        return residual
    return np.clip(residual, -_BOUND_SIGMAS * level, _BOUND_SIGMAS * level)


def have_grown(residual: Array, level: Array) -> bool:
    """Return whether residuals (m, 3) are far beyond the level (m, 3) that was seen before."""
    return bool(np.mean(residual**2) > _GROWN**2 * np.mean(level**2))


def errors_seen(
    t: Array, residual: Array, followed: Array, *, weighted: bool = True, used: Array | None = None
) -> GnssErrors:
    """Return level and correlation at times t (m,), s, from residuals (m, 3) in declared sigmas and from the variance S
    of the predicted positions (m, 3), likewise.

    ``weighted``: in the solution large errors had less weight already. Where they had not, they bent the path, all
    residuals seem to last, and levels are taken to change. ``used`` (m, 3): its factors on the declared sigmas.
    """
    if not weighted:
        return _errors(t, residual, followed, 1.0)
    errors = _likelier(t, residual, followed)
    if used is not None:
        for _ in range(_ROUNDS - 1):
            growth = max(1.0, float(np.median(errors.factor / used)))
            errors = _likelier(t, residual, followed * growth**_FOLLOWS)
    return errors


def _likelier(t: Array, residual: Array, followed: Array) -> GnssErrors:
    """Return levels that change, or one level with errors that last, whichever is likelier."""
    changing = _errors(t, residual, followed, 1.0)
    lasting = _errors(t, residual, followed, float(changing.correlation[~_far(changing.level)][0]))
    gain = _likelihood(t, residual, changing.level) - _likelihood(t, residual, lasting.level)
    return changing if gain > len(_groups(residual)) * (t[-1] - t[0]) / (2.0 * _around_s(t)) else lasting


def _around_s(t: Array) -> float:
    """Return half of the span with one level, s."""
    return max(_AROUND_S, _AROUND_POSITIONS * median_interval(t))


def _errors(t: Array, residual: Array, followed: Array, correlation: float) -> GnssErrors:
    """Return level and correlation where n residuals around a position are worth n / C independent ones."""
    level, correlations = np.empty_like(residual), np.empty(len(t))
    for columns in _groups(residual):
        level[:, columns] = _levels(t, residual[:, columns], followed[:, columns], correlation)[:, None]
    far = _far(level)
    for part in (far, ~far):
        correlations[part] = _correlation(t, residual / level, followed / level**2, part)
    return GnssErrors(level, correlations)


def _far(level: Array) -> np.ndarray:
    """Return which positions have levels far above the median, (m,) of (m, 3)."""
    size = np.sqrt(np.mean(level**2, axis=1))
    return np.asarray(size > _FAR * np.median(size))


def _likelihood(t: Array, residual: Array, level: Array) -> float:
    """Return the logarithm of the likelihood of levels (m, 3), of each residual (m, 3) given the one before it.

    Residuals over their level are a first-order autoregression, those of large levels and the others each one of its
    own. Its innovations follow Cauchy's distribution, whose scale is the median of their magnitudes: outliers are in
    both hypotheses, and must not decide between them.
    """
    z = residual / level
    bounded = np.clip(z, -_BOUND_SIGMAS, _BOUND_SIGMAS)
    far, total = _far(level), 0.0
    adjacent = np.diff(t) < 1.5 * median_interval(t)
    for part in (far, ~far):
        pairs = adjacent & part[1:]
        if np.any(bounded[:-1][pairs]):
            previous, current = bounded[:-1][pairs], bounded[1:][pairs]
            innovation = z[1:][pairs] - z[:-1][pairs] * np.sum(previous * current) / np.sum(previous**2)
            scale = max(float(np.median(np.abs(innovation))), np.finfo(float).eps)
            total -= float(np.sum(np.log(scale * level[1:][pairs]) + np.log1p((innovation / scale) ** 2)))
    return total


def _levels(t: Array, residual: Array, followed: Array, correlation: float) -> Array:
    """Return the level around each position, (m,), of residuals (m, k) of which n are worth n / C independent ones."""
    around = _around_s(t)
    first, last = np.searchsorted(t, t - around), np.searchsorted(t, t + around, side="right")
    count = (last - first) * residual.shape[1]
    independent = np.maximum(count / correlation, residual.shape[1])
    median = (1.0 - 2.0 / (9.0 * independent)) ** 3  # of the mean of so many squares (Wilson & Hilferty, 1931)
    level = np.full(len(t), np.sqrt(np.median(residual**2 + followed)))
    for _ in range(_ROUNDS):
        bound = level[:, None] ** 2
        squares = np.minimum(residual**2, _BOUND_SIGMAS**2 * bound) + np.minimum(followed, _MOST_FOLLOWED * bound)
        total = np.concatenate([[0.0], np.cumsum(squares.sum(axis=1))])
        around_it = total[last] - total[first]
        usual = float(np.median(around_it / count / median))
        declared, of_run = _DECLARED_WEIGHT * correlation, _RUN_WEIGHT * correlation
        usual = (usual * squares.size + declared) / (squares.size + declared)
        level = np.sqrt((around_it + of_run * usual) / (count + of_run))
    return np.asarray(np.clip(level, *_LEVELS))


def _correlation(t: Array, residual: Array, followed: Array, part: np.ndarray) -> float:
    """Return C of the positions ``part``, of residuals (m, 3) and variances S (m, 3) over the level."""
    interval = median_interval(t)
    if not part.any():
        return 1.0
    residual = np.clip(residual, -_BOUND_SIGMAS, _BOUND_SIGMAS)
    followed_there = float(np.mean(np.minimum(followed[part], _MOST_FOLLOWED)))
    variance = float(np.mean(residual[part] ** 2)) + followed_there
    rho: list[float] = []
    longest = max(1, min(int(np.count_nonzero(part)) // _LAGS_OF_POSITIONS, int(LONGEST_S / interval)))
    for lag in range(1, longest + 1):
        pairs = part[:-lag] & part[lag:] & (np.abs(t[lag:] - t[:-lag] - lag * interval) < 0.5 * interval)
        count = int(pairs.sum()) * residual.shape[1]
        product = float(np.mean((residual[:-lag] * residual[lag:])[pairs])) if count else 0.0
        if product <= _SIGNIFICANT * variance / np.sqrt(max(count, 1)):
            break
        rho.append((product + followed_there) / variance)
    if len(rho) < _FITTED_LAGS:
        return 1.0 + 2.0 * sum(rho)
    slope, intercept = np.polyfit(np.arange(1, len(rho) + 1), np.log(rho), 1, w=rho)
    phi, share = float(np.exp(min(slope, -1.0 / longest))), float(min(np.exp(intercept), 1.0))
    return 1.0 + 2.0 * max(sum(rho), share * phi / (1.0 - phi))


def _findings(t: Array, errors: GnssErrors, judged: _Judged) -> tuple[Finding, ...]:
    """Return a warning where measurements are far worse than they declare, with the worst spans."""
    size = np.sqrt(np.mean(errors.level**2, axis=1))
    if np.sqrt(np.mean(size**2)) < _FINDING:
        return ()
    spans = sorted(true_runs(size > _FAR * np.median(size)), key=lambda span: -float(size[slice(*span)].max()))
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
    factor = math.sqrt(grown**_FOLLOWS) if grown > 1.0 else 1.0
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

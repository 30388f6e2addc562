"""Residuals show how large the errors of measurements are, when, and how long they last.

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

A solution by wider sigmas follows more: C belongs to a larger S than that of the solution whose residuals are judged.
Where sigmas grow, S and C are computed in turns here instead of by many solutions.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trackfg.factors.factor_type import FactorType
from trackfg.numerics.arrays import Array
from trackfg.numerics.spans import median_interval

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


def _groups(residual: Array) -> tuple[slice, ...]:
    """Return the columns of horizontal and of vertical residuals; of a speed there is one column."""
    return (slice(0, 2), slice(2, 3)) if residual.shape[1] > 1 else (slice(0, 1),)


def have_changed(sigma: Array, new_sigma: Array) -> bool:
    """Return whether ``new_sigma`` (m, 3) differs so much from ``sigma`` that a run is solved again."""
    return bool(np.sqrt(np.mean(np.log(new_sigma / sigma) ** 2)) > _SETTLED)


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


def variance_growth(factor: float) -> float:
    """Return by what factor the variance of a solution grows where all sigmas of its positions do by ``factor``."""
    return float(factor**_FOLLOWS)


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
            errors = _likelier(t, residual, followed * variance_growth(growth))
    return errors


def _likelier(t: Array, residual: Array, followed: Array) -> GnssErrors:
    """Return levels that change, or one level with errors that last, whichever is likelier."""
    changing = _errors(t, residual, followed, 1.0)
    lasting = _errors(t, residual, followed, float(changing.correlation[~are_far(changing.level)][0]))
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
    far = are_far(level)
    for part in (far, ~far):
        correlations[part] = _correlation(t, residual / level, followed / level**2, part)
    return GnssErrors(level, correlations)


def are_far(level: Array) -> np.ndarray:
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
    far, total = are_far(level), 0.0
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

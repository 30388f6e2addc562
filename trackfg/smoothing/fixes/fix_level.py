"""Leave-one-out residuals show the level of the fixes' errors over their declared sigmas.

A fix with declared sigma s is off from its prediction by all other measurements by e, with the variance
``v = k^2 s^2 + C`` where k is the level and C the variance of the prediction. One in ten may be wrong, by anything up
to a kilometre. The level is the most likely one,

    sum log((1 - P) N(e; 0, v) + P / R) - n0 / 2 (log k^2 + 1 / k^2)  ->  max,

where the second part stands for n0 fixes whose declared sigmas are right.

Errors that are smaller than v expects do not say which of its parts is too large: sensors that are better than declared
predict better, too. So v is ``k^2 s^2`` alone for levels below 1: only fixes that are off by less than they declare,
whatever predicts them, are better than that.

What predicts a fix may err itself: an inertial sensor whose scales are ten times as far off as declared contradicts the
wheel and every fix. Fixes that err do not lie on one line over the way that the wheel rolled, whatever its scale. With
the sum Q of squares about that line, in declared sigmas, levels are as likely as

    L(k) = -Q / (2 k^2) - (n - 2) log k,

and a level is at most the largest that is within two sigmas of the likeliest. What the wheel errs by is in Q, too, so
this bound is no smaller than that of the fixes alone.
"""

from __future__ import annotations

import numpy as np

from trackfg.numerics.arrays import Array

_WRONG = 0.1
"""P: up to one fix in five may be wrong."""
_RANGE_M = 1000.0
"""R, m: it may be another balise's chainage."""

_DECLARED_WEIGHT = 2.0
"""n0: two fixes that say otherwise outweigh what is declared."""

_LOG_LEVELS = np.linspace(np.log(0.5), np.log(1000.0), 200)
"""Levels are sought on this grid, of steps of 4 %; residuals say little about sigmas that are far too wide."""

_SIGNIFICANT = 2.0
"""A level is 1 unless it is more likely by so much (in the logarithm), which is two sigmas (Wilks, 1938)."""


def fix_level(error: Array, sigma: Array, predicted: Array) -> float:
    """Return k from leave-one-out errors (n,), m, declared sigmas (n,), m, and variances C of the predictions, m^2."""

    def likelihood(log_levels: Array) -> Array:
        square = np.exp(2.0 * log_levels)[:, None]
        variance = square * sigma**2 + np.where(square < 1.0, 0.0, predicted)
        right = np.log1p(-_WRONG) - 0.5 * (error**2 / variance + np.log(2.0 * np.pi * variance))
        of_fixes = np.logaddexp(right, np.log(_WRONG / _RANGE_M)).sum(axis=1)
        return np.asarray(of_fixes - 0.5 * _DECLARED_WEIGHT * (np.log(square) + 1.0 / square)[:, 0])

    levels = likelihood(_LOG_LEVELS)
    best = int(np.argmax(levels))
    certain = levels[best] - float(likelihood(np.zeros(1))[0]) > _SIGNIFICANT
    return float(np.exp(_LOG_LEVELS[best])) if certain else 1.0


def most_by_wheel(place: Array, sigma: Array, rolled: Array) -> float:
    """Return the largest k of fixes at ``place`` (n,), m, with declared sigmas (n,), m, where the wheel had ``rolled``
    (n,), m.
    """
    about = rolled - rolled.mean()
    line = np.stack([np.ones_like(about), about], axis=1) / sigma[:, None]
    misfit = place / sigma - line @ (np.linalg.pinv(line) @ (place / sigma))
    likely = -0.5 * float(misfit @ misfit) * np.exp(-2.0 * _LOG_LEVELS) - max(len(place) - 2, 0) * _LOG_LEVELS
    return float(np.exp(_LOG_LEVELS[likely >= likely.max() - _SIGNIFICANT][-1]))

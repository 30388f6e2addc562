"""Medians, standard deviations and least squares that outliers do not change; the jackknife's standard deviation."""

from __future__ import annotations

import math

import numpy as np

from trackfg.numerics.arrays import Array
from trackfg.numerics.kernels import compiled_kernels, kernel_argument

_CAUCHY = 2.385
"""Residual, in sigmas, at which Cauchy's weight is a half: it has 95 % of the efficiency of plain squares (Zhang,
*Parameter estimation techniques* (1997))."""

_ROUNDS = 20
"""Rounds of least squares and weights, at most."""

_SETTLED = 1e-4
"""A round that moves coefficients by less, in sigmas, is the last one. All further ones would add less than 1e-3 of a
sigma where each moves them by nine tenths of the one before at most."""

SD_PER_MAD = 1.4826
"""Standard deviation of a normal variable over its median absolute deviation, 1/Phi^-1(3/4), to four digits (Hampel,
Journal of the American Statistical Association 69, 1974)."""

_LIMITS = np.array([_CAUCHY, _SETTLED, _ROUNDS, SD_PER_MAD])
"""As ``kernels/robust.cpp`` has them."""


def median(x: Array) -> float:
    """Return the median of x (n,), not empty, as ``np.median`` does: NaN where any is.

    For some hundred values numpy takes most of its time to choose an axis.
    """
    half, last = x.size // 2, x.size - 1
    part = np.partition(x, (half - 1, half, last) if half else last)
    if math.isnan(part[last]):
        return math.nan
    return float(part[half]) if x.size % 2 else float(0.5 * (part[half - 1] + part[half]))


def robust_sd(errors: Array) -> float:
    """Return the standard deviation of errors about zero, from their median magnitude.

    ``errors``: any shape, at least one and none NaN; the result has their unit.
    """
    return SD_PER_MAD * median(np.abs(errors).ravel())


def jackknife_sd(others: Array, value: float) -> float:
    """Return the standard deviation of an estimate about ``value`` from its leave-one-out values (n,), in their unit
    (Efron, "The jackknife, the bootstrap and other resampling plans", 1982, ch. 3).
    """
    return float(np.sqrt((others.size - 1) / others.size * np.sum((others - value) ** 2)))


def cauchy_fit(
    rows: Array, right: Array, prior_sd: Array, least_sd: float, per_value: float = 1.0
) -> tuple[Array, Array]:
    """Return the coefficients (c,) with which ``rows`` (n, c) make ``right`` (n,), and their standard deviations (c,).

    Least squares with Cauchy's weights. Coefficients are about 0 within ``prior_sd`` (c,), infinite where they may be
    anything. Residuals have their own level, ``least_sd`` at least, in the unit of ``right``; ``per_value`` of them
    that follow each other are one independent value.
    """
    precision = np.asarray(1.0 / np.square(prior_sd), dtype=np.float64)
    if compiled_kernels():
        from trackfg.numerics import compiled

        fit, arguments = np.empty((2, rows.shape[1])), [kernel_argument(part) for part in (rows, right, precision)]
        if compiled.cauchy_fit(arguments[0], arguments[1], arguments[2], least_sd, per_value, _LIMITS, fit):
            return fit[0], fit[1]
    off, weight, coefficients = right, np.ones(len(rows)), np.full(rows.shape[1], np.nan)
    for _ in range(_ROUNDS):
        level = max(robust_sd(off - median(off)), least_sd)
        weighted = rows.T * weight / (per_value * level**2)
        information = weighted @ rows + np.diag(precision)
        solution = np.asarray(np.linalg.solve(information, weighted @ right), dtype=np.float64)
        step, coefficients = solution - coefficients, solution
        if step @ information @ step < _SETTLED**2:
            break
        off = right - rows @ coefficients
        weight = np.asarray(1.0 / (1.0 + np.square(off / (_CAUCHY * level))), dtype=np.float64)
    return coefficients, np.sqrt(np.diagonal(np.linalg.inv(information)))

"""A series of values at one place is a straight drift, with steps where the track was worked on, and outliers.

    y_i = a + b t_i + sum_j d_j o_ij + sum_k c_k [i >= k] + e_i,    e_i ~ N(0, sigma_i^2)

The columns o are offsets of sensors and the season (:mod:`trackfg.mapping.trends.offsets`), where there are any.
Steps and outliers are found one at a time by what each takes off the sum of squared whitened residuals: a step at k as
a column of ones from k on, an outlier as a column with a single one. Whichever takes off most is taken in, while that
is beyond a threshold; at the last run the two are the same, which counts as a step. The drift goes on at one rate over
all steps. The forward search is that of Chen and Liu, "Joint estimation of model parameters and outlier effects in time
series", J. Am. Stat. Assoc. 88 (1993).

Places are columns of the arrays: everything is computed for all of them at a time.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trackfg.mapping.trends.offsets import different_times
from trackfg.numerics.arrays import Array
from trackfg.numerics.chi_square import exceeds_chance
from trackfg.numerics.key_figures import Outlined
from trackfg.numerics.robust import robust_sd

MOST_SUDDEN = 4
"""Steps and outliers at one place at most: maintenance comes once or twice a year."""

FEWEST_RUNS = 3
"""Fewest runs that determine both a rate and its scatter."""

_LEAST_SHARE = 1e-5
"""Least sigma over the largest one at a place: the normal matrix holds the square, of which doubles keep 16 digits."""

_BY_CHANCE = 1e-3
"""Share of straight drifts whose scatter is taken for more than chance: it leaves the others' sigmas as they are."""

_RUNS_BEFORE_STEP = 2
"""Runs before a step at least; a first run that does not fit the rest is an outlier."""


@dataclass(frozen=True, repr=False)
class Drift(Outlined):
    """The drift at m places: ``rate`` and its sigma, the ``value`` at the time ``at`` and its sigma, all (m,).

    ``covariance``: of rate and value, (m,). ``steps`` (n, m) has at each run how much the value jumped before it, zero
    where it did not, ``step_sd`` the sigma of that; ``outliers`` (n, m) is true for what was left out. ``scale``: by
    which the sigmas were multiplied to agree with the scatter; it is in all of these, and at a place that scatters by
    more than chance its own. ``runs`` counts values, (m,).
    """

    at: float
    rate: Array
    rate_sd: Array
    value: Array
    value_sd: Array
    covariance: Array
    steps: Array
    step_sd: Array
    outliers: np.ndarray
    scale: float
    runs: Array


def drift(t: Array, y: Array, sd: Array, *, threshold: Array | float, offsets: Array | None = None) -> Drift:
    """Fit the drift of values ``y`` (n, m) with sigmas ``sd`` at ascending times ``t`` (n,); NaN: not known.

    ``threshold``: sigmas from which a step or an outlier is one, for all or for each value (n, m). ``offsets``: further
    columns (n, m, k), whose effect the value leaves out.

    Places with fewer values than :data:`FEWEST_RUNS` at different times get NaN. Raises ``ValueError`` for times that
    fall.
    """
    if np.any(np.diff(t) < 0.0):
        raise ValueError("t: expected ascending times")
    at = float(t[-1])
    known = np.isfinite(y) & np.isfinite(sd) & (sd > 0.0)
    enough = different_times(t, known) >= FEWEST_RUNS
    offsets = np.zeros((*y.shape, 0)) if offsets is None else offsets
    steps_from = 2 + offsets.shape[2]
    sd = np.where(known, sd, 0.0)
    sd = np.where(known, np.maximum(sd, _LEAST_SHARE * sd.max(axis=0)), 1.0)
    y, weight = np.where(known, y, 0.0), np.where(known & enough, 1.0 / sd**2, 0.0)
    # Columns (n, m, p): the value at the time, the rate, offsets, and steps; those not taken in are zero.
    X = np.zeros((*y.shape, steps_from + MOST_SUDDEN))
    X[..., 0], X[..., 1], X[..., 2:steps_from] = 1.0, (t - at)[:, None], offsets
    alike = y if steps_from == 2 else y - np.einsum("nmk,mk->nm", offsets, _solved(X, weight, y)[0][:, 2:steps_from])
    scale = _local_scale(t, alike, weight)
    threshold = np.broadcast_to(np.asarray(threshold, dtype=np.float64), y.shape)
    first, outliers = _take_in_steps(X, weight, y, threshold, scale)
    weight = np.where(outliers, 0.0, weight)
    solution, covariance = _solved(X, weight, y)
    scale, of_place = _scales(X, weight, y, solution)
    sd_of = of_place[:, None] * np.sqrt(np.maximum(np.diagonal(covariance, axis1=1, axis2=2), 0.0))
    jump, jump_sd = np.zeros(y.shape), np.zeros(y.shape)
    for number in range(MOST_SUDDEN):
        places = np.flatnonzero(first[number] >= 0)
        jump[first[number, places], places] = solution[places, steps_from + number]
        jump_sd[first[number, places], places] = sd_of[places, steps_from + number]
    last = X[-1, :, steps_from:]  # the value is that after all steps, without offsets
    mixed = np.concatenate([np.ones((y.shape[1], 1)), np.zeros((y.shape[1], steps_from - 1)), last], axis=1)
    of_value = np.einsum("mi,mij->mj", mixed, covariance)
    unknown = np.where(enough, 0.0, np.nan)
    return Drift(
        at=at,
        rate=solution[:, 1] + unknown,
        rate_sd=sd_of[:, 1] + unknown,
        value=np.einsum("mi,mi->m", mixed, solution) + unknown,
        value_sd=of_place * np.sqrt(np.maximum(np.einsum("mi,mi->m", of_value, mixed), 0.0)) + unknown,
        covariance=of_place**2 * of_value[:, 1] + unknown,
        steps=jump,
        step_sd=jump_sd,
        outliers=outliers,
        scale=scale,
        runs=known.sum(axis=0),
    )


def _take_in_steps(
    X: Array, weight: Array, y: Array, threshold: Array, scale: Array | float
) -> tuple[np.ndarray, np.ndarray]:
    """Take the most sudden steps and outliers one after the other, the steps into the last columns of ``X`` (n, m, p).

    Return after which run each step of each place is, (:data:`MOST_SUDDEN`, m), -1 for none, and the outliers (n, m).
    """
    first = np.full((MOST_SUDDEN, y.shape[1]), -1)
    outliers = np.zeros(y.shape, dtype=bool)
    for number in range(MOST_SUDDEN):
        run, gain, is_step = _most_sudden(X, weight, y, threshold)
        sudden = gain > scale**2
        steps, places = np.where(sudden & is_step, run, -1), np.flatnonzero(sudden & ~is_step)
        X[..., number - MOST_SUDDEN] = (np.arange(len(y))[:, None] >= steps) & (steps >= 0)
        first[number] = steps
        outliers[run[places], places] = True
        weight = np.where(outliers, 0.0, weight)
        if not sudden.any():
            break
    return first, outliers


def reached(d: Drift, limit: float, sigmas: float = 2.0) -> tuple[Array, Array, Array]:
    """Return when each place reaches ``limit`` in magnitude: the time, and the interval of ``sigmas``; inf for never.

    The interval has all times at which the limit is within ``sigmas`` of the value then (Fieller, "Some problems in
    interval estimation", J. R. Stat. Soc. B 16, 1954): it is open where the rate might be zero. Where the value is
    beyond the limit already, the time is that of :attr:`Drift.at`.
    """
    sign = np.where(d.rate < 0.0, -1.0, 1.0)
    rate, to_go, covariance = sign * d.rate, limit - sign * d.value, d.covariance
    with np.errstate(divide="ignore", invalid="ignore"):
        expected = np.where(rate > 0.0, to_go / rate, np.inf)
        # (to_go - rate x)^2 = sigmas^2 (value_sd^2 + 2 covariance x + rate_sd^2 x^2), a x^2 - 2 b x + c = 0
        a = rate**2 - sigmas**2 * d.rate_sd**2
        b = to_go * rate + sigmas**2 * covariance
        c = to_go**2 - sigmas**2 * d.value_sd**2
        root = np.sqrt(np.maximum(b**2 - a * c, 0.0))
        early, late = (b - root) / a, np.where(a > 0.0, (b + root) / a, np.inf)
        early = np.where(a > 0.0, early, np.where(c > 0.0, (b - root) / a, 0.0))
    early = np.where(early > 0.0, early, np.where(c > 0.0, np.inf, 0.0))
    over = np.abs(d.value) >= limit

    def date(ahead: Array) -> Array:
        return np.where(np.isnan(d.rate), np.nan, d.at + np.where(over, 0.0, np.maximum(ahead, 0.0)))

    return date(expected), date(np.minimum(early, expected)), date(late)


def _normal(X: Array, weight: Array) -> Array:
    """Return the inverse of the normal matrices (m, p, p); columns that are not there get no covariance."""
    A: Array = np.einsum("nmi,nm,nmj->mij", X, weight, X, optimize=True)
    size = np.sqrt(np.diagonal(A, axis1=1, axis2=2))
    positive = size > 0.0
    size = np.where(positive, size, 1.0)
    whole = A / size[:, :, None] / size[:, None, :] + np.eye(A.shape[1]) * ~positive[:, None, :]
    inverse = np.linalg.inv(whole) * positive[:, :, None] * positive[:, None, :]
    return np.asarray(inverse / size[:, :, None] / size[:, None, :])


def _solved(X: Array, weight: Array, y: Array) -> tuple[Array, Array]:
    covariance = _normal(X, weight)
    return np.asarray(np.einsum("mij,nmj,nm,nm->mi", covariance, X, weight, y, optimize=True)), covariance


def _scales(X: Array, weight: Array, y: Array, solution: Array) -> tuple[float, Array]:
    """Return the robust spread of all whitened residuals, 1 where the sigmas are right, and that of each place (m,).

    The latter is the former, but where a place scatters by more than chance: its drift is not straight.
    """
    residual = np.sqrt(weight) * (y - np.einsum("nmi,mi->nm", X, solution))
    values = (weight > 0.0).sum(axis=0)
    free = values - np.count_nonzero(np.any(X != 0.0, axis=0), axis=1)
    used = (weight > 0.0) & (free > 0)
    if not used.any():
        return 1.0, np.ones(free.size)
    free = np.maximum(free, 1)
    scale = robust_sd((residual / np.sqrt(free / np.maximum(values, 1)))[used])
    mean_square = np.sum(np.where(used, residual, 0.0) ** 2, axis=0) / free
    with np.errstate(divide="ignore", invalid="ignore"):
        scatters = exceeds_chance(mean_square / scale**2, free, _BY_CHANCE)
    return scale, np.where(scatters, np.sqrt(mean_square), scale)


def _local_scale(t: Array, y: Array, weight: Array) -> float:
    """Return the robust spread of whitened deviations from the line between the runs before and after.

    No drift shows in it, and a step in two of them only, even where the whole line was worked on at one time.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        share = ((t[1:-1] - t[:-2]) / (t[2:] - t[:-2]))[:, None]
        variance = 1.0 / weight
        of_deviation = variance[1:-1] + (1.0 - share) ** 2 * variance[:-2] + share**2 * variance[2:]
        whitened = (y[1:-1] - (1.0 - share) * y[:-2] - share * y[2:]) / np.sqrt(of_deviation)
    used = np.isfinite(whitened) & np.isfinite(of_deviation)
    return robust_sd(whitened[used]) if used.any() else 1.0


def _most_sudden(X: Array, weight: Array, y: Array, threshold: Array) -> tuple[Array, Array, np.ndarray]:
    """Return of each place the run with the likeliest step or outlier, and whether it is a step.

    Between them is what it takes off the sum of squares, over that of the threshold.
    """
    solution, inverse = _solved(X, weight, y)
    pull = weight * (y - np.einsum("nmi,mi->nm", X, solution))
    shares = weight[..., None] * X

    def gains(pull: Array, weight: Array, shares: Array) -> Array:
        remainder = weight - np.einsum("nmi,mij,nmj->nm", shares, inverse, shares, optimize=True)
        # What the other columns explain almost wholly cannot be separated from them.
        return (
            np.where(remainder > 1e-6 * weight, pull**2 / np.where(remainder > 0.0, remainder, 1.0), 0.0) / threshold**2
        )

    def from_there_on(values: Array) -> Array:
        return np.cumsum(values[::-1], axis=0)[::-1]

    outlier = gains(pull, weight, shares)
    step = gains(from_there_on(pull), from_there_on(weight), from_there_on(shares))
    positive = weight > 0.0
    values = np.cumsum(positive, axis=0)
    step[values - positive < _RUNS_BEFORE_STEP] = 0.0
    outlier[values == values[-1]] = 0.0  # at the last run it is a step
    at_step, at_outlier = step.argmax(axis=0), outlier.argmax(axis=0)
    gain_step, gain_outlier = (
        np.take_along_axis(gain, at[None], axis=0)[0] for gain, at in ((step, at_step), (outlier, at_outlier))
    )
    is_step = gain_step >= gain_outlier
    return np.where(is_step, at_step, at_outlier), np.maximum(gain_step, gain_outlier), is_step

"""Where exactly a section of a run lies on the reference: least squares on rows of 0.25 m.

With ``f`` the reference (a cubic spline), ``r`` the run's features and ``x`` the run's chainage about the section's
middle, sought are the place ``p`` of the middle and the local scale ``e`` (prior sigma as of the run's scale):

    r(x) = f(p + (1 + e) x) + c + noise,

``c`` a constant of each feature and section (a roll offset, a bias), projected out. Gauss-Newton; rows far off (a
defect) weigh less, ``1/(1 + (residual/3 sigma)^2)``; sigma is the median over the sections of their median absolute
residual, but no less than what the tables' sigmas say of curvature and versines (those of the cross-level are mostly of
its constant).

Noise of neighbouring rows is correlated over the operators' bases. With the gradient ``G_i = f'_i w_i / sigma`` and the
pooled periodogram ``P`` of the weighted residuals of all sections, the covariance is that of least squares under
coloured noise (White, Econometrica 48, 1980, in the form for stationary noise)

    C = A^-1 B A^-1,    A = sum G G^T + prior,    B = mean over frequencies of |G(W)|^2 P(W) + prior,

raised where a section's own residuals are larger than the others', and by ``sum f'^2 / sum f' r'``: slopes of the
reference that the run does not share are no information. Where they are most, ``sum f' r' < 0.7 sum f'^2``, there is
nothing to match, and no sigma.

What is found is the mean of the shift over the section. Where the wheel's scale walks, the shift is an integrated
random walk, and from its mean over a section to its value in the middle is, given the second difference ``d`` of the
means of three sections, normal with mean ``0.051 d`` and sigma ``0.054 sd(d)`` (from the walk's covariance; no outcome
of a match). Both are counted as error.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from trackfg.mapping.recognition.profiles import (
    CROSS_LEVEL,
    CURVATURE,
    LONG_M,
    ROWS_PER_CELL,
    STEP_M,
    Profile,
    forward_mean,
    sections_of,
)
from trackfg.numerics.arrays import Array

_ROUNDS = 4
_FAR = 3.0
_WALK_SCALE = 1e-4
"""Scale of a section that a walk of the wheels makes by itself."""
_CURVES_SCALE = 0.003
"""Sigma of a section's scale where there are only curves: their few slopes would rather fit irregularities."""
_CURVES_SD = 1.3
"""By this much more do matches by curves err (measured on tamped lines): irregularities bend the fit itself."""
_ALIKE = 0.7
_LEAST = 1e-4
"""Of a feature's size: the least noise."""
_MAD = 1.4826
_ON_ROW = 1e-9
"""Of a row: a place that near below it is on it."""
_LEAST_TRIPLES = 5
_WALK_MEAN, _WALK_REST = 0.051, 0.1
_OWN_DOF = 20.0
"""Rows' worth of trust in the noise of all sections against a section's own."""


@dataclass(frozen=True)
class Matches:
    """Of sections (k,): reference chainage of their middle, and its sigma, m (NaN: no match); the local scale error;
    mean of run minus reference of the cross-level, mm, and its sigma (NaN where not known)."""

    reference_m: Array
    sd_m: Array
    scale: Array
    cross_level_bias_mm: Array
    cross_level_bias_mm_sd: Array


@dataclass(frozen=True)
class _Feature:
    """The run's rows (k, m) and their slopes, 1/m; the reference as a cubic spline from row to row.

    ``cubic`` (n, 4): of the row numbered ``first`` and those after it, highest power first; ``known`` (n,): whether the
    row and the next are. ``claimed``: sigma of the comparison by the tables; ``least``: the least taken.
    """

    run: Array
    run_slope: Array
    first: int
    cubic: Array
    known: NDArray[np.bool_]
    claimed: float
    least: float

    def at(self, places: Array) -> tuple[Array, Array, NDArray[np.bool_]]:
        """Values, slopes and whether known at places, m: three of their shape."""
        position = places / STEP_M - self.first
        row = np.floor(position + _ON_ROW).astype(np.int64)
        inside = (row >= 0) & (row < len(self.cubic))
        row = np.clip(row, 0, len(self.cubic) - 1)
        t = np.where(inside, position - row, 0.0)
        a, b, c, d = np.moveaxis(self.cubic[row], -1, 0)
        return ((a * t + b) * t + c) * t + d, ((3.0 * a * t + 2.0 * b) * t + c) / STEP_M, inside & self.known[row]


@dataclass(frozen=True)
class _Fit:
    place: Array
    sd: Array
    scale: Array


def match_sections(
    run: Profile,
    reference: Profile,
    middle_m: Array,
    length_m: int,
    *,
    about_m: Array,
    scale: Array,
    scale_sd: float,
    same: NDArray[np.bool_],
) -> Matches:
    """Match the run's sections with middles at ``middle_m`` (k,) near the reference's ``about_m`` (k,).

    Sections on unchanged track (``same``) by all features on every row, from within 2 m; the others by their curves
    alone, the means of curvature over 20 m.
    """
    sections = len(middle_m)
    rows = length_m * ROWS_PER_CELL
    first = np.rint((middle_m - 0.5 * length_m) / STEP_M).astype(np.int64) - run.first
    x: Array = STEP_M * np.arange(rows, dtype=np.float64) - 0.5 * length_m
    place, sd, local = about_m.copy(), np.full(sections, np.nan), scale.copy()
    for which, long in ((np.flatnonzero(same), False), (np.flatnonzero(~same), True)):
        names = [name for name in run.features if not long or name == CURVATURE]
        if which.size and names:
            features = [_feature(run, reference, name, first[which], rows, long=long) for name in names]
            known_scale = min(scale_sd, _CURVES_SCALE) if long else scale_sd
            fit = _fit(features, x, about_m[which], scale[which], known_scale, searched=not long)
            place[which], local[which] = fit.place, fit.scale
            sd[which] = fit.sd * (_CURVES_SD if long else 1.0)
    sd = np.hypot(sd, _walk(place - middle_m, sd))
    bias, bias_sd = np.full(sections, np.nan), np.full(sections, np.nan)
    found = np.flatnonzero(np.isfinite(sd))
    if CROSS_LEVEL in run.features and found.size:
        feature = _feature(run, reference, CROSS_LEVEL, first[found], rows, long=False)
        bias[found], bias_sd[found] = _bias(feature, x, place[found], local[found], sd[found])
    return Matches(place, sd, local, bias, bias_sd)


def _feature(
    run: Profile, reference: Profile, name: str, first: NDArray[np.int64], rows: int, *, long: bool
) -> _Feature:
    from scipy.interpolate import CubicSpline  # late: 0.2 s

    r, f = run.features[name], reference.features[name]
    if long:
        r, f = (forward_mean(x, LONG_M * ROWS_PER_CELL) for x in (r, f))
    pieces = sections_of(r, first, rows)
    known = np.isfinite(f)
    at = np.flatnonzero(known)
    if at.size < 2:
        cubic, both = np.zeros((1, 4)), np.zeros(1, dtype=bool)
    else:
        every = np.arange(len(f))
        cubic = np.append(CubicSpline(every, np.interp(every, at, f[at])).c.T, np.zeros((1, 4)), axis=0)
        cubic[-1, 3] = f[at[-1]]
        both = known & np.append(known[1:], known[-1])
    told = not long and name != CROSS_LEVEL
    return _Feature(
        pieces,
        np.gradient(pieces, STEP_M, axis=1),
        reference.first,
        cubic,
        both,
        float(np.sqrt(run.claimed_variance(name) + reference.claimed_variance(name))) if told else 0.0,
        max(_LEAST * float(np.std(f[known])) if at.size else 0.0, float(np.finfo(np.float64).tiny) ** 0.25),
    )


def _fit(features: list[_Feature], x: Array, about: Array, scale: Array, scale_sd: float, *, searched: bool) -> _Fit:
    place, given = about.copy(), scale
    if searched:
        place = _searched(features, x, place, scale)
    prior = 1.0 / (scale_sd**2 + _WALK_SCALE**2)
    weights = [np.ones_like(feature.run) for feature in features]
    for step in range(_ROUNDS):
        last = step == _ROUNDS - 1
        A = np.zeros((len(about), 2, 2))
        A[:, 1, 1] = prior
        b = np.zeros((len(about), 2))
        b[:, 1] = prior * (given - scale)
        noise = np.zeros_like(A)
        noise[:, 1, 1] = prior
        alike, slopes = np.zeros(len(about)), np.zeros(len(about))
        squares, rows = np.zeros(len(about)), np.zeros(len(about))
        for i, feature in enumerate(features):
            at = place[:, None] + (1.0 + scale[:, None]) * x
            value, slope, known = feature.at(at)
            known &= np.isfinite(feature.run)
            w = np.where(known, weights[i], 0.0)
            r = _centred(np.where(known, feature.run - value, 0.0), w)
            J = np.stack([_centred(slope, w), _centred(slope * x, w)])
            measured = _typical(r, known)
            sigma = max(measured, feature.claimed, feature.least)
            A += np.einsum("akm,bkm,km->kab", J, J, w) / sigma**2
            b += np.einsum("akm,km,km->ka", J, w, r) / sigma**2
            weights[i] = 1.0 / (1.0 + (r / (_FAR * sigma)) ** 2)
            if last:
                own = np.where(known & np.isfinite(feature.run_slope), feature.run_slope, 0.0)
                alike += (_centred(own, w) * J[0] * w).sum(axis=1) / sigma**2
                slopes += (J[0] ** 2 * w).sum(axis=1) / sigma**2
                u = w * r / sigma
                spectrum = _periodogram(u, known) * max(1.0, (sigma / max(measured, feature.least)) ** 2)
                G = np.fft.rfft(J * w / sigma, 2 * (len(spectrum) - 1), axis=2)
                noise += _mean_over_frequencies(np.real(G[:, None] * np.conj(G[None])) * spectrum).transpose(2, 0, 1)
                power = float((u**2).sum()) / max(int(known.sum()), 1)
                squares += (u**2).sum(axis=1) / max(power, np.finfo(np.float64).tiny)
                rows += known.sum(axis=1)
        A[:, 0, 0] += np.finfo(np.float64).tiny
        inverse = np.linalg.inv(A)
        step_by = np.einsum("kab,kb->ka", inverse, b)
        place, scale = place + np.clip(step_by[:, 0], -5.0, 5.0), scale + np.clip(step_by[:, 1], -0.02, 0.02)
    with np.errstate(divide="ignore", invalid="ignore"):
        variance = (inverse @ noise @ inverse)[:, 0, 0] * (slopes / alike) ** 2
    variance *= np.maximum(1.0, (_OWN_DOF + squares / 10.0) / (_OWN_DOF + rows / 10.0))
    sure = (alike > _ALIKE * slopes) & (rows > 0.5 * len(features) * len(x)) & (np.abs(step_by[:, 0]) < 0.3)
    sure &= np.abs(place - about) < (3.0 if searched else 15.0)
    return _Fit(np.where(sure, place, about), np.where(sure, np.sqrt(variance), np.nan), np.where(sure, scale, scale))


def _searched(features: list[_Feature], x: Array, place: Array, scale: Array) -> Array:
    """The best of places half a metre apart, within 2 m. Every other row, and the reference's nearest, will do."""
    two = 2 * np.arange(-4, 5)
    evidence = np.zeros((len(two), len(place)))
    middle = np.rint((place[:, None] + (1.0 + scale[:, None]) * x[::2]) / STEP_M).astype(np.int64)
    for feature in features:
        r, f = feature.run[:, ::2], np.where(feature.known, feature.cubic[:, 3], np.nan)
        for k, offset in enumerate(two):
            row = middle - feature.first + offset
            d = r - f[np.clip(row, 0, len(f) - 1)]
            known = np.isfinite(d) & (row >= 0) & (row < len(f))
            d = _centred(np.where(known, d, 0.0), known.astype(np.float64))
            count = np.maximum(known.sum(axis=1), 1)
            evidence[k] -= 0.5 * count * np.log((d**2).sum(axis=1) / count + feature.least**2)
    return np.asarray(place + STEP_M * two[np.argmax(evidence, axis=0)])


def _centred(values: Array, weight: Array) -> Array:
    """Less the weighted mean of each row; zero where nothing weighs."""
    total = np.maximum(weight.sum(axis=-1, keepdims=True), np.finfo(np.float64).tiny)
    return np.where(weight > 0.0, values - (values * weight).sum(axis=-1, keepdims=True) / total, 0.0)


def _typical(values: Array, known: NDArray[np.bool_]) -> float:
    """Sigma of the known values, from their median size; 0 if none is known."""
    return _MAD * float(np.median(np.abs(values[known]))) if known.any() else 0.0


def _periodogram(u: Array, known: NDArray[np.bool_]) -> Array:
    """Mean over the sections, per row; one for white noise of unit variance. Smoothed over five frequencies."""
    n = 2 ** int(np.ceil(np.log2(2 * u.shape[1])))
    spectrum = (np.abs(np.fft.rfft(u, n, axis=1)) ** 2).sum(axis=0) / max(int(known.sum()), 1)
    return np.convolve(np.pad(spectrum, 2, mode="reflect"), np.full(5, 0.2), mode="valid")


def _mean_over_frequencies(values: Array) -> Array:
    """Over all frequencies, of values (..., n/2 + 1) at those that are not negative."""
    n = 2 * (values.shape[-1] - 1)
    return np.asarray((2.0 * values.sum(axis=-1) - values[..., 0] - values[..., -1]) / n)


def _walk(shift: Array, sd: Array) -> Array:
    """Sigma of the mean shift over each section about that in its middle, m, (k,); zero if too few sections tell."""
    bend = np.full(len(shift), np.nan)
    bend[1:-1] = shift[:-2] - 2.0 * shift[1:-1] + shift[2:]
    explained = np.zeros(len(shift))
    explained[1:-1] = sd[:-2] ** 2 + 4.0 * sd[1:-1] ** 2 + sd[2:] ** 2
    known = np.isfinite(bend) & np.isfinite(explained)
    if known.sum() < _LEAST_TRIPLES:
        return np.zeros(len(shift))
    usual = (_MAD * float(np.median(np.abs(bend[known])))) ** 2 - float(np.median(explained[known]))
    own = np.where(known, bend**2 - explained, usual)
    return np.sqrt(_WALK_MEAN**2 * np.maximum(own, 0.0) + _WALK_REST**2 * max(usual, 0.0))


def _bias(feature: _Feature, x: Array, place: Array, scale: Array, sd: Array) -> tuple[Array, Array]:
    """Mean of run minus reference, and its sigma."""
    value, slope, known = feature.at(place[:, None] + (1.0 + scale[:, None]) * x)
    known &= np.isfinite(feature.run)
    count = known.sum(axis=1)
    some = np.maximum(count, 1)
    mean = np.where(known, feature.run - value, 0.0).sum(axis=1) / some
    slope = np.where(known, slope, 0.0).sum(axis=1) / some
    r = np.where(known, feature.run - value - mean[:, None], 0.0)
    weight = 1.0 / (1.0 + (r / (_FAR * max(_typical(r, known), feature.least))) ** 2)
    long_waves = float(_periodogram(r * weight, known)[2:9].mean())
    variance = long_waves / some + (slope * sd) ** 2
    return np.where(count > 0, mean, np.nan), np.where(count > 0, np.sqrt(variance), np.nan)

"""Least squares of sections on the rows: their positions on the reference and scale errors, with a covariance.

With ``r`` the run's features, ``f`` the reference (a cubic spline) and ``x`` the run's chainage about a section's
middle, the unknowns of each section are the position ``m`` of its middle on the reference, in metres, and its scale
error ``e``, with a prior sigma as of the run's scale:

    r(x) = f(m + (1 + e) x) + c + noise.

The constant ``c`` of each feature and section (a roll offset, a bias) is projected out. Gauss-Newton steps; rows far
off (a defect) have the weight ``w = 1/(1 + (residual / (3 sigma))^2)`` of Cauchy's loss. Each feature has one sigma:
the robust sigma of its residuals in all sections, but no less than what the tables' sigmas say of curvature and
versines (those of the cross-level are mostly of its constant).

**Derivatives** by m and e are those of the run, ``r'`` and ``r' x`` (an instrumental variable: Stock and Watson,
Introduction to Econometrics, chapter 12). Between rows a spline has less of the reference's noise than on rows, so
residuals are smallest half way: with the reference's own slopes a match is drawn there, by 1 cm where white noise is a
twentieth of the profile. The run's slopes by central differences have nothing of the noise of the row itself, nor of
the reference's. Matches by curves, whose means have no such noise, take the reference's slopes, which know less of the
run's noise.

**Covariance.** Noise of neighbouring rows is correlated over the operators' bases. With the derivatives ``J_i`` of a
row by (m, e), less their weighted mean over the section, the transform ``G(W)`` of ``J_i / sigma`` and the pooled
periodogram ``P`` of ``w_i residual_i / sigma`` of all sections (times ``(sigma / their robust sigma)^2`` where the
tables claim more), it is that of an M-estimator (Huber and Ronchetti, Robust Statistics, section 7.6),

    C = A^-1 B A^-1,    A = k sum w_i J_i J_i^T / sigma^2 + prior,    B = mean over frequencies of G G* P + prior,

summed over the features. ``k`` is the mean derivative of the score ``w_i residual_i`` by the residual, over the mean
weight, of all sections: with Cauchy's loss a row that is far off moves the score less than its weight says.

The variance is raised where a section's own residuals are larger than the others', and by ``(sum J^2 / sum f' r')^2``
where that exceeds one: slopes that run and reference do not share are no information.

**Acceptance.** There is no match, and no sigma, where ``sum f' r' < 0.7 sum f'^2``, where half of the rows
or more are unknown, where the iteration has not converged, or where it went too far from where it began.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trackfg.mapping.recognition.profiles import CROSS_LEVEL, LONG_M, FeatureProfile, forward_mean, sections_of
from trackfg.numerics.arrays import Array
from trackfg.numerics.robust import robust_sd

_STEPS = 4
"""Gauss-Newton steps."""
_GREATEST_STEP_M, _GREATEST_SCALE_STEP = 5.0, 0.02
"""Greatest change of the position, m, and of the scale error in one step."""
_CONVERGED_M = 0.3
"""A section whose last step is longer than this, m, has not converged."""
_SEARCH_M, _SEARCH_STEP_M = 2.0, 0.5
"""How far to either side the position is searched before the first step, m, and in what steps: a place of
:mod:`trackfg.mapping.recognition.likelihood` is 2 m wide."""
REACH_M, REACH_BY_CURVES_M = 3.0, 15.0
"""How far a match by all features, and one by curves, may lie from where it began, m."""
_FAR_SIGMAS = 3.0
"""Width of Cauchy's loss, sigmas."""
_WALK_SCALE = 1e-4
"""Sigma of a section's own scale error: a creep of 1 mm per root of a metre over 100 m."""
_LEAST_SHARED = 0.7
"""Least ``sum f' r' / sum f'^2`` of a match. Chosen on simulated lines; see Assumptions in docs/engine.md."""
_LEAST_SOFTNESS = 0.5
"""Least mean derivative of the score over the mean weight: of normal residuals it is 0.85."""
_LEAST_KNOWN = 0.5
"""Least share of a section's rows that a match needs."""
_LEAST_NOISE = 1e-4
"""Least noise of a feature, as a share of its standard deviation on the reference: for profiles without noise."""
_ON_ROW = 1e-9
"""A position so little below a row, in rows, is on it: rounding."""
_VALUE_M = 2.5
"""Length of track per independent residual, m: a quarter of the base of versines and curvature."""
_COMMON_VALUES = 20.0
"""The noise of all sections counts as much as so many independent residuals of a section's own."""
_SMOOTHED_OVER = 5
"""Frequencies over which the periodogram is averaged."""
_LONG_WAVES = slice(2, 9)
"""Frequencies of the periodogram that stand for long waves: the lowest that are left without the mean."""


@dataclass(frozen=True)
class SectionFeature:
    """One feature: the rows of the run's sections (k, m) and their slopes, 1/m; the reference as a cubic spline.

    ``cubic`` (n, 4): of the row numbered ``first`` and those after it, highest power first; ``known`` (n,): whether the
    row and the next are. ``by_run``: a section is moved along the run's slopes, not the reference's. ``claimed``: sigma
    of the comparison by the tables; ``least_sigma``: the least that is taken.
    """

    run: Array
    run_slope: Array
    by_run: bool
    step_m: float
    first: int
    cubic: Array
    known: NDArray[np.bool_]
    claimed: float
    least_sigma: float

    @property
    def from_middle_m(self) -> Array:
        """The distance of the rows from their section's middle, m, (m,)."""
        rows = self.run.shape[1]
        return np.asarray(self.step_m * (np.arange(rows) - 0.5 * rows))

    def at(self, positions_m: Array) -> tuple[Array, Array, NDArray[np.bool_]]:
        """Return the reference's values, its slopes, and whether they are known: three of the positions' shape."""
        rows = positions_m / self.step_m - self.first
        row = np.floor(rows + _ON_ROW).astype(np.int64)
        inside = (row >= 0) & (row < len(self.cubic))
        row = np.clip(row, 0, len(self.cubic) - 1)
        t = np.where(inside, rows - row, 0.0)
        a, b, c, d = np.moveaxis(self.cubic[row], -1, 0)
        return ((a * t + b) * t + c) * t + d, ((3.0 * a * t + 2.0 * b) * t + c) / self.step_m, inside & self.known[row]


@dataclass(frozen=True)
class _Linearised:
    """One feature at the sections' present positions: residuals (k, m), derivatives by position and scale (2, k, m).

    The derivatives are those of the run where :attr:`SectionFeature.by_run`, and ``slope`` (k, m) is the reference's.
    ``weight`` (k, m): of Cauchy's loss, 0 where not known. ``spread``: robust sigma of the residuals; ``sigma``: that
    or, if it is larger, what the tables claim.
    """

    feature: SectionFeature
    residual: Array
    jacobian: Array
    slope: Array
    weight: Array
    known: NDArray[np.bool_]
    spread: float
    sigma: float

    @classmethod
    def of(cls, feature: SectionFeature, positions_m: Array, weight: Array) -> _Linearised:
        """Linearise with the rows at ``positions_m`` (k, m) and the weights of the step before (k, m)."""
        value, slope, known = feature.at(positions_m)
        steep = feature.run_slope if feature.by_run else slope
        known &= np.isfinite(feature.run) & np.isfinite(steep)
        w = np.where(known, weight, 0.0)
        residual = _centred(np.where(known, feature.run - value, 0.0), w)
        steep = np.where(known, steep, 0.0)
        jacobian = np.stack([_centred(steep, w), _centred(steep * feature.from_middle_m, w)])
        spread = robust_sd(residual[known]) if known.any() else 0.0
        return cls(
            feature,
            residual,
            jacobian,
            _centred(slope, w),
            w,
            known,
            spread,
            max(spread, feature.claimed, feature.least_sigma),
        )

    @property
    def cauchy_weight(self) -> Array:
        """The weights of the next step, (k, m)."""
        return 1.0 / (1.0 + (self.residual / (_FAR_SIGMAS * self.sigma)) ** 2)

    def normal(self) -> tuple[Array, Array]:
        """Return the normal matrix (k, 2, 2) and the right-hand side (k, 2)."""
        J, w = self.jacobian, self.weight
        matrix = np.einsum("akm,bkm,km->kab", J, J, w) / self.sigma**2
        return matrix, np.einsum("akm,km,km->ka", J, w, self.residual) / self.sigma**2

    @property
    def softness(self) -> float:
        """The mean derivative of the score by the residual, over the mean weight."""
        square = (self.residual[self.known] / (_FAR_SIGMAS * self.sigma)) ** 2
        if not square.size:
            return 1.0
        return max(
            float(np.mean((1.0 - square) / (1.0 + square) ** 2) / np.mean(1.0 / (1.0 + square))), _LEAST_SOFTNESS
        )

    def coloured(self) -> Array:
        """Return B without the prior: the variance of the right-hand side under coloured noise, (k, 2, 2)."""
        u = self.weight * self.residual / self.sigma
        spectrum = _periodogram(u, self.known) * max(
            1.0, (self.sigma / max(self.spread, self.feature.least_sigma)) ** 2
        )
        G = np.fft.rfft(self.jacobian * self.known / self.sigma, 2 * (len(spectrum) - 1), axis=2)
        return _mean_over_frequencies(np.real(G[:, None] * np.conj(G[None])) * spectrum).transpose(2, 0, 1)

    def slopes(self) -> tuple[Array, Array, Array]:
        """Return ``sum f' r'``, ``sum f'^2`` and the sum of the squared derivatives of each section, weighted, (k,)."""
        of_run = np.where(self.known & np.isfinite(self.feature.run_slope), self.feature.run_slope, 0.0)
        w = self.weight
        products = (_centred(of_run, w) * self.slope, self.slope**2, self.jacobian[0] ** 2)
        shared, of_reference, used = ((product * w).sum(axis=1) / self.sigma**2 for product in products)
        return shared, of_reference, used

    def squares(self) -> Array:
        """Return the sections' sums of squared residuals in units of the mean over all sections, (k,)."""
        u = self.weight * self.residual / self.sigma
        power = float((u**2).sum()) / max(int(self.known.sum()), 1)
        return np.asarray((u**2).sum(axis=1) / max(power, np.finfo(np.float64).tiny))


class SectionFit(NamedTuple):
    """Positions of the sections' middles, their sigmas (NaN: no match) and the scale errors, (k,) each."""

    position_m: Array
    sd_m: Array
    scale: Array


def section_feature(
    run: FeatureProfile, reference: FeatureProfile, name: str, first: NDArray[np.int64], rows: int, *, by_curves: bool
) -> SectionFeature:
    """Return one feature of the run's sections that begin at rows ``first`` (k,), or its means over 20 m."""
    from scipy.interpolate import CubicSpline  # late: 0.2 s

    r, f = run.features[name], reference.features[name]
    if by_curves:
        r, f = (forward_mean(values, LONG_M * run.rows_per_cell) for values in (r, f))
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
    has_claim = not by_curves and name != CROSS_LEVEL
    return SectionFeature(
        run=pieces,
        run_slope=sections_of(np.gradient(r, run.step_m), first, rows),
        by_run=not by_curves,
        step_m=run.step_m,
        first=reference.first,
        cubic=cubic,
        known=both,
        claimed=float(np.sqrt(run.claimed_variance(name) + reference.claimed_variance(name))) if has_claim else 0.0,
        least_sigma=max(
            _LEAST_NOISE * float(np.std(f[known])) if at.size else 0.0, float(np.finfo(np.float64).tiny) ** 0.25
        ),
    )


def fit_sections(
    features: Sequence[SectionFeature], about_m: Array, about_scale: Array, scale_sd: float, *, searched: bool
) -> SectionFit:
    """Return positions and scale errors that fit best, by Gauss-Newton from ``about_m`` and ``about_scale``, all (k,).

    ``about_scale`` and ``scale_sd`` are mean and sigma of the scale's prior. ``searched``: the positions about
    ``about_m`` are searched for the best one first.
    """
    scale = about_scale
    position_m = searched_positions(features, about_m, scale) if searched else about_m
    prior = 1.0 / (scale_sd**2 + _WALK_SCALE**2)
    weights = [np.ones_like(feature.run) for feature in features]
    for _ in range(_STEPS):
        rows_m = position_m[:, None] + (1.0 + scale[:, None]) * features[0].from_middle_m
        linearised = [_Linearised.of(feature, rows_m, w) for feature, w in zip(features, weights, strict=True)]
        A, b = _normal_equations(linearised, prior, about_scale - scale)
        step = np.linalg.solve(A, b[..., None])[..., 0]
        position_m = position_m + np.clip(step[:, 0], -_GREATEST_STEP_M, _GREATEST_STEP_M)
        scale = scale + np.clip(step[:, 1], -_GREATEST_SCALE_STEP, _GREATEST_SCALE_STEP)
        weights = [part.cauchy_weight for part in linearised]
    reach_m = REACH_M if searched else REACH_BY_CURVES_M
    accepted = _is_match(linearised) & (np.abs(step[:, 0]) < _CONVERGED_M) & (np.abs(position_m - about_m) < reach_m)
    sd_m = np.sqrt(_variance(linearised, prior), where=accepted, out=np.full(len(about_m), np.nan))
    return SectionFit(np.where(accepted, position_m, about_m), sd_m, scale)


def _normal_equations(linearised: Sequence[_Linearised], prior: float, pull: Array) -> tuple[Array, Array]:
    """Return A (k, 2, 2) and the right-hand side (k, 2); ``pull`` (k,): the prior scale error less the present one."""
    A, b = np.zeros((len(pull), 2, 2)), np.zeros((len(pull), 2))
    A[:, 1, 1] = prior
    b[:, 1] = prior * pull
    for part in linearised:
        matrix, vector = part.normal()
        A += matrix
        b += vector
    A[:, 0, 0] += np.finfo(np.float64).tiny
    return A, b


def _variance(linearised: Sequence[_Linearised], prior: float) -> Array:
    """Return the variances of the positions, m^2 (k,), under coloured noise."""
    count = len(linearised[0].residual)
    A, B = np.zeros((count, 2, 2)), np.zeros((count, 2, 2))
    A[:, 1, 1] = B[:, 1, 1] = prior
    A[:, 0, 0] += np.finfo(np.float64).tiny
    shared, slopes, squares, rows = (np.zeros(count) for _ in range(4))
    for part in linearised:
        A += part.softness * part.normal()[0]
        B += part.coloured()
        with_run, _, used = part.slopes()
        shared += with_run
        slopes += used
        squares += part.squares()
        rows += part.known.sum(axis=1)
    inverse = np.linalg.inv(A)
    with np.errstate(divide="ignore", invalid="ignore"):
        variance = (inverse @ B @ inverse)[:, 0, 0] * np.maximum(slopes / shared, 1.0) ** 2
    per_value = _VALUE_M / linearised[0].feature.step_m
    own_noise = (_COMMON_VALUES + squares / per_value) / (_COMMON_VALUES + rows / per_value)
    return np.asarray(variance * np.maximum(1.0, own_noise))


def _is_match(linearised: Sequence[_Linearised]) -> NDArray[np.bool_]:
    """Return whether each section (k,) shares its slopes with the reference, and has rows enough."""
    shared, slopes, _ = (sum(parts) for parts in zip(*(part.slopes() for part in linearised), strict=True))
    known = np.concatenate([part.known for part in linearised], axis=1)
    return np.asarray((shared > _LEAST_SHARED * slopes) & (known.sum(axis=1) > _LEAST_KNOWN * known.shape[1]))


def searched_positions(features: Sequence[SectionFeature], about_m: Array, scale: Array) -> Array:
    """Return the best of positions at every 0.5 m within 2 m, m (k,), by every 0.5 m of the run.

    Compared are profile log likelihoods, those of the best constant and variance of the noise, on the nearest rows, as
    far as the reference knows them at all positions. Where there are none, the position stays: the least shift comes
    first.
    """
    step_m = features[0].step_m
    stride = max(1, round(_SEARCH_STEP_M / step_m))
    reach = round(_SEARCH_M / (stride * step_m))
    offsets = stride * np.array(sorted(range(-reach, reach + 1), key=abs))
    log_likelihood = np.zeros((len(offsets), len(about_m)))
    middle = np.rint((about_m[:, None] + (1.0 + scale[:, None]) * features[0].from_middle_m[::stride]) / step_m).astype(
        np.int64
    )
    for feature in features:
        r, f = feature.run[:, ::stride], np.where(feature.known, feature.cubic[:, 3], np.nan)
        beyond = np.append(f, np.nan)
        rows = (middle - feature.first + offset for offset in offsets)
        differences = [r - beyond[np.where((row >= 0) & (row < len(f)), row, len(f))] for row in rows]
        known = np.logical_and.reduce([np.isfinite(d) for d in differences])
        count = known.sum(axis=1)
        for i, d in enumerate(differences):
            squares = (_centred(np.where(known, d, 0.0), known.astype(np.float64)) ** 2).sum(axis=1)
            log_likelihood[i] -= 0.5 * count * np.log(squares / np.maximum(count, 1) + feature.least_sigma**2)
    return np.asarray(about_m + step_m * offsets[np.argmax(log_likelihood, axis=0)])


def _centred(values: Array, weight: Array) -> Array:
    """Return values less the weighted mean of their row; zero where nothing weighs."""
    total = np.maximum(weight.sum(axis=-1, keepdims=True), np.finfo(np.float64).tiny)
    return np.where(weight > 0.0, values - (values * weight).sum(axis=-1, keepdims=True) / total, 0.0)


def _periodogram(u: Array, known: NDArray[np.bool_]) -> Array:
    """Return the mean periodogram per row of sections (k, m), smoothed; one for white noise of unit variance."""
    n = 2 ** int(np.ceil(np.log2(2 * u.shape[1])))
    spectrum = (np.abs(np.fft.rfft(u, n, axis=1)) ** 2).sum(axis=0) / max(int(known.sum()), 1)
    padded = np.pad(spectrum, _SMOOTHED_OVER // 2, mode="reflect")
    return np.convolve(padded, np.full(_SMOOTHED_OVER, 1.0 / _SMOOTHED_OVER), mode="valid")


def _mean_over_frequencies(values: Array) -> Array:
    """Return means over all frequencies of values (..., n/2 + 1) at those that are not negative."""
    n = 2 * (values.shape[-1] - 1)
    return np.asarray((2.0 * values.sum(axis=-1) - values[..., 0] - values[..., -1]) / n)


def mean_difference(feature: SectionFeature, fit: SectionFit) -> tuple[Array, Array]:
    """Return the means of run minus reference over matched sections, and their sigmas, (k,) each."""
    value, slope, known = feature.at(fit.position_m[:, None] + (1.0 + fit.scale[:, None]) * feature.from_middle_m)
    known &= np.isfinite(feature.run)
    count = known.sum(axis=1)
    some = np.maximum(count, 1)
    mean = np.where(known, feature.run - value, 0.0).sum(axis=1) / some
    slope = np.where(known, slope, 0.0).sum(axis=1) / some
    r = np.where(known, feature.run - value - mean[:, None], 0.0)
    spread = robust_sd(r[known]) if known.any() else 0.0
    weight = 1.0 / (1.0 + (r / (_FAR_SIGMAS * max(spread, feature.least_sigma))) ** 2)
    long_waves = float(_periodogram(r * weight, known)[_LONG_WAVES].mean())
    variance = long_waves / some + (slope * fit.sd_m) ** 2
    return np.where(count > 0, mean, np.nan), np.where(count > 0, np.sqrt(variance), np.nan)

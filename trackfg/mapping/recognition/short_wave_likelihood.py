"""Log likelihood ratio of the places of a section by its short waves.

Let ``r`` be the short waves of a section of the run and ``f`` those of the reference from a place on, in cells of 1 m.

**At that place, unchanged**, the residual has the mean square ``v = mean (r - b f)^2``. The gain ``0 <= b <= 1`` is
the best one: where there is only noise, b is near zero and no place is better than another. **On any other track** it
is ``v = mean r^2``. The section has ``n`` independent values: its cells over ``sum of rho^2`` over all lags, ``rho``
the reference's autocorrelation (Bartlett, Journal of the Royal Statistical Society 98, 1935).

The variance itself is not known, only that it is about ``s^2``. With a scaled inverse chi-square prior of ``k`` degrees
of freedom about ``s^2`` the marginal likelihood is (Gelman et al., Bayesian Data Analysis, 3rd ed., section 2.6)

    log L(v, s^2) = (k/2) log(k s^2) - ((k + n)/2) log(k s^2 + n v) + constant,

so a section proves what its own residual lets it prove, whatever the tables' sigmas claim. Of an unchanged section
``s^2`` is the sum of the variances that the tables claim (none for the cross-level, whose sigma is mostly of its
constant), of what half a cell of offset and an unknown scale leave, ``mean f'^2 (1 + var_scale L^2)/12``, and of
(10 % of the reference's rms)^2, but no less than what the best sections leave (:meth:`ShortWaves.residual`). Of any
other track it is the mean square of the reference, or the claimed variance if that is larger.

**The ratio** is

    short(p) = 1/2 (log L(max(v_same, 2 s_same^2), s_same^2) - log L(max(v_any, 2 s_same^2), s_any^2)) - 1/2 log(1 + n).

The last term is the price of the parameter b. The floor: differences between residuals below ``2 s^2`` are noise of the
two profiles and evidence for neither place. The tempering: the ratio is halved (a tempered, or power, likelihood),
because the residuals are not quite as modelled and the cells' dependence is known only on average.

The correlations ``sum r f`` of many sections with many offsets are products of matrices, which for sections of 100
cells is several times as fast as an FFT for each section.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from trackfg.mapping.recognition.profiles import (
    CROSS_LEVEL,
    FeatureProfile,
    clipped,
    piece,
    sections_of,
    short_waves,
)
from trackfg.numerics.arrays import Array

Array32 = NDArray[np.float32]

_PRIOR_DOF = 4.0
"""Degrees of freedom k of the variance's prior: few, so that the residual decides."""
_FLOOR = 2.0
"""Residuals below so many times s^2 are equally good. Chosen on simulated lines; see Assumptions in docs/engine.md."""
_TEMPERING = 0.5
"""Exponent of the tempered likelihood ratio. Chosen; see Assumptions in docs/engine.md."""
_LEAST_NOISE = 0.1
"""Noise of short waves that is added, as a share of their rms on the reference: what the sigmas do not contain. Chosen
on simulated lines; see Assumptions in docs/engine.md."""
_LONGEST_MEMORY_M = 50
"""Lags, m, over which the autocorrelation is summed: twice the base that short waves are free of."""


@dataclass(frozen=True)
class ShortWaves:
    """The short waves of one feature: of the run's sections (k, m) and of the reference's cells (n,).

    NaN where not known. ``cells_per_value``: cells per independent value. ``same_variance``, ``any_variance``: s^2 of
    an unchanged section at its place and on any other track, in the feature's unit squared.
    """

    sections: Array32
    reference: Array32
    cells_per_value: float
    same_variance: float
    any_variance: float

    def log_ratios(self, which: slice, begin: int, stop: int) -> Array32:
        """Return the ratios of some sections at the reference's cells ``begin`` to ``stop``: (k, stop - begin)."""
        count, squares, power = self._sums(which, begin, stop)
        least = np.float32(_FLOOR * self.same_variance) * count
        ratio = self._log_evidence(count, np.maximum(squares, least, out=squares), self.same_variance)
        ratio -= self._log_evidence(count, np.maximum(power, least), self.any_variance)
        ratio *= np.float32(_TEMPERING)
        ratio -= 0.5 * np.log1p(count / np.float32(self.cells_per_value))
        return ratio

    def residual(self, which: slice, begin: int, stop: int) -> Array32:
        """Return the least mean square that the reference leaves of each section, (k,); infinite where unknown."""
        count, squares, _ = self._sums(which, begin, stop)
        with np.errstate(divide="ignore", invalid="ignore"):
            mean = np.where(count > 0.5 * self.sections.shape[1], squares / count, np.inf)
        return np.asarray(mean.min(axis=1), dtype=np.float32)

    def _sums(self, which: slice, begin: int, stop: int) -> tuple[Array32 | np.float32, Array32, Array32]:
        """Return the number of cells known of both, and the sums over them of ``(r - b f)^2`` and of ``r^2``."""
        r = self.sections[which]
        f = piece(self.reference, begin, stop + r.shape[1] - 1)
        r_known, f_known = np.isfinite(r), np.isfinite(f)
        r, f = np.where(r_known, r, np.float32(0)), np.where(f_known, f, np.float32(0))
        windows = _windows(f, r.shape[1])
        run_power = (r**2).sum(axis=1, keepdims=True)
        count: Array32 | np.float32 = np.float32(r.shape[1])
        if r_known.all() and f_known.all():
            power = _windows(f**2, r.shape[1]).sum(axis=1)
        else:
            both = _windows(f_known.astype(np.float32), r.shape[1]).T
            count = r_known.astype(np.float32) @ both
            run_power = r**2 @ both
            power = r_known.astype(np.float32) @ _windows(f**2, r.shape[1]).T
        product = r @ windows.T
        gain = product / np.maximum(power, np.finfo(np.float32).tiny)
        np.clip(gain, 0.0, 1.0, out=gain)
        squares = gain * power  # b^2 sum f^2 - 2 b sum r f + sum r^2, in place
        squares -= product
        squares -= product
        squares *= gain
        squares += run_power
        return count, np.maximum(squares, 0.0, out=squares), run_power

    def _log_evidence(self, count: Array32 | np.float32, squares: Array32, variance: float) -> Array32:
        """Return ``log L`` of values whose sum of squares over ``count`` cells is ``squares``."""
        prior = np.float32(_PRIOR_DOF * variance)
        out = squares * np.float32(1.0 / self.cells_per_value)
        out += prior
        np.log(out, out=out)
        out = out * np.asarray(-0.5 * (_PRIOR_DOF + count / self.cells_per_value), dtype=np.float32)
        out += np.float32(0.5 * _PRIOR_DOF * np.log(prior))
        return out


def short_waves_of(
    run: FeatureProfile,
    reference: FeatureProfile,
    name: str,
    first_cells: NDArray[np.int64],
    length: int,
    scale_sd: float,
) -> ShortWaves | None:
    """Return the short waves of one feature, None if either profile has none.

    The run's sections have ``length`` cells from ``first_cells`` (k,), m, on.
    """
    r, f = (short_waves(profile.cells(name)) for profile in (run, reference))
    if not (np.isfinite(r).any() and np.isfinite(f).any()):
        return None
    r, f = clipped(r, f)
    # Sigmas of the cross-level are mostly those of its constant, which is no part of short waves.
    profiles = () if name == CROSS_LEVEL else (run, reference)
    claimed = float(sum(profile.claimed_variance(name) for profile in profiles))
    power = float(np.nanmean(f**2))
    slope = float(np.nanmean(np.diff(f) ** 2))
    same = claimed + slope * (1.0 + (scale_sd * length) ** 2) / 12.0 + _LEAST_NOISE**2 * power
    tiny = 1e6 * float(np.finfo(np.float32).tiny)
    return ShortWaves(
        sections_of(r, first_cells - run.first_cell, length).astype(np.float32),
        f.astype(np.float32),
        _cells_per_value(f, power),
        max(same, tiny),
        max(power, claimed, tiny),
    )


def _cells_per_value(x: Array, power: float) -> float:
    """Return ``sum of rho^2`` over all lags up to 50 m."""
    if power == 0.0:
        return 1.0
    lags = range(1, min(_LONGEST_MEMORY_M, len(x) - 1) + 1)
    products = (x[lag:] * x[:-lag] for lag in lags)
    rho = [float(np.nanmean(p)) / power for p in products if np.isfinite(p).any()]
    return 1.0 + 2.0 * float(np.sum(np.square(rho)))


def _windows(x: Array32, length: int) -> Array32:
    """Return every ``length`` neighbours as a row of its own in memory, which products of matrices need."""
    return np.ascontiguousarray(np.lib.stride_tricks.sliding_window_view(x, length))

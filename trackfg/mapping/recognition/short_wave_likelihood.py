"""How well short waves of a section fit a place of the reference, against those of any track.

With ``r`` the run's section and ``f`` the reference at an offset, in cells of 1 m: of a feature, ``n`` independent
values (Bartlett: cells over ``sum of rho^2`` over all lags, ``rho`` the reference's autocorrelation) have mean square
``v = mean (r - b f)^2`` if the section is there and unchanged, and ``v = mean r^2`` if it is like any track. The share
``0 <= b <= 1`` is the best one: where there is nothing but noise, ``b`` is near zero and no place better than another
(it costs ``log(1 + n)/2``, as a parameter does). The variance is not known, but about ``s^2``: with a scaled inverse
chi-square prior of ``k`` degrees of freedom the marginal likelihood is (Gelman et al., Bayesian Data Analysis, section
3.3)

    log L = (k/2) log(k s^2) - ((k + n)/2) log(k s^2 + n v) + a constant.

So a section proves what its own residual lets it prove, whatever sigmas claim. ``s^2`` of an unchanged section: the
claimed variances and what half a cell of offset and an unknown scale leave, ``mean f'^2 (1 + var_scale L^2)/12``, but
no less than what the best of the sections leave (:meth:`ShortWaves.residual`); of any track: the mean square of the
reference.

Of two places that fit equally one has the lesser residual, by the reference's own noise, which speaks neither for it
nor against the other. So residuals below ``2 s^2`` are all equally good, and only half of the log likelihood ratio
counts (a fractional likelihood).

The correlations ``sum r f`` of many sections with many offsets are products of matrices: with sections of 100 cells,
several times as fast as an FFT for each section.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from trackfg.mapping.recognition.profiles import CROSS_LEVEL, Profile, cells, clipped, piece, sections_of, short_waves
from trackfg.numerics.arrays import Array

Array32 = NDArray[np.float32]

_PRIOR_DOF = 4.0
_FLOOR = 2.0
_TRUST = 0.5
_LEAST = 0.1
"""Least noise, of the short waves' own size: what sigmas do not tell."""
_LONGEST_MEMORY_M = 50


@dataclass(frozen=True)
class ShortWaves:
    """One feature: of the run's sections (k, m), of the reference's cells (n,), NaN where not known."""

    sections: Array32
    reference: Array32
    cells_per_value: float
    same_variance: float
    any_variance: float

    def scores(self, which: slice, begin: int, stop: int) -> Array32:
        """Of some sections that begin at the reference's cells ``begin`` to ``stop``: shape (k, stop - begin)."""
        count, squares, power = self._compared(which, begin, stop)
        least = np.float32(_FLOOR * self.same_variance) * count
        same = self._evidence(count, np.maximum(squares, least, out=squares), self.same_variance)
        same -= self._evidence(count, np.maximum(power, least), self.any_variance)
        same *= np.float32(_TRUST)
        same -= 0.5 * np.log1p(count / np.float32(self.cells_per_value))
        return same

    def residual(self, which: slice, begin: int, stop: int) -> Array32:
        """The least mean square that the reference leaves of each section, (k,); infinite where it is not known."""
        count, squares, _ = self._compared(which, begin, stop)
        with np.errstate(divide="ignore", invalid="ignore"):
            mean = np.where(count > 0.5 * self.sections.shape[1], squares / count, np.inf)
        return np.asarray(mean.min(axis=1), dtype=np.float32)

    def _compared(self, which: slice, begin: int, stop: int) -> tuple[Array32 | np.float32, Array32, Array32]:
        """Cells known of both, sum of squares over them of ``r - b f``, and of ``r``."""
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
        share = product / np.maximum(power, np.finfo(np.float32).tiny)
        np.clip(share, 0.0, 1.0, out=share)
        squares = share * power
        squares -= product
        squares -= product
        squares *= share
        squares += run_power
        return count, np.maximum(squares, 0.0, out=squares), run_power

    def _evidence(self, count: Array32 | np.float32, squares: Array32, variance: float) -> Array32:
        """``log L`` of values whose sum of squares over ``count`` cells is ``squares``."""
        prior = np.float32(_PRIOR_DOF * variance)
        out = squares * np.float32(1.0 / self.cells_per_value)
        out += prior
        np.log(out, out=out)
        out = out * np.asarray(-0.5 * (_PRIOR_DOF + count / self.cells_per_value), dtype=np.float32)
        out += np.float32(0.5 * _PRIOR_DOF * np.log(prior))
        return out


def short_waves_of(
    run: Profile, reference: Profile, name: str, first_cells: NDArray[np.int64], length: int, scale_sd: float
) -> ShortWaves | None:
    """Of one feature; the run's sections have ``length`` cells from ``first_cells`` (k,), m, on. None if not known."""
    r, f = (short_waves(cells(profile.features[name])) for profile in (run, reference))
    if not (np.isfinite(r).any() and np.isfinite(f).any()):
        return None
    r, f = clipped(r, f)
    # Sigmas of the cross-level are mostly those of its constant, which is no part of short waves.
    profiles = () if name == CROSS_LEVEL else (run, reference)
    claimed = float(sum(profile.claimed_variance(name) for profile in profiles))
    power = float(np.nanmean(f**2))
    slope = float(np.nanmean(np.diff(f) ** 2))
    same = claimed + slope * (1.0 + (scale_sd * length) ** 2) / 12.0 + _LEAST**2 * power
    tiny = 1e6 * float(np.finfo(np.float32).tiny)
    return ShortWaves(
        sections_of(r, first_cells - run.first_cell, length).astype(np.float32),
        f.astype(np.float32),
        _cells_per_value(f, power),
        max(same, tiny),
        max(power, claimed, tiny),
    )


def _cells_per_value(x: Array, power: float) -> float:
    """``sum of rho^2`` over all lags up to 50 m."""
    if power == 0.0:
        return 1.0
    lags = range(1, min(_LONGEST_MEMORY_M, len(x) - 1) + 1)
    products = (x[lag:] * x[:-lag] for lag in lags)
    rho = [float(np.nanmean(p)) / power for p in products if np.isfinite(p).any()]
    return 1.0 + 2.0 * float(np.sum(np.square(rho)))


def _windows(x: Array32, length: int) -> Array32:
    """Every ``length`` neighbours, in rows of their own in memory, as products of matrices want them."""
    return np.ascontiguousarray(np.lib.stride_tricks.sliding_window_view(x, length))

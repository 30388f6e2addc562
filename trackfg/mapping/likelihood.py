"""How well each section of a run fits each place of the reference, against fitting none.

All scores are log likelihood ratios against "nothing on this reference", where short waves and curves are those of any
track. With ``r`` the run's section and ``f`` the reference at an offset, in cells of 1 m:

**Short waves.** Of a feature, ``n`` independent values (Bartlett: cells over ``sum of rho^2`` over all lags, ``rho``
the reference's autocorrelation) have mean square ``v = mean (r - f)^2`` if the section is there and unchanged, and ``v
= mean r^2`` if it is like any track. The variance is not known, but about ``s^2``: with a scaled inverse chi-square
prior of ``k`` degrees of freedom the marginal likelihood is (Gelman et al., Bayesian Data Analysis, section 3.3)

    log L = (k/2) log(k s^2) - ((k + n)/2) log(k s^2 + n v) + a constant.

So a section proves what its own residual lets it prove, whatever sigmas claim. ``s^2`` of an unchanged section: the
claimed variances, and what half a cell of offset and an unknown scale leave, ``mean f'^2 (1 + var_scale L^2)/12``; of
any track: the mean square of the reference.

**Curves.** Means of curvature over 20 m, each with Student's t of 5 degrees of freedom about the reference's. Its scale
is the irregularities of both (so it holds even where all short waves have changed, and curves alone count), 3 % of the
curvature, and 1 m of offset in a transition. The next mean of any track is as the last, goes on with the last slope, is
straight again, or anything up to the usual curves, with the probabilities :data:`_NEXT`.

The correlations ``sum r f`` of many sections with many offsets are products of matrices: with sections of 100 cells,
several times as fast as an FFT for each section.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from trackfg.frames import Array
from trackfg.mapping.profiles import CURVATURE, LONG_M, Profile, cells, clipped, forward_mean, irregularity, short_waves

Array32 = NDArray[np.float32]

PLACE_M = 2
"""The search tells places 2 m apart: a section there begins at one of two cells, the one that fits better."""

_PRIOR_DOF = 4.0
_STUDENT_DOF = 5.0
_RADIUS_CHANGE = 0.03
_NEXT = {"as the last": 0.6, "goes on": 0.2, "straight": 0.1, "anything": 0.1}
_USUAL_CURVES_1PM = 5e-4
"""At least; else the root mean square of the reference's."""
_LEAST = 1e-3
"""Least noise of short waves, of their own size: for profiles without any."""
_LONGEST_MEMORY_M = 50
_SECTIONS_AT_ONCE, _PLACES_AT_ONCE = 64, 4096


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
        r = self.sections[which]
        f = _piece(self.reference, begin, stop + r.shape[1] - 1)
        r_known, f_known = np.isfinite(r), np.isfinite(f)
        r, f = np.where(r_known, r, np.float32(0)), np.where(f_known, f, np.float32(0))
        windows = _windows(f, r.shape[1])
        run_power, count = (r**2).sum(axis=1, keepdims=True), np.float32(r.shape[1])
        if r_known.all() and f_known.all():
            power = _windows(f**2, r.shape[1]).sum(axis=1)
        else:
            both = _windows(f_known.astype(np.float32), r.shape[1]).T
            count = r_known.astype(np.float32) @ both
            run_power = r**2 @ both
            power = r_known.astype(np.float32) @ _windows(f**2, r.shape[1]).T
        difference = r @ windows.T
        difference *= -2.0
        difference += run_power
        difference += power
        same = self._evidence(count, np.maximum(difference, 0.0), self.same_variance)
        same -= self._evidence(count, run_power, self.any_variance)
        return same

    def _evidence(self, count: Array32 | np.float32, squares: Array32, variance: float) -> Array32:
        """``log L`` of values whose sum of squares over ``count`` cells is ``squares``."""
        prior = np.float32(_PRIOR_DOF * variance)
        out = squares / np.float32(self.cells_per_value)
        out += prior
        np.log(out, out=out)
        out = out * (-0.5 * (_PRIOR_DOF + count / self.cells_per_value)).astype(np.float32)
        out += np.float32(0.5 * _PRIOR_DOF * np.log(prior))
        return out


@dataclass(frozen=True)
class Curves:
    """Means of curvature over 20 m, 1/m: of the run's sections (k, m), of the reference from each cell on (n,).

    ``noise``: sigma of a mean of the run about the reference's, (n,). ``anywhere``: log density of the sections' means
    on any track, (k, m). NaN where not known.
    """

    sections: Array
    reference: Array
    noise: Array
    anywhere: Array

    def scores(self, which: slice, begin: int, stop: int, every: int) -> Array32:
        """Of some sections that begin at every so manieth cell from ``begin`` to ``stop``: shape (k, cells)."""
        y, elsewhere = self.sections[which].astype(np.float32), self.anywhere[which].astype(np.float32)
        means = y.shape[1]
        reach = stop + LONG_M * (means - 1)
        g, noise = (_piece(x, begin, reach).astype(np.float32) for x in (self.reference, self.noise))
        y_known, g_known = np.isfinite(y).astype(np.float32), np.isfinite(g).astype(np.float32)
        y, elsewhere = np.nan_to_num(y), np.where(y_known > 0, elsewhere, np.float32(0))
        narrowness = np.where(g_known > 0, 1.0 / noise, np.float32(0))
        log_noise = np.where(g_known > 0, np.log(noise), np.float32(0))
        g = np.nan_to_num(g)
        total, factor = np.float32(0), np.float32(1)
        for j in range(means):
            at = slice(LONG_M * j, LONG_M * j + stop - begin, every)
            known = y_known[:, j : j + 1]
            z = (y[:, j : j + 1] * g_known[at] - known * g[at]) * narrowness[at]
            factor = factor * (1.0 + z * z / np.float32(_STUDENT_DOF))
            if j % 4 == 3 or j == means - 1:
                total, factor = total + np.log(factor), np.float32(1)
            if j == 0:
                constant = np.zeros_like(z)
            constant -= known * log_noise[at] + elsewhere[:, j : j + 1] * g_known[at]
        return constant - np.float32(0.5 * (_STUDENT_DOF + 1.0)) * total


@dataclass(frozen=True)
class Scores:
    """All that is compared. The reference's first cell is at ``first_cell`` m and it has ``cells`` of them."""

    short: tuple[ShortWaves, ...]
    curves: Curves | None
    sections: int
    first_cell: int
    cells: int

    def at(self, which: slice, begin: int, stop: int) -> tuple[Array32, Array32]:
        """Short waves and curves of some sections at places ``begin`` to ``stop``: two of shape (k, stop - begin).

        A section at place ``p`` begins at ``2 p`` m of the reference. Beyond its ends, where nothing is known, all
        scores are zero.
        """
        count = len(range(*which.indices(self.sections)))
        short = np.zeros((count, (stop - begin) * PLACE_M), dtype=np.float32)
        first = begin * PLACE_M - self.first_cell
        last = stop * PLACE_M - self.first_cell
        for waves in self.short:
            short += waves.scores(which, first, last)
        best = short.reshape(count, -1, PLACE_M).max(axis=2)
        return best, np.zeros_like(best) if self.curves is None else self.curves.scores(which, first, last, PLACE_M)

    def everywhere(self, begin: int, stop: int) -> tuple[Array32, Array32]:
        """:meth:`at` of all sections, a part at a time."""
        short, curves = (np.empty((self.sections, stop - begin), dtype=np.float32) for _ in range(2))
        for first in range(begin, stop, _PLACES_AT_ONCE):
            last = min(first + _PLACES_AT_ONCE, stop)
            for k in range(0, self.sections, _SECTIONS_AT_ONCE):
                which, part = slice(k, k + _SECTIONS_AT_ONCE), slice(first - begin, last - begin)
                short[which, part], curves[which, part] = self.at(which, first, last)
        return short, curves


def scores_of(run: Profile, reference: Profile, first_cells: NDArray[np.int64], length: int, scale_sd: float) -> Scores:
    """Of the run's sections that begin at ``first_cells`` (k,), m, each ``length`` m long, one after the other."""
    short = []
    for name in run.values:
        r, f = (short_waves(cells(profile.values[name])) for profile in (run, reference))
        if np.isfinite(r).any() and np.isfinite(f).any():
            r, f = clipped(r, f)
            claimed = _claimed_variance(run, name) + _claimed_variance(reference, name)
            sections = _sections(r, first_cells - run.first_cell, length)
            short.append(_expected(sections, f, claimed, scale_sd * length))
    curves = None
    if CURVATURE in run.values:
        y, g = (forward_mean(cells(profile.values[CURVATURE]), LONG_M) for profile in (run, reference))
        curves = _curves(_sections(y, first_cells - run.first_cell, length)[:, : length - LONG_M + 1 : LONG_M], y, g)
    return Scores(tuple(short), curves, len(first_cells), reference.first_cell, reference.rows // 4)


def _expected(sections: Array, reference: Array, claimed: float, stretch_m: float) -> ShortWaves:
    """With the variances that unchanged and other sections have."""
    power = float(np.nanmean(reference**2))
    slope = float(np.nanmean(np.diff(reference) ** 2))
    same = claimed + slope * (1.0 + stretch_m**2) / 12.0 + (_LEAST**2) * power
    tiny = np.finfo(np.float32).tiny * 1e6
    return ShortWaves(
        sections.astype(np.float32),
        reference.astype(np.float32),
        _cells_per_value(reference, power),
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


def _claimed_variance(profile: Profile, name: str) -> float:
    """Median; 0 where the table has no sigmas."""
    sigma = profile.sigmas[name]
    sigma = sigma[np.isfinite(sigma)]
    return float(np.median(sigma)) ** 2 if sigma.size else 0.0


def _curves(sections: Array, run: Array, reference: Array) -> Curves:
    own, theirs = irregularity(run), irregularity(reference)
    usual = max(_USUAL_CURVES_1PM, float(np.sqrt(np.nanmean(reference**2))))
    own = max(own, _LEAST * usual)
    slope = np.nan_to_num(np.gradient(reference)) if len(reference) > 1 else np.zeros(len(reference))
    noise = np.sqrt(own**2 + theirs**2 + (_RADIUS_CHANGE * reference) ** 2 + slope**2)
    return Curves(sections, reference, noise, _anywhere(sections.ravel(), own, usual).reshape(sections.shape))


def _anywhere(y: Array, noise: float, usual: float) -> Array:
    """Log density of each mean given those before it, on any track. Shape (n,) to (n,)."""
    last, before = (np.concatenate([np.full(lag, np.nan), y[:-lag]])[: len(y)] for lag in (1, 2))
    density, weight = np.zeros(len(y)), np.zeros(len(y))
    for (about, scale), probability in zip(
        ((last, noise * 2.0**0.5), (2.0 * last - before, noise * 6.0**0.5), (0.0, noise), (0.0, usual)),
        _NEXT.values(),
        strict=True,
    ):
        part = (1.0 + ((y - about) / scale) ** 2 / _STUDENT_DOF) ** (-0.5 * (_STUDENT_DOF + 1.0)) / scale
        density += probability * np.nan_to_num(part)
        weight += probability * np.isfinite(part)
    out = np.full(len(y), np.nan)
    known = weight > 0.0
    out[known] = np.log(density[known] / weight[known])
    return out


def _sections(x: Array, first: NDArray[np.int64], length: int) -> Array:
    """Pieces of ``x`` from each ``first`` on, NaN beyond the ends. Shape (k, length)."""
    index = first[:, None] + np.arange(length)
    return np.where((index >= 0) & (index < len(x)), x[np.clip(index, 0, len(x) - 1)], np.nan)


def _piece(x: NDArray[np.floating], begin: int, stop: int) -> NDArray[np.floating]:
    """``x[begin:stop]``, NaN beyond the ends."""
    out = np.full(stop - begin, np.nan, dtype=x.dtype)
    low, high = max(begin, 0), min(stop, len(x))
    if low < high:
        out[low - begin : high - begin] = x[low:high]
    return out


def _windows(x: Array32, length: int) -> Array32:
    """Every ``length`` neighbours, in rows of their own in memory, as products of matrices want them."""
    return np.ascontiguousarray(np.lib.stride_tricks.sliding_window_view(x, length))

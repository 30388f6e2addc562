"""Log likelihood ratios of the places of each section: short waves and curves together.

For section k and place p, against "the section is on some other track",

    l_k(p) = log P(section k | at p) - log P(section k | anywhere else) = short_k(p) + curves_k(p).

The two parts have noises of their own (:mod:`trackfg.mapping.recognition.short_wave_likelihood`,
:mod:`trackfg.mapping.recognition.curve_likelihood`) and are kept apart, because track that was maintained has new short
waves on old curves.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from trackfg.mapping.recognition.curve_likelihood import CurveMeans, curve_means_of
from trackfg.mapping.recognition.profiles import CURVATURE, FeatureProfile
from trackfg.mapping.recognition.short_wave_likelihood import Array32, ShortWaves, short_waves_of
from trackfg.numerics.arrays import Array

PLACE_M = 2
"""Distance of places in the search, m (two cells): a section at a place begins at the cell of the two that fits better.
The fine match searches 2 m to either side."""

_SAMPLE = 32
"""The noise of short waves is estimated from so many sections at least, evenly taken from the run."""
_BEST_SHARE = 0.2
"""Share of these sections that is taken to lie unchanged on the reference. Chosen; see Assumptions in
docs/engine.md.
"""
_SECTIONS_AT_ONCE, _PLACES_AT_ONCE = 64, 512
"""Sections and places that are compared in one product of matrices: they stay in the processor's cache."""


@dataclass(frozen=True)
class LogLikelihoods:
    """The log likelihood ratios of all sections of a run, computed for the places that are asked for.

    ``short``: one entry per feature. The reference's first cell is at ``first_cell`` m and it has ``cells`` of them.
    """

    short: tuple[ShortWaves, ...]
    curves: CurveMeans | None
    sections: int
    first_cell: int
    cells: int

    def at(self, which: slice, begin: int, stop: int) -> tuple[Array32, Array32]:
        """Return the ratios by short waves and by curves of some sections at places ``begin`` to ``stop``.

        Two arrays of shape (sections, stop - begin). A section at place ``p`` begins at ``2 p`` m of the reference.
        Beyond the reference's ends, where nothing is known, all ratios are zero.
        """
        count = len(range(*which.indices(self.sections)))
        short = np.zeros((count, (stop - begin) * PLACE_M), dtype=np.float32)
        first = begin * PLACE_M - self.first_cell
        last = stop * PLACE_M - self.first_cell
        for waves in self.short:
            short += waves.log_ratios(which, first, last)
        best = np.maximum(short[:, ::PLACE_M], short[:, 1::PLACE_M])
        if self.curves is None:
            return best, np.zeros_like(best)
        return best, self.curves.log_ratios(which, first, last, PLACE_M)

    def places(self, length: int) -> tuple[int, int]:
        """Return the first place and the one after the last where a section of ``length`` m may begin.

        It may reach over either end of the reference by half of its length.
        """
        begin = (self.first_cell - length // 2) // PLACE_M
        return begin, (self.first_cell + self.cells - length // 2) // PLACE_M + 1

    def everywhere(self, begin: int, stop: int, first_section: int = 0) -> tuple[Array32, Array32]:
        """Return :meth:`at` of all sections from ``first_section`` on, computed in parts."""
        count = self.sections - first_section
        short, curves = (np.empty((count, stop - begin), dtype=np.float32) for _ in range(2))
        for k in range(0, count, _SECTIONS_AT_ONCE):
            rows = slice(k, min(k + _SECTIONS_AT_ONCE, count))
            which = slice(first_section + rows.start, first_section + rows.stop)
            for first in range(begin, stop, _PLACES_AT_ONCE):
                last = min(first + _PLACES_AT_ONCE, stop)
                columns = slice(first - begin, last - begin)
                short[rows, columns], curves[rows, columns] = self.at(which, first, last)
        return short, curves

    def least_residuals(self, section: int, begin: int, stop: int) -> Array:
        """Return the mean square that the best of places ``begin`` to ``stop`` leaves of a section's short waves.

        One value per feature, (features,), infinite where nothing is known.
        """
        least = np.full(len(self.short), np.inf)
        for first in range(begin, stop, _PLACES_AT_ONCE):
            low, high = (PLACE_M * place - self.first_cell for place in (first, min(first + _PLACES_AT_ONCE, stop)))
            for i, waves in enumerate(self.short):
                least[i] = min(least[i], float(waves.residual(slice(section, section + 1), low, high)[0]))
        return least

    def with_noise(self, least: Array) -> LogLikelihoods:
        """Return the ratios with a noise of short waves that is no less than what is seen.

        ``least`` (sections, features): :meth:`least_residuals` of some sections. Of these the best fifth lies unchanged
        on the reference; what it leaves is noise.
        """
        short = []
        for waves, values in zip(self.short, least.T, strict=True):
            finite = values[np.isfinite(values)]
            noise = float(np.quantile(finite, _BEST_SHARE)) if finite.size else 0.0
            short.append(replace(waves, same_variance=max(waves.same_variance, noise)))
        return replace(self, short=tuple(short))

    def with_noise_of(self, begin: NDArray[np.int64], stop: NDArray[np.int64]) -> LogLikelihoods:
        """Return :meth:`with_noise` of some of the sections, each at its places ``begin`` to ``stop`` (k,)."""
        some = range(0, self.sections, max(1, self.sections // _SAMPLE))
        return self.with_noise(np.array([self.least_residuals(k, int(begin[k]), int(stop[k])) for k in some]))


def log_likelihoods_of(
    run: FeatureProfile, reference: FeatureProfile, first_cells: NDArray[np.int64], length: int, scale_sd: float
) -> LogLikelihoods:
    """Return the ratios of the run's sections that begin at ``first_cells`` (k,), m, each ``length`` m long."""
    short = (short_waves_of(run, reference, name, first_cells, length, scale_sd) for name in run.features)
    curves = curve_means_of(run, reference, first_cells, length) if CURVATURE in run.features else None
    cells = reference.rows // reference.rows_per_cell
    return LogLikelihoods(
        tuple(waves for waves in short if waves), curves, len(first_cells), reference.first_cell, cells
    )

"""How well each section of a run fits each place of the reference, against fitting none.

Two log likelihood ratios against "nothing on this reference", of noises that are estimated apart: of short waves
(:mod:`trackfg.mapping.recognition.short_wave_likelihood`) and of curves
(:mod:`trackfg.mapping.recognition.curve_likelihood`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from trackfg.mapping.recognition.curve_likelihood import Curves, curves_of
from trackfg.mapping.recognition.profiles import CURVATURE, ROWS_PER_CELL, Profile
from trackfg.mapping.recognition.short_wave_likelihood import Array32, ShortWaves, short_waves_of
from trackfg.numerics.arrays import Array

PLACE_M = 2
"""The search tells places 2 m apart: a section there begins at one of two cells, the one that fits better."""

_SAMPLE, _BEST_SHARE = 32, 0.2
"""Sections whose residuals tell the noise, and the share of them that are taken to be unchanged and there."""
_SECTIONS_AT_ONCE, _PLACES_AT_ONCE = 64, 512
"""What is worked on stays in the processor's cache."""


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
        best = np.maximum(short[:, ::PLACE_M], short[:, 1::PLACE_M])
        return best, np.zeros_like(best) if self.curves is None else self.curves.scores(which, first, last, PLACE_M)

    def places(self, length: int) -> tuple[int, int]:
        """From which place to before which a section of ``length`` m may be, or reach over the ends by half of it."""
        begin = (self.first_cell - length // 2) // PLACE_M
        return begin, (self.first_cell + self.cells - length // 2) // PLACE_M + 1

    def everywhere(self, begin: int, stop: int, first_section: int = 0) -> tuple[Array32, Array32]:
        """:meth:`at` of all sections from one on, a part at a time."""
        count = self.sections - first_section
        short, curves = (np.empty((count, stop - begin), dtype=np.float32) for _ in range(2))
        for k in range(0, count, _SECTIONS_AT_ONCE):
            own = slice(k, min(k + _SECTIONS_AT_ONCE, count))
            which = slice(first_section + own.start, first_section + own.stop)
            for first in range(begin, stop, _PLACES_AT_ONCE):
                last = min(first + _PLACES_AT_ONCE, stop)
                part = slice(first - begin, last - begin)
                short[own, part], curves[own, part] = self.at(which, first, last)
        return short, curves

    def least_residuals(self, section: int, begin: int, stop: int) -> Array:
        """What is left of a section's short waves at the best of places ``begin`` to ``stop``, by feature: (features,),
        infinite where nothing is known.
        """
        least = np.full(len(self.short), np.inf)
        for first in range(begin, stop, _PLACES_AT_ONCE):
            low, high = (PLACE_M * place - self.first_cell for place in (first, min(first + _PLACES_AT_ONCE, stop)))
            for i, waves in enumerate(self.short):
                least[i] = min(least[i], float(waves.residual(slice(section, section + 1), low, high)[0]))
        return least

    def with_noise(self, least: Array) -> Scores:
        """Unchanged sections leave no less than the best fifth of some do, ``least`` (sections, features)."""
        short = []
        for waves, values in zip(self.short, least.T, strict=True):
            known = values[np.isfinite(values)]
            noise = float(np.quantile(known, _BEST_SHARE)) if known.size else 0.0
            short.append(replace(waves, same_variance=max(waves.same_variance, noise)))
        return replace(self, short=tuple(short))

    def with_noise_of(self, begin: NDArray[np.int64], stop: NDArray[np.int64]) -> Scores:
        """:meth:`with_noise` of some of the sections at their places, (k,) to (k,)."""
        some = range(0, self.sections, max(1, self.sections // _SAMPLE))
        return self.with_noise(np.array([self.least_residuals(k, int(begin[k]), int(stop[k])) for k in some]))


def scores_of(run: Profile, reference: Profile, first_cells: NDArray[np.int64], length: int, scale_sd: float) -> Scores:
    """Of the run's sections that begin at ``first_cells`` (k,), m, each ``length`` m long, one after the other."""
    short = (short_waves_of(run, reference, name, first_cells, length, scale_sd) for name in run.features)
    curves = curves_of(run, reference, first_cells, length) if CURVATURE in run.features else None
    cells = reference.rows // ROWS_PER_CELL
    return Scores(tuple(waves for waves in short if waves), curves, len(first_cells), reference.first_cell, cells)

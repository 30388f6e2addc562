"""How well the curves of a section fit a place of the reference, against those of any track.

Means of curvature over 20 m, each with Student's t of 5 degrees of freedom about the reference's. Its scale is the
irregularities of both (so it holds even where all short waves have changed, and curves alone count), 3 % of the
curvature, and 1 m of offset in a transition. The next mean of any track is as the last, goes on with the last slope, is
straight again, or anything up to the usual curves, with the probabilities :data:`_NEXT`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from trackfg.mapping.recognition.profiles import (
    CURVATURE,
    LONG_M,
    Profile,
    cells,
    forward_mean,
    irregularity,
    piece,
    sections_of,
)
from trackfg.mapping.recognition.short_wave_likelihood import Array32
from trackfg.numerics.arrays import Array

_STUDENT_DOF = 5.0
_RADIUS_CHANGE = 0.03
_NEXT = {"as the last": 0.6, "goes on": 0.2, "straight": 0.1, "anything": 0.1}
_LEAST_IRREGULAR = 1e-3
"""Of usual curves: for profiles without irregularities."""
_USUAL_CURVES_1PM = 5e-4
"""At least; else the root mean square of the reference's."""


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
        """Of some sections that begin at cells ``begin`` to ``stop``, ``every`` apart: shape (k, cells)."""
        y, elsewhere = self.sections[which].astype(np.float32), self.anywhere[which].astype(np.float32)
        means = y.shape[1]
        reach = stop + LONG_M * (means - 1)
        g, noise = (piece(x, begin, reach).astype(np.float32) for x in (self.reference, self.noise))
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


def curves_of(run: Profile, reference: Profile, first_cells: NDArray[np.int64], length: int) -> Curves:
    """Of the run's sections of ``length`` cells from ``first_cells`` (k,), m, on, one after the other."""
    y, f = (forward_mean(cells(profile.features[CURVATURE]), LONG_M) for profile in (run, reference))
    sections = sections_of(y, first_cells - run.first_cell, length)[:, : length - LONG_M + 1 : LONG_M]
    usual = _USUAL_CURVES_1PM
    if np.isfinite(f).any():
        usual = max(usual, float(np.sqrt(np.nanmean(f**2))))
    own, theirs = max(irregularity(y), _LEAST_IRREGULAR * usual), irregularity(f)
    slope = np.nan_to_num(np.gradient(f)) if len(f) > 1 else np.zeros(len(f))
    noise = np.sqrt(own**2 + theirs**2 + (_RADIUS_CHANGE * f) ** 2 + slope**2)
    forwards = sections.ravel() if first_cells[0] <= first_cells[-1] else sections[::-1].ravel()
    anywhere = _anywhere(forwards, own, usual).reshape(sections.shape)
    return Curves(sections, f, noise, anywhere if first_cells[0] <= first_cells[-1] else anywhere[::-1])


def _anywhere(y: Array, noise: float, usual: float) -> Array:
    """Log density of each mean given those before it, on any track. Shape (n,) to (n,)."""
    last, before = (np.concatenate([np.full(lag, np.nan), y[:-lag]])[: len(y)] for lag in (1, 2))
    density, weight = np.zeros(len(y)), np.zeros(len(y))
    rounding = _RADIUS_CHANGE * y  # as on the reference, lest the same circle be likelier anywhere
    for (about, scale), probability in zip(
        (
            (last, np.hypot(noise * 2.0**0.5, rounding)),
            (2.0 * last - before, np.hypot(noise * 6.0**0.5, rounding)),
            (0.0, noise),
            (0.0, usual),
        ),
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

"""Log likelihood ratio of the places of a section by its curves.

A section has means ``y_j`` of curvature over 20 m, the reference at a place has ``g_j``. The ratio is

    curves(p) = sum_j log t(y_j; g_j, sigma_j) - log q(y_j | y_j-1, y_j-2).

**At the place** each mean has Student's t density of 5 degrees of freedom about the reference's, with the scale

    sigma_j^2 = irregularities of the run^2 + of the reference^2 + (3 % of g_j)^2 + (1 m of offset in a transition)^2.

The irregularities are in it, so it holds even where all short waves have changed and curves alone count.

**On any other track** the density q is a mixture: the next mean is as the last, goes on with the last slope, is
straight again, or is anything up to the usual curves, with the probabilities :data:`_NEXT`. So a long circle is one
piece of evidence and not five.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from trackfg.mapping.recognition.profiles import (
    CURVATURE,
    LONG_M,
    FeatureProfile,
    forward_mean,
    irregularity,
    piece,
    sections_of,
)
from trackfg.mapping.recognition.short_wave_likelihood import Array32
from trackfg.numerics.arrays import Array

_STUDENT_DOF = 5.0
"""Degrees of freedom of Student's t: its tails let one mean of a section be wrong (Lange, Little and Taylor, Journal of
the American Statistical Association 84, 1989)."""
_RADIUS_CHANGE = 0.03
"""Sigma of a curvature after maintenance, relative. Chosen on simulated tamped lines; see Assumptions in
docs/engine.md.
"""
_NEXT = {"as the last": 0.6, "goes on": 0.2, "straight": 0.1, "anything": 0.1}
"""Probabilities of the next mean of curvature on any track. Chosen on simulated lines; see Assumptions in
docs/engine.md.
"""
_LEAST_IRREGULAR = 1e-3
"""Least sigma of irregularities, as a share of usual curves: for profiles without any."""
_USUAL_CURVES_1PM = 5e-4
"""Least scale of usual curves, 1/m: a radius of 2 km. Where the reference has sharper ones it is their rms."""


@dataclass(frozen=True)
class CurveMeans:
    """Means of curvature over 20 m, 1/m: of the run's sections (k, m), of the reference from each cell on (n,).

    ``noise``: sigma of a mean of the run about the reference's, (n,). ``anywhere``: log density q of the sections'
    means on any track, (k, m). NaN where not known.
    """

    sections: Array
    reference: Array
    noise: Array
    anywhere: Array

    def log_ratios(self, which: slice, begin: int, stop: int, every: int) -> Array32:
        """Return the ratios of some sections at cells ``begin`` to ``stop``, ``every`` apart: shape (k, cells)."""
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


def curve_means_of(
    run: FeatureProfile, reference: FeatureProfile, first_cells: NDArray[np.int64], length: int
) -> CurveMeans:
    """Return the means of the run's sections of ``length`` cells from ``first_cells`` (k,), m, on.

    The sections follow one another, in or against the order of chainage.
    """
    y, f = (forward_mean(profile.cells(CURVATURE), LONG_M) for profile in (run, reference))
    sections = sections_of(y, first_cells - run.first_cell, length)[:, : length - LONG_M + 1 : LONG_M]
    usual = _USUAL_CURVES_1PM
    if np.isfinite(f).any():
        usual = max(usual, float(np.sqrt(np.nanmean(f**2))))
    of_run, of_reference = max(irregularity(y), _LEAST_IRREGULAR * usual), irregularity(f)
    slope = np.nan_to_num(np.gradient(f)) if len(f) > 1 else np.zeros(len(f))
    noise = np.sqrt(of_run**2 + of_reference**2 + (_RADIUS_CHANGE * f) ** 2 + slope**2)
    forwards = sections.ravel() if first_cells[0] <= first_cells[-1] else sections[::-1].ravel()
    anywhere = _log_density_anywhere(forwards, of_run, usual).reshape(sections.shape)
    return CurveMeans(sections, f, noise, anywhere if first_cells[0] <= first_cells[-1] else anywhere[::-1])


def _log_density_anywhere(y: Array, noise: float, usual: float) -> Array:
    """Return the log density q of each mean given the two before it, on any track. Shape (n,) to (n,)."""
    last, last_but_one = (np.concatenate([np.full(lag, np.nan), y[:-lag]])[: len(y)] for lag in (1, 2))
    density, weight = np.zeros(len(y)), np.zeros(len(y))
    rounding = _RADIUS_CHANGE * y  # as on the reference, or the same circle would be likelier on any other track
    for (about, scale), probability in zip(
        (
            (last, np.hypot(noise * 2.0**0.5, rounding)),
            (2.0 * last - last_but_one, np.hypot(noise * 6.0**0.5, rounding)),
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

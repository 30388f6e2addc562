"""Fine match of sections: where exactly each lies on the reference, by least squares on the rows.

Sections on unchanged track are matched by all features (:mod:`trackfg.mapping.recognition.section_fit`). Slopes of raw
rows are mostly those of the shortest waves. Recording cars do not repeat these, so a section that is not accepted is
matched once more with both profiles low-passed at 4 m, where runs become coherent; the same rule holds then. Sections
on changed track are matched by their curves alone, the means of curvature over 20 m.

**Mean and middle.** Least squares gives about the mean over the section of the shift between the two chainages; it is
reported as the shift at the middle. Where the wheel's scale is a random walk, the shift is an integrated one. Let ``d``
be the second difference of the mean shifts of three sections in a row. From the covariance of an integrated Wiener
process, ``var(d) = 11/20 L^3 q``, the difference of mean and middle has the expectation ``0.055 d`` and the sigma
``0.052 sd(d)`` about it (taken twice as large, :data:`_WALK_REST`). Neither is corrected, both enter the variance: a
correction by d would mix the errors of three matches, which are used as independent ones.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from trackfg.mapping.recognition.profiles import CROSS_LEVEL, CURVATURE, FeatureProfile
from trackfg.mapping.recognition.section_fit import (
    REACH_BY_CURVES_M,
    SectionFit,
    fit_sections,
    mean_difference,
    section_feature,
)
from trackfg.numerics.arrays import Array
from trackfg.numerics.robust import robust_sd

_CURVES_SCALE = 0.003
"""Greatest sigma of a section's scale error where there are only curves: their few slopes would fit irregularities by
it. Chosen on simulated tamped lines; see Assumptions in docs/engine.md."""
_CURVES_SD = 1.3
"""Factor of the sigma of matches by curves: irregularities bend the fit itself. Chosen on simulated tamped lines; see
Assumptions in docs/engine.md."""
_LEAST_TRIPLES = 5
"""Triples of sections from which the wheel's walk can be estimated."""
_WALK_MEAN = 0.055
"""The expectation of the mean shift less that at the middle, per second difference d (module docstring)."""
_WALK_REST = 0.1
"""The sigma about it, per sd(d): twice the 0.052 of a Wiener process. Chosen on ten pairs of simulated runs (shuttle,
mainline), whose matches err by 1.0 to 1.7 sigmas rms with it and by 1.15 to 1.8 with 0.052; see Assumptions in
docs/engine.md."""


@dataclass(frozen=True)
class Sections:
    """The sections of a run that are to be matched, (k,) each.

    Their middles are at ``middle_m`` in the run's chainage and, to a metre or two, at ``about_m`` on the reference,
    with a scale error of about ``scale``. ``unchanged``: whether the track is as on the reference.
    """

    middle_m: Array
    length_m: int
    about_m: Array
    scale: Array
    unchanged: NDArray[np.bool_]

    def __getitem__(self, which: NDArray[np.int64]) -> Sections:
        return Sections(
            self.middle_m[which], self.length_m, self.about_m[which], self.scale[which], self.unchanged[which]
        )


@dataclass(frozen=True)
class Matches:
    """Matches of sections (k,).

    ``reference_m``: chainage of their middle on the reference, and its sigma ``sd_m`` (NaN: no match).
    ``cross_level_bias_mm``: mean of run minus reference, and its sigma (NaN where not known).
    """

    reference_m: Array
    sd_m: Array
    cross_level_bias_mm: Array
    cross_level_bias_mm_sd: Array


def match_sections(run: FeatureProfile, reference: FeatureProfile, sections: Sections, scale_sd: float) -> Matches:
    """Match sections of the run. ``scale_sd``: prior sigma of their scale errors."""
    count = len(sections.middle_m)
    position_m, sd_m, scale = sections.about_m.copy(), np.full(count, np.nan), sections.scale.copy()
    every = tuple(run.features)
    for coherent in (False, True):
        which = np.flatnonzero(sections.unchanged & np.isnan(sd_m))
        if which.size:
            some = sections[which]
            profiles = _low_passed(run, reference, some) if coherent else (run, reference)
            fit = _fitted(*profiles, some, every, scale_sd)
            position_m[which], sd_m[which], scale[which] = fit
    which = np.flatnonzero(~sections.unchanged)
    if which.size and CURVATURE in run.features:
        fit = _fitted(run, reference, sections[which], (CURVATURE,), min(scale_sd, _CURVES_SCALE), by_curves=True)
        position_m[which], sd_m[which], scale[which] = fit.position_m, _CURVES_SD * fit.sd_m, fit.scale
    sd_m = np.hypot(sd_m, _mean_to_middle_sd(position_m - sections.middle_m, sd_m))
    bias, bias_sd = np.full(count, np.nan), np.full(count, np.nan)
    which = np.flatnonzero(np.isfinite(sd_m))
    if CROSS_LEVEL in run.features and which.size:
        feature = section_feature(run, reference, CROSS_LEVEL, *_rows(run, sections[which]), by_curves=False)
        fit = SectionFit(position_m[which], sd_m[which], scale[which])
        bias[which], bias_sd[which] = mean_difference(feature, fit)
    return Matches(position_m, sd_m, bias, bias_sd)


def _fitted(
    run: FeatureProfile,
    reference: FeatureProfile,
    sections: Sections,
    names: Sequence[str],
    scale_sd: float,
    *,
    by_curves: bool = False,
) -> SectionFit:
    """Return the sections' least-squares fit by the features ``names``, or by their means over 20 m."""
    rows = _rows(run, sections)
    features = [section_feature(run, reference, name, *rows, by_curves=by_curves) for name in names]
    return fit_sections(features, sections.about_m, sections.scale, scale_sd, searched=not by_curves)


def _low_passed(
    run: FeatureProfile, reference: FeatureProfile, sections: Sections
) -> tuple[FeatureProfile, FeatureProfile]:
    """Return both profiles about the sections without the waves in which runs are not coherent."""
    around = 0.5 * sections.length_m + REACH_BY_CURVES_M
    of_run, of_reference = (
        profile.between(float(middle_m.min()) - around, float(middle_m.max()) + around).low_passed()
        for profile, middle_m in ((run, sections.middle_m), (reference, sections.about_m))
    )
    return of_run, of_reference


def _rows(run: FeatureProfile, sections: Sections) -> tuple[NDArray[np.int64], int]:
    """Return the rows of the run at which the sections begin, (k,), and how many rows each has."""
    first = np.rint((sections.middle_m - 0.5 * sections.length_m) / run.step_m).astype(np.int64)
    return np.asarray(first - run.first), sections.length_m * run.rows_per_cell


def _mean_to_middle_sd(shift: Array, sd: Array) -> Array:
    """Return the sigma of the mean shift over each section about that in its middle, m, (k,).

    It is zero if there are too few triples of sections to estimate the walk.
    """
    bend = np.full(len(shift), np.nan)
    bend[1:-1] = shift[:-2] - 2.0 * shift[1:-1] + shift[2:]
    explained = np.zeros(len(shift))
    explained[1:-1] = sd[:-2] ** 2 + 4.0 * sd[1:-1] ** 2 + sd[2:] ** 2
    known = np.isfinite(bend) & np.isfinite(explained)
    if known.sum() < _LEAST_TRIPLES:
        return np.zeros(len(shift))
    usual = robust_sd(bend[known]) ** 2 - float(np.median(explained[known]))
    of_section = np.where(known, bend**2 - explained, usual)
    return np.sqrt(_WALK_MEAN**2 * np.maximum(of_section, 0.0) + _WALK_REST**2 * max(usual, 0.0))

"""Detection of curves in smoothed curvature and cross-level: chainages, radii, laws and cants, each with its sigma."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from scipy.special import chdtri

from trackfg.curves.cells import Cells, cells_of
from trackfg.curves.curve import QUANTITIES, Curve, CurveKind, CurveLaw
from trackfg.curves.fit import Fit, Stretch, canted, fitted
from trackfg.curves.line import CurvedLine, LineNoise, tilt_noise, turn_noise
from trackfg.curves.model import CurveChain
from trackfg.curves.segments import first_chains
from trackfg.curves.structure import simplified, structured
from trackfg.curves.transition_law_selection import LawTrial, law_spread, law_trial, law_weights, with_likeliest_laws
from trackfg.numerics.arrays import Array
from trackfg.numerics.blas_threads import one_thread

_SHARED_ABOVE = 1e-4
"""Significance of the likelihood ratio test that the ramps of cant and of curvature are the same."""


def find_curves(profile: pd.DataFrame, *, base_m: float = 10.0) -> list[Curve]:
    """Find the curves of a profile, in order of chainage.

    Parameters
    ----------
    profile
        A result's geometry table: ``chainage_m`` ascending in uniform steps, ``curvature_1pm`` and its ``_sd``, and
        perhaps ``cross_level_mm``. Rows may be missing or NaN.
    base_m
        Length over which the curvature is averaged, m.

    Returns
    -------
    list of Curve
        Sigmas refer to the profile's own chainage: that of the chainage itself is not in them.

    Raises
    ------
    BadInputError
        For a profile without these columns or this grid.

    Examples
    --------
    >>> import numpy as np
    >>> import pandas as pd
    >>> from trackfg.curves import find_curves
    >>> chainage = np.arange(0.0, 600.0, 0.25)
    >>> curvature = np.interp(chainage, [150, 200, 400, 450], [0, 1 / 500, 1 / 500, 0])  # to the left, R 500 m
    >>> profile = pd.DataFrame({"chainage_m": chainage, "curvature_1pm": curvature, "curvature_1pm_sd": 1e-5})
    >>> [(curve.sense, round(curve.radius_m)) for curve in find_curves(profile)]
    [('left', 500)]
    """
    with one_thread():
        return _curves_of(cells_of(profile, base_m))


def _curves_of(pieces: Sequence[Cells]) -> list[Curve]:
    lines = [CurvedLine(cells, tuple(first_chains(cells))) for cells in pieces]
    if not any(line.chains for line in lines):
        return []
    noise = LineNoise(turn_noise(lines, straights_only=True), None)
    lines = [line.undisturbed(noise) for line in lines]
    noise = LineNoise(turn_noise(lines, straights_only=True), None)
    lines = [line.structured(noise) for line in lines]
    noise = LineNoise(turn_noise(lines, straights_only=False), tilt_noise(lines))
    lines = [line.undisturbed(noise).canted(noise) for line in lines]
    noise = LineNoise(turn_noise(lines, straights_only=False), tilt_noise(lines))
    groups = [_group(chain, line.stretch(k, noise)) for line in lines for k, chain in enumerate(line.chains)]
    fits = [group for group in groups if group is not None]
    weights = law_weights([group.trial for group in fits])
    fits = [replace(group, trial=with_likeliest_laws(group.trial, w)) for group, w in zip(fits, weights, strict=True)]
    weights = law_weights([group.trial for group in fits])
    curves = [curve for group, w in zip(fits, weights, strict=True) for curve in _curves(group, w)]
    return [replace(curve, id=number) for number, curve in enumerate(curves, start=1)]


@dataclass(frozen=True)
class Group:
    """A group of curves with its laws on trial.

    ``cants`` are those of a fit of their own, where the cant's ramps are elsewhere than the transitions; ``trial`` is
    then that of the curvature alone.
    """

    trial: LawTrial
    cants: Fit | None


def _group(chain: CurveChain, stretch: Stretch) -> Group | None:
    curvature_fit = structured(chain, stretch.without_tilt())
    if curvature_fit is None:
        return None
    if stretch.tilt is None or not any(curvature_fit.chain.straight):
        return Group(law_trial(curvature_fit), None)
    seeded, stretch = canted(curvature_fit.chain, replace(curvature_fit.stretch, tilt=stretch.tilt))
    joint_fit = fitted(seeded, stretch)
    cant_fit = fitted(seeded, replace(stretch, turn=None))
    excess = joint_fit.chi2 / joint_fit.scale - (curvature_fit.chi2 + cant_fit.chi2) / joint_fit.scale
    limit = float(chdtri(len(curvature_fit.chain.places), _SHARED_ABOVE))
    if excess < limit and np.all(np.diff(joint_fit.chain.points) >= 0.0):
        return Group(law_trial(simplified(joint_fit)), None)
    return Group(law_trial(curvature_fit), cant_fit)


def _curves(group: Group, weights: Array) -> list[Curve]:
    """Return the curves of a group, with the id 0."""
    trial = group.trial
    chain, stretch = trial.fit.chain, trial.fit.stretch
    covariance = trial.fit.covariance + law_spread(trial, weights)
    sure = dict(zip(trial.transitions, weights.max(axis=1), strict=True))
    p, c = len(chain.places), len(chain.curved)
    curves = []
    for k, level in enumerate(chain.curved):
        sign = float(np.sign(chain.curvature[level]))
        values, of_parameter = np.full(6, np.nan), np.zeros((6, len(covariance)))
        for transition, first in ((level - 1, 0), (level, 2)):
            if 0 <= transition < len(chain.laws):
                ends = [chain.begin[transition], chain.end[transition]]
                values[first : first + 2] = chain.places[ends]
                of_parameter[[first, first + 1], ends] = 1.0
        values[4] = chain.curvature[level]
        of_parameter[4, p + k] = 1.0
        cant_variance = 0.0
        if stretch.tilt is not None:
            values[5] = -sign * chain.cant[level]
            of_parameter[5, p + c + k] = -sign
        elif group.cants is not None:
            values[5] = -sign * group.cants.chain.cant[level]
            cant_variance = float(group.cants.covariance[p + c + k, p + c + k])
        uncertain = of_parameter @ covariance @ of_parameter.T
        uncertain[4, 4] += _profile_variance(stretch, stretch.curvature_known, values[:4])
        uncertain[5, 5] += cant_variance + _profile_variance(stretch, stretch.cross_level_known, values[:4])
        unknown = np.isnan(values)
        uncertain[unknown, :] = uncertain[:, unknown] = np.nan
        law_in, law_out = _law(chain, int(level) - 1), _law(chain, int(level))
        curves.append(
            Curve(
                id=0,
                kind=_kind(chain, int(level)),
                sense="left" if sign > 0.0 else "right",
                **dict(zip(QUANTITIES, values.tolist(), strict=True)),
                law_in=law_in,
                law_out=law_out,
                law_in_probability=float(sure.get(int(level) - 1, 1.0 if law_in == "none" else np.nan)),
                law_out_probability=float(sure.get(int(level), 1.0 if law_out == "none" else np.nan)),
                covariance=uncertain,
            )
        )
    return curves


def _profile_variance(stretch: Stretch, variance: Array, points: Array) -> float:
    """Return by how much the profile's own variance of curvature, or cross-level, is greater in the curve.

    The difference is its scale, which all of a run's curves share. What the profile does not know on the straight
    either is short, and among the residuals, or an offset, which a curve has not.
    """
    middle = float(np.nanmean(points[1:3]))
    return float(np.interp(middle, stretch.edges[1:-1], variance)) - float(variance.min())


def _law(chain: CurveChain, transition: int) -> CurveLaw:
    if not 0 <= transition < len(chain.laws):
        return "unseen"
    return "none" if chain.begin[transition] == chain.end[transition] else chain.laws[transition]


def _kind(chain: CurveChain, level: int) -> CurveKind:
    last = len(chain.straight) - 1
    beside = [i for i in (level - 1, level + 1) if 0 <= i <= last]
    compound = any(not chain.straight[i] for i in beside)
    joined_at_begin = level > 1 and chain.straight[level - 1] and chain.end[level - 2] == chain.begin[level - 1]
    joined_at_end = level + 1 < last and chain.straight[level + 1] and chain.end[level] == chain.begin[level + 1]
    # Straights without length lie between curves of opposite sign, and may between those of one.
    reverse = (joined_at_begin and chain.curvature[level - 2] * chain.curvature[level] < 0.0) or (
        joined_at_end and chain.curvature[level + 2] * chain.curvature[level] < 0.0
    )
    if reverse:
        return "compound and reverse part" if compound else "reverse part"
    return "compound part" if compound else "simple"

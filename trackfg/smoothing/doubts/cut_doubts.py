"""A body on two bogies cuts curves: its middle travels less far than the track is long.

With pivots 2l apart the middle of their chord is ``k l^2 / 2`` inside a curve of curvature k, so that its way is
shorter by ``k^2 l^2 / 2`` per metre: 0.13 m per radian at R 300 with l = 9 m. The graph takes the way of that point for
the track's. Nothing in a recording shows how far apart the pivots are, and fixes alone show how long the track is.
"""

from __future__ import annotations

import math

import numpy as np

from trackfg.factors.factor_type import FactorType
from trackfg.numerics.arrays import Array
from trackfg.output.trajectory import QUANTITIES, keyframe_variances
from trackfg.results.verdict import Doubt
from trackfg.smoothing.doubts.usual_sigmas import LEAST_WIDENING
from trackfg.smoothing.passage import STEP_M, chord_curvature, passage
from trackfg.smoothing.reassessment import SolvedRun

HALF_PIVOTS_M = 9.0
"""Half the distance of a coach's pivots, m: 17 to 19 m of 26 m coaches, less of shorter bodies."""

_SHARPEST_1PM = 1.0 / 80.0
"""Sharper than the sharpest curves of a railway for such bodies (R 100 to 160): the vehicle is none on bogies."""

CELLS = 2
"""Curvature is that of the heading over so many cells to either side: irregularities are no curves."""

LEAST_SD_M = 0.01
"""Sigmas below this are those of where the chainage is counted from."""

_HINT = "declare fixes more often: nothing else shows how long the track is"


def cut_per_cell(heading: Array) -> Array | None:
    """Return how much shorter the way is in each cell, m, for headings (n,) of cells: (n - 2 :data:`CELLS`,).

    None of a vehicle that turns more sharply than any on bogies.
    """
    curvature = chord_curvature(heading, CELLS) if len(heading) > 2 * CELLS else np.zeros(0)
    if np.max(np.abs(curvature), initial=0.0) > _SHARPEST_1PM:
        return None
    return np.asarray(0.5 * HALF_PIVOTS_M**2 * curvature**2 * STEP_M)


def doubt_of_cut(factor: float, most_m: float) -> Doubt:
    """Return the doubt of a chainage whose sigma is too small by a ``factor``, where a cut is ``most_m`` at most."""
    reason = f"a body on bogies {2 * HALF_PIVOTS_M:.0f} m apart would cut curves by {most_m:.2f} m"
    return Doubt(("chainage",), factor, reason, _HINT)


def cut_doubts(run: SolvedRun) -> list[Doubt]:
    """Return a doubt of the chainage of a body on springs, where it may have cut curves by more than its sigma."""
    if run.problem.family(FactorType.PATH) is not None or run.problem.family(FactorType.GRAVITY_TILT) is not None:
        return []
    states = run.solution.states
    way = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(states.odo.distance)))])
    cuts = cut_per_cell(passage(run).heading)
    if cuts is None:
        return []
    cut = np.interp(way, STEP_M * (np.arange(len(cuts) + 1) + CELLS), np.concatenate([[0.0], np.cumsum(cuts)]))
    fixes = run.problem.family(FactorType.ABSOLUTE_FIX)
    known = np.unique(fixes.slots[0].index) if fixes is not None and len(fixes) else np.array([0])
    error = cut - np.interp(way, way[known], cut[known])
    variance = keyframe_variances(states, run.covariance, run.problem.run.lever_arm)[:, QUANTITIES.index("chainage_m")]
    sure = variance > LEAST_SD_M**2
    if not sure.any():
        return []
    factor = math.sqrt(1.0 + float(np.mean(error[sure] ** 2 / variance[sure])))
    return [doubt_of_cut(factor, float(np.max(np.abs(error))))] if factor >= LEAST_WIDENING else []

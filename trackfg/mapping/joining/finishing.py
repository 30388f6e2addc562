"""The finished map: a survey moved to the joint solution of its runs."""

from __future__ import annotations

from functools import partial

import numpy as np
import pandas as pd

from trackfg.curves import find_curves
from trackfg.mapping.joining.anchors import is_chainage, sighted_values
from trackfg.mapping.joining.design import cant_profile
from trackfg.mapping.joining.joint_solution import JointSolution
from trackfg.mapping.joining.landmarks import landmarks
from trackfg.mapping.joining.reference_line import drawn_line, moved_line, positions_on
from trackfg.mapping.joining.survey import Chainages, Survey, SurveyedRun
from trackfg.mapping.recognition.warp import Warp, warped
from trackfg.maps.feature_map import GRID_COLUMNS, RUN_COLUMNS, FeatureMap, RunInformation
from trackfg.numerics.arrays import Array
from trackfg.results.place_covariance import interpolated_variance, interpolation_weights
from trackfg.results.summary import versions

_NO_LENGTH_M2 = 1e-6
"""Moment of a run's anchors about their middle, m^2, where it passed one alone, so that there is no slope."""


def finished(survey: Survey) -> FeatureMap:
    """Return the map of a survey: grid, line and landmarks moved to the joint solution."""
    assert survey.grid is not None
    assert survey.conventions is not None
    at = survey.chainages
    move = Warp(np.array([survey.place[anchor] for anchor in at.anchors]), at.place)
    grid = warped(survey.grid, move, survey.conventions.step_m)
    x = grid["chainage_m"].to_numpy()
    grid["chainage_m_sd"] = np.sqrt(interpolated_variance(at.place, at.covariance, x))
    anchors, place, level, covariance = at.levels()
    if anchors:
        change = level - np.array([survey.level[anchor] for anchor in anchors])
        grid["cross_level_mm"] += np.interp(x, place, change)
        grid["cross_level_mm_sd"] = np.sqrt(
            grid["cross_level_mm_sd"] ** 2 + interpolated_variance(place, covariance, x)
        )
    curves = find_curves(grid, base_m=survey.conventions.curvature_base_m)
    grid["cant_mm"], grid["cant_mm_sd"] = cant_profile(curves, x)
    line = drawn_line(grid) if survey.line is None else moved_line(survey.line, move)

    def place_covariance(chainage: Array) -> Array:
        weights = interpolation_weights(at.place, chainage)
        return np.asarray(weights @ at.covariance @ weights.T)

    def observations(chainage: Array) -> np.ndarray:
        nearest = np.clip(np.searchsorted(x, chainage), 0, len(x) - 1)
        return grid["observations"].to_numpy()[nearest]

    table, covariance_of_landmarks = landmarks(
        curves, survey.landmarks, place_covariance, partial(positions_on, line), observations
    )
    return FeatureMap(
        name=survey.name,
        conventions=survey.conventions,
        landmarks=table,
        covariance=covariance_of_landmarks,
        grid=grid[list(GRID_COLUMNS)],
        line=line,
        runs=_run_table(survey, at),
        information=dict(survey.information),
        configuration=dict(survey.configuration),
        software=versions(),
        origin=survey.origin,
        pooled=survey.pooled,
        parent=survey.version,
    )


def _run_table(survey: Survey, at: Chainages) -> pd.DataFrame:
    """Return what each run differed by, from its own values at the anchors and the map's."""
    rows = [_run_row(run_id, run, survey.information[run_id], at.joint) for run_id, run in survey.runs.items()]
    return pd.DataFrame(rows, columns=list(RUN_COLUMNS))


def _run_row(
    run_id: str, run: SurveyedRun, information: RunInformation, joint: JointSolution
) -> tuple[str | float, ...]:
    """Return a row of :data:`~trackfg.maps.feature_map.RUN_COLUMNS`.

    Offset and scale are those of the straight line through the anchors, the bias is the mean over them.
    """
    values = sighted_values(information)
    sighted, names = values.to_numpy(), list(values.index)
    which = joint.rows(names)
    is_place = np.array([is_chainage(name) for name in names])
    x, places, levels = sighted[is_place], which[is_place], which[~is_place]
    about_middle = x - x.mean()
    line = np.array([np.full(len(x), 1.0 / len(x)), about_middle / max(about_middle @ about_middle, _NO_LENGTH_M2)])
    (middle, slope), spread = line @ joint.x[places], line @ joint.covariance[np.ix_(places, places)] @ line.T
    scale, scale_sd = (float(slope), float(np.sqrt(spread[1, 1]))) if len(x) > 1 else (1.0, np.nan)
    to_zero = np.array([1.0, -x.mean()])
    bias, bias_sd = np.nan, np.nan
    if len(levels):
        bias = run.facts.direction * float((sighted[~is_place] - joint.x[levels]).mean())
        bias_sd = float(np.sqrt(joint.covariance[np.ix_(levels, levels)].mean()))
    return (
        run_id,
        run.recording_id,
        run.facts.start or "",
        run.facts.content_sha256,
        run.facts.direction,
        float(middle - scale * x.mean()),
        float(np.sqrt(to_zero @ spread @ to_zero)),
        scale,
        scale_sd,
        bias,
        bias_sd,
    )

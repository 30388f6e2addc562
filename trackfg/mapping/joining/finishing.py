"""A survey moved to the joint solution of its runs: the map."""

from __future__ import annotations

from functools import partial

import numpy as np
import pandas as pd

from trackfg.curves import find_curves
from trackfg.mapping.joining.anchors import seen_by
from trackfg.mapping.joining.design import cant_profile
from trackfg.mapping.joining.joint_solution import Joint
from trackfg.mapping.joining.landmarks import landmarks
from trackfg.mapping.joining.reference_line import drawn_line, moved_line, positions_on
from trackfg.mapping.joining.survey import Chainages, Survey, SurveyedRun
from trackfg.mapping.recognition.warp import Warp, warped
from trackfg.maps.feature_map import GRID_COLUMNS, RUN_COLUMNS, FeatureMap, RunInformation
from trackfg.numerics.arrays import Array
from trackfg.results.place_covariance import interpolated_variance, interpolation_weights
from trackfg.results.summary import versions


def finished(survey: Survey) -> FeatureMap:
    """Everything moved to the joint solution."""
    assert survey.grid is not None
    assert survey.conventions is not None
    at = survey.at
    move = Warp(np.array([survey.place[mark] for mark in at.marks]), at.place)
    grid = warped(survey.grid, move, survey.conventions.step_m)
    x = grid["chainage_m"].to_numpy()
    grid["chainage_m_sd"] = np.sqrt(interpolated_variance(at.place, at.covariance, x))
    marks, place, level, covariance = at.levels()
    if marks:
        change = level - np.array([survey.level[mark] for mark in marks])
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
        parent=survey.version,
    )


def _run_table(survey: Survey, at: Chainages) -> pd.DataFrame:
    """What each run brought along, from its own values at the marks and the map's."""
    rows = [_run_row(run_id, run, survey.information[run_id], at.joint) for run_id, run in survey.runs.items()]
    return pd.DataFrame(rows, columns=list(RUN_COLUMNS))


def _run_row(run_id: str, run: SurveyedRun, information: RunInformation, joint: Joint) -> tuple[str | float, ...]:
    """Offset and scale are those of the straight line through the marks, the bias is the mean over them."""
    own = seen_by(information)
    place, level = own[own.index.str.endswith("/chainage_m")], own[own.index.str.endswith("/cross_level_mm")]
    x, which = place.to_numpy(), joint.rows(list(place.index))
    line = np.vander(x - x.mean(), min(2, len(x)), increasing=True)
    fit = np.linalg.pinv(line)
    (middle, *slope), spread = fit @ joint.x[which], fit @ joint.covariance[np.ix_(which, which)] @ fit.T
    scale, scale_sd = (slope[0], np.sqrt(spread[1, 1])) if slope else (1.0, np.nan)
    to_zero = np.array([1.0, -x.mean()])[: len(fit)]
    bias, bias_sd = np.nan, np.nan
    if len(level):
        which = joint.rows(list(level.index))
        bias = run.facts.direction * float((level.to_numpy() - joint.x[which]).mean())
        bias_sd = float(np.sqrt(joint.covariance[np.ix_(which, which)].mean()))
    return (
        run_id,
        run.recording_id,
        run.facts.start or "",
        run.facts.content_sha256,
        run.facts.direction,
        float(middle - scale * x.mean()),
        float(np.sqrt(to_zero @ spread @ to_zero)),
        float(scale),
        float(scale_sd),
        bias,
        bias_sd,
    )

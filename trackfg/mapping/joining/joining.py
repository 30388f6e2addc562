"""One run joined to a survey: recognised on its grid, said in its variables, merged into it."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pandas as pd

from trackfg.errors import BadInputError
from trackfg.mapping.joining.anchors import (
    WINDOW_M,
    Sensor,
    Sightings,
    chainage_variable,
    mark_names,
    roll_variable,
    said_of_marks,
    sensor_of,
    without_wrong,
)
from trackfg.mapping.joining.merging import MERGED, local_cross_level_sd, merged, window_means, with_place_noise
from trackfg.mapping.joining.reference_line import positions_of_run, with_positions
from trackfg.mapping.joining.survey import Chainages, Survey, SurveyedRun
from trackfg.mapping.recognition.conventions import check_conventions, laid_over
from trackfg.mapping.recognition.recognition import Recognition
from trackfg.mapping.recognition.warp import Warp, warped
from trackfg.maps.feature_map import MapConventions
from trackfg.numerics.arrays import Array
from trackfg.numerics.chainage_grid import multiples_between
from trackfg.results.place_covariance import APART_M
from trackfg.results.result import Result
from trackfg.results.summary import RunFacts

_NEAR_SECTION_M = 150.0
"""A mark counts as seen where a recognised section is this near."""
_NEW_MARK_M = 0.5 * APART_M
_END_MARK_M = 0.2 * APART_M
_OVERLAP_M = 300.0
"""Runs that share less than this can be joined by their chainages alone."""
_BETWEEN_SECTIONS_SD_M = 4e-3
"""What a wheel's creep, 1 mm per root of a metre, does between the middles of sections 100 m apart."""
_NOTHING_SEEN = Sightings((), np.zeros(0), np.zeros(0), np.zeros(0))


def run_facts(result: Result) -> RunFacts:
    facts, what = result.summary.run, f"run {result.summary.recording_id}"
    if facts is None:
        raise BadInputError(f"{what}: smoothed by an older version: smooth it again")
    if result.summary.map is not None and result.summary.map.sections:
        raise BadInputError(f"{what}: smoothed with a map: a map would be told what it said itself; smooth without")
    if len(result.covariance.chainage_m) == 0:
        raise BadInputError(f"{what}: its result has no track geometry, so it says nothing of the track")
    return facts


def joined(survey: Survey, result: Result) -> Survey:
    """The survey with one run more, on the grid as it is.

    Raises :class:`~trackfg.errors.BadInputError` for a run that says nothing of the track, is in the survey already,
    has other conventions, or is not recognised.
    """
    facts, conventions = run_facts(result), _conventions(result)
    run_id = _run_id(survey, result.summary.recording_id, facts)
    if survey.conventions is not None:
        check_conventions(result.summary.geometry, survey.conventions, run_id)
    there = result.geometry[result.geometry[list(MERGED)].notna().any(axis=1)].assign(observations=1)
    there = there.assign(cross_level_mm_sd=local_cross_level_sd(there))
    to_map, old = Warp(np.zeros(1), np.zeros(1)), _NOTHING_SEEN
    if survey.grid is not None:
        to_map, recognition = _place(survey, run_id, result, facts)
        there = warped(there, to_map, conventions.step_m)
        old = _seen_again(survey, there, to_map, recognition)
        old = old[_agreeing(survey.at, old, result, anchored=facts.anchored and survey.anchored)]
        if recognition is not None:
            match_sd = recognition.sections["match_sd_m"].median()
            there = with_place_noise(there, float(np.hypot(match_sd, _BETWEEN_SECTIONS_SD_M)))
    there = there.assign(cross_level_mm=there["cross_level_mm"] - _offset(survey, old, there["chainage_m"].to_numpy()))
    new, places = _new_marks(survey, there, to_map)
    if survey.grid is not None and not old.marks and not (new.marks and facts.anchored and survey.anchored):
        raise BadInputError(
            f"run {run_id}: it passes none of the map's places, some {APART_M:g} m apart, that runs are tied to: "
            "expected a longer run"
        )
    information = said_of_marks(
        run_id,
        _together(old, replace(new, cross_level_mm=new.cross_level_mm + _offset(survey, old, places))),
        result.covariance,
        _sensor(survey, run_id, facts, conventions.cross_level_base_m),
        anchored=facts.anchored,
    )
    line = _line_seen(survey, result, facts, to_map)
    level = {mark: mean for mark, mean in zip(new.marks, new.cross_level_mm.tolist(), strict=True) if np.isfinite(mean)}
    return replace(
        survey,
        conventions=conventions,
        grid=there[["chainage_m", *_merged_columns()]] if survey.grid is None else merged(survey.grid, there),
        line=line if survey.line is None else survey.line if line is None else with_positions(survey.line, line),
        origin=survey.origin or facts.origin,
        place={**survey.place, **dict(zip(new.marks, places.tolist(), strict=True))},
        level={**survey.level, **level},
        information={**survey.information, run_id: information},
        runs={**survey.runs, run_id: SurveyedRun(result.summary.recording_id, facts)},
        configuration={**survey.configuration, run_id: dict(result.summary.configuration)},
    )


def _sensor(survey: Survey, run_id: str, facts: RunFacts, cross_level_base_m: float) -> Sensor | None:
    """Return the run's sensor, None where its description gives the roll of the mounting without a sigma."""
    if facts.mount_roll_sd_rad == 0.0:
        return None
    name = sensor_of(facts.imu_id, run_id)
    in_map = roll_variable(name) in survey.variables
    return Sensor(name, None if in_map else facts.mount_roll_sd_rad, facts.direction * cross_level_base_m)


def _merged_columns() -> list[str]:
    return [*(column for name in MERGED for column in (name, f"{name}_sd")), "observations"]


def _run_id(survey: Survey, recording_id: str, facts: RunFacts) -> str:
    for run_id, run in survey.runs.items():
        if run.facts.content_sha256 == facts.content_sha256:
            raise BadInputError(f"run {recording_id}: is in the map already, as {run_id}")
    taken, number, run_id = set(survey.runs), 1, recording_id
    while run_id in taken:
        number += 1
        run_id = f"{recording_id}-{number}"
    return run_id


def _place(survey: Survey, run_id: str, result: Result, facts: RunFacts) -> tuple[Warp, Recognition | None]:
    """From the run's chainage to the grid's, and what was recognised; None where it has no track in common."""
    grid = survey.grid
    assert grid is not None
    both = facts.anchored and survey.anchored
    map_sd = float(np.sqrt(np.median(np.diag(survey.at.covariance))))
    recognition = laid_over(result, grid, map_sd if both else None)
    to_map = recognition.warp
    if to_map is not None:
        return to_map, recognition
    mine, theirs = result.geometry["chainage_m"], grid["chainage_m"]
    overlap = min(mine.iloc[-1], theirs.iloc[-1]) - max(mine.iloc[0], theirs.iloc[0])
    if both and overlap < _OVERLAP_M:
        return Warp(np.zeros(1), np.zeros(1)), None
    raise BadInputError(
        f"run {run_id}: its track is not recognised on the map, which reaches from {theirs.iloc[0]:.0f} m to "
        f"{theirs.iloc[-1]:.0f} m: expected a run over the same track"
    )


def _seen_again(survey: Survey, there: pd.DataFrame, to_map: Warp, match: Recognition | None) -> Sightings:
    """The map's marks that the run passed and that a recognised section is near to."""
    if match is None:
        return _NOTHING_SEEN
    assert survey.grid is not None
    used = match.used.sort_values("reference_m")
    marks = sorted(survey.place, key=lambda mark: survey.place[mark])
    places = np.array([survey.place[mark] for mark in marks])
    section = used["reference_m"].to_numpy()
    covered = there["chainage_m"].to_numpy()
    seen = (_distance(places, section) <= _NEAR_SECTION_M) & (_distance(places, covered) <= 1.0)
    places = places[seen]
    both = survey.grid[["chainage_m", "cross_level_mm"]].merge(
        there[["chainage_m", "cross_level_mm"]].round({"chainage_m": 6}), on="chainage_m", suffixes=("", "_run")
    )
    both["more"] = both["cross_level_mm_run"] - both["cross_level_mm"]
    kept = tuple(mark for mark, is_seen in zip(marks, seen, strict=True) if is_seen)
    level = np.array([survey.level.get(mark, np.nan) for mark in kept])
    more = window_means(both, "more", places, WINDOW_M) if len(both) > 1 else np.full(len(places), np.nan)
    return Sightings(kept, to_map.inverse(places), np.interp(places, section, used["match_sd_m"]), level + more)


def _agreeing(at: Chainages, seen: Sightings, result: Result, *, anchored: bool) -> np.ndarray:
    """Which sightings do not contradict what the runs before say."""
    if not seen.marks:
        return np.zeros(0, dtype=bool)
    rows = at.joint.rows([chainage_variable(mark) for mark in seen.marks])
    covariance = at.joint.covariance[np.ix_(rows, rows)]
    return without_wrong(seen, result.covariance, at.joint.x[rows], covariance, anchored=anchored)


def _offset(survey: Survey, old: Sightings, chainage: Array) -> Array:
    """By how much the run's cross-level is above the grid's, mm: known at the marks seen again, linear in between."""
    places = np.array([survey.place[mark] for mark in old.marks])
    offset = old.cross_level_mm - np.array([survey.level.get(mark, np.nan) for mark in old.marks])
    known = np.isfinite(offset)
    return np.interp(chainage, places[known], offset[known]) if known.any() else np.zeros(len(chainage))


def _new_marks(survey: Survey, there: pd.DataFrame, to_map: Warp) -> tuple[Sightings, Array]:
    """Marks where the run passed and the map has none, with the grid's cross-level, and their places on the grid."""
    x = there["chainage_m"].to_numpy()
    at = np.array(list(survey.place.values()))
    regular = multiples_between(x[0], x[-1], APART_M)
    regular = regular[(_distance(regular, at) >= _NEW_MARK_M) & (_distance(regular, x) <= 1.0)]
    ends = x[[0, -1]]
    ends = ends[_distance(ends, np.concatenate([at, regular])) >= _END_MARK_M]
    places = np.sort(np.concatenate([regular, ends]))
    levels = window_means(there, "cross_level_mm", places, WINDOW_M)
    taken, names = set(survey.place), []
    for name in mark_names(places):
        while name in taken:
            name += "'"
        taken.add(name)
        names.append(name)
    return Sightings(tuple(names), to_map.inverse(places), np.zeros(len(places)), levels), places


def _together(a: Sightings, b: Sightings) -> Sightings:
    order = np.argsort(np.concatenate([a.chainage_m, b.chainage_m]), kind="stable")
    both = Sightings(
        a.marks + b.marks,
        np.concatenate([a.chainage_m, b.chainage_m]),
        np.concatenate([a.match_sd_m, b.match_sd_m]),
        np.concatenate([a.cross_level_mm, b.cross_level_mm]),
    )
    return both[order]


def _distance(places: Array, others: Array) -> Array:
    """From each place to the nearest of the others."""
    if len(others) == 0:
        return np.full(len(places), np.inf)
    others = np.sort(others)
    right = np.clip(np.searchsorted(others, places), 0, len(others) - 1)
    left = np.maximum(right - 1, 0)
    return np.asarray(np.minimum(np.abs(places - others[left]), np.abs(places - others[right])))


def _line_seen(survey: Survey, result: Result, facts: RunFacts, to_map: Warp) -> pd.DataFrame | None:
    if facts.origin is None:
        return None
    return positions_of_run(result.trajectory, to_map, facts.origin, survey.origin or facts.origin)


def _conventions(result: Result) -> MapConventions:
    meaning = result.summary.geometry
    return MapConventions(**{part.name: getattr(meaning, part.name) for part in fields(MapConventions)})

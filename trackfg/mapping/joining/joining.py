"""Runs joined to a survey: recognised on its grid, condensed to rows on its variables, merged into its grid."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace

import numpy as np
import pandas as pd
from pydantic import JsonValue

from trackfg.errors import BadInputError
from trackfg.mapping.joining.anchors import (
    WINDOW_M,
    Sensor,
    Sightings,
    information_on_anchors,
    sensor_name,
)
from trackfg.mapping.joining.merging import MERGED, local_cross_level_sd, merged, window_means
from trackfg.mapping.joining.placement import placement
from trackfg.mapping.joining.reference_line import Origin, positions_of_run, with_positions
from trackfg.mapping.joining.survey import Survey, SurveyedRun
from trackfg.mapping.joining.unstated_sigmas import with_unstated_sigmas
from trackfg.mapping.recognition.conventions import check_conventions
from trackfg.mapping.recognition.warp import Warp
from trackfg.maps.feature_map import FeatureMap, MapConventions, RunInformation
from trackfg.numerics.arrays import Array
from trackfg.numerics.chainage.chainage_grid import multiples_between
from trackfg.numerics.spans import distance_to_nearest
from trackfg.results.place_covariance import APART_M
from trackfg.results.result import Result
from trackfg.results.summary import RunFacts, Summary

_NEW_ANCHOR_M = 0.5 * APART_M
"""Distance to the next anchor, m, from which a new one is made at a multiple of the spacing."""
_END_ANCHOR_M = 0.2 * APART_M
"""Distance to the next anchor, m, from which a new one is made at a run's end."""
_PLACE = "result"
"""Key of the place of a run's result among its settings in a map."""
_KILOMETRAGE = "kilometrage"
"""Key of the kilometrage, by the map's chainage, among the settings of a run whose chainage is the map's."""


def run_facts(summary: Summary) -> RunFacts:
    """Return the facts of a run that a map needs.

    Raises :class:`BadInputError` for a result without any, and for one that is not to be trusted.
    """
    facts, what = summary.run, f"run {summary.recording_id}"
    if facts is None:
        raise BadInputError(f"{what}: smoothed by an older version: smooth it again")
    if summary.map is not None and summary.map.sections:
        raise BadInputError(f"{what}: smoothed with a map, so its chainage is the map's: expected one smoothed without")
    for verdict in summary.verdicts:
        if verdict.quantity in ("chainage", "cross_level") and verdict.status == "not_trusted":
            raise BadInputError(
                f"{what}: its {verdict.quantity.replace('_', '-')} is not to be trusted: {verdict.reasons[0]}. "
                f"Hint: {verdict.hints[0]}"
            )
    return facts


@dataclass(frozen=True)
class Part:
    """The part that runs add to a survey, on its grid and on its variables; parts of one survey are added in any
    groups.

    ``grid`` and ``line``: their profiles and positions, averaged. ``place``, ``level``: of new anchors. ``origin`` is
    that of the line's frame. ``doubts``: by run, what a user should know of it.
    """

    conventions: MapConventions
    grid: pd.DataFrame
    line: pd.DataFrame | None
    origin: Origin | None
    information: Mapping[str, RunInformation]
    runs: Mapping[str, SurveyedRun]
    configuration: Mapping[str, JsonValue]
    place: Mapping[str, float]
    level: Mapping[str, float]
    doubts: Mapping[str, str]

    def makes_longer(self, survey: Survey) -> bool:
        """Return whether the part has anchors or a frame that the survey has not, so that further runs build on it."""
        return bool(self.place) or (survey.origin is None and self.origin is not None)


def joined(survey: Survey, part: Part) -> Survey:
    """Return the survey with what runs add to it."""
    return replace(
        survey.with_information(part.runs, part.information),
        conventions=part.conventions,
        grid=part.grid if survey.grid is None else merged(survey.grid, part.grid),
        line=_averaged_line(survey.line, part.line),
        origin=survey.origin or part.origin,
        place={**survey.place, **part.place},
        level={**survey.level, **part.level},
        doubts={**survey.doubts, **part.doubts},
        configuration={**_still_valid(survey, part), **part.configuration},
    )


def _still_valid(survey: Survey, part: Part) -> Mapping[str, JsonValue]:
    """Return the settings of the survey's runs, without kilometrages that counted from the start of its first run, once
    a run with fixes has one that counts as the map does from then on.
    """
    anchors_it = any(run.facts.anchored and run.facts.kilometrage is not None for run in part.runs.values())
    if survey.anchored or not anchors_it:
        return survey.configuration
    return {
        run_id: {key: value for key, value in settings.items() if key != _KILOMETRAGE}
        if isinstance(settings, dict)
        else settings
        for run_id, settings in survey.configuration.items()
    }


def together(a: Part, b: Part) -> Part:
    """Return what two parts of one survey add to it, neither of which makes it longer."""
    return replace(
        a,
        grid=merged(a.grid, b.grid),
        line=_averaged_line(a.line, b.line),
        information={**a.information, **b.information},
        runs={**a.runs, **b.runs},
        configuration={**a.configuration, **b.configuration},
        doubts={**a.doubts, **b.doubts},
    )


def part_of_run(survey: Survey, run_id: str, result: Result, place: str | None = None) -> Part:
    """Return what a run adds to a survey: recognised on its grid, condensed to rows on its variables.

    ``place`` is where its result is kept, which the map remembers. Raises
    :class:`~trackfg.errors.BadInputError` for a run without track geometry, with other conventions, or that is not
    recognised.
    """
    facts, conventions = run_facts(result.summary), _conventions(result)
    profile = _own_profile(result, run_id)
    if survey.conventions is not None:
        check_conventions(result.summary.geometry, survey.conventions, run_id)
    place_on_survey = placement(survey, run_id, result, facts, profile)
    profile, to_map, sighted = place_on_survey.profile, place_on_survey.to_map, place_on_survey.sighted
    offset = _offset(survey, sighted, profile["chainage_m"].to_numpy())
    profile = profile.assign(cross_level_mm=profile["cross_level_mm"] - offset)
    added, places = _new_anchors(survey, profile, to_map, sighted)
    if survey.grid is not None and not sighted.anchors and not (added.anchors and facts.anchored and survey.anchored):
        raise BadInputError(
            f"run {run_id}: it passes none of the map's anchors, which are some {APART_M:g} m apart: "
            "expected a longer run"
        )
    information = information_on_anchors(
        run_id,
        _in_order(sighted, replace(added, cross_level_mm=added.cross_level_mm + _offset(survey, sighted, places))),
        result.covariance,
        _sensor(run_id, facts, conventions.cross_level_base_m),
        anchored=facts.anchored,
    )
    level = {
        anchor: mean
        for anchor, mean in zip(added.anchors, added.cross_level_mm.tolist(), strict=True)
        if np.isfinite(mean)
    }
    return Part(
        conventions=conventions,
        grid=profile[["chainage_m", *(column for name in MERGED for column in (name, f"{name}_sd")), "observations"]],
        line=_line_seen(survey, result, facts, to_map),
        origin=survey.origin or facts.origin,
        information={run_id: information},
        runs={run_id: SurveyedRun(result.summary.recording_id, facts)},
        configuration={run_id: _configuration(survey, result, facts, place)},
        place=dict(zip(added.anchors, places.tolist(), strict=True)),
        level=level,
        doubts=place_on_survey.doubts,
    )


def _own_profile(result: Result, run_id: str) -> pd.DataFrame:
    """Return the measured rows of a run's geometry, by its own chainage, with the sigmas that a map needs."""
    measured = result.geometry[list(MERGED)].notna().any(axis=1)
    if len(result.covariance.chainage_m) == 0 or measured.sum() < 2:
        raise BadInputError(f"run {run_id}: its result has no track geometry, or one row of it: a map needs more")
    geometry = with_unstated_sigmas(result.geometry, (*MERGED, "twist_mm"))
    profile = geometry[measured].assign(observations=1)
    return profile.assign(cross_level_mm_sd=local_cross_level_sd(profile))


def _averaged_line(a: pd.DataFrame | None, b: pd.DataFrame | None) -> pd.DataFrame | None:
    return b if a is None else a if b is None else with_positions(a, b)


def place_of_result(feature_map: FeatureMap, run_id: str) -> str:
    """Return where the result of a run was when it was joined.

    Raises :class:`BadInputError` where the map does not say.
    """
    settings = feature_map.configuration.get(run_id)
    place = settings.get(_PLACE) if isinstance(settings, dict) else None
    if not isinstance(place, str):
        raise BadInputError(f"run {run_id}: the map does not say where its result is")
    return place


def _configuration(survey: Survey, result: Result, facts: RunFacts, place: str | None) -> dict[str, JsonValue]:
    """Return the settings of a run, with its kilometrage where its chainage is the map's, and its result's place."""
    settings = dict(result.summary.configuration)
    if place is not None:
        settings[_PLACE] = place
    shared = survey.grid is None or facts.anchored  # with a fix the map counts as the fixes do
    if shared and facts.kilometrage is not None:
        settings[_KILOMETRAGE] = facts.kilometrage.model_dump(mode="json")
    return settings


def _sensor(run_id: str, facts: RunFacts, cross_level_base_m: float) -> Sensor | None:
    """Return the run's sensor, None where its description gives the roll of the mounting without a sigma."""
    if facts.mount_roll_sd_rad == 0.0:
        return None
    return Sensor(sensor_name(facts.imu_id, run_id), facts.direction * cross_level_base_m)


def _offset(survey: Survey, sightings: Sightings, chainage: Array) -> Array:
    """Return by how much the run's cross-level is above the grid's, mm: known at sighted anchors, linear in between."""
    places = np.array([survey.place[anchor] for anchor in sightings.anchors])
    offset = sightings.cross_level_mm - np.array([survey.level.get(anchor, np.nan) for anchor in sightings.anchors])
    known = np.isfinite(offset)
    return np.interp(chainage, places[known], offset[known]) if known.any() else np.zeros(len(chainage))


def _new_anchors(survey: Survey, profile: pd.DataFrame, to_map: Warp, sighted: Sightings) -> tuple[Sightings, Array]:
    """Return sightings of new anchors, where the map has none, with the grid's cross-level, and their places on it.

    A run that sighted anchors gets none at an end of it that lies between the map's anchors.
    """
    x = profile["chainage_m"].to_numpy()
    at = np.array(list(survey.place.values()))
    regular = multiples_between(x[0], x[-1], APART_M)
    regular = regular[(distance_to_nearest(regular, at) >= _NEW_ANCHOR_M) & (distance_to_nearest(regular, x) <= 1.0)]
    ends = x[[0, -1]]
    if sighted.anchors:
        ends = ends[(ends < at.min()) | (ends > at.max())]
    ends = ends[distance_to_nearest(ends, np.concatenate([at, regular])) >= _END_ANCHOR_M]
    places = np.sort(np.concatenate([regular, ends]))
    levels = window_means(profile, "cross_level_mm", places, WINDOW_M)
    taken, names = set(survey.place), []
    for place in places:
        name = f"{place:.0f}"  # in whole metres
        while name in taken:
            name += "'"
        taken.add(name)
        names.append(name)
    return Sightings(tuple(names), to_map.inverse(places), np.zeros(len(places)), levels), places


def _in_order(a: Sightings, b: Sightings) -> Sightings:
    order = np.argsort(np.concatenate([a.chainage_m, b.chainage_m]), kind="stable")
    both = Sightings(
        a.anchors + b.anchors,
        np.concatenate([a.chainage_m, b.chainage_m]),
        np.concatenate([a.match_sd_m, b.match_sd_m]),
        np.concatenate([a.cross_level_mm, b.cross_level_mm]),
    )
    return both[order]


def _line_seen(survey: Survey, result: Result, facts: RunFacts, to_map: Warp) -> pd.DataFrame | None:
    """Return where the run passed the line's vertices; None where it has no places on the Earth, or passed none."""
    if facts.origin is None:
        return None
    line = positions_of_run(result.trajectory, to_map, facts.origin, survey.origin or facts.origin)
    return None if line.empty else line


def _conventions(result: Result) -> MapConventions:
    meaning = result.summary.geometry
    return MapConventions(**{part.name: getattr(meaning, part.name) for part in fields(MapConventions)})

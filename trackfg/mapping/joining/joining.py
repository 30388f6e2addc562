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
    WRONG_SIGMAS,
    Sensor,
    Sightings,
    agreeing_sightings,
    chainage_variable,
    information_on_anchors,
    offset_of_run,
    sensor_name,
)
from trackfg.mapping.joining.merging import MERGED, local_cross_level_sd, merged, window_means, with_place_noise
from trackfg.mapping.joining.reference_line import Origin, positions_of_run, with_positions
from trackfg.mapping.joining.survey import Chainages, Survey, SurveyedRun
from trackfg.mapping.joining.unstated_sigmas import with_unstated_sigmas
from trackfg.mapping.recognition.conventions import check_conventions, recognised_on_map
from trackfg.mapping.recognition.other_track import TELLING, is_other_track, other_track_message
from trackfg.mapping.recognition.recognition import Recognition
from trackfg.mapping.recognition.warp import Warp, warped
from trackfg.maps.feature_map import FeatureMap, MapConventions, RunInformation
from trackfg.numerics.arrays import Array
from trackfg.numerics.chainage.chainage_grid import multiples_between
from trackfg.results.place_covariance import APART_M
from trackfg.results.result import Result
from trackfg.results.summary import RunFacts, Summary

_NEAR_SECTION_M = 150.0
"""An anchor counts as sighted where the middle of a recognised section is this near, m: 1.5 sections."""
_NEW_ANCHOR_M = 0.5 * APART_M
"""Distance to the next anchor, m, from which a new one is made at a multiple of the spacing."""
_END_ANCHOR_M = 0.2 * APART_M
"""Distance to the next anchor, m, from which a new one is made at a run's end."""
_OVERLAP_M = 300.0
"""Runs with fixes that share less than this, m, are joined by their chainages alone: three sections are too few to
recognise."""
_BETWEEN_SECTIONS_SD_M = 4e-3
"""Sigma, m, of the chainage half way between the middles of two sections 100 m apart: a creep of 1 mm per root of a
metre, as a bridge, has 5 mm there and 4 mm on average."""
_PLACE = "result"
"""Key of the place of a run's result among its settings in a map."""
_KILOMETRAGE = "kilometrage"
"""Key of the kilometrage, by the map's chainage, among the settings of a run whose chainage is the map's."""
_NO_SIGHTINGS = Sightings((), np.zeros(0), np.zeros(0), np.zeros(0))


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
    measured = result.geometry[list(MERGED)].notna().any(axis=1)
    if len(result.covariance.chainage_m) == 0 or measured.sum() < 2:
        raise BadInputError(f"run {run_id}: its result has no track geometry, or one row of it: a map needs more")
    if survey.conventions is not None:
        check_conventions(result.summary.geometry, survey.conventions, run_id)
    geometry = with_unstated_sigmas(result.geometry, (*MERGED, "twist_mm"))
    profile = geometry[measured].assign(observations=1)
    profile = profile.assign(cross_level_mm_sd=local_cross_level_sd(profile))
    to_map, sighted, doubts = Warp(np.zeros(1), np.zeros(1)), _NO_SIGHTINGS, dict[str, str]()
    if survey.grid is not None:
        to_map, recognition = _place(survey, run_id, result, facts)
        profile = warped(profile, to_map, conventions.step_m)
        sighted = _sightings_of_known_anchors(survey, profile, to_map, recognition)
        both = facts.anchored and survey.anchored
        sighted = sighted[_agreeing(survey.chainages, sighted, result, anchored=both)]
        if both and sighted.anchors:
            _refuse_other_fixes(survey.chainages, sighted, result, run_id)
        if recognition is not None:
            if _of_other_track(profile, survey.grid, recognition):
                doubts = {run_id: other_track_message(result.summary.recording_id, survey.name)}
            match_sd = recognition.sections["match_sd_m"].median()
            profile = with_place_noise(profile, float(np.hypot(match_sd, _BETWEEN_SECTIONS_SD_M)))
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
        doubts=doubts,
    )


def _of_other_track(profile: pd.DataFrame, grid: pd.DataFrame, recognition: Recognition) -> bool:
    """Return whether a run, on the grid's cells, is of another track than the grid."""
    columns = ["chainage_m", TELLING, f"{TELLING}_sd"]
    run, reference = (table[columns].round({"chainage_m": 6}) for table in (profile, grid))
    both = run.merge(reference, on="chainage_m", suffixes=("", "_map"))
    place, of_run, run_sd, of_map, map_sd = both.to_numpy().T
    return is_other_track(place, of_run - of_map, np.hypot(run_sd, map_sd), of_map, recognition.used)


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


def _place(survey: Survey, run_id: str, result: Result, facts: RunFacts) -> tuple[Warp, Recognition | None]:
    """Return the function from the run's chainage to the grid's, and the recognition; None if they share no track."""
    grid = survey.grid
    assert grid is not None
    both = facts.anchored and survey.anchored
    map_sd = float(np.sqrt(np.median(np.diag(survey.chainages.covariance))))
    recognition = recognised_on_map(result, grid, map_sd if both else None)
    to_map = recognition.warp
    if to_map is not None:
        return to_map, recognition
    of_run, of_map = result.geometry["chainage_m"], grid["chainage_m"]
    overlap = min(of_run.iloc[-1], of_map.iloc[-1]) - max(of_run.iloc[0], of_map.iloc[0])
    if both and overlap < _OVERLAP_M:
        return Warp(np.zeros(1), np.zeros(1)), None
    raise BadInputError(
        f"run {run_id}: its track is not recognised on the map, which reaches from {of_map.iloc[0]:.0f} m to "
        f"{of_map.iloc[-1]:.0f} m: expected a run over the same track"
    )


def _sightings_of_known_anchors(
    survey: Survey, profile: pd.DataFrame, to_map: Warp, match: Recognition | None
) -> Sightings:
    """Return the sightings of those of the map's anchors that the run passed near a recognised section."""
    if match is None:
        return _NO_SIGHTINGS
    assert survey.grid is not None
    used = match.used.sort_values("reference_m")
    anchors = sorted(survey.place, key=lambda anchor: survey.place[anchor])
    places = np.array([survey.place[anchor] for anchor in anchors])
    section = used["reference_m"].to_numpy()
    covered = profile["chainage_m"].to_numpy()
    seen = (_distance(places, section) <= _NEAR_SECTION_M) & (_distance(places, covered) <= 1.0)
    places = places[seen]
    both = survey.grid[["chainage_m", "cross_level_mm"]].merge(
        profile[["chainage_m", "cross_level_mm"]].round({"chainage_m": 6}), on="chainage_m", suffixes=("", "_run")
    )
    both["more"] = both["cross_level_mm_run"] - both["cross_level_mm"]
    kept = tuple(anchor for anchor, is_seen in zip(anchors, seen, strict=True) if is_seen)
    level = np.array([survey.level.get(anchor, np.nan) for anchor in kept])
    more = window_means(both, "more", places, WINDOW_M) if len(both) > 1 else np.full(len(places), np.nan)
    return Sightings(kept, to_map.inverse(places), np.interp(places, section, used["match_sd_m"]), level + more)


def _agreeing(at: Chainages, sightings: Sightings, result: Result, *, anchored: bool) -> np.ndarray:
    """Return which sightings do not contradict the runs in the survey, bool (m,)."""
    if not sightings.anchors:
        return np.zeros(0, dtype=bool)
    return agreeing_sightings(sightings, result.covariance, *_anchors_of_survey(at, sightings), anchored=anchored)


def _refuse_other_fixes(at: Chainages, sightings: Sightings, result: Result, run_id: str) -> None:
    """Raise :class:`BadInputError` for a run whose fixes place it elsewhere than those of the runs in the survey do."""
    off, sd = offset_of_run(sightings, result.covariance, *_anchors_of_survey(at, sightings))
    if abs(off) > WRONG_SIGMAS * sd:
        where = f"{abs(off):.2f} m {'ahead of' if off > 0.0 else 'behind'} where the map has it"
        raise BadInputError(
            f"run {run_id}: its fixes place it {where}, {abs(off) / sd:.0f} times the sigma: expected fixes that agree "
            "with those of the map's runs. Hint: check their chainages, or smooth it without [fixes] to join it by its "
            "track"
        )


def _anchors_of_survey(at: Chainages, sightings: Sightings) -> tuple[Array, Array]:
    """Return where the survey has the anchors that were sighted, m (m,), and the covariance (m, m)."""
    rows = at.joint.rows([chainage_variable(anchor) for anchor in sightings.anchors])
    return at.joint.x[rows], at.joint.covariance[np.ix_(rows, rows)]


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
    regular = regular[(_distance(regular, at) >= _NEW_ANCHOR_M) & (_distance(regular, x) <= 1.0)]
    ends = x[[0, -1]]
    if sighted.anchors:
        ends = ends[(ends < at.min()) | (ends > at.max())]
    ends = ends[_distance(ends, np.concatenate([at, regular])) >= _END_ANCHOR_M]
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


def _distance(places: Array, others: Array) -> Array:
    """Return the distance from each place to the nearest of the others."""
    if len(others) == 0:
        return np.full(len(places), np.inf)
    others = np.sort(others)
    right = np.clip(np.searchsorted(others, places), 0, len(others) - 1)
    left = np.maximum(right - 1, 0)
    return np.asarray(np.minimum(np.abs(places - others[left]), np.abs(places - others[right])))


def _line_seen(survey: Survey, result: Result, facts: RunFacts, to_map: Warp) -> pd.DataFrame | None:
    """Return where the run passed the line's vertices; None where it has no places on the Earth, or passed none."""
    if facts.origin is None:
        return None
    line = positions_of_run(result.trajectory, to_map, facts.origin, survey.origin or facts.origin)
    return None if line.empty else line


def _conventions(result: Result) -> MapConventions:
    meaning = result.summary.geometry
    return MapConventions(**{part.name: getattr(meaning, part.name) for part in fields(MapConventions)})

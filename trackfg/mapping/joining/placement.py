"""Runs are placed on a survey: their geometry by the survey's chainage, the survey's anchors that they sighted."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import pandas as pd

from trackfg.errors import BadInputError
from trackfg.mapping.joining.anchors import (
    WINDOW_M,
    WRONG_SIGMAS,
    Sightings,
    agreeing_sightings,
    chainage_variable,
    offset_of_run,
)
from trackfg.mapping.joining.merging import window_means, with_place_noise
from trackfg.mapping.joining.survey import Chainages, Survey
from trackfg.mapping.recognition.conventions import recognised_on_map
from trackfg.mapping.recognition.other_track import TELLING, is_other_track, other_track_message
from trackfg.mapping.recognition.recognition import Recognition
from trackfg.mapping.recognition.warp import Warp, warped
from trackfg.numerics.arrays import Array
from trackfg.numerics.spans import distance_to_nearest
from trackfg.results.result import Result
from trackfg.results.summary import RunFacts

_NEAR_SECTION_M = 150.0
"""An anchor counts as sighted where the middle of a recognised section is this near, m: 1.5 sections."""
_OVERLAP_M = 300.0
"""Runs with fixes that share less than this, m, are joined by their chainages alone: three sections are too few to
recognise."""
_BETWEEN_SECTIONS_SD_M = 4e-3
"""Sigma, m, of the chainage half way between the middles of two sections 100 m apart: a creep of 1 mm per root of a
metre, as a bridge, has 5 mm there and 4 mm on average."""
_NO_SIGHTINGS = Sightings((), np.zeros(0), np.zeros(0), np.zeros(0))
_SAME_CHAINAGE = Warp(np.zeros(1), np.zeros(1))
"""The function to the map's chainage of a run whose chainage is the map's."""


@dataclass(frozen=True)
class Placement:
    """The ``profile`` of a run, by the survey's chainage; the function ``to_map`` from the run's chainage to that; the
    anchors that it ``sighted``; ``doubts``: by run, what a user should know of it.
    """

    profile: pd.DataFrame
    to_map: Warp = _SAME_CHAINAGE
    sighted: Sightings = _NO_SIGHTINGS
    doubts: Mapping[str, str] = field(default_factory=dict)


def placement(survey: Survey, run_id: str, result: Result, facts: RunFacts, profile: pd.DataFrame) -> Placement:
    """Return the placement of a run on a survey; the first run of a survey keeps its chainage.

    ``profile``: of the run, by its own chainage, in whole multiples of the geometry's step.
    Raises :class:`~trackfg.errors.BadInputError` for a run that is not recognised, or whose fixes contradict others.
    """
    if survey.grid is None:
        return Placement(profile)
    to_map, recognition = _place(survey, run_id, result, facts)
    profile = warped(profile, to_map, result.summary.geometry.step_m)
    sighted = _sightings_of_known_anchors(survey, profile, to_map, recognition)
    both_anchored = facts.anchored and survey.anchored
    sighted = sighted[_agreeing(survey.chainages, sighted, result, anchored=both_anchored)]
    if both_anchored and sighted.anchors:
        _refuse_other_fixes(survey.chainages, sighted, result, run_id)
    if recognition is None:
        return Placement(profile, to_map, sighted)
    doubts = {}
    if _of_other_track(profile, survey.grid, recognition):
        doubts = {run_id: other_track_message(result.summary.recording_id, survey.name)}
    match_sd = recognition.sections["match_sd_m"].median()
    profile = with_place_noise(profile, float(np.hypot(match_sd, _BETWEEN_SECTIONS_SD_M)))
    return Placement(profile, to_map, sighted, doubts)


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
        return _SAME_CHAINAGE, None
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
    seen = (distance_to_nearest(places, section) <= _NEAR_SECTION_M) & (distance_to_nearest(places, covered) <= 1.0)
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


def _of_other_track(profile: pd.DataFrame, grid: pd.DataFrame, recognition: Recognition) -> bool:
    """Return whether a run, on the grid's cells, is of another track than the grid."""
    columns = ["chainage_m", TELLING, f"{TELLING}_sd"]
    run, reference = (table[columns].round({"chainage_m": 6}) for table in (profile, grid))
    both = run.merge(reference, on="chainage_m", suffixes=("", "_map"))
    place, of_run, run_sd, of_map, map_sd = both.to_numpy().T
    return is_other_track(place, of_run - of_map, np.hypot(run_sd, map_sd), of_map, recognition.used)

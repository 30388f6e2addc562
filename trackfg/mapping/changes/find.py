"""Changes of the track that a smoothed run shows against a map: the run is recognised, laid over it and compared."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd

from trackfg.errors import BadInputError
from trackfg.mapping.changes.changes import Changes, changes
from trackfg.mapping.changes.overlay import QUANTITIES
from trackfg.mapping.joining.unstated_sigmas import with_unstated_sigmas
from trackfg.mapping.recognition.conventions import check_conventions, recognised_on_map
from trackfg.mapping.recognition.other_track import TELLING, is_other_track
from trackfg.maps.feature_map import FeatureMap
from trackfg.results.result import Result


def find_changes(result: Result, feature_map: FeatureMap, *, floor_mm: float = 1.0) -> Changes:
    """Find where the track of a run is other than that of a map, by more than noise.

    Parameters
    ----------
    result
        A smoothed run.
    feature_map
        A map that the run is on.
    floor_mm
        Least change of cross-level, twist and versines, mm.

    Returns
    -------
    Changes
        One row each with place, m, size and sigma; and what was compared where.

    Raises
    ------
    BadInputError
        For a run without track geometry, with other conventions, or not recognised on the map.

    Examples
    --------
    >>> import trackfg
    >>> from trackfg.mapping import find_changes
    >>> from trackfg.maps import read_map
    >>> len(find_changes(trackfg.Result.read("out1"), read_map("line.gpkg")).table)  # the map was made of this run
    0
    """
    run, grid = result.summary.recording_id, feature_map.grid
    if result.geometry.empty:
        raise BadInputError(f"run {run}: its result has no track geometry, so it shows no changes of the track")
    check_conventions(result.summary.geometry, feature_map.conventions, run)
    facts, used = result.summary.run, result.summary.map
    placed = (facts is not None and facts.anchored) or (used is not None and used.sections > 0)
    recognition = recognised_on_map(result, grid, float(grid["chainage_m_sd"].median()) if placed else None)
    to_map, sections = recognition.warp, recognition.used
    if to_map is None:
        raise BadInputError(f"run {run}: its track is not recognised on the map {feature_map.name!r}")
    shift_sd = np.interp(result.geometry["chainage_m"], sections["run_m"], sections["match_sd_m"])
    differences = changes(
        with_unstated_sigmas(result.geometry, QUANTITIES),
        grid,
        conventions=result.summary.geometry,
        to_map=to_map,
        shift_sd_m=shift_sd,
        floor_mm=floor_mm,
    )
    return replace(differences, other_track=_of_other_track(differences, feature_map, sections))


def _of_other_track(differences: Changes, feature_map: FeatureMap, sections: pd.DataFrame) -> bool:
    """Return whether the run is of another track than the map, by its differences and their sigmas as stated."""
    place, grid = differences.cells["chainage_m"].to_numpy(), feature_map.grid
    factor = differences.thresholds.loc[differences.thresholds["quantity"] == TELLING, "noise_factor"].to_numpy()
    stated = differences.cells[f"{TELLING}_sd"].to_numpy() / factor
    profile = np.interp(place, grid["chainage_m"], grid[TELLING])
    return is_other_track(place, differences.cells[TELLING].to_numpy(), stated, profile, sections)

"""The runs that ``tools/positioning.py`` measures on: the shuttle, longer, changed, or with less of its recording."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
import pandas as pd
from accuracy.curves import designed_curves

from trackfg.config import SmoothConfig
from trackfg.datasets.catalogue import scenario
from trackfg.datasets.line.defects import Defect
from trackfg.datasets.scenario import Scenario
from trackfg.datasets.scenarios import Simulation, simulate
from trackfg.mapping import build_map
from trackfg.maps.feature_map import FeatureMap
from trackfg.numerics.arrays import Array
from trackfg.recording.model import Recording
from trackfg.results.result import Result
from trackfg.smoothing.smoother import smooth

SHUTTLE = scenario("shuttle")
BALISE_FROM_END_M = 100.0
SURVEY_RUNS = 10
"""Runs of which a map is made; those from this number on are later ones."""


def long_shuttle(length_m: float, duration_s: float) -> Scenario:
    """The shuttle on a longer line, with a balise at each end and none in between."""
    assert SHUTTLE.balises is not None
    places = (BALISE_FROM_END_M, length_m - BALISE_FROM_END_M)
    return replace(
        SHUTTLE,
        name=f"shuttle-{1e-3 * length_m:.0f}km",
        length_m=length_m,
        duration_s=duration_s,
        balises=replace(SHUTTLE.balises, places_m=places),
    )


def with_defects(defects: tuple[Defect, ...]) -> Scenario:
    """The shuttle on the same track with defects, so that runs of one seed are before and after they came."""
    return replace(SHUTTLE, name="shuttle-later", defects=defects)


def with_fixes(recording: Recording, kept: slice | list[int] | None) -> Recording:
    """With only some of its fixes, by their number, or with none."""
    fixes = None if kept is None or recording.fixes is None else recording.fixes.iloc[kept].reset_index(drop=True)
    if fixes is not None and len(fixes):
        return replace(recording, fixes=fixes)
    return replace(recording, fixes=None, description=recording.description.model_copy(update={"fixes": None}))


def cut(recording: Recording, from_s: float, to_s: float) -> Recording:
    """What a recorder has that is switched on under way and off again, and that passes no balise."""

    def during(table: pd.DataFrame) -> pd.DataFrame:
        return table[table["t_s"].between(from_s, to_s)].reset_index(drop=True)

    assert recording.tach is not None
    return replace(with_fixes(recording, None), imu=during(recording.imu), tach=during(recording.tach))


@dataclass(frozen=True)
class Survey:
    """The first runs of a seed's shuttle, smoothed, and the truth of them.

    ``designed`` (n, 6) are the quantities of :func:`curve_detection.designed_curves`; ``roll_error_rad`` (runs,) is by
    how much the roll of a result is too great in the mean, ``mount_roll_rad`` what of it the mounting is to blame for.
    """

    results: tuple[Result, ...]
    designed: Array
    true_geometry: pd.DataFrame
    mount_roll_rad: Array
    roll_error_rad: Array


@lru_cache(maxsize=1)
def survey(seed: int) -> Survey:
    """The runs that the map of a seed is made of; the parts that need them take turns in one process."""
    results, mounts, rolls = [], [], []
    for number in range(SURVEY_RUNS):
        run = simulate(SHUTTLE, seed=seed, run=number)
        if number == 0:
            designed, true_geometry = designed_curves(run.track.line), run.truth_geometry
        result = smooth(run.recording, SmoothConfig())
        results.append(result)
        mounts.append(run.mount_rpy_rad[0])
        rolls.append(float(error_of(result, run, "roll_rad").mean()))
    return Survey(tuple(results), designed, true_geometry, np.array(mounts), np.array(rolls))


@lru_cache(maxsize=1)
def map_of_all(seed: int) -> FeatureMap:
    """The map of a seed's survey."""
    return build_map(survey(seed).results, name=f"shuttle {seed}")


def error_of(result: Result, run: Simulation, quantity: str) -> Array:
    """By how much a quantity of the trajectory is too great, at each of its rows."""
    trajectory = result.trajectory
    return np.asarray(trajectory[quantity] - true_at(run, quantity, trajectory["t_s"].to_numpy()))


def true_at(run: Simulation, quantity: str, t: Array) -> Array:
    """The truth at times (n,)."""
    return np.asarray(np.interp(t, run.truth["t_s"], run.truth[quantity]))

"""Passages of balises as a run measured them without any of its fixes (:mod:`trackfg.results.balise_passages`).

The graph at its solution, without its fixes and map landmarks and with the start held, is linearised once more: one
Gauss-Newton step gives the distances that everything else makes of the passages, and the square root their joint
covariance. Both are exact for the linearised graph, in which distances along the track are all but linear.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from trackfg.factors.factor_type import FactorType
from trackfg.factors.states import KEYFRAME_DIM, SHARED_DIM, Kind, Odo, States, offset_in_keyframe
from trackfg.graph.build import Problem, with_start_at
from trackfg.numerics.arrays import Array
from trackfg.output.place_covariance import place_functions
from trackfg.results.balise_passages import PASSAGE_COLUMNS, BalisePassages
from trackfg.solver.covariance import Functions, joint_covariance, posterior_covariance
from trackfg.solver.elimination import eliminate

if TYPE_CHECKING:
    from trackfg.recording.model import Recording

_PLACES = (FactorType.ABSOLUTE_FIX, FactorType.BALISE_PASSAGE, FactorType.LANDMARK)
"""Factors that measure where on the line the vehicle is, or that it is at a place again."""

_NO_READING_SD_M = 1e-3
"""Of a fix without an id, whose sigma is that of its place and of reading it together, m: next to nothing."""


def own_passages(recording: Recording, problem: Problem, states: States) -> BalisePassages:
    """Return the passages of all balises and fixes of a recording whose graph was solved.

    ``recording`` has its balises and its fixes apart. Without a balise there is nothing to survey, and none is
    returned.
    """
    part = recording.description.balises
    if recording.balises is None or part is None or recording.balises.empty:
        return BalisePassages.none()
    readings = recording.balises.assign(reading_m_sd=part.reading_sd_m)
    if recording.fixes is not None:
        readings = pd.concat([readings, recording.fixes.assign(id="", reading_m_sd=_NO_READING_SD_M)])
    readings = readings.rename(columns={"chainage_m": "planned_m", "chainage_sd_m": "planned_m_sd"})
    within = readings["t_s"].between(problem.t[0], problem.t[-1])
    readings = readings[within].sort_values("t_s", kind="stable", ignore_index=True)
    if readings.empty:
        return BalisePassages.none()
    t, direction = readings["t_s"].to_numpy(), problem.run.direction
    distance, covariance = _without_places(problem, states, t)
    return BalisePassages(readings.assign(chainage_m=direction * distance)[list(PASSAGE_COLUMNS)], covariance)


def _without_places(problem: Problem, states: States, t: Array) -> tuple[Array, Array]:
    """Return distances (m,), m, at times t and their covariance, both without factors of places."""
    others = tuple(family for family in problem.families if family.type not in _PLACES)
    start = float(states.odo.distance[0])
    held = with_start_at(replace(problem, initial=states, families=others), start, 0.0)
    factors = [family.linearize(states) for family in held.families]
    root = eliminate([held.inertial.linearize(states), *factors], len(problem.t))
    moved = states.odo.distance + root.solution().of(Kind.ODO)[:, Odo.DISTANCE]
    covariance = joint_covariance(root, _distances(problem.t, t), posterior_covariance(root)).matrix
    offset = np.mean(np.interp(t, problem.t, states.odo.distance - moved))
    return np.interp(t, problem.t, moved) + offset, covariance


def _distances(keyframe_s: Array, t: Array) -> Functions:
    """Return the distances at times t (m,) ascending, between keyframes linear in time."""
    first = np.clip(np.searchsorted(keyframe_s, t, side="right") - 1, 0, len(keyframe_s) - 2)
    fraction = (t - keyframe_s[first]) / np.diff(keyframe_s)[first]
    row = np.zeros(KEYFRAME_DIM + SHARED_DIM)
    row[offset_in_keyframe(Kind.ODO) + Odo.DISTANCE] = 1.0
    return place_functions(np.broadcast_to(row, (len(keyframe_s), 1, len(row))), first, fraction)

"""A map in the making: the grid as it is, and what every run said.

While runs are joined, the grid stays in the chainage of the first one; once all are in, everything is moved to the
joint solution (:mod:`trackfg.mapping.joining.finishing`). A finished map opens again for more runs.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import pandas as pd
from pydantic import JsonValue

from trackfg.mapping.joining.anchors import chainage_variable, cross_level_variable, offset_variable
from trackfg.mapping.joining.joint_solution import Joint, joint_solution
from trackfg.mapping.joining.reference_line import Origin
from trackfg.maps.feature_map import FeatureMap, MapConventions, RunInformation
from trackfg.numerics.arrays import Array
from trackfg.results.place_covariance import interpolated_variance
from trackfg.results.summary import RunFacts


@dataclass(frozen=True)
class SurveyedRun:
    recording_id: str
    facts: RunFacts


@dataclass(frozen=True)
class Survey:
    """A map in the making. ``place`` and ``level``: chainage and mean cross-level of each mark on the grid as it is;
    the grid's cross-level has the sigma of its shape between marks.
    """

    name: str
    conventions: MapConventions | None = None
    grid: pd.DataFrame | None = None
    line: pd.DataFrame | None = None
    origin: Origin | None = None
    place: Mapping[str, float] = field(default_factory=dict)
    level: Mapping[str, float] = field(default_factory=dict)
    information: Mapping[str, RunInformation] = field(default_factory=dict)
    runs: Mapping[str, SurveyedRun] = field(default_factory=dict)
    landmarks: pd.DataFrame | None = None
    configuration: Mapping[str, JsonValue] = field(default_factory=dict)
    version: int | None = None

    @cached_property
    def at(self) -> Chainages:
        """The joint estimate from what was said so far."""
        return Chainages.of(joint_solution(self.information.values()))

    @property
    def anchored(self) -> bool:
        """Whether any run knew where on the line it was."""
        return any(run.facts.anchored for run in self.runs.values())

    @property
    def variables(self) -> set[str]:
        """The names of all variables."""
        return {name for information in self.information.values() for name in information.variables}


@dataclass(frozen=True)
class Chainages:
    """The joint estimate of the marks, in order along the track."""

    joint: Joint
    marks: tuple[str, ...]

    @classmethod
    def of(cls, joint: Joint) -> Chainages:
        marks = [name.split("/")[1] for name in joint.names if name.endswith("/chainage_m")]
        place = {mark: joint.x[joint.index[chainage_variable(mark)]] for mark in marks}
        return cls(joint, tuple(sorted(marks, key=lambda mark: place[mark])))

    @property
    def place(self) -> Array:
        return np.asarray(self.joint.x[self._rows])

    @property
    def covariance(self) -> Array:
        return np.asarray(self.joint.covariance[np.ix_(self._rows, self._rows)])

    def levels(self) -> tuple[list[str], Array, Array, Array]:
        """Marks whose cross-level is known, their places, means and covariance."""
        known = [mark for mark in self.marks if cross_level_variable(mark) in self.joint.index]
        rows = self.joint.rows([cross_level_variable(mark) for mark in known])
        place = self.joint.x[self.joint.rows([chainage_variable(mark) for mark in known])]
        return known, place, self.joint.x[rows], self.joint.covariance[np.ix_(rows, rows)]

    @property
    def _rows(self) -> np.ndarray:
        return self.joint.rows([chainage_variable(mark) for mark in self.marks])


def reopened(feature_map: FeatureMap) -> Survey:
    """A finished map, ready for more: what the grid's cross-level has from the joint solution is taken out again."""
    at = Chainages.of(joint_solution(feature_map.information.values()))
    grid = feature_map.grid.drop(columns=["cant_mm", "cant_mm_sd"])
    marks, place, level, covariance = at.levels()
    if marks:
        common = interpolated_variance(place, covariance, grid["chainage_m"].to_numpy())
        local = np.maximum(grid["cross_level_mm_sd"] ** 2 - common, 1e-6 * grid["cross_level_mm_sd"] ** 2)
        grid = grid.assign(cross_level_mm_sd=np.sqrt(local))
    runs = {}
    columns = ["run_id", "recording_id", "start", "content_sha256", "direction"]
    for run_id, recording_id, start, content, direction in feature_map.runs[columns].to_numpy().tolist():
        information = feature_map.information[run_id]
        facts = RunFacts(
            start=start or None,
            content_sha256=content,
            direction=1 if direction == 1 else -1,
            anchored=offset_variable(run_id) not in information.variables,
            imu_id=_sensor_in(information, run_id),
            mount_roll_sd_rad=0.0,
        )
        runs[run_id] = SurveyedRun(recording_id, facts)
    return Survey(
        name=feature_map.name,
        conventions=feature_map.conventions,
        grid=grid,
        line=None if feature_map.origin is None else feature_map.line,
        origin=feature_map.origin,
        place=dict(zip(at.marks, at.place.tolist(), strict=True)),
        level=dict(zip(marks, level.tolist(), strict=True)),
        information=dict(feature_map.information),
        runs=runs,
        landmarks=feature_map.landmarks,
        configuration=dict(feature_map.configuration),
        version=feature_map.version,
    )


def _sensor_in(information: RunInformation, run_id: str) -> str | None:
    """The sensor that a run's rows name, None for one that is nobody else's."""
    names = [name.split("/")[1] for name in information.variables if name.startswith("sensor/")]
    return None if not names or names[0] == run_id else names[0]

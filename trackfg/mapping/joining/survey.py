"""The survey is a map in the making: the grid as it is, the information of every run, and that of all together.

While runs are joined, the grid stays in the chainage of the first one; once all are in, everything is moved to the
joint solution (:mod:`trackfg.mapping.joining.finishing`). A finished map opens again for more runs.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import pandas as pd
from pydantic import JsonValue

from trackfg.errors import BadInputError
from trackfg.mapping.joining.anchors import (
    chainage_variable,
    cross_level_variable,
    is_chainage,
    is_offset,
    offset_variable,
    roll_variable,
    sensor_name,
    with_roll_prior,
)
from trackfg.mapping.joining.joint_solution import JointSolution, joint_solution, pooled
from trackfg.mapping.joining.reference_line import Origin
from trackfg.maps.feature_map import FeatureMap, MapConventions, RunInformation
from trackfg.numerics.arrays import Array
from trackfg.results.place_covariance import interpolated_variance
from trackfg.results.summary import RunFacts

_NOTHING = RunInformation((), np.zeros((0, 0)), np.zeros(0))


@dataclass(frozen=True)
class SurveyedRun:
    """A run of the survey: its recording and its facts."""

    recording_id: str
    facts: RunFacts


@dataclass(frozen=True)
class Survey:
    """A map in the making.

    ``place`` and ``level``: chainage and mean cross-level of each anchor on the grid as it is. The sigma of the grid's
    cross-level is that of its shape between anchors. ``pooled``: the ``information`` of all runs together, in which the
    variables of one run alone are eliminated. ``doubts``: by run that was joined now, what a user should know of it.
    """

    name: str
    conventions: MapConventions | None = None
    grid: pd.DataFrame | None = None
    line: pd.DataFrame | None = None
    origin: Origin | None = None
    place: Mapping[str, float] = field(default_factory=dict)
    level: Mapping[str, float] = field(default_factory=dict)
    information: Mapping[str, RunInformation] = field(default_factory=dict)
    pooled: RunInformation = _NOTHING
    runs: Mapping[str, SurveyedRun] = field(default_factory=dict)
    landmarks: pd.DataFrame | None = None
    configuration: Mapping[str, JsonValue] = field(default_factory=dict)
    version: int | None = None
    doubts: Mapping[str, str] = field(default_factory=dict)

    @cached_property
    def chainages(self) -> Chainages:
        """The joint estimate from the runs so far."""
        return Chainages.of(joint_solution([self.pooled]))

    @property
    def anchored(self) -> bool:
        """True if any run had fixes."""
        return any(run.facts.anchored for run in self.runs.values())

    def with_information(self, runs: Mapping[str, SurveyedRun], information: Mapping[str, RunInformation]) -> Survey:
        """Return the survey with the information of more runs, in their order.

        The first run of a sensor brings the prior of its roll.
        """
        added, known = dict(information), {name for rows in self.information.values() for name in rows.variables}
        for run_id, rows in information.items():
            facts = runs[run_id].facts
            sensor = sensor_name(facts.imu_id, run_id)
            if facts.mount_roll_sd_rad and roll_variable(sensor) not in known:
                added[run_id] = with_roll_prior(rows, sensor, facts.mount_roll_sd_rad)
            known.update(rows.variables)
        together = replace(self, information={**self.information, **added}, runs={**self.runs, **runs})
        return replace(together, pooled=together._pooled_with(self.pooled, added))

    def with_weights(self, weights: Mapping[str, Array]) -> Survey:
        """Return the survey in which each row of a run's information counts by the square of its weight (m,) of it."""
        weighted = {
            run_id: RunInformation(rows.variables, weights[run_id][:, None] * rows.R, weights[run_id] * rows.d)
            for run_id, rows in self.information.items()
        }
        return replace(self, pooled=self._pooled_with(_NOTHING, weighted))

    def _pooled_with(self, whole: RunInformation, information: Mapping[str, RunInformation]) -> RunInformation:
        """Return what is pooled already, with the information of the runs that follow, the variables of one run alone
        eliminated.

        The first run's offset is kept while no run had a fix, since the survey counts from its start.
        """
        order = list(self.runs)
        anchored = any(self.runs[run_id].facts.anchored for run_id in order[: -len(information)])
        for run_id, rows in information.items():
            facts = self.runs[run_id].facts
            anchored = anchored or facts.anchored
            alone = {name for name in (*whole.variables, *rows.variables) if anchored and is_offset(name)}
            alone |= {roll_variable(run_id)} if facts.imu_id is None else set()
            alone |= {offset_variable(run_id)} if run_id != order[0] else set()
            whole = pooled(whole, rows, alone)
        return whole


@dataclass(frozen=True)
class Chainages:
    """The joint estimate of the anchors, in order along the track."""

    joint: JointSolution
    anchors: tuple[str, ...]

    @classmethod
    def of(cls, joint: JointSolution) -> Chainages:
        """Return the anchors of a joint solution in order."""
        anchors = [name.split("/")[1] for name in joint.names if is_chainage(name)]
        place = {anchor: joint.x[joint.index[chainage_variable(anchor)]] for anchor in anchors}
        return cls(joint, tuple(sorted(anchors, key=lambda anchor: place[anchor])))

    @property
    def place(self) -> Array:
        """The chainages of the anchors, m (m,)."""
        return np.asarray(self.joint.x[self._rows])

    @property
    def covariance(self) -> Array:
        """The covariance of these, m^2 (m, m)."""
        return np.asarray(self.joint.covariance[np.ix_(self._rows, self._rows)])

    def levels(self) -> tuple[list[str], Array, Array, Array]:
        """Return the anchors with a known cross-level: names, places, mean cross-levels and their covariance."""
        anchors = [anchor for anchor in self.anchors if cross_level_variable(anchor) in self.joint.index]
        rows = self.joint.rows([cross_level_variable(anchor) for anchor in anchors])
        place = self.joint.x[self.joint.rows([chainage_variable(anchor) for anchor in anchors])]
        return anchors, place, self.joint.x[rows], self.joint.covariance[np.ix_(rows, rows)]

    @property
    def _rows(self) -> np.ndarray:
        return self.joint.rows([chainage_variable(anchor) for anchor in self.anchors])


def reopened(feature_map: FeatureMap) -> Survey:
    """Return a finished map as a survey, ready for more runs.

    The variance that the grid's cross-level has from the joint solution is taken out again. Raises
    :class:`~trackfg.errors.BadInputError` for a map whose runs' information is not there or does not fit.
    """
    try:
        return _reopened(feature_map)
    except (KeyError, IndexError, ValueError, np.linalg.LinAlgError) as error:
        raise BadInputError(f"map {feature_map.name!r}: the information of its runs is damaged: {error}") from error


def _reopened(feature_map: FeatureMap) -> Survey:
    survey, runs = Survey(feature_map.name), _runs(feature_map)
    if feature_map.pooled is None:
        survey = survey.with_information(runs, feature_map.information)
    else:
        survey = replace(survey, information=feature_map.information, runs=runs, pooled=feature_map.pooled)
    at = survey.chainages
    grid = feature_map.grid.drop(columns=["cant_mm", "cant_mm_sd"])
    anchors, place, level, covariance = at.levels()
    if anchors:
        common = interpolated_variance(place, covariance, grid["chainage_m"].to_numpy())
        local = np.maximum(grid["cross_level_mm_sd"] ** 2 - common, 1e-6 * grid["cross_level_mm_sd"] ** 2)
        grid = grid.assign(cross_level_mm_sd=np.sqrt(local))
    return replace(
        survey,
        conventions=feature_map.conventions,
        grid=grid,
        line=None if feature_map.origin is None else feature_map.line,
        origin=feature_map.origin,
        place=dict(zip(at.anchors, at.place.tolist(), strict=True)),
        level=dict(zip(anchors, level.tolist(), strict=True)),
        landmarks=feature_map.landmarks,
        configuration=dict(feature_map.configuration),
        version=feature_map.version,
    )


def _runs(feature_map: FeatureMap) -> dict[str, SurveyedRun]:
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
    return runs


def _sensor_in(information: RunInformation, run_id: str) -> str | None:
    """Return the sensor that a run's rows name, None for one of the run's own."""
    names = [name.split("/")[1] for name in information.variables if name.startswith("sensor/")]
    return None if not names or names[0] == run_id else names[0]

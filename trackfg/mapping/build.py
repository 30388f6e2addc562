"""Maps from runs: one run starts a map, every further one is recognised on it and joined.

run -> where its profile lies on the map's (``recognition``) -> what it says of the map's variables (``marks``), and its
profile merged into the grid (``merging``) -> the joint solution of all runs (``joint``) -> grid moved to it, landmarks,
line

The runs that are in the map already are not needed again: what they said of the variables is kept, and the grid is
their weighted mean.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import pandas as pd
from pydantic import JsonValue

from trackfg.curves import find_curves
from trackfg.errors import BadInputError
from trackfg.frames import Array
from trackfg.mapping.design import cant_profile
from trackfg.mapping.joint import Joint, joint_solution
from trackfg.mapping.landmarks import landmarks
from trackfg.mapping.marks import (
    WINDOW_M,
    Sensor,
    Sightings,
    chainage_variable,
    chainages_seen,
    cross_level_variable,
    mark_names,
    offset_variable,
    roll_variable,
    said_of_marks,
    sensor_of,
    without_wrong,
)
from trackfg.mapping.merging import MERGED, local_cross_level_sd, merged, window_means
from trackfg.mapping.recognition import Recognition, recognise
from trackfg.mapping.reference_line import Origin, drawn_line, moved_line, positions_of_run, with_positions
from trackfg.mapping.warp import Warp, warped
from trackfg.maps.feature_map import GRID_COLUMNS, RUN_COLUMNS, FeatureMap, MapConventions, RunInformation
from trackfg.place_covariance import APART_M, interpolation_weights
from trackfg.results import Result, RunFacts, versions

_NEAR_SECTION_M = 150.0
"""A mark counts as seen where a recognised section is this near."""
_NEW_MARK_M = 0.5 * APART_M
_END_MARK_M = 0.2 * APART_M
_OVERLAP_M = 300.0
"""Runs that share less than this can be joined by their chainages alone."""
_SCALE_SD_WITHOUT_WHEEL = 1e-3

Progress = Callable[[str, float], None]


def build_map(results: Sequence[Result], *, name: str, progress: Progress | None = None) -> FeatureMap:
    """One map from any number of smoothed runs. Those that fixes told where they were come first.

    ``progress(run, fraction)`` is called before each. Raises :class:`~trackfg.errors.BadInputError` for a run that says
    nothing of the track, is there twice, has other conventions, or is not recognised.
    """
    if not results:
        raise BadInputError("a map needs at least one run")
    show = progress or (lambda what, done: None)
    survey = _Survey(name)
    for number, result in enumerate(sorted(results, key=lambda result: not _facts(result).anchored)):
        show(result.summary.recording_id, number / (len(results) + 1))
        survey = _joined(survey, result)
    show("landmarks", len(results) / (len(results) + 1))
    return _finished(survey)


def add_run(feature_map: FeatureMap, result: Result) -> FeatureMap:
    """The map with one run more. Raises as :func:`build_map`."""
    return _finished(_joined(_reopened(feature_map), result))


@dataclass(frozen=True)
class _Run:
    recording_id: str
    facts: RunFacts


@dataclass(frozen=True)
class _Survey:
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
    runs: Mapping[str, _Run] = field(default_factory=dict)
    landmarks: pd.DataFrame | None = None
    configuration: Mapping[str, JsonValue] = field(default_factory=dict)
    version: int | None = None

    @property
    def anchored(self) -> bool:
        """Whether any run knew where on the line it was."""
        return any(run.facts.anchored for run in self.runs.values())

    @property
    def variables(self) -> set[str]:
        """The names of all variables."""
        return {name for information in self.information.values() for name in information.variables}


def _facts(result: Result) -> RunFacts:
    facts, what = result.summary.run, f"run {result.summary.recording_id}"
    if facts is None:
        raise BadInputError(f"{what}: smoothed by an older version: smooth it again")
    if result.summary.map is not None and result.summary.map.sections:
        raise BadInputError(f"{what}: smoothed with a map: a map would be told what it said itself; smooth without")
    if len(result.covariance.chainage_m) == 0:
        raise BadInputError(f"{what}: its result has no track geometry, so it says nothing of the track")
    return facts


def _conventions(result: Result) -> MapConventions:
    meaning = result.summary.geometry
    return MapConventions(
        gauge_m=meaning.gauge_m,
        cross_level_base_m=meaning.cross_level_base_m,
        curvature_base_m=meaning.curvature_base_m,
        gradient_base_m=meaning.gradient_base_m,
        chord_m=meaning.chord_m,
        step_m=meaning.step_m,
    )


def _joined(survey: _Survey, result: Result) -> _Survey:
    """The survey with one run more, on the grid as it is."""
    facts, conventions = _facts(result), _conventions(result)
    run_id = _run_id(survey, result.summary.recording_id, facts)
    if survey.conventions not in (None, conventions):
        raise BadInputError(f"run {run_id}: {conventions}; expected those of the map, {survey.conventions}")
    step, grid = conventions.step_m, survey.grid
    run = result.geometry.assign(
        observations=result.geometry[list(MERGED)].notna().any(axis=1).astype(np.int64),
    )
    if grid is None:
        to_map, match = Warp(np.zeros(1), np.zeros(1)), None
        there = run
    else:
        to_map, match = _place(survey, run_id, result, facts)
        there = warped(run, to_map, step)
    there = there.assign(cross_level_mm_sd=local_cross_level_sd(there))
    old = _seen_again(survey, there, to_map, match)
    old = old[_agreeing(survey, old, result, facts)]
    places = np.array([survey.place[mark] for mark in old.marks])
    offset = old.cross_level_mm - np.array([survey.level.get(mark, np.nan) for mark in old.marks])
    known = np.isfinite(offset)
    x = there["chainage_m"].to_numpy()
    shift = np.interp(x, places[known], offset[known]) if known.any() else np.zeros(len(x))
    new, new_places = _new_marks(survey, there, to_map, places)
    there = there.assign(cross_level_mm=there["cross_level_mm"] - shift)
    levels = window_means(there, "cross_level_mm", new_places, WINDOW_M)
    sensor = sensor_of(facts.imu_id, run_id)
    known_already = roll_variable(sensor) in survey.variables
    information = said_of_marks(
        run_id,
        _together(old, new),
        result.covariance,
        Sensor(sensor, None if known_already else facts.mount_roll_sd_rad, facts.direction * conventions.cross_level_base_m),
        anchored=facts.anchored,
    )
    seen = _line_seen(survey, result, facts, to_map)
    return replace(
        survey,
        conventions=conventions,
        grid=there[["chainage_m", *_merged_columns()]] if grid is None else merged(grid, there),
        line=seen if survey.line is None else survey.line if seen is None else with_positions(survey.line, seen),
        origin=survey.origin or facts.origin,
        place={**survey.place, **dict(zip(new.marks, new_places.tolist(), strict=True))},
        level={**survey.level, **{m: v for m, v in zip(new.marks, levels.tolist(), strict=True) if np.isfinite(v)}},
        information={**survey.information, run_id: information},
        runs={**survey.runs, run_id: _Run(result.summary.recording_id, facts)},
        configuration={**survey.configuration, run_id: dict(result.summary.configuration)},
    )


def _merged_columns() -> list[str]:
    return [*(column for name in MERGED for column in (name, f"{name}_sd")), "observations"]


def _run_id(survey: _Survey, recording_id: str, facts: RunFacts) -> str:
    for run_id, run in survey.runs.items():
        if run.facts.content_sha256 == facts.content_sha256:
            raise BadInputError(f"run {recording_id}: is in the map already, as {run_id}")
    taken, number, run_id = set(survey.runs), 1, recording_id
    while run_id in taken:
        number += 1
        run_id = f"{recording_id}-{number}"
    return run_id


def _place(survey: _Survey, run_id: str, result: Result, facts: RunFacts) -> tuple[Warp, Recognition | None]:
    """From the run's chainage to the grid's, and what was recognised; None where it has no track in common."""
    run, grid = result.geometry, survey.grid
    assert grid is not None
    both = facts.anchored and survey.anchored
    sd = run["chainage_m_sd"].to_numpy()
    wheel = result.summary.wheel_scale
    recognition = recognise(
        run,
        grid,
        place_sd_m=np.hypot(sd, float(grid["chainage_m_sd"].median())) if both and "chainage_m_sd" in grid else sd if both else None,
        rate_sd=_SCALE_SD_WITHOUT_WHEEL if wheel is None else wheel.sd,
        direction=facts.direction,
    )
    used = recognition.sections[recognition.sections["used"]]
    if len(used) > 1:
        return Warp(used["run_m"].to_numpy(), used["reference_m"].to_numpy()), recognition
    mine, theirs = run["chainage_m"], grid["chainage_m"]
    overlap = min(mine.iloc[-1], theirs.iloc[-1]) - max(mine.iloc[0], theirs.iloc[0])
    if both and overlap < _OVERLAP_M:
        return Warp(np.zeros(1), np.zeros(1)), None
    raise BadInputError(
        f"run {run_id}: its track is not recognised on the map, which reaches from {theirs.iloc[0]:.0f} m to "
        f"{theirs.iloc[-1]:.0f} m: expected a run over the same track"
    )


def _seen_again(survey: _Survey, there: pd.DataFrame, to_map: Warp, match: Recognition | None) -> Sightings:
    """The map's marks that the run passed and that a recognised section is near to."""
    none = Sightings((), np.zeros(0), np.zeros(0), np.zeros(0))
    if survey.grid is None or match is None:
        return none
    used = match.sections[match.sections["used"]].sort_values("reference_m")
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


def _agreeing(survey: _Survey, seen: Sightings, result: Result, facts: RunFacts) -> np.ndarray:
    """Which sightings do not contradict what the runs before say."""
    if not seen.marks:
        return np.zeros(0, dtype=bool)
    joint = joint_solution(survey.information.values())
    rows = joint.rows([chainage_variable(mark) for mark in seen.marks])
    anchored = facts.anchored and survey.anchored
    covariance = joint.covariance[np.ix_(rows, rows)]
    return without_wrong(seen, result.covariance, joint.x[rows], covariance, anchored=anchored)


def _new_marks(
    survey: _Survey, there: pd.DataFrame, to_map: Warp, seen_again: Array
) -> tuple[Sightings, Array]:
    """Marks where the run passed and the map has none, and their places on the grid."""
    x = there["chainage_m"].to_numpy()
    at = np.array(list(survey.place.values()))
    regular = np.arange(np.ceil(x[0] / APART_M), np.floor(x[-1] / APART_M) + 1.0) * APART_M
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


def _line_seen(survey: _Survey, result: Result, facts: RunFacts, to_map: Warp) -> pd.DataFrame | None:
    if facts.origin is None:
        return None
    return positions_of_run(result.trajectory, to_map, facts.origin, survey.origin or facts.origin)


@dataclass(frozen=True)
class _Chainages:
    """The joint estimate of the marks, in order along the track."""

    joint: Joint
    marks: tuple[str, ...]

    @classmethod
    def of(cls, joint: Joint) -> _Chainages:
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


def _finished(survey: _Survey) -> FeatureMap:
    """Everything moved to the joint solution."""
    assert survey.grid is not None
    assert survey.conventions is not None
    at = _Chainages.of(joint_solution(survey.information.values()))
    move = Warp(np.array([survey.place[mark] for mark in at.marks]), at.place)
    grid = warped(survey.grid, move, survey.conventions.step_m)
    x = grid["chainage_m"].to_numpy()
    grid["chainage_m_sd"] = np.sqrt(_interpolated_variance(at.place, at.covariance, x))
    marks, place, level, covariance = at.levels()
    if marks:
        change = level - np.array([survey.level[mark] for mark in marks])
        grid["cross_level_mm"] += np.interp(x, place, change)
        grid["cross_level_mm_sd"] = np.sqrt(
            grid["cross_level_mm_sd"] ** 2 + _interpolated_variance(place, covariance, x)
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

    def position(chainage: Array) -> tuple[Array, Array]:
        along = line["chainage_m"].to_numpy()
        values, sigmas = (
            np.column_stack([np.interp(chainage, along, line[f"{axis}{suffix}"]) for axis in ("east_m", "north_m", "up_m")])
            for suffix in ("", "_sd")
        )
        return values, sigmas

    table, covariance_of_landmarks = landmarks(curves, survey.landmarks, place_covariance, position, observations)
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


def _interpolated_variance(places: Array, covariance: Array, at: Array) -> Array:
    """Of a quantity known at ascending places and linear in between, constant beyond. Shape (n,)."""
    if len(places) == 1:
        return np.full(len(at), covariance[0, 0])
    left = np.clip(np.searchsorted(places, at, side="right") - 1, 0, len(places) - 2)
    f = np.clip((at - places[left]) / (places[left + 1] - places[left]), 0.0, 1.0)
    variance, beside = np.diag(covariance), np.diag(covariance, 1)
    return np.asarray(
        (1.0 - f) ** 2 * variance[left] + 2.0 * f * (1.0 - f) * beside[left] + f**2 * variance[left + 1]
    )


def _run_table(survey: _Survey, at: _Chainages) -> pd.DataFrame:
    """Offset and scale of each run: the straight line through the marks' chainages over the run's own."""
    assert survey.conventions is not None
    rows = []
    base = survey.conventions.cross_level_base_m
    joint = at.joint
    for run_id, run in survey.runs.items():
        marks, own = chainages_seen(survey.information[run_id])
        which = joint.rows([chainage_variable(mark) for mark in marks])
        A = np.column_stack([np.ones(len(own)), own - own.mean()]) if len(own) > 1 else np.ones((1, 1))
        fit = np.linalg.pinv(A)
        coefficients = fit @ joint.x[which]
        spread = fit @ joint.covariance[np.ix_(which, which)] @ fit.T
        scale, scale_sd = (coefficients[1], np.sqrt(spread[1, 1])) if len(own) > 1 else (1.0, np.nan)
        to_zero = np.r_[1.0, -own.mean()][: len(coefficients)]
        roll = joint.index.get(roll_variable(sensor_of(run.facts.imu_id, run_id)))
        rows.append(
            (
                run_id,
                run.recording_id,
                run.facts.start or "",
                run.facts.content_sha256,
                run.facts.direction,
                float(coefficients @ to_zero) if len(own) > 1 else float(coefficients[0] - own[0]),
                float(np.sqrt(to_zero @ spread @ to_zero)),
                float(scale),
                float(scale_sd),
                np.nan if roll is None else float(base * joint.x[roll]),
                np.nan if roll is None else float(base * np.sqrt(joint.covariance[roll, roll])),
            )
        )
    return pd.DataFrame(rows, columns=list(RUN_COLUMNS))


def _reopened(feature_map: FeatureMap) -> _Survey:
    """A finished map, ready for more: what the grid's cross-level has from the joint solution is taken out again."""
    at = _Chainages.of(joint_solution(feature_map.information.values()))
    grid = feature_map.grid.drop(columns=["cant_mm", "cant_mm_sd"])
    marks, place, level, covariance = at.levels()
    if marks:
        common = _interpolated_variance(place, covariance, grid["chainage_m"].to_numpy())
        local = np.maximum(grid["cross_level_mm_sd"] ** 2 - common, 1e-6 * grid["cross_level_mm_sd"] ** 2)
        grid = grid.assign(cross_level_mm_sd=np.sqrt(local))
    runs = {}
    for row in feature_map.runs.itertuples():
        information = feature_map.information[row.run_id]
        facts = RunFacts(
            start=row.start or None,
            content_sha256=row.content_sha256,
            direction=1 if row.direction == 1 else -1,
            anchored=offset_variable(row.run_id) not in information.variables,
            imu_id=_sensor_in(information, row.run_id),
            mount_roll_sd_rad=0.0,
        )
        runs[row.run_id] = _Run(row.recording_id, facts)
    return _Survey(
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

"""Smoothed tables: trajectory, geometry and events of what left the window, by the batch smoother's functions.

They are made a piece at a time from keyframes that reach beyond the piece on both sides, because a chord or a band of
wavelengths reaches beyond the place that it is of.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import pandas as pd

from trackfg.factors.states import States
from trackfg.graph.run_context import RunContext
from trackfg.numerics.arrays import Array
from trackfg.numerics.chainage.chainage_grid import cells_of
from trackfg.numerics.chainage.passes import passes
from trackfg.numerics.float_table import float_table
from trackfg.output.dense_motion import DenseMotion, dense_motion, dense_step
from trackfg.output.event_sources import EventSources
from trackfg.output.profiles import Profile, profiles
from trackfg.output.rail_profiles import seen_profiles
from trackfg.output.track_geometry import geometry_table, reach_m
from trackfg.output.trajectory import trajectory_table
from trackfg.results.events import Event
from trackfg.smoothing.localisation import MapChainage
from trackfg.solver.covariance import Covariance, posterior_covariance
from trackfg.solver.square_root import SquareRoot
from trackfg.streaming.tables.settled_events import EventInput, SettledEvents
from trackfg.streaming.window.marginalised import MarginalisedHistory
from trackfg.streaming.window.records.noise_record import NoiseRecord
from trackfg.streaming.window.sample_buffer import AFTER_S, SampleBuffer
from trackfg.streaming.window.stream_context import StreamContext
from trackfg.streaming.window.tach_buffer import TachBuffer
from trackfg.streaming.window.window import Window

_MARGIN_S = 1.0
"""Keyframes so much older than the end of the trajectory are kept, s: rates are means over some tenths."""
_JUMP_M = 5.0
"""A place that moves by more than this was found anew, m; by less, it was corrected."""


class TableInput(NamedTuple):
    """The input that tables are made from besides the history.

    ``window`` with the square ``root`` of its information and its ``covariance``, if that is known, ``noise`` with the
    levels of its intervals, the recent ``rests`` (r, 2), s, the ``tach``, and the ``chainage`` of a map on which the
    run is located. ``doubt_m``: the sigma that contradicting fixes add to the distance. ``usual_gnss`` (3,): by what
    the sigmas of GNSS positions usually exceed the declared ones.
    """

    window: Window
    root: SquareRoot
    covariance: Covariance | None
    noise: NoiseRecord
    rests: Array
    tach: TachBuffer | None
    chainage: MapChainage | None = None
    doubt_m: float = 0.0
    usual_gnss: Array | None = None


class TrackPiece(NamedTuple):
    """A piece of track as the sensor's motion shows it: rows of a geometry table in order of passing, when they were
    passed (n,), s, and by how much the distance then exceeds the straight line between the keyframes (n,), m.

    ``moved``: by how many steps of chainage all earlier places have moved since they were given.
    """

    table: pd.DataFrame
    t: Array
    beyond: Array
    moved: int


class Tables(NamedTuple):
    """Rows of both tables, in order of time and of passing, and events.

    ``track``: what the geometry is from, even where the sensor does not follow the track and there is none.
    """

    trajectory: pd.DataFrame
    geometry: pd.DataFrame
    events: tuple[Event, ...]
    track: TrackPiece


class _SmoothedRun(NamedTuple):
    """Keyframes of history and window at ``t`` (n,), s, with what the output functions need."""

    t: Array
    states: States
    root: SquareRoot
    covariance: Covariance
    run: RunContext


class _PassedRows(NamedTuple):
    """Rows of geometry that are due, in order of passing: the cell of chainage, between which keyframes and where, and
    the time, s. Shapes (n,).
    """

    cell: np.ndarray
    keyframe: np.ndarray
    fraction: Array
    t: Array

    @classmethod
    def joined(cls, parts: Iterable[_PassedRows]) -> _PassedRows:
        """Return the rows of all parts, in their order."""
        none = np.zeros(0, dtype=np.int64)
        return cls(
            *(np.concatenate(same) for same in zip(cls(none, none, np.zeros(0), np.zeros(0)), *parts, strict=True))
        )


@dataclass
class SmoothedTables:
    """Makes the tables of a stream; ``done_s`` (trajectory) and ``passed_s`` (geometry): up to when they are made, s.

    ``last_cell``: the last place of the geometry, in steps of chainage. ``for_map``: whether a map needs the track even
    where the sensor does not follow it. ``distances`` (2, n): times and distances of the last piece's keyframes.
    """

    context: StreamContext
    done_s: float
    passed_s: float
    events: SettledEvents
    last_cell: int | None = None
    history: MarginalisedHistory = field(default_factory=MarginalisedHistory)
    for_map: bool = False
    distances: Array = field(default_factory=lambda: np.zeros((2, 0)))

    @classmethod
    def beginning(cls, context: StreamContext, begin_s: float, *, for_map: bool) -> SmoothedTables:
        """Return tables that begin at ``begin_s``."""
        return cls(context, begin_s, begin_s, SettledEvents(begin_s), for_map=for_map)

    def next_piece(self, buffer: SampleBuffer, inputs: TableInput, settled_s: float, *, at_end: bool) -> Tables:
        """Return the tables of what is older than ``settled_s``; at the end of the stream all that are left."""
        smoothed = self._smoothed_run(buffer, inputs)
        t, states, covariance, run = smoothed.t, smoothed.states, smoothed.covariance, smoothed.run
        clock = _clock(self.done_s, settled_s, self.context.config.output.rate_hz)
        motion = dense_motion(run, states, dense_step(states, run.conventions.step_m), clock)
        sources = self._event_sources(buffer, inputs, smoothed)
        events = self.events.emit(EventInput(sources, run, motion, states, covariance), settled_s, at_end=at_end)
        trajectory = trajectory_table(run, motion.at(clock), states, covariance)
        rails = seen_profiles(self.context.description, buffer.rail_views(), run, motion, states)
        shapes = rails or (profiles(run, motion, states) if self.for_map else [])
        moved = self._moved(t, states, run.direction * run.conventions.step_m)
        until = float(t[-1]) if at_end else self._settled_place(t, states, settled_s)
        rows = _PassedRows.joined([self._passed(t, profile, until) for profile in shapes])
        columns = self._geometry(rows, shapes if len(rows.cell) else [], smoothed)
        place, distance = run.direction * run.conventions.step_m * rows.cell, states.odo.distance
        k, f = rows.keyframe, rows.fraction
        beyond = place - (1.0 - f) * distance[k] - f * distance[k + 1]
        track = TrackPiece(float_table(columns), rows.t, beyond, moved)
        self.done_s, self.passed_s = max(self.done_s, settled_s), max(self.passed_s, until)
        self.distances = np.stack([t, distance])
        passed_at = rows.t
        if self.context.description.laser:
            passed_at = _vehicle_at(place, passed_at, t, distance, motion)
        count = len(passed_at) if rails else 0
        geometry = float_table({name: column[:count] for name, column in {"t_s": passed_at, **columns}.items()})
        return Tables(trajectory, geometry, events, track)

    def _smoothed_run(self, buffer: SampleBuffer, inputs: TableInput) -> _SmoothedRun:
        t, states, root = self.history.joined_with(inputs.window, inputs.root)
        # Not all rows that have come: noise is judged by a whole record, and batches of any length shall give the same.
        data = buffer.intervals(-np.inf, float(t[-1]) + AFTER_S)
        run = self.context.run_of(t, data, self.context.noise_of(t, data, inputs.noise))
        covariance = self._covariance(root, inputs.covariance).with_added_distance_variance(inputs.doubt_m**2)
        if inputs.chainage is not None:
            covariance = inputs.chainage.with_uncertainty(covariance, states, run.direction)
        return _SmoothedRun(t, states, root, covariance, run)

    def _covariance(self, root: SquareRoot, of_window: Covariance | None) -> Covariance:
        """Return the covariance of history and window, from that of the window where it is known."""
        history = len(self.history.parts)
        if of_window is None or not history:
            return of_window or posterior_covariance(root)
        return posterior_covariance(root.first(history), of_window)

    def _event_sources(self, buffer: SampleBuffer, inputs: TableInput, smoothed: _SmoothedRun) -> EventSources:
        t, counts, wheel = smoothed.t, smoothed.states.odo.count, None
        if inputs.tach is not None:
            wheel = inputs.tach.wheel_over(buffer.tach, t, counts, buffer.breaks["tach"])
        return EventSources(
            t=t,
            direction=smoothed.run.direction,
            rests=inputs.rests,
            gaps=buffer.inertial.gaps(),
            wheel=wheel,
            clock_origin=self.context.clock_origin,
            families=self.history.with_later_families(inputs.window.families),
            usual_gnss=inputs.usual_gnss,
        )

    @staticmethod
    def _geometry(rows: _PassedRows, shapes: list[Profile], smoothed: _SmoothedRun) -> dict[str, Array]:
        """Return some rows of the geometry of these ``shapes``, by columns."""
        run = smoothed.run
        geometry = geometry_table(run, shapes, smoothed.states, smoothed.covariance, smoothed.root)
        at = np.searchsorted(cells_of(geometry, run.conventions.step_m), rows.cell)
        return dict(zip(map(str, geometry), geometry.to_numpy().T[:, at], strict=True))

    def _moved(self, t: Array, states: States, cell_m: float) -> int:
        """Return by how many steps of chainage places have moved since the last piece.

        A small correction counts as none, so that no chainage is given twice and none is left out.
        """
        if not self.distances.size:
            return 0
        away = float(np.interp(self.passed_s, t, states.odo.distance) - np.interp(self.passed_s, *self.distances))
        cells = round(away / cell_m) if abs(away) > _JUMP_M else 0
        if self.last_cell is not None:
            self.last_cell += cells
        return cells

    def forget(self) -> Array:
        """Drop keyframes that no later piece reaches, and collapse long rests.

        Returns the rests of which only begin and end are kept, s, shape (r, 2).
        """
        t = self.history.t
        if not len(t):
            return np.zeros((0, 2))
        distance = np.interp(t, *self.distances)
        newest = float(np.interp(self.passed_s, t, distance))
        behind = np.flatnonzero((np.abs(distance - newest) > self._reach_m) & (t < self.passed_s))
        needed = self.done_s - _MARGIN_S, self.events.needed_since_s
        self.history.forget(float(min(t[behind[-1]] if behind.size else t[0], *needed)))
        return self.history.collapse_rests(min(needed))

    @property
    def _reach_m(self) -> float:
        apart = max((2.0 * abs(laser.position_m[0]) for laser in self.context.description.laser), default=0.0)
        return reach_m(self.context.conventions) + 5.0 + apart

    def _settled_place(self, t: Array, states: States, settled_s: float) -> float:
        """Return until when places are passed that have enough track on the far side, s."""
        distance = states.odo.distance
        beyond = np.abs(distance - distance[-1]) >= self._reach_m
        if not beyond.any():
            return self.passed_s
        return float(min(t[np.flatnonzero(beyond)[-1]], settled_s))

    def _passed(self, t: Array, profile: Profile, until: float) -> _PassedRows:
        """Return the rows of a pass that are due, in order of passing; a pass that goes on does so at the next cell."""
        cell, when = profile.cell, _times(t, profile)
        sense = 1 if when[-1] >= when[0] else -1
        due = when > self.passed_s
        if self.last_cell is not None and when.min() < self.passed_s < when.max():
            due = sense * (cell - self.last_cell) > 0
        rows: np.ndarray = np.flatnonzero(due & (when <= until))[::sense]
        if len(rows):
            self.last_cell = int(cell[rows[-1]])
        return _PassedRows(cell[rows], profile.keyframe[rows], profile.fraction[rows], when[rows])


def _times(t: Array, profile: Profile) -> Array:
    """Return when the rows of a profile were passed, between keyframes at ``t`` (n,), s."""
    return np.asarray(t[profile.keyframe] * (1.0 - profile.fraction) + t[profile.keyframe + 1] * profile.fraction)


def _vehicle_at(place: Array, seen_at: Array, t: Array, distance: Array, motion: DenseMotion) -> Array:
    """Return when the vehicle itself was at places (m,) that a laser ahead or behind saw at ``seen_at``, s.

    ``t``, ``distance`` (n,) are those of the keyframes.
    """
    out = seen_at.copy()
    for stretch in passes(distance):
        mask = (seen_at >= t[stretch.first]) & (seen_at <= t[stretch.last])
        rows = stretch.rows(t, motion.t)
        covered = np.maximum.accumulate(stretch.sense * motion.distance[rows])
        out[mask] = np.interp(stretch.sense * place[mask], covered, motion.t[rows])
    return out


def _clock(begin: float, until: float, rate_hz: float) -> Array:
    """Return whole multiples of the output interval after one time and up to another, s."""
    first, last = np.floor(np.array([begin, until]) * rate_hz + 1e-9)
    return np.arange(first + 1.0, last + 1.0) / rate_hz

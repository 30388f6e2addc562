"""What is told of what left the window: trajectory, geometry and events, by the functions that the batch smoother uses.

They are made a piece at a time, with some track on either side, because a chord or a band of wavelengths reaches
beyond the place that it is of.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import pandas as pd

from trackfg.factors.states import States
from trackfg.geometry.bands import Band, end_margin_m
from trackfg.numerics.arrays import Array
from trackfg.numerics.chainage_grid import cells_of
from trackfg.numerics.passes import passes
from trackfg.output.dense_motion import DenseMotion, dense_motion, dense_step
from trackfg.output.event_sources import EventSources
from trackfg.output.profile_samples import Points
from trackfg.output.profiles import Profile, profiles
from trackfg.output.rail_profiles import seen_profiles
from trackfg.output.track_geometry import geometry_table
from trackfg.output.trajectory import trajectory_table
from trackfg.smoothing.localisation import MapChainage
from trackfg.solver.covariance import posterior_covariance
from trackfg.solver.square_root import SquareRoot
from trackfg.streaming.events import StreamEvent
from trackfg.streaming.tables.settled_events import SettledEvents
from trackfg.streaming.window.marginalised import History
from trackfg.streaming.window.sample_buffer import Tape
from trackfg.streaming.window.stream_context import Setting
from trackfg.streaming.window.tach_buffer import Odometer
from trackfg.streaming.window.window import Window

_MARGIN_S = 1.0
_JUMP_M = 5.0
"""By more than that a place is not corrected, but found."""


class Sight(NamedTuple):
    """The track as the sensor's motion shows it: rows of a geometry table in order of passing, when they were passed
    (n,), s, and by how much the distance then is beyond the straight line between the keyframes (n,), m.

    ``moved``: by how many steps of chainage all places before are elsewhere now than they were said to be.
    """

    table: pd.DataFrame
    t: Array
    beyond: Array
    moved: int


class Tables(NamedTuple):
    """Rows of both tables, in order of time and of passing, and events. ``sight``: what the geometry is from, even
    where the sensor does not follow the track and there is none.
    """

    trajectory: pd.DataFrame
    geometry: pd.DataFrame
    events: tuple[StreamEvent, ...]
    sight: Sight


@dataclass
class SmoothedTables:
    """Makes the tables of a stream; ``done_s`` (trajectory) and ``passed_s`` (geometry): up to when they are made;
    ``last_cell``, in steps of chainage: the last place of the geometry.

    ``looks``: whether somebody wants to see the track even where the sensor does not follow it. ``along`` (2, n): times
    and distances of the last piece's keyframes.
    """

    setting: Setting
    done_s: float
    passed_s: float
    events: SettledEvents
    last_cell: int | None = None
    history: History = field(default_factory=History)
    looks: bool = False
    along: Array = field(default_factory=lambda: np.zeros((2, 0)))

    @classmethod
    def beginning(cls, setting: Setting, begin_s: float, *, looks: bool) -> SmoothedTables:
        """Of what comes after ``begin_s``."""
        return cls(setting, begin_s, begin_s, SettledEvents(begin_s), looks=looks)

    def up_to(
        self,
        tape: Tape,
        window: Window,
        root: SquareRoot,
        settled_s: float,
        *,
        rests: Array,
        odometer: Odometer | None,
        at_end: bool = False,
        chainage: MapChainage | None = None,
        doubt_m: float = 0.0,
    ) -> Tables:
        """The tables of what is older than ``settled_s``; at the end of the stream of all there is.

        ``rests`` (r, 2), s, are those of late. ``chainage``: where the run is located on a map, how well its places are
        known. ``doubt_m``: how far it is in doubt by contradicting fixes.
        """
        t, states, whole = self.history.with_window(window, root)
        data = tape.data
        assert data is not None
        run = self.setting.run_of(t, data)
        track, step_m = self.setting.description.track, run.conventions.step_m
        covariance = posterior_covariance(whole).with_added_distance_variance(doubt_m**2)
        if chainage is not None:
            covariance = chainage.with_uncertainty(covariance, states, track.direction)
        clock = _clock(self.done_s, settled_s, self.setting.config.output.rate_hz)
        motion = dense_motion(run, states, dense_step(states, step_m), clock)
        sources = EventSources(
            t=t,
            direction=track.direction,
            rests=rests,
            gaps=data.gaps(),
            wheel=None if odometer is None else odometer.over(tape.tach, t, states.odo.count, tape.breaks["tach"]),
            clock_origin=self.setting.clock_origin,
            families=self.history.with_families(window.families),
        )
        events = self.events.until(sources, run, motion, states, covariance, settled_s, at_end=at_end)
        trajectory = trajectory_table(run, motion.at(clock), states, covariance)
        seen = seen_profiles(self.setting.description, tape.rails(), run, motion, states)
        looked = profiles(run, motion, states) if self.looks and not seen else []
        shapes = seen or looked
        moved = self._moved(t, states, track.direction * step_m)
        until = t[-1] if at_end else self._settled_place(t, states, settled_s)
        geometry = geometry_table(run, shapes, states, covariance, whole)
        passed = [self._passed(t, profile, until) for profile in shapes]
        none = np.zeros(0, dtype=np.int64)
        row = pd.Series(np.arange(len(geometry)), index=cells_of(geometry, step_m))
        cells = np.concatenate([none, *(profile.cell[rows] for profile, rows in zip(shapes, passed, strict=True))])
        own = geometry.iloc[row[cells]].reset_index(drop=True)
        points = [profile.views[0].points for profile in shapes]
        k = np.concatenate([none, *(at.keyframe[rows] for at, rows in zip(points, passed, strict=True))])
        f = np.concatenate([np.zeros(0), *(at.fraction[rows] for at, rows in zip(points, passed, strict=True))])
        distance, following = states.odo.distance, k + 1
        beyond = track.direction * step_m * cells - (1.0 - f) * distance[k] - f * distance[following]
        passed_at = np.concatenate(
            [np.zeros(0), *(_times(t, at)[rows] for at, rows in zip(points, passed, strict=True))]
        )
        sight = Sight(own.copy(), passed_at, beyond, moved)
        self.done_s, self.passed_s = max(self.done_s, settled_s), max(self.passed_s, until)
        self.along = np.stack([t, distance])
        own = own if seen else own.iloc[:0]
        if self.setting.description.laser:
            passed_at = _vehicle_at(track.direction * step_m * cells, passed_at, t, distance, motion)
        own.insert(0, "t_s", passed_at[: len(own)])
        return Tables(trajectory, own, events, sight)

    def _moved(self, t: Array, states: States, cell_m: float) -> int:
        """By how many steps a place was found to be elsewhere since the last piece: none where it was only corrected,
        lest a chainage be given twice or none to a place.
        """
        if not self.along.size:
            return 0
        away = float(np.interp(self.passed_s, t, states.odo.distance) - np.interp(self.passed_s, *self.along))
        cells = round(away / cell_m) if abs(away) > _JUMP_M else 0
        if self.last_cell is not None:
            self.last_cell += cells
        return cells

    def forget(self) -> Array:
        """Keyframes that nothing needs any more: older than all that is to come, and further back than it reaches.

        Rests of which the begin and the end are kept alone, s, shape (r, 2).
        """
        t = self.history.t
        if not len(t):
            return np.zeros((0, 2))
        distance = np.interp(t, *self.along)
        here = float(np.interp(self.passed_s, t, distance))
        behind = np.flatnonzero((np.abs(distance - here) > self._reach_m) & (t < self.passed_s))
        needed = self.done_s - _MARGIN_S, self.events.since_s
        self.history.forget(float(min(t[behind[-1]] if behind.size else t[0], *needed)))
        return self.history.stood(min(needed))

    @property
    def _reach_m(self) -> float:
        config = self.setting.config.geometry
        band = end_margin_m(config.step_m, Band(*config.band_m))
        apart = max((2.0 * abs(laser.position_m[0]) for laser in self.setting.description.laser), default=0.0)
        return max(band, config.twist_base_m, 0.5 * config.gradient_base_m, config.chord_m) + 5.0 + apart

    def _settled_place(self, t: Array, states: States, settled_s: float) -> float:
        """Until when places are passed that have enough track on the far side."""
        distance = states.odo.distance
        beyond = np.abs(distance - distance[-1]) >= self._reach_m
        if not beyond.any():
            return self.passed_s
        return float(min(t[np.flatnonzero(beyond)[-1]], settled_s))

    def _passed(self, t: Array, profile: Profile, until: float) -> np.ndarray:
        """The rows of a pass that are due, in the order of passing; a pass that goes on does so at the next cell."""
        points, cell = profile.views[0].points, profile.cell
        when = _times(t, points)
        sense = 1 if when[-1] >= when[0] else -1
        due = when > self.passed_s
        if self.last_cell is not None and when.min() < self.passed_s < when.max():
            due = sense * (cell - self.last_cell) > 0
        rows: np.ndarray = np.flatnonzero(due & (when <= until))[::sense]
        if len(rows):
            self.last_cell = int(cell[rows[-1]])
        return rows


def _times(t: Array, points: Points) -> Array:
    """When the points were passed, between keyframes at ``t`` (n,), s."""
    return np.asarray(t[points.keyframe] * (1.0 - points.fraction) + t[points.keyframe + 1] * points.fraction)


def _vehicle_at(place: Array, seen_at: Array, t: Array, distance: Array, motion: DenseMotion) -> Array:
    """When the vehicle itself was at places (m,) that a unit of lasers ahead or behind saw at other times, s.

    ``t``, ``distance`` (n,) are those of the keyframes.
    """
    out = seen_at.copy()
    for stretch in passes(distance):
        own = (seen_at >= t[stretch.first]) & (seen_at <= t[stretch.last])
        rows = stretch.rows(t, motion.t)
        gone = np.maximum.accumulate(stretch.sense * motion.distance[rows])
        out[own] = np.interp(stretch.sense * place[own], gone, motion.t[rows])
    return out


def _clock(after: float, until: float, rate_hz: float) -> Array:
    """Whole multiples of the output interval after one time and up to another."""
    first, last = np.floor(np.array([after, until]) * rate_hz + 1e-9)
    return np.arange(first + 1.0, last + 1.0) / rate_hz

"""What is told of what left the window: trajectory, geometry and events, by the functions that the batch smoother uses.

They are made a piece at a time, with some track on either side, because a chord or a band of wavelengths reaches
beyond the place that it is of.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
import pandas as pd

from trackfg.chainage_grid import cells_of
from trackfg.covariance import posterior_covariance
from trackfg.dense import dense_motion, dense_step
from trackfg.factors.states import States
from trackfg.frames import Array
from trackfg.geometry.bands import Band, end_margin_m
from trackfg.graph import Problem
from trackfg.profile import Profile, profiles
from trackfg.square_root import SquareRoot
from trackfg.streaming.history import History
from trackfg.streaming.odometer import Odometer
from trackfg.streaming.setting import Setting
from trackfg.streaming.settled_events import SettledEvents
from trackfg.streaming.stream_events import StreamEvent
from trackfg.streaming.tape import Tape
from trackfg.streaming.window import Window
from trackfg.track_geometry import conventions, geometry_table
from trackfg.trajectory import trajectory_table

_MARGIN_S = 1.0


class Tables(NamedTuple):
    """Rows of both tables, in order of time and of passing, and events."""

    trajectory: pd.DataFrame
    geometry: pd.DataFrame
    events: tuple[StreamEvent, ...]


@dataclass
class SmoothedTables:
    """Makes the tables of a stream; ``done_s`` (trajectory) and ``passed_s`` (geometry): up to when they are made;
    ``last_cell``, in steps of chainage: the last place of the geometry.
    """

    setting: Setting
    done_s: float
    passed_s: float
    events: SettledEvents
    last_cell: int | None = None
    history: History = field(default_factory=History)

    @classmethod
    def beginning(cls, setting: Setting, begin_s: float) -> SmoothedTables:
        """Of a stream whose first keyframe is at ``begin_s``."""
        before = begin_s - 1e-6
        return cls(setting, before, before, SettledEvents(begin_s))

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
    ) -> Tables:
        """The tables of what is older than ``settled_s``; at the end of the stream of all there is. ``rests`` (r, 2),
        s, are those of late.
        """
        t, states, whole = self.history.with_window(window, root)
        assert tape.data is not None
        problem = self.setting.problem_of(t, states, tape.data)
        track, config = self.setting.description.track, self.setting.config
        covariance = posterior_covariance(whole)
        clock = _clock(self.done_s, settled_s, config.output.rate_hz)
        meaning = conventions(config.geometry, track)
        motion = dense_motion(problem, states, dense_step(states, meaning.step_m), clock)
        told = replace(
            problem,
            rests=rests,
            gaps=tape.data.gaps(),
            wheel=None if odometer is None else odometer.over(tape.tach, t, states.odo[:, 2]),
            families=self.history.with_families(window.families),
        )
        events = self.events.until(told, motion, states, covariance, settled_s, track.direction, at_end=at_end)
        trajectory = trajectory_table(problem, motion.at(clock), states, covariance, track.direction)
        shapes = profiles(problem, motion, states, track.direction, meaning.step_m) if self._follows_track else []
        until = t[-1] if at_end else self._settled_place(t, states, settled_s)
        geometry = geometry_table(problem, shapes, states, covariance, whole, meaning)
        cells = [self._passed(problem, profile, until) for profile in shapes]
        row = pd.Series(np.arange(len(geometry)), index=cells_of(geometry, meaning.step_m))
        own = geometry.iloc[row[np.concatenate([np.zeros(0, dtype=np.int64), *cells])]].reset_index(drop=True)
        self.done_s, self.passed_s = max(self.done_s, settled_s), max(self.passed_s, until)
        return Tables(trajectory, own, events)

    @property
    def _follows_track(self) -> bool:
        return self.setting.description.imu.rigid

    def forget(self) -> Array:
        """Keyframes that nothing needs any more: older than all that is to come, and further back than it reaches.

        Rests of which the begin and the end are kept alone, s, shape (r, 2).
        """
        t, distance = self.history.t, self.history.distance
        if not len(t):
            return np.zeros((0, 2))
        here = float(np.interp(self.passed_s, t, distance))
        behind = np.flatnonzero((np.abs(distance - here) > self._reach_m) & (t < self.passed_s))
        needed = self.done_s - _MARGIN_S, self.events.since_s
        self.history.forget(float(min(t[behind[-1]] if behind.size else t[0], *needed)))
        return self.history.stood(min(needed))

    @property
    def _reach_m(self) -> float:
        config = self.setting.config.geometry
        band = end_margin_m(config.step_m, Band(*config.band_m))
        return max(band, config.twist_base_m, 0.5 * config.gradient_base_m, config.chord_m) + 5.0

    def _settled_place(self, t: Array, states: States, settled_s: float) -> float:
        """Until when places are passed that have enough track on the far side."""
        distance = states.odo[:, 0]
        beyond = np.abs(distance - distance[-1]) >= self._reach_m
        if not beyond.any():
            return self.passed_s
        return float(min(t[np.flatnonzero(beyond)[-1]], settled_s))

    def _passed(self, problem: Problem, profile: Profile, until: float) -> np.ndarray:
        """The cells of a pass that are due, in the order of passing; a pass that goes on does so at the next cell."""
        points, cell = profile.views[0].points, profile.cell
        when = problem.t[points.keyframe] * (1.0 - points.fraction) + problem.t[points.keyframe + 1] * points.fraction
        sense = 1 if when[-1] >= when[0] else -1
        due = when > self.passed_s
        if self.last_cell is not None and when.min() < self.passed_s:
            due = sense * (cell - self.last_cell) > 0
        cells: np.ndarray = cell[due & (when <= until)][::sense]
        if len(cells):
            self.last_cell = int(cells[-1])
        return cells


def _clock(after: float, until: float, rate_hz: float) -> Array:
    """Whole multiples of the output interval after one time and up to another."""
    first, last = np.floor(np.array([after, until]) * rate_hz + 1e-9)
    return np.arange(first + 1.0, last + 1.0) / rate_hz

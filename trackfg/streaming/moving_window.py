"""The window moving along a stream: from rows to one keyframe after the other.

The window begins as a batch problem of the first seconds. From then on each keyframe adds its factors, the states move
by a Gauss-Newton step or a few, and what is older than the lag is eliminated: what it said stays as a factor. Where a
step fails or the steps do not settle, the whole window is solved as a batch from what it knows.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from trackfg.config import SmoothConfig
from trackfg.covariance import posterior_covariance
from trackfg.errors import UnsolvableError
from trackfg.factors.states import States
from trackfg.frames import Array
from trackfg.graph import build_problem, placeless
from trackfg.inertial_factors import graph_of, measurements_of, walk_of
from trackfg.layout import world_of
from trackfg.motion_factors import resting
from trackfg.solver import solve
from trackfg.spans import joined_spans
from trackfg.square_root import SquareRoot
from trackfg.standstill import find_standstills
from trackfg.streaming.increment import interval
from trackfg.streaming.odometer import Odometer
from trackfg.streaming.setting import Setting
from trackfg.streaming.tape import Tape
from trackfg.streaming.window import Gone, Window
from trackfg.trajectory import QUANTITIES, keyframe_variances
from trackfg.wheel import Wheel

START_S = 10.0
"""What the first window covers."""
AFTER_S = 0.3
"""A keyframe needs rows this much younger than itself."""
BEFORE_S = 10.0
"""Rows this much older than the window are needed."""
_BEFORE_S = 0.6
_REST_LOOK_S = 8.0
_REST_MARGIN_S = 1.5
"""A gentle start takes as long to show."""
_TOO_CLOSE = 0.35
_LEAST_S = 0.02
_SETTLED = 1000.0
"""Length of a step, in posterior sigmas, that needs no second one: a wheel's distance against that of the inertial
sensor alone makes some hundred, and what is left after the step is less than one.
"""
_SETTLED_AT_START = 15.0
_STEPS = 4
_ORIENTED_RAD = 0.03
_LONGEST_WITHOUT_HEADING = 240
"""Keyframes: a vehicle may stand for hours before it shows its heading."""
_TOGETHER = 4
"""Keyframes leave that many at a time."""


class Update(NamedTuple):
    """The window with its newest keyframe, the square root of its information, and what leaves it then.

    ``by_batch``: why it was solved as a batch, empty where it was not.
    """

    window: Window
    root: SquareRoot
    gone: Gone | None
    by_batch: str


@dataclass
class MovingWindow:
    """Keyframes up to ``lag_s`` older than the newest; ``rests`` (r, 2), s, of late."""

    tape: Tape
    config: SmoothConfig
    lag_s: float
    setting: Setting | None = None
    window: Window | None = None
    odometer: Odometer | None = None
    oriented: bool = False
    """Whether the heading is known. Until it is, nothing leaves: linearised at a wrong one, positions mislead."""
    rests: Array = field(default_factory=lambda: np.zeros((0, 2)))

    def updates(self) -> Iterator[Update]:
        """One keyframe after the other, as far as the rows go."""
        if self.window is None:
            first = self._first()
            if first is None:
                return
            yield first
        while (t := self._next_keyframe()) is not None:
            yield self._advanced(t)

    def last(self) -> Update | None:
        """A keyframe at the end of the rows, if they reach beyond the newest one."""
        self.tape.end()
        if self.window is None or self.tape.until < self.window.t[-1] + _LEAST_S:
            return None
        return self._advanced(self.tape.until)

    def _first(self) -> Update | None:
        tape = self.tape
        if tape.data is None or tape.until < tape.data.edges[0] + START_S + AFTER_S:
            return None
        begin = float(tape.data.edges[0])
        recording, data = tape.recording(begin, begin + START_S), tape.intervals(begin, begin + START_S)
        problem = build_problem(recording, self.config, data)
        if tape.description.fixes is not None and problem.family("absolute fix") is None:
            problem = replace(problem, families=placeless(problem.families))  # the first one is to come
        solution = solve(problem, self.config.solver)
        measured = measurements_of(problem.native)
        self.rests = problem.rests
        self.setting = Setting(tape.description, self.config, world_of(recording), problem.clock_origin)
        if problem.wheel is not None and tape.description.tach is not None:
            signed = tape.description.tach.signed or problem.wheel.integrates_speed
            self.odometer = Odometer.of(problem.wheel, tape.tach, signed=signed, max_gap_s=self.config.tach.max_gap_s)
        self.window = Window(problem.t, solution.states, measured, problem.response, problem.families)
        return Update(self.window, solution.root, None, "the first seconds")

    def _next_keyframe(self) -> float | None:
        """When the next keyframe is; None while rows are missing."""
        window, tape = self.window, self.tape
        assert window is not None
        assert tape.data is not None
        here, config = float(window.t[-1]), self.config.keyframes
        speed = float(np.linalg.norm(window.states.nav.v[-1]))
        due = here + 1.0 / max(1.0 / config.interval_s, speed / config.distance_m)
        for table in tape.positions.values():
            times = table[:, 0]
            coming = times[(times > here + 1e-3) & (times < here + (1.0 + _TOO_CLOSE) * (due - here))]
            if coming.size:
                due = float(coming[0])
        edges = tape.data.edges
        at = int(np.searchsorted(edges, due))
        if at >= len(edges) or edges[-1] < edges[at] + AFTER_S:
            return None
        if due - edges[at - 1] < edges[at] - due and edges[at - 1] > here:
            at -= 1
        return float(edges[at])

    def _advanced(self, t: float) -> Update:
        window, setting = self.window, self.setting
        assert window is not None
        assert setting is not None
        here = float(window.t[-1])
        recording = self.tape.positions_between(here, t)
        data = self.tape.intervals(here - _BEFORE_S, t + AFTER_S)
        edges = np.searchsorted(data.edges, [here - 1e-9, t - 1e-9])
        wheel = None
        if self.odometer is not None:
            newest = window.states.nav[-1:]
            wheel = self.odometer.about(self.tape.tach, here, t + AFTER_S, float(newest.v[0] @ newest.R[0, :, 0]))
        new = interval(setting, window, recording, data, wheel, edges)
        self._find_rests(wheel, t + AFTER_S)
        imu = setting.description.imu
        window = window.extended(new)
        walk = walk_of(window.t, window.response, imu.noise)
        window = window.with_families(walk, *resting(window.t, self.rests, self.config.motion, rigid=imu.rigid))
        leaving = int(np.searchsorted(window.t, t - self.lag_s))
        if leaving < _TOGETHER or not (self.oriented or len(window) > _LONGEST_WITHOUT_HEADING):
            leaving = 0
        window, root, left, origin, by_batch = self._solved(window, leaving)
        self.oriented = self.oriented or self._heading_sd(window, root) < _ORIENTED_RAD
        self.window, gone = window.without(leaving, root, left, origin) if leaving else (window, None)
        return Update(window, root, gone, by_batch)

    def _solved(self, window: Window, leaving: int) -> tuple[Window, SquareRoot, Array, States, str]:
        """By a few steps, or as a batch; with what keyframes leave that are leaving, and where it was linearised."""
        try:
            for _ in range(_STEPS):
                origin = window.states
                window, root, left = window.moved(leaving)
                if root.length < (_SETTLED if self.oriented else _SETTLED_AT_START):
                    return window, root, left, origin, ""
            reason = f"the step was {root.length:.2g} posterior sigmas after {_STEPS} of them"
        except (UnsolvableError, ValueError, np.linalg.LinAlgError) as error:
            reason = str(error)
        window = self._by_batch(window)
        origin = window.states
        window, root, left = window.moved(leaving)
        return window, root, left, origin, reason

    def _by_batch(self, window: Window) -> Window:
        """The whole window from what it knows."""
        assert self.setting is not None
        assert self.tape.data is not None
        problem = self.setting.problem_of(window.t, window.states, self.tape.data)
        problem = replace(problem, native=graph_of(window.measured), families=window.families)
        return replace(window, states=solve(problem, self.config.solver).states)

    def _heading_sd(self, window: Window, root: SquareRoot) -> float:
        """The sigma of the newest yaw, rad."""
        assert self.setting is not None
        covariance = posterior_covariance(root.last(1))
        variances = keyframe_variances(window.states.take(slice(-1, None)), covariance, self.setting.lever_arm)
        return float(np.sqrt(variances[0, QUANTITIES.index("yaw_rad")]))

    def _find_rests(self, wheel: Wheel | None, until: float) -> None:
        span = np.array([until - self.config.motion.min_rest_s, until])
        if wheel is not None and wheel.covers(span).all() and abs(np.diff(wheel.at(span))[0]) > 1.5 * wheel.quantum:
            return
        recording = self.tape.recording(until - _REST_LOOK_S, until)
        if recording.imu.empty:  # a long gap
            return
        found = find_standstills(recording, self.config.motion.min_rest_s)
        found[:, 1] = np.minimum(found[:, 1], until - _REST_MARGIN_S)
        spans = np.concatenate([self.rests, found[found[:, 1] > found[:, 0]]])
        self.rests = joined_spans(spans[spans[:, 1] > until - 2.0 * (self.lag_s + _REST_LOOK_S)])

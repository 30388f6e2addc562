"""The fixed-lag smoother: the batch smoother's graph on the last seconds of a stream, at constant cost.

rows -> the next keyframe's factors -> one Gauss-Newton step of the window -> the newest state (filtered); keyframes
older than the lag leave -> smoothed states

The window begins as a batch problem of the first seconds. From then on each keyframe adds its factors, the states move
by one step, and what is older than the lag is eliminated: what it said stays as a factor. Where a step fails or does
not settle, the whole window is solved as a batch from what it knows.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import pandas as pd

from trackfg.config import SmoothConfig
from trackfg.description import RecordingDescription
from trackfg.errors import UnsolvableError
from trackfg.factors.states import States
from trackfg.frames import Array
from trackfg.graph import Problem, build_problem
from trackfg.inertial_factors import graph_of, walk_of
from trackfg.layout import world_of
from trackfg.motion_factors import resting
from trackfg.solver import solve
from trackfg.square_root import SquareRoot
from trackfg.standstill import find_standstills
from trackfg.streaming.increment import Setting, interval
from trackfg.streaming.tape import Tape
from trackfg.streaming.window import Gone, Window
from trackfg.wheel import Wheel, read_wheel

START_S = 10.0
"""What the first window covers."""
AFTER_S = 0.3
"""A keyframe needs rows this much younger than itself."""
_BEFORE_S = 0.6
_REST_LOOK_S = 8.0
_REST_MARGIN_S = 1.5
"""A gentle start takes as long to show."""
_TOO_CLOSE = 0.35
_SETTLED = 3.0
"""Length of a step, in posterior sigmas, that needs no second one."""
_STEPS = 4


class Update(NamedTuple):
    """The window after a keyframe, the square root of its information, and what left it."""

    window: Window
    root: SquareRoot
    gone: Gone | None
    by_batch: bool


class FixedLagSmoother:
    """Rows in, estimates out."""

    def __init__(
        self,
        description: RecordingDescription,
        config: SmoothConfig | None = None,
        *,
        lag_s: float = 10.0,
        gnss_origin: Array | None = None,
    ) -> None:
        self.config = config or SmoothConfig()
        self.lag_s = lag_s
        self.tape = Tape(description, gnss_origin)
        self.window: Window | None = None
        self.setting: Setting | None = None
        self.rests = np.zeros((0, 2))
        self._begin: float | None = None

    def updates(self) -> Iterator[Update]:
        """One keyframe after the other, as far as the rows go."""
        if self.window is None:
            first = self._first()
            if first is None:
                return
            yield first
        while (t := self._next_keyframe()) is not None:
            yield self._advanced(t)

    def _first(self) -> Update | None:
        tape = self.tape
        if tape.data is None or tape.until < tape.data.edges[0] + START_S + AFTER_S:
            return None
        begin = float(tape.data.edges[0])
        recording, data = tape.between(begin, begin + START_S)
        problem = build_problem(recording, self.config, data)
        solution = solve(problem, self.config.solver)
        measured = tuple(problem.native.at(k).preintegratedMeasurements() for k in range(problem.native.size()))
        self.rests = problem.rests
        self.setting = Setting(tape.description, self.config, world_of(recording), problem.clock_origin)
        self.window = Window(problem.t, solution.states, measured, problem.response, problem.families)
        return Update(self.window, solution.root, None, by_batch=True)

    def _next_keyframe(self) -> float | None:
        """When the next keyframe is; None while rows are missing."""
        window, tape = self.window, self.tape
        assert window is not None
        assert tape.data is not None
        here, config = float(window.t[-1]), self.config.keyframes
        speed = float(np.linalg.norm(window.states.nav.v[-1]))
        due = here + 1.0 / max(1.0 / config.interval_s, speed / config.distance_m)
        if len(self.rests) and self.rests[-1, 1] >= here - _REST_MARGIN_S - 2.0 * config.interval_s and speed < 0.01:
            due = here + config.interval_s
        for table in tape.positions.values():
            times = table["t_s"].to_numpy()
            coming = times[(times > here + 1e-3) & (times < here + (1.0 + _TOO_CLOSE) * (due - here))]
            if coming.size:
                due = min(due if coming[0] > due else np.inf, float(coming[0]))
        edges = tape.data.edges
        at = int(np.searchsorted(edges, due))
        if at >= len(edges) or edges[-1] < edges[at] + AFTER_S:
            return None
        if at > 0 and due - edges[at - 1] < edges[at] - due and edges[at - 1] > here:
            at -= 1
        return float(edges[at])

    def _advanced(self, t: float) -> Update:
        window, setting = self.window, self.setting
        assert window is not None
        assert setting is not None
        here = float(window.t[-1])
        recording, data = self.tape.between(here - _BEFORE_S, t + AFTER_S)
        edges = np.searchsorted(data.edges, [here - 1e-9, t - 1e-9])
        new = interval(setting, window, recording, data, self._wheel(here - 3.0, t + AFTER_S), edges)
        self._find_rests(t + AFTER_S)
        description = setting.description
        window = window.extended(new)
        window = window.with_families(
            walk_of(window.t, window.response, description.imu.noise),
            *resting(window.t, self.rests, self.config.motion, rigid=description.imu.rigid),
        )
        by_batch = False
        origin = window.states
        for _ in range(_STEPS):
            origin = window.states
            window, root, linear = window.moved()
            if root.length < _SETTLED:
                break
        gone = None
        count = int(np.searchsorted(window.t, t - self.lag_s))
        if count > 0:
            window, gone = window.left(count, linear, origin)
        self.window = window
        return Update(window, root, gone, by_batch)

    def _wheel(self, begin: float, end: float) -> Wheel | None:
        recording, _ = self.tape.between(begin, end)
        return read_wheel(recording, self.config.tach.max_gap_s)

    def _find_rests(self, until: float) -> None:
        recording, _ = self.tape.between(until - _REST_LOOK_S, until)
        found = find_standstills(recording, self.config.motion.min_rest_s)
        if len(found):
            found[:, 1] = np.minimum(found[:, 1], until - _REST_MARGIN_S)
            spans = np.concatenate([self.rests, found[found[:, 1] > found[:, 0]]])
            merged: list[list[float]] = []
            for a, b in spans[np.argsort(spans[:, 0])].tolist():
                if merged and a <= merged[-1][1]:
                    merged[-1][1] = max(merged[-1][1], b)
                else:
                    merged.append([a, b])
            self.rests = np.array(merged)

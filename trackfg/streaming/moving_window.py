"""The window moving along a stream: from rows to one keyframe after the other.

The window begins as a batch problem of the first seconds. From then on each keyframe adds its factors to the newest
few, the front, which move by a Gauss-Newton step at once: what the rest of the window says is a factor on the front's
first one. Every few keyframes the whole window takes a step, where robust weights and linearisations are made anew;
what is older than the lag is eliminated then, and what it said stays as a factor. Where a step fails or the steps do
not settle, the whole window is solved as a batch from what it knows.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from trackfg.config import SmoothConfig
from trackfg.covariance import posterior_covariance
from trackfg.errors import UnsolvableError
from trackfg.factors.family import Family
from trackfg.frames import Array
from trackfg.graph import build_problem, placeless
from trackfg.inertial_factors import walk_of
from trackfg.layout import world_of
from trackfg.motion_factors import resting
from trackfg.solver import solve
from trackfg.spans import joined_spans, parted
from trackfg.square_root import SquareRoot
from trackfg.standstill import find_standstills
from trackfg.streaming.increment import Ahead, ahead, completed
from trackfg.streaming.odometer import Odometer
from trackfg.streaming.setting import Setting
from trackfg.streaming.tape import Tape
from trackfg.streaming.window import Gone, Interval, Stepped, Window
from trackfg.trajectory import QUANTITIES, keyframe_variances

START_S = 10.0
"""What the first window covers."""
AFTER_S = 0.3
"""A keyframe needs rows this much younger than itself."""
BEFORE_S = 10.0
"""Rows this much older than the window are needed."""
_AROUND_S = 0.1
"""Inertial samples on either side of an interval tell the rates at its ends."""
_REST_LOOK_S = 8.0
_REST_MARGIN_S = 1.5
"""A gentle start takes as long to show."""
_NOT_AT_REST_MPS = 2.0
"""A tach that is stuck, on a smooth straight, looks like a rest, but for the speed that the vehicle had before."""
_TOO_CLOSE = 0.35
_LEAST_S = 0.02
_SETTLED = 1000.0
"""Length of a step, in posterior sigmas, that needs no second one: a wheel's distance against that of the inertial
sensor alone makes some hundred, and what is left after the step is less than one.
"""
_SETTLED_AT_START = 15.0
_STEPS = 4
_FAILURES = (UnsolvableError, ValueError, np.linalg.LinAlgError)
_ORIENTED_RAD = 0.03
_LONGEST_WITHOUT_HEADING = 240
"""Keyframes: a vehicle may stand for hours before it shows its heading."""
TOGETHER = 4
"""The whole window takes a step when so many keyframes have come."""
_FRONT = 2
"""As many older ones are in the front: a slip shows in intervals one after the other."""


class Update(NamedTuple):
    """The newest keyframes, and the square root of the information as it is then."""

    front: Window
    root: SquareRoot


class Pass(NamedTuple):
    """A step of the whole window: the window, the square root of its information, and what leaves it then.

    ``by_batch``: why it was solved as a batch, empty where it was not.
    """

    window: Window
    root: SquareRoot
    gone: Gone | None
    by_batch: str


@dataclass
class MovingWindow:
    """Keyframes up to ``lag_s`` older than the newest; ``rests`` (r, 2), s, of late.

    ``window`` is as the last pass left it, ``since`` what has come after it, ``front`` the newest keyframes, ``coming``
    the interval after them.
    """

    tape: Tape
    config: SmoothConfig
    lag_s: float
    setting: Setting | None = None
    window: Window | None = None
    front: Window | None = None
    since: list[Interval] = field(default_factory=list)
    coming: Ahead | None = None
    odometer: Odometer | None = None
    oriented: bool = False
    """Whether the heading is known. Until it is, nothing leaves: linearised at a wrong one, positions mislead."""
    rests: Array = field(default_factory=lambda: np.zeros((0, 2)))
    early: Pass | None = None
    """A pass that could not wait."""
    sparser: float = 1.0
    """How many times further apart keyframes are than the settings say."""
    on_map: bool = False
    """Whether a map will tell where the vehicle is, which nobody knows before."""

    def ready(self) -> bool:
        """Whether the rows reach the next keyframe."""
        t = self._next_keyframe()
        return t is not None and self.tape.until >= t + AFTER_S

    def prepare(self) -> None:
        """Begin the next interval, if the inertial sensor's rows reach as far: less is left when the others do."""
        t = self._next_keyframe()
        if t is not None and self.front is not None and self.tape.until >= t + _AROUND_S:
            self._begin(t)

    def advanced(self) -> Update:
        """The next keyframe, where :meth:`ready` says that there is one."""
        if self.front is None:
            return self._begun()
        t = self._next_keyframe()
        assert t is not None
        return self._advanced(t)

    def last(self) -> Update | None:
        """A keyframe at the end of the rows, if they reach beyond the newest one."""
        self.tape.end()
        if self.front is None or self.tape.until < self.front.t[-1] + _LEAST_S:
            return None
        return self._advanced(self.tape.until)

    def passed(self, *, at_end: bool = False) -> Pass | None:
        """The step of the whole window, if it is due; at the end of the stream it always is."""
        if self.early is None and self.window is not None and (len(self.since) >= TOGETHER or at_end):
            return self._passed()
        early, self.early = self.early, None
        return early

    def tell(self, family: Family) -> None:
        """Something about the first keyframe that stays."""
        assert self.window is not None
        self.window = self.window.with_families(family)

    def _begun(self) -> Update:
        tape = self.tape
        assert tape.data is not None
        begin = float(tape.data.edges[0])
        recording, data = tape.recording(begin, begin + START_S), tape.intervals(begin, begin + START_S)
        problem = build_problem(recording, self.config, data)
        told_later = tape.description.fixes is not None or self.on_map
        if told_later and problem.family("absolute fix") is None:
            problem = replace(problem, families=placeless(problem.families))
        if problem.wheel is not None and tape.description.tach is not None:
            max_gap_s = self.config.tach.max_gap_s
            self.odometer = Odometer.of(problem.wheel, tape.tach, tape.description.tach, max_gap_s=max_gap_s)
            problem = replace(problem, families=self.odometer.rounded(problem.families))
        solution = solve(problem, self.config.solver)
        self.rests = problem.rests
        self.setting = Setting(tape.description, self.config, world_of(recording), problem.clock_origin)
        window = Window(problem.t, solution.states, problem.measured, problem.response, problem.families)
        self.window = self.front = window
        self.early = Pass(window, solution.root, None, "")
        return Update(window, solution.root)

    def _next_keyframe(self) -> float | None:
        """When the next keyframe is; None while rows are missing."""
        window, tape = self.front, self.tape
        if tape.data is None:
            return None
        if window is None:
            return float(tape.data.edges[0]) + START_S
        here, config = float(window.t[-1]), self.config.keyframes
        speed = float(np.linalg.norm(window.states.nav.v[-1]))
        due = here + self.sparser / max(1.0 / config.interval_s, speed / config.distance_m)
        for table in tape.positions.values():
            times = table[:, 0]
            soon = min(here + (1.0 + _TOO_CLOSE) * (due - here), due + AFTER_S)
            coming = times[(times > here + 1e-3) & (times < soon)]
            if coming.size:
                due = float(coming[0])
        due = min([due, *tape.turns(here, due)[:1]])
        edges = tape.data.edges
        at = int(np.searchsorted(edges, due))
        if at >= len(edges):
            return None
        if due - edges[at - 1] < edges[at] - due and edges[at - 1] > here:
            at -= 1
        return float(edges[at])

    def _begin(self, t: float) -> Ahead:
        """What the inertial sensor says of the interval to ``t``."""
        front, setting = self.front, self.setting
        assert front is not None
        assert setting is not None
        if self.coming is None or self.coming.interval.t != t:
            here = float(front.t[-1])
            data = self.tape.intervals(here - _AROUND_S, t + _AROUND_S)
            edges = np.searchsorted(data.edges, [here - 1e-9, t - 1e-9])
            self.coming = ahead(setting, front, data, edges, broken=self.tape.broken(here, t))
        return self.coming

    def _advanced(self, t: float) -> Update:
        begun, front, setting = self._begin(t), self.front, self.setting
        self.coming = None
        assert front is not None
        assert setting is not None
        here, wheel = float(front.t[-1]), None
        if self.odometer is not None:
            newest = front.states.nav[-1:]
            speed = float(newest.v[0] @ newest.R[0, :, 0])
            wheel = self.odometer.about(self.tape.tach, here, t + AFTER_S, speed, self._uncounted())
        new = completed(begun, self.tape.positions_between(here, t), wheel)
        self.since.append(new)
        front = front.extended(new)
        self.front = front.with_families(walk_of(front.t, front.response, setting.description.imu.noise))
        try:
            step = self._step(self.front)
        except _FAILURES as error:
            self.early = self._passed(str(error))
            return Update(self.front, self.early.root)
        self.front = step.window
        return Update(step.window, step.root)

    def _passed(self, failure: str = "") -> Pass:
        """``failure``: why the front could not take its step."""
        window, front, setting = self.window, self.front, self.setting
        assert window is not None
        assert front is not None
        assert setting is not None
        imu, begin = setting.description.imu, float(window.t[-1])
        window = window.extended(*self.since)
        older = window.states.take(slice(0, len(window) - len(front)))
        window = replace(window, states=older.joined(front.states))
        self._find_rests(window, begin - _REST_LOOK_S, float(window.t[-1]) + AFTER_S)
        walk = walk_of(window.t, window.response, imu.noise)
        window = window.with_families(walk, *resting(window.t, self.rests, self.config.motion, rigid=imu.rigid))
        leaving = before = 0
        if self.oriented or len(window) > _LONGEST_WITHOUT_HEADING:
            leaving = int(np.searchsorted(window.t, window.t[-1] - self.lag_s))
            before = max(len(window) - _FRONT, leaving)
        step, failure = self._solved(window, {leaving, before} - {0}, failure)
        self.oriented = self.oriented or self._heading_sd(step.window, step.root) < _ORIENTED_RAD
        self.window, gone = step.without(leaving) if leaving else (step.window, None)
        self.front = step.without(before)[0] if before else step.window
        self.since, self.coming = [], None
        return Pass(step.window, step.root, gone, failure)

    def _step(self, window: Window, gone: Collection[int] = ()) -> Stepped:
        """Steps until one is short. Raises ``UnsolvableError`` or ``ValueError`` where that does not happen."""
        for _ in range(_STEPS):
            step = window.moved(gone)
            if step.root.length < (_SETTLED if self.oriented else _SETTLED_AT_START):
                return step
            window = step.window
        raise ValueError(f"the step was {step.root.length:.2g} posterior sigmas after {_STEPS} of them")

    def _solved(self, window: Window, gone: Collection[int], failure: str) -> tuple[Stepped, str]:
        """By a few steps, or as a batch."""
        try:
            return self._step(window, gone), failure
        except _FAILURES as error:
            return self._by_batch(window).moved(gone), str(error)

    def _by_batch(self, window: Window) -> Window:
        """The whole window from what it knows."""
        assert self.setting is not None
        assert self.tape.data is not None
        problem = self.setting.problem_of(window.t, window.states, self.tape.data)
        problem = replace(problem, measured=window.measured, families=window.families)
        return replace(window, states=solve(problem, self.config.solver).states)

    def _heading_sd(self, window: Window, root: SquareRoot) -> float:
        """The sigma of the newest yaw, rad."""
        assert self.setting is not None
        covariance = posterior_covariance(root.last(1))
        variances = keyframe_variances(window.states.take(slice(-1, None)), covariance, self.setting.lever_arm)
        return float(np.sqrt(variances[0, QUANTITIES.index("yaw_rad")]))

    def _find_rests(self, window: Window, begin: float, until: float) -> None:
        config, tach = self.config.motion, self.tape.tach
        if self.odometer is not None and len(tach) and tach[0, 0] <= begin and tach[-1, 0] >= until:
            t = np.arange(begin, until - config.min_rest_s, 0.5 * config.min_rest_s)
            rolled = np.interp(t + config.min_rest_s, *tach.T) - np.interp(t, *tach.T)
            if (np.abs(rolled) > 1.5 * self.odometer.wheel.quantum).all():
                return
        found = find_standstills(self.tape.recording(begin, until), config.min_rest_s)
        last = tach[: np.searchsorted(tach[:, 0], until), 0][-1:]
        if (last > until - _REST_MARGIN_S).all():  # else it is a tach that says nothing at rest
            until = min(until, *last)
        # What the rows before and after these would show is not known.
        found = np.clip(found, begin + _REST_MARGIN_S, until - _REST_MARGIN_S)
        fast = window.t[np.linalg.norm(window.states.nav.v, axis=1) > _NOT_AT_REST_MPS]
        moving = np.searchsorted(fast, found[:, 0]) < np.searchsorted(fast, found[:, 1])
        spans = np.concatenate([self.rests, found[(found[:, 1] > found[:, 0]) & ~moving]])
        rests = joined_spans(spans[spans[:, 1] > begin - 2.0 * self.lag_s - _REST_LOOK_S])
        self.rests = parted(rests, self.tape.breaks["imu"])

    def _uncounted(self) -> Array:
        """Spans in which the tach did not count, (u, 2), s: a device that is off counts nothing."""
        breaks = self.tape.breaks
        return np.concatenate([breaks["tach"], breaks["imu"]])

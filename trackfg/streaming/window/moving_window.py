"""The window moving along a stream: from rows to one keyframe after the other.

The window begins as a batch problem of the first seconds. From then on each keyframe is found by a step of two, the
tip (:mod:`trackfg.streaming.window.filter_step`). Where that step casts doubt on what was believed before, all
keyframes since the last pass take it anew, the front: robust weights and linearisations are made again. In a pass,
every few keyframes, the whole window takes a step; what is older than the lag is eliminated then, and what it said
stays as a factor.

Where the front's step fails or its steps do not settle, the whole window takes over; where the window's do, it is
solved as a batch from what it knows; and where that fails too, a new window begins where the newest keyframe was.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from trackfg.checks.limits import CheckLimits
from trackfg.config import SmoothConfig
from trackfg.errors import UnsolvableError
from trackfg.factors.factor_type import FactorType
from trackfg.factors.family import Family
from trackfg.factors.states import Kind, States, offset_in_keyframe
from trackfg.graph.build import Problem, build_problem, with_free_start, with_start_at
from trackfg.graph.inertial import walk_of
from trackfg.graph.inputs import world_of
from trackfg.graph.keyframes import TOO_CLOSE
from trackfg.graph.motion import resting
from trackfg.numerics.arrays import Array
from trackfg.numerics.spans import subtract, union
from trackfg.output.trajectory import QUANTITIES, keyframe_variances
from trackfg.sensors.standstills import find_standstills
from trackfg.sensors.tach import read_wheel
from trackfg.solver.covariance import Covariance, posterior_covariance
from trackfg.solver.gauss_newton import solve
from trackfg.solver.square_root import SquareRoot
from trackfg.streaming.checkpoint.snapshot import MADE_AGAIN
from trackfg.streaming.events import StreamEvent
from trackfg.streaming.window.filter_step import Begun, Found
from trackfg.streaming.window.fix_voting import PlaceVotes, moved_interval, moved_states, moved_window
from trackfg.streaming.window.next_interval import ahead, completed
from trackfg.streaming.window.sample_buffer import Tape
from trackfg.streaming.window.stream_context import Setting
from trackfg.streaming.window.tach_buffer import Odometer
from trackfg.streaming.window.window import Gone, Interval, Stepped, Window

START_S = 10.0
"""What the first window covers."""
_LATE_S = 1.0
"""A tach, or GNSS, that sends its first row so much later than the inertial sensor begins late."""
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
_LEAST_S = 0.02
_SETTLED = 15.0
"""Length of a step, in posterior sigmas, that needs no second one: what is left after it is a tenth or less."""
_SETTLED_FRONT = 1000.0
"""And of the front: a wheel's distance against that of the inertial sensor alone makes some hundred, and what is left
is for the pass.
"""
_STEPS = 4
_FAILURES = (UnsolvableError, ValueError, np.linalg.LinAlgError, RuntimeError)
"""The last are GTSAM's."""
_ORIENTED_RAD = 0.03
_LONGEST_WITHOUT_HEADING = 240
"""Keyframes: a vehicle may stand for hours before it shows its heading."""
TOGETHER = 10
"""The whole window takes a step when so many keyframes have come."""
_FRONT = 2
"""As many older ones are in the front: a slip shows in intervals one after the other."""
_BELIEVED = 0.9
"""A wheel that is believed less is looked at in the front."""


class Update(NamedTuple):
    """The newest keyframes, and the covariance of the last two."""

    window: Window
    covariance: Covariance

    @classmethod
    def of(cls, window: Window, root: SquareRoot) -> Update:
        """``root``: of the information about the window."""
        return cls(window, posterior_covariance(root.last(2)))

    @property
    def speed_sd(self) -> float:
        """Of the newest keyframe along its own axis, m/s."""
        at = offset_in_keyframe(Kind.NAV) + 6
        return float(np.sqrt(self.covariance.marginal[-1, at, at]))


class Pass(NamedTuple):
    """A step of the whole window: the window, the square root of its information, and what leaves it then.

    ``event``: what took over, and why, where something had to.
    """

    window: Window
    root: SquareRoot
    gone: Gone | None
    event: StreamEvent | None = None


class Lost(NamedTuple):
    """Nothing could be made of the rows from ``begin_s`` on: the window begins anew.

    ``left``: the window as its last step left it; ``distance``: along the track at its newest keyframe with its sigma,
    m. None at the begin of the stream.
    """

    begin_s: float
    reason: str
    left: Pass | None
    distance: tuple[float, float] | None


@dataclass
class MovingWindow:
    """Keyframes up to ``lag_s`` older than the newest; ``rests`` (r, 2), s, of late.

    ``window`` and the ``root`` of its information, linearised at ``origin``, are as the last pass left them, ``front``
    its newest keyframes with what the others say; ``since`` is what has come after, with keyframes where they were
    found, and ``links`` what their steps said of the older ones, given the tip; ``tip`` is the newest keyframe with
    what all others say, ``coming`` the interval after it.
    """

    tape: Tape
    config: SmoothConfig
    lag_s: float
    setting: Setting | None = None
    window: Window | None = None
    root: SquareRoot | None = None
    origin: States | None = None
    front: Window | None = None
    since: list[Interval] = field(default_factory=list)
    links: list[Gone] = field(default_factory=list)
    tip: Window | None = None
    coming: Begun | None = field(default=None, metadata=MADE_AGAIN)
    odometer: Odometer | None = None
    oriented: bool = False
    """Whether the heading is known. Until it is, nothing leaves: linearised at a wrong one, positions mislead."""
    damped: bool = False
    """Whether the batch solver has taken over because the heading is not known, which is told once."""
    rests: Array = field(default_factory=lambda: np.zeros((0, 2)))
    early: Pass | None = None
    """A pass that could not wait."""
    speed_sd: float = 0.0
    """Of the newest keyframe, m/s."""
    lost: Lost | None = None
    """What the window begins after, until it has begun."""
    begin_s: float | None = None
    """When the first window begins, as far as is known; ``waiting_since_s``: when it would with all rows there."""
    waiting_since_s: float = -np.inf
    newly_lost: bool = False
    """Until somebody has taken notice."""
    sparser: float = 1.0
    """How many times further apart keyframes are than the settings say."""
    on_map: bool = False
    """Whether a map will tell where the vehicle is, which nobody knows before."""
    places: PlaceVotes = field(default_factory=PlaceVotes)

    def next_keyframe(self) -> float | None:
        """When the next keyframe is; None while rows are missing."""
        tip, tape, data = self.tip, self.tape, self.tape.data
        if data is None:
            return None
        if tip is None:
            begin = self._first_window()
            return None if begin is None else begin + START_S
        here, config = float(tip.t[0]), self.config.keyframes
        speed = float(np.linalg.norm(tip.states.nav.v[0]))
        due = here + self.sparser / max(1.0 / config.interval_s, speed / config.distance_m)
        for table in tape.positions.values():
            times = table[:, 0]
            soon = min(here + (1.0 + TOO_CLOSE) * (due - here), due + AFTER_S)
            coming = times[(times > here + 1e-3) & (times < soon)]
            if coming.size:
                due = float(coming[0])
        due = min([due, *tape.turns(here, due)[:1]])
        edges = data.edges
        at = int(np.searchsorted(edges, due))
        if at >= len(edges):
            return None
        if due - edges[at - 1] < edges[at] - due and edges[at - 1] > here:
            at -= 1
        return float(edges[at])

    def _first_window(self) -> float | None:
        """Return when the first window begins, s: where something measures the speed; None while nothing does.

        Stretches of :data:`START_S` without two rows of the tach or GNSS are passed over, and so is what comes before
        the first of these rows: a tach that has begun within the window would be taken for one that stood.
        """
        tape = self.tape
        if self.begin_s is None:
            assert tape.data is not None
            self.begin_s = self.waiting_since_s = float(tape.data.edges[0])
        while (first := tape.first_speed(self.begin_s)) is not None:
            if first > self.begin_s + _LATE_S:
                self.begin_s = first
            end = self.begin_s + START_S
            if not self.reaches(end) or tape.measures_speed(self.begin_s, end):
                return self.begin_s
            self.begin_s = end
        return None

    def without_speed(self, until_s: float) -> StreamEvent:
        """Return the event that nothing measured the speed up to a time."""
        detail = "nothing measured the speed: expected rows of the tach or of GNSS; estimates begin with these"
        return StreamEvent("no-speed", t_s=self.waiting_since_s, until_s=until_s, detail=detail)

    def reaches(self, t: float) -> bool:
        """Whether the rows that a keyframe at ``t`` needs are there."""
        return self.tape.until >= t + AFTER_S

    def prepare(self, t: float) -> None:
        """Begin the interval to the next keyframe, if the inertial sensor's rows reach as far: less is left when the
        others do. Not where a pass is due, which moves the keyframe that it begins at.
        """
        if self.tip is not None and self.tape.until >= t + _AROUND_S and not self._pass_due:
            self._begin(t)

    def advanced(self, t: float) -> Update | None:
        """The next keyframe, at ``t``; None where it is :attr:`lost`."""
        try:
            return self._begun(t) if self.tip is None else self._advanced(t)
        except _FAILURES as error:
            self._lose(t, str(error))
            return None

    def last(self) -> Update | None:
        """A keyframe at the end of the rows, if they reach beyond the newest one."""
        self.tape.end()
        if self.tip is None or self.tape.until < self.tip.t[0] + _LEAST_S:
            return None
        return self.advanced(self.tape.until)

    def passed(self, *, at_end: bool = False) -> Pass | None:
        """The step of the whole window, if it is due and the window is not :attr:`lost`; at the end of the stream it
        always is due.
        """
        if self.early is None and self.window is not None and (self._pass_due or at_end):
            try:
                return self._passed()
            except _FAILURES as error:
                self._lose(float(self.window.t[-1]), str(error))
        early, self.early = self.early, None
        return early

    @property
    def _pass_due(self) -> bool:
        return len(self.since) >= TOGETHER

    def _lose(self, t: float, reason: str) -> None:
        """Begin anew: where the last pass knew the vehicle, or after rows that do not make a first window."""
        begin, left, distance = t, None, None if self.lost is None else self.lost.distance
        if self.window is not None and self.root is not None:
            begin, left = float(self.window.t[-1]), Pass(self.window, self.root, None)
            variance = posterior_covariance(self.root.last(1)).of(Kind.ODO)[0, 0, 0]
            distance = (
                float(self.window.states.odo.distance[-1]),
                float(np.hypot(np.sqrt(variance), self.places.doubt_m)),
            )
        self.lost = Lost(begin, reason, left, distance)
        self.newly_lost = True
        self.begin_s = self.waiting_since_s = begin
        self.window = self.root = self.origin = self.front = self.tip = self.coming = self.early = None
        self.since, self.links, self.rests = [], [], np.zeros((0, 2))
        self.oriented = self.damped = False

    def tell(self, family: Family) -> None:
        """Something about the first keyframe that stays."""
        assert self.window is not None
        self.window = self.window.joined([family])

    def _begun(self, t: float) -> Update:
        tape = self.tape
        begin = t - START_S
        recording, data = tape.recording(begin, t), tape.intervals(begin, t)
        if recording.tach is not None and not (len(recording.tach) and recording.tach["t_s"].iloc[0] < begin + _LATE_S):
            recording = replace(recording, tach=None)
        problem = build_problem(recording, self.config, data)
        told_later = tape.description.fixes is not None or self.on_map
        if told_later and problem.family(FactorType.ABSOLUTE_FIX) is None:
            problem = replace(problem, families=with_free_start(problem.families))
        self.odometer = None
        if problem.wheel is not None and recording.tach is not None and tape.description.tach is not None:
            rows, max_gap_s = recording.tach.to_numpy(), self.config.tach.max_gap_s
            self.odometer = Odometer.of(problem.wheel, rows, tape.description.tach, max_gap_s=max_gap_s)
            problem = replace(problem, families=self.odometer.rounded(problem.families))
        if self.lost is not None and self.lost.distance is not None:
            distance, sd = self.lost.distance
            passed_over_m = CheckLimits().speed_error_mps * (begin - self.lost.begin_s)
            problem = with_start_at(problem, distance, float(np.hypot(sd, passed_over_m)))
        solution = solve(problem, self.config.solver)
        self.rests = problem.rests
        self.setting = Setting(tape.description, self.config, world_of(recording), problem.clock_origin)
        window = Window(problem.t, solution.states, problem.measured, problem.run.response, problem.families)
        self.window, self.root, self.origin, self.front = window, solution.root, solution.states, window
        self.tip = window.moved({len(window) - 1}).rest(len(window) - 1)
        waited = self.without_speed(begin) if begin > self.waiting_since_s + _LATE_S else None
        self.early, self.lost = Pass(window, solution.root, None, waited), None
        self.places.begin(problem.family(FactorType.ABSOLUTE_FIX), solution.states)
        return self._told(Update.of(window, solution.root))

    def _begin(self, t: float) -> Begun:
        """What the inertial sensor says of the interval to ``t``."""
        tip, setting = self.tip, self.setting
        assert tip is not None
        assert setting is not None
        if self.coming is None or self.coming.ahead.interval.t != t:
            here = float(tip.t[0])
            data = self.tape.intervals(here - _AROUND_S, t + _AROUND_S)
            edges = np.searchsorted(data.edges, [here - 1e-9, t - 1e-9])
            next_ = ahead(setting, tip, data, edges, broken=self.tape.broken(here, t))
            self.coming = Begun.of(tip, next_, setting.description.imu.noise)
        return self.coming

    def _advanced(self, t: float) -> Update:
        begun, tip = self._begin(t), self.tip
        self.coming = None
        assert tip is not None
        here, wheel = float(tip.t[0]), None
        if self.odometer is None:
            self.odometer = self._late_tach(here, float(tip.states.odo.count[0]))
        if self.odometer is not None:
            newest = tip.states.nav
            speed = float(newest.v[0] @ newest.R[0, :, 0])
            wheel = self.odometer.about(self.tape.tach, here, t + AFTER_S, speed, self._uncounted())
        new = completed(begun.ahead, self.tape.positions_between(here, t), wheel, self.speed_sd)
        if not self.on_map:  # which judges fixes by itself
            new, by_m = self.places.judged(new, tip.states)
            if by_m:
                return self._told(self._elsewhere(new, by_m))
        found = self._found(begun, new)
        if found is None:
            return self._told(self._doubted(new))
        self.since.append(new.found(found.pair.states))
        self.links.append(found.link)
        self.tip = found.tip
        return self._told(Update.of(found.pair, found.root))

    def _late_tach(self, here: float, count: float) -> Odometer | None:
        """Return the tach that began to send rows after the first window did, :data:`START_S` later."""
        tach, begin = self.tape.description.tach, here - START_S
        recording = self.tape.recording(begin, here)
        if tach is None or recording.tach is None or not len(recording.tach):
            return None
        wheel = read_wheel(recording, self.config.tach.max_gap_s)
        if wheel is None or wheel.t[0] > begin + _LATE_S:
            return None
        odometer = Odometer.of(wheel, recording.tach.to_numpy(), tach, max_gap_s=self.config.tach.max_gap_s)
        return odometer.counting_on(here, count)

    def _found(self, begun: Begun, new: Interval) -> Found | None:
        """The next keyframe by a step of its own; None where that is not to be trusted."""
        if not self.oriented:
            return None
        try:
            found = begun.step(new)
        except _FAILURES:
            return None
        return found if found.root.length < _SETTLED_FRONT and found.tip.wheel_belief >= _BELIEVED else None

    def _doubted(self, new: Interval) -> Update:
        """The next keyframe by a step of the whole front."""
        front, setting = self.front, self.setting
        assert front is not None
        assert setting is not None
        self.since.append(new)
        front = front.extended(*self.since)
        front = front.with_families(walk_of(front.t, front.response, setting.description.imu.noise))
        try:
            step = self._step(front, {len(front) - 1}, _SETTLED_FRONT if self.oriented else _SETTLED)
        except _FAILURES as error:
            self.early = self._passed(str(error))
            return Update.of(self.early.window, self.early.root)
        first, states = len(front) - len(self.since) - 1, step.window.states
        self.since = [one.found(states.take(slice(k, k + 2))) for k, one in enumerate(self.since, first)]
        self.tip, self.links = step.rest(len(front) - 1), [Gone.of(front.t, step.root, step.origin, len(front) - 1)]
        return Update.of(step.window, step.root)

    def _elsewhere(self, new: Interval, by_m: float) -> Update:
        """The next keyframe, by a step of the whole front: the vehicle is further along the track than was believed."""
        assert self.window is not None
        assert self.front is not None
        assert self.origin is not None
        self.window, self.front = moved_window(self.window, by_m), moved_window(self.front, by_m)
        self.origin = moved_states(self.origin, by_m)
        self.since = [moved_interval(interval, by_m) for interval in self.since]
        return self._doubted(moved_interval(new, by_m))

    def _told(self, update: Update) -> Update:
        self.speed_sd = update.speed_sd
        self.places.learn(update.covariance)
        return update

    def _passed(self, failed: str | None = None) -> Pass:
        """``failed``: why the front could not take its step."""
        window, setting = self.window, self.setting
        assert window is not None
        assert setting is not None
        imu, begin = setting.description.imu, float(window.t[-1])
        window = window.extended(*self.since)
        now = float(window.t[-1])
        if failed is None:
            window = replace(window, states=self._looking_back(window))
        self._find_rests(window, begin - _REST_LOOK_S, now + AFTER_S)
        walk = walk_of(window.t, window.response, imu.noise)
        window = window.with_families(walk, *resting(window.t, self.rests, self.config.motion, rigid=imu.rigid))
        leaving = before = 0
        if self.oriented or len(window) > _LONGEST_WITHOUT_HEADING:
            leaving = int(np.searchsorted(window.t, now - self.lag_s))
            before = max(len(window) - _FRONT, leaving)
        newest = len(window) - 1
        gone_at = {leaving, before, newest} - {0}
        step, event = self._settled(window, gone_at, failed)
        self.oriented = self.oriented or self._heading_sd(step.window, step.root) < _ORIENTED_RAD
        gone = step.gone(leaving) if leaving else None
        self.window, self.front, self.tip = step.rest(leaving), step.rest(before), step.rest(newest)
        self.root, self.origin = step.root.last(len(self.window)), step.origin.take(slice(leaving, None))
        self.since, self.links, self.coming = [], [], None
        return Pass(step.window, step.root, gone, event)

    def _settled(self, window: Window, gone: Collection[int], failed: str | None) -> tuple[Stepped, StreamEvent | None]:
        """The whole window after its step, or after what had to take over, and what is told of that."""
        now = float(window.t[-1])
        if failed is not None and not self.oriented:  # steps without damping: they would not settle here either
            event = None if self.damped else StreamEvent("by-batch", t_s=now, detail=failed)
            self.damped = True
            return self._by_batch(window).moved(gone), event
        event = None if failed is None else StreamEvent("by-window", t_s=now, detail=failed)
        try:
            step = self._step(window, gone, _SETTLED)
            if step.window.doubts_wheel and (other := self._by_batch(window)).cost < step.window.cost:
                step = other.moved(gone)
        except _FAILURES as error:
            step, event = self._by_batch(window).moved(gone), StreamEvent("by-batch", t_s=now, detail=str(error))
        return step, event

    def _looking_back(self, window: Window) -> States:
        """Of the whole window, as the tip tells them by what each keyframe's step said of the ones before."""
        assert self.tip is not None
        assert self.window is not None
        assert self.root is not None
        assert self.origin is not None
        states, k, at_pass = [self.tip.states], len(window) - 1, len(self.window) - 1
        for link in reversed(self.links):
            states.append(link.before(_own_bias(states[-1], window.response[k])))
            k -= len(link.t)
        if k:
            older = Gone.of(window.t, self.root, self.origin, k)
            states.append(older.before(_own_bias(states[-1], window.response[k]) if k == at_pass else states[-1]))
        oldest, *others = reversed(states)
        return oldest.joined(*others)

    def _step(self, window: Window, gone: Collection[int], settled: float) -> Stepped:
        """Steps until one is short. Raises ``UnsolvableError`` or ``ValueError`` where that does not happen."""
        for _ in range(_STEPS):
            step = window.moved(gone)
            if step.root.length < settled:
                return step
            window = step.window
        raise ValueError(f"the step was {step.root.length:.2g} posterior sigmas after {_STEPS} of them")

    def _by_batch(self, window: Window) -> Window:
        """The whole window from what it knows."""
        data = self.tape.data
        assert self.setting is not None
        assert data is not None
        problem = Problem(
            run=self.setting.run_of(window.t, data),
            measured=window.measured,
            families=window.families,
            initial=window.states,
            rests=self.rests,
            gaps=data.gaps(),
            wheel=None if self.odometer is None else self.odometer.wheel,
            clock_origin=self.setting.clock_origin,
        )
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
        recording = self.tape.recording(begin, until)
        if recording.imu.empty:  # within a long gap
            return
        if self.odometer is None:
            recording = replace(recording, tach=None)
        silent = self.odometer is not None and self.odometer.silent_at_rest
        found = find_standstills(recording, config.min_rest_s, silent_at_rest=silent)
        if self.odometer is not None:
            read = tach[slice(*np.searchsorted(tach[:, 0], [begin, until])), 0]
            if not silent:  # else no rows are as good as rows that do not change
                begin, until = (float(read[0]), float(read[-1])) if len(read) else (until, begin)
            elif len(read) and read[-1] > until - _REST_MARGIN_S:
                until = float(read[-1])
        # What the rows before and after these would show is not known.
        found = np.clip(found, begin + _REST_MARGIN_S, until - _REST_MARGIN_S)
        fast = window.t[np.linalg.norm(window.states.nav.v, axis=1) > _NOT_AT_REST_MPS]
        moving = np.searchsorted(fast, found[:, 0]) < np.searchsorted(fast, found[:, 1])
        spans = np.concatenate([self.rests, found[(found[:, 1] > found[:, 0]) & ~moving]])
        rests = union(spans[spans[:, 1] > begin - 2.0 * self.lag_s - _REST_LOOK_S])
        self.rests = subtract(rests, self.tape.breaks["imu"])

    def _uncounted(self) -> Array:
        """Spans in which the tach did not count, (u, 2), s: a device that is off counts nothing."""
        breaks = self.tape.breaks
        return np.concatenate([breaks["tach"], breaks["imu"]])


def _own_bias(states: States, response: Array) -> States:
    """Keyframe by keyframe with the sensor's own bias, as a newest keyframe has it, for that of the interval after."""
    return replace(states, bias=states.bias - states.imu[0] @ response.T)

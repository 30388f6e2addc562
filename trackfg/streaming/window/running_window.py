"""The running window: a filter step per keyframe, and every few keyframes a relinearisation pass.

Between two passes the window stays as the last one left it, at its linearisation point. The intervals since are kept
with the conditionals that their filter steps left, so that the next pass begins with back-substitution from the newest
keyframe and needs one Gauss-Newton step.

A filter step that doubts the wheel is replaced by a step of the *recent* keyframes, those since the last pass and two
before them: whether a wheel slipped shows in several intervals. If that fails, the pass is taken at once; if the pass
does not settle, the window is solved as a batch from its own states. Until the heading is known, linearised positions
are of little worth: nothing is marginalised then unless the window has more than 240 keyframes, the recent keyframes
are the whole window, and where up to four steps of it do not settle, the damped batch solver takes over. Rows that
contradict each other, as in random order, never determine a heading, and the solver begins far from a minimum
each time: its work on one window is bounded, and a window that needs more is lost.
"""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from trackfg.errors import UnsolvableError
from trackfg.factors.factor_type import FactorType
from trackfg.factors.family import Family, family_of
from trackfg.factors.states import Kind, States, offset_in_keyframe
from trackfg.graph.inertial import walk_of
from trackfg.graph.motion import resting
from trackfg.numerics.arrays import Array
from trackfg.output.trajectory import QUANTITIES, keyframe_variances
from trackfg.recording.description import ImuNoise
from trackfg.results.events import Event
from trackfg.solver.covariance import Covariance, posterior_covariance
from trackfg.solver.gauss_newton import solve
from trackfg.solver.square_root import SquareRoot
from trackfg.solver.variance_components import GROUPS, Residuals, group_residuals, ratios_of, walk_residuals
from trackfg.streaming.checkpoint.snapshot import DERIVED
from trackfg.streaming.window.filter_step import FilterResult, PredictedPair
from trackfg.streaming.window.fix_voting import FixVotes, shift_interval, shift_window
from trackfg.streaming.window.gnss_record import GnssRecord
from trackfg.streaming.window.next_interval import predict_interval, with_other_rows
from trackfg.streaming.window.noise_record import NoiseRecord
from trackfg.streaming.window.rests import LOOK_S, Rests
from trackfg.streaming.window.sample_buffer import AFTER_S, SampleBuffer
from trackfg.streaming.window.starting_window import FirstProblem, KnownDistance, late_tach
from trackfg.streaming.window.stream_context import StreamContext
from trackfg.streaming.window.tach_buffer import TachBuffer
from trackfg.streaming.window.walk_record import WalkRecord
from trackfg.streaming.window.wheel_creep import WALK_PER_SQRT_M, Creep, scale_walks, with_creep, with_walk
from trackfg.streaming.window.window import Interval, MarginalisedKeyframes, Window, WindowStep

FAILURES = (UnsolvableError, ValueError, np.linalg.LinAlgError, RuntimeError)
"""What a step raises that fails; the last are GTSAM's."""
BETWEEN_PASSES = 10
"""Keyframes from one relinearisation pass to the next."""
_BEFORE_PASS = 2
"""Older keyframes among the recent ones: a slip shows in intervals one after the other."""
_RATES_S = 0.1
"""Time around the end of an interval, s, over which inertial samples give the rate there."""
_NOISE_S = 2.5
"""Time before an interval, s, over which inertial samples show its white noise: three blocks and more of
:mod:`trackfg.sensors.imu_noise`."""
_SETTLED = 15.0
"""Maximum length, in posterior sigmas, of a step that needs no second one: what is left after it is a tenth or less."""
_SETTLED_RECENT = 1000.0
"""The same for recent keyframes. A wheel against the inertial sensor alone makes some hundred; the pass does the rest.
"""
_HEADING_SD_RAD = 0.03
"""Maximum sigma of yaw with which the heading is known, rad."""
_MOST_WITHOUT_HEADING = 240
"""Keyframes in a window whose heading is not known: a vehicle may stand for hours before it shows."""
_MOST_DAMPED = 50_000
"""Steps that the batch solver tries, times keyframes, in all, that a window is given to determine its heading. One
takes some 0.13 ms, so these take 7 s. The simulated lines that need any need 400 to 19,500.
"""
_MOVED_M = 5.0
"""Way from the first keyframe of a window, m, from which on others determine the heading: those at rest cannot."""
_DAMPED_BEFORE = 0.5
"""Share of such work that counts in the next window, where the heading stayed unknown. The 25,000 that are left for
that one are still enough for the simulated lines.
"""
_CERTAIN_SIGMAS = 3.0
"""A vehicle whose speed is so many sigmas from 0 moves: at a rest of minutes an inertial sensor alone may show 0.3 m/s.
"""
_ROLLING = 0.9
"""Minimum probability that the wheel rolls; below it the recent keyframes are solved again."""


class FilterUpdate(NamedTuple):
    """The ``newest_keyframes``, two or more, and the joint covariance of the last two."""

    newest_keyframes: Window
    covariance: Covariance

    @classmethod
    def of(cls, window: Window, root: SquareRoot) -> FilterUpdate:
        """Return the update of a window; ``root`` is the square root of its information."""
        return cls(window, posterior_covariance(root.last(2)))

    @property
    def speed_sd(self) -> float:
        """The sigma of the newest keyframe's velocity along its first axis, m/s."""
        at = offset_in_keyframe(Kind.NAV) + 6
        return float(np.sqrt(self.covariance.of_keyframes[-1, at, at]))


class Relinearisation(NamedTuple):
    """The ``whole_window`` after a relinearisation pass, with the keyframes that this marginalises; the square root of
    its information; the keyframes marginalised; an event where a step failed and something had to take over; and the
    window's covariance, where the pass has needed it.
    """

    whole_window: Window
    root: SquareRoot
    marginalised: MarginalisedKeyframes | None
    event: Event | None = None
    covariance: Covariance | None = None


@dataclass
class RunningWindow:
    """A window that has begun; ``lag_s`` is its length. ``on_map``: a map gives the distance, and fixes do not vote.

    ``window``, the ``root`` of its information and its ``linearisation_point`` are those of the last pass; ``recent``
    are its newest keyframes behind their marginal prior. ``added`` are the intervals since, ``conditionals`` what their
    steps left; ``newest`` is the newest keyframe behind its marginal prior. ``speed_sd``: of that, m/s.
    ``heading_known`` stays once it is; ``damped``: the batch solver has taken over before it was, which is one event;
    ``damped_work``: the steps it tried until then, times the keyframes of each, with a share of those of lost windows.
    ``walks``: whether the wheel's scale walks by the accelerometer's evidence. ``gnss``: what its positions have shown
    of their errors, ``noise``: what residuals have shown of all else. ``speed_doubted``: whether the sigmas of the
    speed are too small beyond chance so far. ``walk``: how fast biases walk.
    ``undelivered_pass``: the result of a pass that :meth:`add_keyframe` had to take, or of the first window.
    """

    buffer: SampleBuffer
    context: StreamContext
    lag_s: float
    on_map: bool
    votes: FixVotes
    rests: Rests
    tach: TachBuffer | None
    window: Window
    root: SquareRoot
    linearisation_point: States
    recent: Window
    newest: Window
    added: list[Interval] = field(default_factory=list)
    conditionals: list[MarginalisedKeyframes] = field(default_factory=list)
    predicted: PredictedPair | None = field(default=None, metadata=DERIVED)
    heading_known: bool = False
    damped: bool = False
    damped_work: int = 0
    speed_sd: float = 0.0
    walks: bool = False
    gnss: GnssRecord = field(default_factory=GnssRecord)
    gnss_speeds: GnssRecord = field(default_factory=GnssRecord.of_speeds)
    noise: NoiseRecord = field(default_factory=NoiseRecord)
    speed_doubted: bool = False
    walk: WalkRecord = field(default_factory=WalkRecord)
    undelivered_pass: Relinearisation | None = None

    @classmethod
    def begin(
        cls, first: FirstProblem, buffer: SampleBuffer, votes: FixVotes, lag_s: float, *, on_map: bool, damped_work: int
    ) -> tuple[RunningWindow, FilterUpdate]:
        """Solve the first window. Raises as :func:`~trackfg.solver.gauss_newton.solve` does.

        ``damped_work``: that of the windows before, as :attr:`damped_work_after` gives it.
        """
        problem = first.problem
        solution = solve(problem, first.context.config.solver)
        root, states = solution.root, solution.states
        window = Window(problem.t, states, problem.measured, problem.response, problem.families)
        newest = window.gauss_newton_step({len(window) - 1}).window_without_first(len(window) - 1)
        if not on_map:
            votes.written_s = max(votes.written_s, float(window.t[0]))
            votes.count_first_window(problem.family(FactorType.ABSOLUTE_FIX), states, problem.t)
        rests, context = Rests(lag_s, problem.rests), first.context
        running = cls(
            buffer=buffer,
            context=context,
            lag_s=lag_s,
            on_map=on_map,
            votes=votes,
            rests=rests,
            tach=first.tach,
            damped_work=damped_work,
            window=window,
            root=root,
            linearisation_point=states,
            recent=window,
            newest=newest,
            undelivered_pass=Relinearisation(window, root, None, first.waited),
        )
        running.noise.look_at_rests(buffer, problem.rests)  # the problem has the noise that they show
        return running, running._record(FilterUpdate.of(window, root))

    def next_keyframe(self, spacing: float) -> float | None:
        """Return the time of the next keyframe, s, on an edge of the inertial record; None while that ends before it.

        ``spacing``: how many times further apart keyframes are than the settings say.
        """
        config, speed = self.context.config.keyframes, math.hypot(*self.newest.states.nav.v[0].tolist())
        return self.buffer.keyframe_after(
            float(self.newest.t[0]), spacing / max(1.0 / config.interval_s, speed / config.distance_m)
        )

    @property
    def known_distance(self) -> KnownDistance:
        """The distance along the track at the last pass; contradicting fixes add to its sigma."""
        variance = posterior_covariance(self.root.last(1)).of(Kind.ODO)[0, 0, 0]
        sd = float(np.hypot(np.sqrt(variance), self.votes.doubt_m))
        return KnownDistance(float(self.window.t[-1]), float(self.window.states.odo.distance[-1]), sd)

    def has_tach_for(self, t: float) -> bool:
        """Return whether the tach's rows that a keyframe at ``t`` needs are there, or will not come."""
        return self.tach is None or self.tach.rows_end(t, self.buffer.tach, self.buffer.until) is not None

    def prepare(self, t: float) -> None:
        """Predict the interval to the keyframe at ``t``, if the inertial sensor's rows reach as far.

        Not where a pass is due, which moves the keyframe that it begins at.
        """
        if self.buffer.until >= t + _RATES_S and not self._pass_is_due:
            self._preintegrate_next(t)

    def add_keyframe(self, t: float) -> FilterUpdate:
        """Estimate the next keyframe, at ``t``. Raises one of :data:`FAILURES`.

        :meth:`relinearise_if_due` must have been called since the keyframe before: a result that it has not delivered
        would be lost.
        """
        pair, newest = self._preintegrate_next(t), self.newest
        self.predicted = None
        wheel, last = None, float(newest.t[0])
        if self.tach is None:
            self.tach = late_tach(self.buffer, self.context.config, last, float(newest.states.odo.count[0]))
        if self.tach is not None:
            navs, buffer = (newest.states.nav, pair.prediction.interval.predicted.nav), self.buffer
            forward = (float(nav.v[0] @ nav.R[0, :, 0]) for nav in navs)
            begin, end = (speed if abs(speed) > _CERTAIN_SIGMAS * self.speed_sd else 0.0 for speed in forward)
            until = self.tach.rows_end(t, buffer.tach, buffer.until) or t + AFTER_S
            wheel = self.tach.wheel_until(until, buffer.tach, last, (begin, end), buffer.uncounted)
        interval = with_other_rows(pair.prediction, self.buffer.other_rows_between(last, t), wheel, self.speed_sd)
        interval = interval._replace(families=self.noise.weigh_wheel(interval.families))
        gnss_width = self.context.config.position.gnss_width
        families = self.gnss.weigh_next(interval.families, gnss_width)
        interval = interval._replace(families=self.gnss_speeds.weigh_next(families, gnss_width))
        if not self.on_map:
            interval, shift_m = self.votes.vote_on_fixes(interval, newest.states, self._others_sd_m)
            creep = self.votes.pop_creep()
            if shift_m:
                return self._record(self._jump_along_track(interval, shift_m))
            if creep is not None:
                return self._record(self._follow_creep(interval, creep))
        result = self._filter_step(pair, interval)
        if result is None:
            return self._record(self._resolve_recent_keyframes(interval))
        self.added.append(interval.at(result.pair.states))
        self.conditionals.append(result.older)
        self.newest = result.newest
        return self._record(FilterUpdate.of(result.pair, result.root))

    def relinearise_if_due(self, *, at_end: bool = False) -> Relinearisation | None:
        """Take the relinearisation pass, if it is due, or return the one that was taken already.

        Raises one of :data:`FAILURES`.
        """
        if self.undelivered_pass is None and (self._pass_is_due or at_end):
            return self._relinearise_window()
        delivered, self.undelivered_pass = self.undelivered_pass, None
        return delivered

    def add_to_first_keyframe(self, family: Family) -> None:
        """Add a family of factors on the first keyframe of the window; others stay."""
        self.window = self.window.with_factors([family])

    @property
    def damped_work_after(self) -> int:
        """The batch solver's work that counts in the window after this one, should it be lost."""
        return 0 if self.heading_known else int(_DAMPED_BEFORE * self.damped_work)

    @property
    def _imu_noise(self) -> ImuNoise:
        """The declared noise of the inertial sensor, with the walk that residuals have shown."""
        return self.walk.of(self.context.description.imu.noise)

    @property
    def _pass_is_due(self) -> bool:
        return len(self.added) >= BETWEEN_PASSES

    def _preintegrate_next(self, t: float) -> PredictedPair:
        """Predict the interval to ``t`` by the inertial sensor, unless that has been done."""
        if self.predicted is None or self.predicted.prediction.interval.t != t:
            last = float(self.newest.t[0])
            data = self.buffer.intervals(last - _NOISE_S, t + _RATES_S)
            edges = data.edges.searchsorted([last - 1e-9, t - 1e-9])
            broken = self.buffer.has_break(last, t)
            prediction = predict_interval(self.context, self.newest, data, edges, self.noise.shown, broken=broken)
            walks = self.walks or self.gnss.rest_erred or self.gnss_speeds.rest_erred
            walk = max(self.votes.walk_per_sqrt_m, WALK_PER_SQRT_M if walks else 0.0)
            prediction = prediction.with_walking_scale(walk)
            bridged = bool(data.bridged[edges[0]])
            weighed = self.noise.weigh_next(prediction.interval, bridged=bridged)
            self.predicted = PredictedPair.of(self.newest, prediction._replace(interval=weighed), self._imu_noise)
        return self.predicted

    def _filter_step(self, pair: PredictedPair, interval: Interval) -> FilterResult | None:
        """Return the filter step's result; None where it is not to be trusted."""
        if not self.heading_known:
            return None
        try:
            result = pair.update(interval)
        except FAILURES:
            return None
        rolls = result.newest.rolling_probability >= _ROLLING
        return result if result.root.length < _SETTLED_RECENT and rolls else None

    def _resolve_recent_keyframes(self, interval: Interval) -> FilterUpdate:
        """Estimate the next keyframe by a step of all recent ones; by the pass where that fails."""
        self.added.append(interval)
        recent = self.recent.extended(*self.added)
        recent = recent.with_families(walk_of(recent.t, recent.response, self._imu_noise))
        last = len(recent) - 1
        try:
            step = recent.settled_step({last}, _SETTLED_RECENT if self.heading_known else _SETTLED)
        except FAILURES as error:
            self.undelivered_pass = self._relinearise_window(str(error))
            return FilterUpdate.of(self.undelivered_pass.whole_window, self.undelivered_pass.root)
        first, states = last - len(self.added), step.window.states
        self.added = [added.at(states.take(slice(k, k + 2))) for k, added in enumerate(self.added, first)]
        self.newest = step.window_without_first(last)
        self.conditionals = [MarginalisedKeyframes.first(recent.t, step.root, step.linearisation_point, last)]
        return FilterUpdate.of(step.window, step.root)

    def _jump_along_track(self, interval: Interval, shift_m: float) -> FilterUpdate:
        """Shift the window along the track, where the votes of the fixes say so, and estimate the next keyframe."""
        begins = [self.window.states.take(slice(-1, None)), *(added.predicted for added in self.added)]
        *self.added, interval = (
            shift_interval(added, begin, shift_m) for added, begin in zip([*self.added, interval], begins, strict=True)
        )
        self.window, self.recent = shift_window(self.window, shift_m), shift_window(self.recent, shift_m)
        self.linearisation_point = self.linearisation_point.moved_along(shift_m)
        return self._resolve_recent_keyframes(interval)

    def _follow_creep(self, interval: Interval, creep: Creep) -> FilterUpdate:
        """Let the scale have walked since the fix before, and estimate the next keyframe by a pass of the window."""
        self.added.append(interval)
        oldest = float(self.window.t[0])
        if creep.since_s < oldest:
            self.votes.events += (creep.doubt(oldest),)
        self.undelivered_pass = self._relinearise_window(creep=creep)
        return FilterUpdate.of(self.undelivered_pass.whole_window, self.undelivered_pass.root)

    @property
    def _others_sd_m(self) -> float:
        """The sigma of the window's newest GNSS position, m; infinite where only wheels and fixes measure the distance.

        A further sensor of the speed notices any creep.
        """
        speed, gnss = (
            family_of(self.window.families, kind) for kind in (FactorType.SPEED_DISTANCE, FactorType.GNSS_POSITION)
        )
        if speed is not None and len(speed):
            return 0.0
        return float(np.max(gnss.sigma[-1, :2])) if gnss is not None and len(gnss) else np.inf

    def _record(self, update: FilterUpdate) -> FilterUpdate:
        self.speed_sd = update.speed_sd
        self.votes.update_covariance(update.covariance)
        for record in (self.gnss, self.gnss_speeds):
            record.put(update.newest_keyframes, update.covariance)
        return update

    def _relinearise_window(self, failure: str | None = None, creep: Creep | None = None) -> Relinearisation:
        """Relinearise the whole window and marginalise what is older than the lag.

        ``failure``: why the recent keyframes could not take their step; their states are then no linearisation point.
        ``creep``: what the last fix has shown of the wheel.
        """
        config, imu, last_pass = self.context.config.motion, self.context.description.imu, float(self.window.t[-1])
        window = self.window.extended(*self.added)
        now = float(window.t[-1])
        for record in (self.gnss, self.gnss_speeds):
            window = record.weigh(window, self.context.config.position.gnss_width)
        if creep is not None:
            window = with_creep(window, creep)
        elif failure is None:
            window = replace(window, states=self._back_substituted_states(window))
        self.rests.update(self.buffer, self.tach, window, config, (last_pass - LOOK_S, now + AFTER_S))
        window = self.noise.with_rests(window, self.buffer, self.rests.spans)
        walk = walk_of(window.t, window.response, self._imu_noise)
        window = window.with_families(walk, *resting(window.t, self.rests.spans, config, rigid=imu.rigid))
        leaving = before_recent = 0
        if self.heading_known or len(window) > _MOST_WITHOUT_HEADING:
            leaving = int(np.searchsorted(window.t, now - self.lag_s))
            before_recent = max(len(window) - _BEFORE_PASS, leaving)
        last = len(window) - 1
        marginalise = {leaving, before_recent, last} - {0}
        step, event = self._settle_window(window, marginalise, failure)
        weighed, covariance = self._reassessed(step, leaving)
        if weighed is not step.window:
            step, again = self._settle_window(weighed, marginalise, failure)
            event, covariance = event or again, None
        if self.heading_known:
            declared, walked = self.context.config.tach.scale_walk_per_sqrt_m, self.walks
            self.walks = scale_walks(step.window, declared, walks=walked)
            if self.walks and not walked:
                step, _ = self._settle_window(with_walk(step.window), marginalise, None)
                covariance = None
                event = event or Event(
                    "wheel-crept", "tach", last_pass, now, 0, "the wheel's scale changes: it may walk"
                )
        if not self.heading_known and self._heading_sd(step.window, step.root) < _HEADING_SD_RAD:
            self.heading_known = True
            for record in (self.gnss, self.gnss_speeds):
                record.forget()  # at rest a receiver's errors last for as long as the rest
        marginalised = step.marginalised_first(leaving) if leaving else None
        self.window, self.recent = step.window_without_first(leaving), step.window_without_first(before_recent)
        self.newest, self.root = step.window_without_first(last), step.root.last(len(self.window))
        self.linearisation_point = step.linearisation_point.take(slice(leaving, None))
        self.added, self.conditionals, self.predicted = [], [], None
        return Relinearisation(step.window, step.root, marginalised, event, covariance)

    def _reassessed(self, step: WindowStep, leaving: int) -> tuple[Window, Covariance | None]:
        """Return the window with sigmas as its residuals show them, and the covariance that these were judged by, if
        they were; sigmas of GNSS change with the next pass.

        Of GNSS and all else, what is further beyond its sigmas is judged, as in the batch. A street canyon bends the
        speed, too: doubts of it only count against the other sensors where these are noisier than declared.
        """
        window = step.window
        adapts = self.context.config.noise.adapt and self.heading_known and len(window) > 1
        groups: dict[str, Residuals] = {}
        covariance = None
        if adapts:
            covariance = posterior_covariance(step.root)
            groups = group_residuals(
                window, window.states, covariance, self.buffer.inertial.bridged_from(window.t[:-1])
            )
        ratios, changes = ratios_of(groups), False
        speed_doubted = self.speed_doubted and self.noise.has_risen
        for record, doubted in ((self.gnss, speed_doubted), (self.gnss_speeds, False)):
            level = float(np.median(record.usual))
            if doubted or self.noise.is_worse_than_gnss(ratios, GROUPS[record.kind], level):
                record.forget()
            else:
                changes |= record.judge(heading_known=self.heading_known)
        if changes or covariance is None:
            return window, covariance
        walk = walk_residuals(window, window.states, covariance)
        window = window if walk is None else self.walk.weigh(window, walk, leaving, self.noise.far_off)
        return self.noise.weigh(window, groups, leaving), covariance

    def _settle_window(
        self, window: Window, marginalise: Collection[int], failure: str | None
    ) -> tuple[WindowStep, Event | None]:
        """Return the whole window after its step, or after what had to take over, and the event of that."""
        now = float(window.t[-1])
        if failure is not None and not self.heading_known:  # undamped steps would not settle here either
            event = None if self.damped else Event("by-batch", t_s=now, detail=failure)
            self.damped = True
            return self._batch_solution(window).gauss_newton_step(marginalise), event
        event = None if failure is None else Event("by-window", t_s=now, detail=failure)
        try:
            step = window.settled_step(marginalise, _SETTLED)
        except FAILURES as error:
            event = Event("by-batch", t_s=now, detail=str(error))
            return self._batch_solution(window).gauss_newton_step(marginalise), event
        if step.window.suspects_slip:
            step = self._cheaper_by_batch(window, step, marginalise)
        return step, event

    def _cheaper_by_batch(self, window: Window, step: WindowStep, marginalise: Collection[int]) -> WindowStep:
        """Return the step at the window's batch solution where that exists and costs less, else the ``step`` taken."""
        try:
            batch = self._batch_solution(window)
            return batch.gauss_newton_step(marginalise) if batch.cost < step.window.cost else step
        except FAILURES:
            return step

    def _back_substituted_states(self, window: Window) -> States:
        """Return states of the whole window by back-substitution from the newest keyframe through the conditionals."""
        states, k, last_pass = [self.newest.states], len(window) - 1, len(self.window) - 1
        for older in reversed(self.conditionals):
            states.append(older.back_substitute(_with_own_bias(states[-1], window.response[k])))
            k -= len(older.t)
        if k:
            older = MarginalisedKeyframes.first(window.t, self.root, self.linearisation_point, k)
            # The newest keyframe of the last pass had the sensor's own bias: it began no interval then.
            next_state = _with_own_bias(states[-1], window.response[k]) if k == last_pass else states[-1]
            states.append(older.back_substitute(next_state))
        oldest, *later = reversed(states)
        return oldest.joined(*later)

    def _batch_solution(self, window: Window) -> Window:
        """Return the window solved by the damped batch solver, from its own states.

        Raises ``UnsolvableError`` where that has been done too often while the heading is unknown.
        """
        if not self.heading_known and self.damped_work >= _MOST_DAMPED:
            raise UnsolvableError(
                f"the heading is unknown after {len(window)} keyframes: their rows contradict each other"
            )
        solution = solve(window, self.context.config.solver)
        if not self.heading_known:
            distance = solution.states.odo.distance
            self.damped_work += solution.trials * int(np.sum(np.abs(distance - distance[0]) > _MOVED_M))
        return replace(window, states=solution.states)

    def _heading_sd(self, window: Window, root: SquareRoot) -> float:
        """Return the sigma of the newest yaw, rad."""
        covariance = posterior_covariance(root.last(1))
        variances = keyframe_variances(window.states.take(slice(-1, None)), covariance, self.context.lever_arm)
        return float(np.sqrt(variances[0, QUANTITIES.index("yaw_rad")]))


def _with_own_bias(states: States, response: Array) -> States:
    """Return states with the sensor's own bias, without the calibration's contribution over the interval after it."""
    return states.with_bias(states.bias - states.imu[0] @ response.T)

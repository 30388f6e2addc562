"""The running window: a filter step per keyframe, and every few keyframes a relinearisation pass.

Between two passes the window stays as the last one left it, at its linearisation point. The intervals since are kept
with the conditionals that their filter steps left, so that the next pass begins with back-substitution from the newest
keyframe and needs one Gauss-Newton step.

A filter step that doubts the wheel is replaced by a step of the *recent* keyframes, those since the last pass and two
before them: whether a wheel slipped shows in several intervals. If that fails, the pass is taken at once, with whatever
takes over where its own steps fail (:mod:`trackfg.streaming.window.window_solver`). Until the heading is known,
linearised positions are of little worth: nothing is marginalised then unless the window has more than 240 keyframes,
and the recent keyframes are the whole window.
"""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from trackfg.factors.factor_type import FactorType
from trackfg.factors.family import Family, family_of
from trackfg.factors.states import Kind, Nav, States, offset_in_keyframe
from trackfg.graph.inertial import walk_of
from trackfg.graph.motion import resting
from trackfg.numerics.arrays import Array
from trackfg.recording.description import ImuNoise
from trackfg.results.events import Event
from trackfg.sensors.tach import Wheel
from trackfg.solver.covariance import Covariance, posterior_covariance
from trackfg.solver.gauss_newton import solve
from trackfg.solver.square_root import SquareRoot
from trackfg.streaming.checkpoint.snapshot import DERIVED
from trackfg.streaming.window.filter_step import FilterResult, PredictedPair
from trackfg.streaming.window.fix_voting import FixVotes, shift_interval, shift_window
from trackfg.streaming.window.next_interval import predict_interval, with_other_rows
from trackfg.streaming.window.records.residual_records import ResidualRecords
from trackfg.streaming.window.rests import LOOK_S, Rests
from trackfg.streaming.window.sample_buffer import AFTER_S, SampleBuffer
from trackfg.streaming.window.starting_window import FirstProblem, KnownDistance, late_tach
from trackfg.streaming.window.stream_context import StreamContext
from trackfg.streaming.window.tach_buffer import TachBuffer
from trackfg.streaming.window.wheel_creep import WALK_PER_SQRT_M, Creep, scale_walks, with_creep, with_walk
from trackfg.streaming.window.window import FAILURES, Interval, MarginalisedKeyframes, Window, WindowStep
from trackfg.streaming.window.window_solver import SETTLED, WindowSolver

BETWEEN_PASSES = 10
"""Keyframes from one relinearisation pass to the next."""
_BEFORE_PASS = 2
"""Older keyframes among the recent ones: a slip shows in intervals one after the other."""
_RATES_S = 0.1
"""Time around the end of an interval, s, over which inertial samples give the rate there."""
_NOISE_S = 2.5
"""Time before an interval, s, over which inertial samples show its white noise: three blocks and more of
:mod:`trackfg.sensors.imu_noise`."""
_SETTLED_RECENT = 1000.0
"""Maximum length, in posterior sigmas, of a step of the recent keyframes. A wheel against the inertial sensor alone
makes some hundred; the pass does the rest.
"""
_MOST_WITHOUT_HEADING = 240
"""Keyframes in a window whose heading is not known: a vehicle may stand for hours before it shows."""
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
    ``scale_is_walking``: whether the wheel's scale walks by the accelerometer's evidence. ``undelivered_pass``: the
    result of a pass that :meth:`add_keyframe` had to take, or of the first window.
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
    solver: WindowSolver = field(default_factory=WindowSolver)
    records: ResidualRecords = field(default_factory=ResidualRecords)
    speed_sd: float = 0.0
    scale_is_walking: bool = False
    undelivered_pass: Relinearisation | None = None

    @classmethod
    def begin(
        cls, first: FirstProblem, buffer: SampleBuffer, votes: FixVotes, lag_s: float, *, on_map: bool, damped_work: int
    ) -> tuple[RunningWindow, FilterUpdate]:
        """Solve the first window. Raises as :func:`~trackfg.solver.gauss_newton.solve` does.

        ``damped_work``: that of the windows before, as :attr:`WindowSolver.damped_work_after` gives it.
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
            solver=WindowSolver(damped_work=damped_work),
            window=window,
            root=root,
            linearisation_point=states,
            recent=window,
            newest=newest,
            undelivered_pass=Relinearisation(window, root, None, first.waited),
        )
        running.records.noise.look_at_rests(buffer, problem.rests)  # the problem has the noise that they show
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
        pair = self._preintegrate_next(t)
        self.predicted = None
        interval = self._interval_with_other_rows(pair, t)
        if not self.on_map:
            interval, shift_m = self.votes.vote_on_fixes(interval, self.newest.states, self._others_sd_m)
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
    def heading_known(self) -> bool:
        """Return whether the heading is known, which it stays."""
        return self.solver.heading_known

    @property
    def _imu_noise(self) -> ImuNoise:
        """The declared noise of the inertial sensor, with the walk that residuals have shown."""
        return self.records.walk.of(self.context.description.imu.noise)

    @property
    def _pass_is_due(self) -> bool:
        return len(self.added) >= BETWEEN_PASSES

    def _preintegrate_next(self, t: float) -> PredictedPair:
        """Predict the interval to ``t`` by the inertial sensor, unless that has been done."""
        if self.predicted is None or self.predicted.prediction.interval.t != t:
            last = float(self.newest.t[0])
            data = self.buffer.intervals(last - _NOISE_S, t + _RATES_S)
            edges = data.edges_at([last, t])
            broken = self.buffer.has_break(last, t)
            noise = self.records.noise
            prediction = predict_interval(self.context, self.newest, data, edges, noise.shown, broken=broken)
            walks = self.scale_is_walking or self.records.rest_erred
            walk = max(self.votes.walk_per_sqrt_m, WALK_PER_SQRT_M if walks else 0.0)
            prediction = prediction.with_walking_scale(walk)
            bridged = bool(data.bridged[edges[0]])
            weighed = noise.weigh_next(prediction.interval, bridged=bridged)
            self.predicted = PredictedPair.of(self.newest, prediction._replace(interval=weighed), self._imu_noise)
        return self.predicted

    def _interval_with_other_rows(self, pair: PredictedPair, t: float) -> Interval:
        """Return the interval to ``t`` with the factors of the other sensors' rows, weighed by the records."""
        buffer, last = self.buffer, float(self.newest.t[0])
        wheel = self._wheel_until(t, pair.prediction.interval.predicted.nav)
        interval = with_other_rows(pair.prediction, buffer.other_rows_between(last, t), wheel, self.speed_sd)
        width = self.context.config.position.gnss_width
        return interval._replace(families=self.records.weigh_others(interval.families, width))

    def _wheel_until(self, t: float, predicted: Nav) -> Wheel | None:
        """Return the wheel up to the keyframe at ``t`` and a little more, signed by the newest and the ``predicted``
        motion; None without a tach.
        """
        buffer, newest = self.buffer, self.newest
        last = float(newest.t[0])
        if self.tach is None:
            self.tach = late_tach(buffer, self.context.config, last, float(newest.states.odo.count[0]))
        if self.tach is None:
            return None
        forward = (float(nav.v[0] @ nav.R[0, :, 0]) for nav in (newest.states.nav, predicted))
        begin, end = (speed if abs(speed) > _CERTAIN_SIGMAS * self.speed_sd else 0.0 for speed in forward)
        until = self.tach.rows_end(t, buffer.tach, buffer.until) or t + AFTER_S
        return self.tach.wheel_until(until, buffer.tach, last, (begin, end), buffer.uncounted)

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
            step = recent.settled_step({last}, _SETTLED_RECENT if self.heading_known else SETTLED)
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
        self.records.put(update.newest_keyframes, update.covariance)
        return update

    def _relinearise_window(self, failure: str | None = None, creep: Creep | None = None) -> Relinearisation:
        """Relinearise the whole window and marginalise what is older than the lag.

        ``failure``: why the recent keyframes could not take their step; their states are then no linearisation point.
        ``creep``: what the last fix has shown of the wheel.
        """
        last_pass = float(self.window.t[-1])
        window = self._extended_window(failure, creep)
        now, last, leaving, before_recent = float(window.t[-1]), len(window) - 1, 0, 0
        if self.heading_known or len(window) > _MOST_WITHOUT_HEADING:
            leaving = int(np.searchsorted(window.t, now - self.lag_s))
            before_recent = max(len(window) - _BEFORE_PASS, leaving)
        marginalise = {leaving, before_recent, last} - {0}
        step, covariance, event = self._reassessed_step(window, marginalise, leaving, failure)
        if self.heading_known:
            declared, walked = self.context.config.tach.scale_walk_per_sqrt_m, self.scale_is_walking
            self.scale_is_walking = scale_walks(step.window, declared, walks=walked)
            if self.scale_is_walking and not walked:
                step, _ = self._settle(with_walk(step.window), marginalise)
                detail = "the wheel's scale changes: it may walk"
                covariance, event = None, event or Event("wheel-crept", "tach", last_pass, now, 0, detail)
        if self.solver.finds_heading(step, self.context.lever_arm):
            self.records.forget_receiver()
        marginalised = step.marginalised_first(leaving) if leaving else None
        self.window, self.recent = step.window_without_first(leaving), step.window_without_first(before_recent)
        self.newest, self.root = step.window_without_first(last), step.root.last(len(self.window))
        self.linearisation_point = step.linearisation_point.take(slice(leaving, None))
        self.added, self.conditionals, self.predicted = [], [], None
        return Relinearisation(step.window, step.root, marginalised, event, covariance)

    def _extended_window(self, failure: str | None, creep: Creep | None) -> Window:
        """Return the window with all keyframes since the last pass, at its new linearisation point, with what is known
        by now of GNSS, rests and noise.
        """
        config, imu, last_pass = self.context.config, self.context.description.imu, float(self.window.t[-1])
        window = self.records.weigh_receiver(self.window.extended(*self.added), config.position.gnss_width)
        if creep is not None:
            window = with_creep(window, creep)
        elif failure is None:
            window = replace(window, states=self._back_substituted_states(window))
        span = last_pass - LOOK_S, float(window.t[-1]) + AFTER_S
        self.rests.update(self.buffer, self.tach, window, config.motion, span)
        window = self.records.noise.with_rests(window, self.buffer, self.rests.spans)
        walk = walk_of(window.t, window.response, self._imu_noise)
        return window.with_families(walk, *resting(window.t, self.rests.spans, config.motion, rigid=imu.rigid))

    def _reassessed_step(
        self, window: Window, marginalise: Collection[int], leaving: int, failure: str | None
    ) -> tuple[WindowStep, Covariance | None, Event | None]:
        """Return the window's step, taken again where its residuals change sigmas, its covariance where that is known,
        and an event where something had to take over.
        """
        step, event = self._settle(window, marginalise, failure)
        bridged = self.buffer.inertial.bridged_from(window.t[:-1])
        adapts = self.context.config.noise.adapt
        known = self.heading_known
        weighed, covariance = self.records.reassess(step, leaving, bridged, adapts=adapts, heading_known=known)
        if weighed is step.window:
            return step, covariance, event
        step, again = self._settle(weighed, marginalise, failure)
        return step, None, event or again

    def _settle(
        self, window: Window, marginalise: Collection[int], failure: str | None = None
    ) -> tuple[WindowStep, Event | None]:
        return self.solver.settle(window, self.context.config.solver, marginalise, failure)

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


def _with_own_bias(states: States, response: Array) -> States:
    """Return states with the sensor's own bias, without the calibration's contribution over the interval after it."""
    return states.with_bias(states.bias - states.imu[0] @ response.T)

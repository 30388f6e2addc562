"""The first window of a stream: ten seconds that are solved as a batch.

It begins where something measures the speed: with the first rows of the tach or of GNSS. A tach that begins within a
window cannot be distinguished from one that stood before, so stretches without its rows are passed over, and reported.

Without a latitude the Earth may turn, and does on every railway. The batch widens that prior where its data contradict
an Earth that does not (:mod:`trackfg.smoothing.wide_priors`). A stream cannot do so later, so its prior is wide.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from trackfg.checks.limits import CheckLimits
from trackfg.config import SmoothConfig
from trackfg.factors.factor_type import FactorType
from trackfg.graph.build import Problem, build_problem, with_start_at
from trackfg.graph.inputs import world_of
from trackfg.graph.priors import with_free_start, with_turning_earth
from trackfg.results.events import Event
from trackfg.sensors.tach import read_wheel
from trackfg.streaming.window.sample_buffer import AFTER_S, SampleBuffer
from trackfg.streaming.window.stream_context import StreamContext
from trackfg.streaming.window.tach_buffer import TachBuffer

START_S = 10.0
"""The length of the first window, s."""
_LATE_S = 1.0
"""A tach, or GNSS, whose first row comes so much later than the inertial sensor's begins late, s."""


@dataclass(frozen=True)
class KnownDistance:
    """The distance along the track at ``t_s`` with its sigma, m, as a lost window left it."""

    t_s: float
    distance_m: float
    sd_m: float

    def sd_at(self, t_s: float) -> float:
        """Return the sigma at a later time, m: in between the vehicle may have run at any speed."""
        return float(np.hypot(self.sd_m, CheckLimits().speed_error_mps * (t_s - self.t_s)))


@dataclass
class StartingWindow:
    """A window that has not begun. ``requested_s``: when it would begin if the speed were measured, ``begin_s``: when
    it does as far as is known; None until the inertial sensor has rows. ``distance``: where the window before ended.
    """

    requested_s: float | None = None
    begin_s: float | None = None
    distance: KnownDistance | None = None

    @classmethod
    def after(cls, t_s: float, distance: KnownDistance | None) -> StartingWindow:
        """Return a window that begins at ``t_s`` or later."""
        return cls(t_s, t_s, distance)

    def end(self, buffer: SampleBuffer) -> float | None:
        """Return the time of the first window's end, s; None while nothing measures the speed."""
        if buffer.is_empty:
            return None
        if self.begin_s is None:
            self.begin_s = self.requested_s = float(buffer.inertial.edges[0])
        while (first := buffer.first_speed(self.begin_s)) is not None:
            if first > self.begin_s + _LATE_S:
                self.begin_s = first
            end = self.begin_s + START_S
            if buffer.until < end + AFTER_S or buffer.measures_speed(self.begin_s, end):
                return end
            self.begin_s = end
        return None

    def without_speed(self, until_s: float) -> Event | None:
        """Return the event that nothing measured the speed up to a time; None where it did."""
        if self.requested_s is None or until_s <= self.requested_s + _LATE_S:
            return None
        detail = "nothing measured the speed: expected rows of the tach or of GNSS; estimates begin with these"
        return Event("no-speed", t_s=self.requested_s, until_s=until_s, detail=detail)

    def problem(self, buffer: SampleBuffer, config: SmoothConfig, end: float, *, on_map: bool) -> FirstProblem:
        """Return the batch problem of the window that ends at ``end``, s.

        ``on_map``: a map will give the distance, which is unknown until then. Raises as
        :func:`~trackfg.graph.build.build_problem` does.
        """
        begin, description = end - START_S, buffer.description
        recording = buffer.recording(begin, end)
        if recording.tach is not None and not recording.tach["t_s"].iloc[:1].lt(begin + _LATE_S).any():
            recording = replace(recording, tach=None)
        problem = build_problem(recording, config, buffer.intervals(begin, end), steps=False)
        if (description.fixes is not None or on_map) and problem.family(FactorType.ABSOLUTE_FIX) is None:
            problem = replace(problem, families=with_free_start(problem.families))
        world = world_of(recording)
        if not world.earth_rate.any():
            problem = replace(problem, families=with_turning_earth(problem.families))
        tach = None
        if problem.wheel is not None and recording.tach is not None and description.tach is not None:
            rows = recording.tach.to_numpy()
            tach = TachBuffer.of(problem.wheel, rows, description.tach, max_gap_s=config.tach.max_gap_s)
            problem = replace(problem, families=tach.with_known_rounding(problem.families))
        if self.distance is not None:
            problem = with_start_at(problem, self.distance.distance_m, self.distance.sd_at(begin))
        context = StreamContext(description, config, world, problem.clock_origin)
        return FirstProblem(problem, context, tach, self.without_speed(begin))


@dataclass(frozen=True)
class FirstProblem:
    """The batch problem of the first window, what stays constant along the stream, and the tach if it has one.

    ``waited``: the event that nothing measured the speed before.
    """

    problem: Problem
    context: StreamContext
    tach: TachBuffer | None
    waited: Event | None


def late_tach(buffer: SampleBuffer, config: SmoothConfig, t: float, count: float) -> TachBuffer | None:
    """Return a tach that began after the first window did, once it has sent rows for :data:`START_S` up to ``t``, s.

    Its distances are shifted so that the count at ``t`` is ``count``, m.
    """
    recording = buffer.recording(t - START_S, t)
    wheel, tach = read_wheel(recording, config.tach.max_gap_s), buffer.description.tach
    if wheel is None or tach is None or recording.tach is None or wheel.t[0] > t - START_S + _LATE_S:
        return None
    return TachBuffer.of(wheel, recording.tach.to_numpy(), tach, max_gap_s=config.tach.max_gap_s).counting_on(t, count)

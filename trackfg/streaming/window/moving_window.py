"""The window along a stream: it begins, runs, and begins anew where it was lost.

Where a step fails another one takes over, in this order: instead of a filter step one of the newest keyframes, then a
relinearisation pass (:mod:`~trackfg.streaming.window.running_window`), a batch solution of the window
(:mod:`~trackfg.streaming.window.window_solver`), and last a new first window
(:mod:`~trackfg.streaming.window.starting_window`), which begins where the lost one ended.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, field
from typing import NamedTuple

from trackfg.config import SmoothConfig
from trackfg.results.events import Event
from trackfg.streaming.window.fix_voting import FixVotes
from trackfg.streaming.window.running_window import FilterUpdate, Relinearisation, RunningWindow
from trackfg.streaming.window.sample_buffer import AFTER_S, SampleBuffer
from trackfg.streaming.window.starting_window import StartingWindow
from trackfg.streaming.window.window import FAILURES

_SHORTEST_S = 0.02
"""The last interval of a stream is as long as this, s, or there is none."""


class LostWindow(NamedTuple):
    """A window that no solver could continue from ``begin_s`` on, as its last pass ``left`` it, if it had begun."""

    begin_s: float
    reason: str
    left: RunningWindow | None


@dataclass
class MovingWindow:
    """The window of a stream with the keyframes of the last ``lag_s`` seconds, and up to ten more.

    ``running`` is None before the window has begun, which ``starting`` waits for. ``on_map``: a map gives the distance.
    ``keyframe_spacing``: how many times further apart keyframes are than the settings say. ``damped_work``: the
    batch solver's steps times keyframes on lost windows, as far as they count towards the bound of the next one.
    """

    buffer: SampleBuffer
    config: SmoothConfig
    lag_s: float
    on_map: bool = False
    keyframe_spacing: float = 1.0
    starting: StartingWindow = field(default_factory=StartingWindow)
    running: RunningWindow | None = None
    votes: FixVotes = field(default_factory=FixVotes)
    lost: LostWindow | None = None
    damped_work: int = 0

    def next_keyframe(self) -> float | None:
        """Return the time of the next keyframe, s; None while rows are missing."""
        if self.running is None:
            return self.starting.end(self.buffer)
        return self.running.next_keyframe(self.keyframe_spacing)

    def has_rows_for(self, t: float) -> bool:
        """Return whether the rows that a keyframe at ``t`` needs are there."""
        return self.buffer.until >= t + AFTER_S and (self.running is None or self.running.has_tach_for(t))

    def prepare(self, t: float) -> None:
        """Do what can be done of the keyframe at ``t`` before its last rows come.

        What fails here fails again in :meth:`add_keyframe`, which deals with it.
        """
        if self.running is not None:
            with suppress(*FAILURES):
                self.running.prepare(t)

    def add_keyframe(self, t: float) -> FilterUpdate | None:
        """Estimate the next keyframe, at ``t``; None where the window was lost by it."""
        try:
            if self.running is not None:
                return self.running.add_keyframe(t)
            first = self.starting.problem(self.buffer, self.config, t, on_map=self.on_map)
            self.running, update = RunningWindow.begin(
                first, self.buffer, self.votes, self.lag_s, on_map=self.on_map, damped_work=self.damped_work
            )
        except FAILURES as error:
            self._lose(t, str(error))
            return None
        return update

    def add_last_keyframe(self) -> FilterUpdate | None:
        """Estimate a keyframe at the end of all rows, if they reach beyond the newest one."""
        self.buffer.end()
        if self.running is None or self.buffer.until < self.running.newest.t[0] + _SHORTEST_S:
            return None
        return self.add_keyframe(self.buffer.until)

    def relinearise_if_due(self, *, at_end: bool = False) -> Relinearisation | None:
        """Take the relinearisation pass, if it is due; at the end of the stream it always is."""
        if self.running is None:
            return None
        try:
            return self.running.relinearise_if_due(at_end=at_end)
        except FAILURES as error:
            self._lose(float(self.running.window.t[-1]), str(error))
            return None

    def pop_lost(self) -> LostWindow | None:
        """Return the window that was lost since the last call."""
        lost, self.lost = self.lost, None
        return lost

    def waiting_event(self) -> Event | None:
        """Return the event that the stream has not begun because nothing measures the speed, if that is so."""
        if self.running is not None or self.next_keyframe() is not None:
            return None
        return self.starting.without_speed(self.buffer.until)

    def _lose(self, t: float, reason: str) -> None:
        """Begin anew where the last pass knew the vehicle, or after rows that do not make a first window."""
        begin, distance = t, self.starting.distance
        if self.running is not None:
            distance, self.damped_work = self.running.known_distance, self.running.solver.damped_work_after
            begin = distance.t_s
        self.lost = LostWindow(begin, reason, self.running)
        self.running, self.starting = None, StartingWindow.after(begin, distance)

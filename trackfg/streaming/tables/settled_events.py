"""The events of what left the lag, by the functions that the batch smoother uses; each is told once, when it is over.

A piece of a stream ends anywhere. An event that ends later than the piece, or so near its end that it may go on, is
told with a later one, whole: the keyframes that it is made from are kept until then. One that lasts longer than
``LONGEST_S`` is told in parts.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from trackfg.factors.factor_type import FactorType
from trackfg.factors.family import changed
from trackfg.factors.states import States
from trackfg.graph.run_context import RunContext
from trackfg.numerics.arrays import Array
from trackfg.numerics.spans import union
from trackfg.output.dense_motion import DenseMotion
from trackfg.output.event_sources import EventSources
from trackfg.output.events import Event, events
from trackfg.output.slip_events import wheel_excess
from trackfg.output.trajectory import trajectory_table
from trackfg.solver.covariance import Covariance
from trackfg.streaming.checkpoint.json_numbers import finite_or_none
from trackfg.streaming.events import StreamEvent

LONGEST_S = 300.0
_STEP_S = 0.1
_REST_GROWS_S = 10.0
"""The end of a rest may be found so much later."""
_BEFORE_S = 0.5
"""A rate at a time needs this much before it."""
_MOVED_M = 1.0
"""A wheel that has not turned over a longer distance is silent."""

EVENT_TABLES = {
    "standstill": "imu",
    "imu gap": "imu",
    "tach gap": "tach",
    "slip": "tach",
    "slide": "tach",
    "fix used": "fixes",
    "fix set aside": "fixes",
    "gnss set aside": "gnss",
}
"""Which table an event concerns; a map is none."""
_EITHER = {"fix used": "fix", "fix set aside": "fix", "landmark used": "landmark", "landmark set aside": "landmark"}
"""Kinds of which one thing has either."""


@dataclass
class SettledEvents:
    """``since_s``: from when on keyframes are still needed. ``told_s``: by kind, until when all are told. ``rests``
    (r, 2), s: those that may not have been told.
    """

    since_s: float
    told_s: dict[str, float] = field(default_factory=dict)
    rests: Array = field(default_factory=lambda: np.zeros((0, 2)))

    def until(
        self,
        sources: EventSources,
        run: RunContext,
        motion: DenseMotion,
        states: States,
        covariance: Covariance,
        settled_s: float,
        *,
        at_end: bool,
    ) -> tuple[StreamEvent, ...]:
        """The events that are over before ``settled_s``; at the end of the stream all there are.

        ``sources`` has the families, rests, gaps and the wheel of all keyframes, from :attr:`since_s` or before to
        ``settled_s`` or after.
        """
        sources = self._untold(sources)
        clock = np.arange(np.ceil(self.since_s / _STEP_S - 1e-6), np.floor(settled_s / _STEP_S + 1e-6) + 1.0) * _STEP_S
        trajectory = trajectory_table(run, motion.at(clock), states, covariance)
        excess = wheel_excess(sources, states, trajectory)
        rolled_s = settled_s if excess is None else excess.open_since()
        latest = {"standstill": settled_s - _REST_GROWS_S, "slip": rolled_s, "slide": rolled_s}
        told, waiting, cut = [], [rolled_s - _BEFORE_S, _turned_s(sources, states)], []
        for event in events(sources, states, covariance, trajectory):
            if not self.told_s.get(_thing(event), -np.inf) < event.start_s <= settled_s:
                continue
            over = event.end_s <= latest.get(event.kind, settled_s)
            at_rest = event.kind == "standstill"  # a vehicle at rest is where it was
            lasts = not at_rest and event.start_s < settled_s - LONGEST_S
            if over or lasts or at_end:
                told.append(event)
            elif not at_rest:
                waiting.append(event.start_s - _BEFORE_S)
            if lasts and not over:
                cut.append(min(event.end_s, settled_s) + _STEP_S)
        self.told_s |= {_thing(event): event.end_s for event in told}
        self.since_s = max(self.since_s, min(waiting), settled_s - LONGEST_S, *cut)
        return tuple(_stream_event(event) for event in told)

    def _untold(self, sources: EventSources) -> EventSources:
        """With the rests of before, and without the GNSS positions that are told: runs of them are one event."""
        rests = union(np.concatenate([self.rests, sources.rests]))
        self.rests = rests[rests[:, 1] > self.told_s.get("standstill", -np.inf)]
        since = self.told_s.get("gnss set aside", -np.inf)
        families = changed(
            sources.families,
            FactorType.GNSS_POSITION,
            lambda family: family.take(sources.t[family.first_keyframe] > since),
        )
        return replace(sources, rests=self.rests, families=families)


def _thing(event: Event) -> str:
    return _EITHER.get(event.kind, event.kind)


def _turned_s(sources: EventSources, states: States) -> float:
    """Since when the wheel has been silent although the vehicle moved; infinite where it is not."""
    if sources.wheel is None:
        return np.inf
    turned = np.flatnonzero(np.diff(sources.wheel.distance))
    last = float(sources.wheel.t[turned[-1] + 1 if turned.size else 0])
    distance = states.odo.distance
    return last if abs(distance[-1] - np.interp(last, sources.t, distance)) > _MOVED_M else np.inf


def _stream_event(event: Event) -> StreamEvent:
    kind, start, end, *numbers, detail = event
    known = (finite_or_none(value) for value in numbers)
    return StreamEvent(kind, EVENT_TABLES.get(kind, ""), start, end, 0, detail, *known)

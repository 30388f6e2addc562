"""Settled events are those of what left the lag, by the batch smoother's functions; each is emitted once it is over.

A piece of a stream ends anywhere. An event that ends later than the piece, or so near its end that it may go on, is
emitted whole with a later one: the keyframes that it is made from are kept until then. An event longer than
``LONGEST_S`` is emitted in parts.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from trackfg.factors.factor_type import FactorType
from trackfg.factors.family import changed
from trackfg.factors.states import States
from trackfg.graph.run_context import RunContext
from trackfg.numerics.arrays import Array
from trackfg.numerics.spans import union
from trackfg.output.dense_motion import DenseMotion
from trackfg.output.event_sources import EventSources
from trackfg.output.events import events
from trackfg.output.slip_events import wheel_excess
from trackfg.output.trajectory import trajectory_columns
from trackfg.results.events import Event
from trackfg.solver.covariance import Covariance

LONGEST_S = 300.0
"""An event that lasts longer is emitted in parts, s: keyframes are kept no longer for it."""
_STEP_S = 0.1
"""Step of the trajectory in which slips are found, s: that of the batch's default rate."""
_REST_GROWS_S = 10.0
"""The end of a rest may move by so much while the window passes over it, s."""
_BEFORE_S = 0.5
"""A rate at a time needs rows from this much before it, s."""
_MOVED_M = 1.0
"""A wheel that has not turned over a longer distance is silent, m."""

_SILENT_S = 5.0
"""A tach whose rows end so long before those of the IMU was silent, s; a logger may end one file before another."""

_EITHER = {"fix used": "fix", "fix set aside": "fix", "landmark used": "landmark", "landmark set aside": "landmark"}
"""Kinds that exclude each other, by what they are of."""


class EventInput(NamedTuple):
    """The input that events are made from: the sources of all keyframes from :attr:`SettledEvents.needed_since_s` or
    before to the time up to which they are emitted or after, with their run, motion, states and covariance.
    """

    sources: EventSources
    run: RunContext
    motion: DenseMotion
    states: States
    covariance: Covariance


@dataclass
class SettledEvents:
    """Emits the events of a stream, each once. ``needed_since_s``: oldest keyframe time still needed.

    ``emitted_s[kind]``: events of this kind that begin before it have been emitted. ``rests`` (r, 2), s: those that may
    not have been.
    """

    needed_since_s: float
    emitted_s: dict[str, float] = field(default_factory=dict)
    rests: Array = field(default_factory=lambda: np.zeros((0, 2)))

    def emit(self, inputs: EventInput, settled_s: float, *, at_end: bool) -> tuple[Event, ...]:
        """Return the events that are over before ``settled_s``; at the end of the stream all that are left."""
        sources, run, motion, states, covariance = inputs
        sources = self._unemitted(_silent_to_the_end(sources, states) if at_end else sources)
        first, last = np.ceil(self.needed_since_s / _STEP_S - 1e-6), np.floor(settled_s / _STEP_S + 1e-6)
        clock = np.arange(first, last + 1.0) * _STEP_S
        excess = wheel_excess(sources, states, trajectory_columns(run, motion.at(clock), states, covariance))
        rolled_s = settled_s if excess is None else excess.open_since()
        latest = {"standstill": settled_s - _REST_GROWS_S, "slip": rolled_s, "slide": rolled_s}
        over, waiting, cut = [], [rolled_s - _BEFORE_S, _turned_s(sources, states)], []
        for event in events(sources, states, covariance, excess):
            start_s, end_s = event.span_s
            if not self.emitted_s.get(_thing(event), -np.inf) < start_s <= settled_s:
                continue
            is_over = end_s <= latest.get(event.kind, settled_s)
            at_rest = event.kind == "standstill"  # a vehicle at rest is where it was
            lasts = not at_rest and start_s < settled_s - LONGEST_S
            if is_over or lasts or at_end:
                over.append(event)
            elif not at_rest:
                waiting.append(start_s - _BEFORE_S)
            if lasts and not is_over:
                cut.append(min(end_s, settled_s) + _STEP_S)
        self.emitted_s |= {_thing(event): event.span_s[1] for event in over}
        self.needed_since_s = max(self.needed_since_s, min(waiting), settled_s - LONGEST_S, *cut)
        return tuple(over)

    def _unemitted(self, sources: EventSources) -> EventSources:
        """Return sources with the earlier rests, and without GNSS positions whose run has been emitted."""
        rests = union(np.concatenate([self.rests, sources.rests]))
        self.rests = rests[rests[:, 1] > self.emitted_s.get("standstill", -np.inf)]
        since = self.emitted_s.get("gnss set aside", -np.inf)
        families = changed(
            sources.families,
            FactorType.GNSS_POSITION,
            lambda family: family.take(sources.t[family.first_keyframe] > since),
        )
        return replace(sources, rests=self.rests, families=families)


def _thing(event: Event) -> str:
    return _EITHER.get(event.kind, event.kind)


def _silent_to_the_end(sources: EventSources, states: States) -> EventSources:
    """Return sources of a whole stream with a gap of a tach that had no more rows although the vehicle moved on."""
    wheel = sources.wheel
    if wheel is None:
        return sources
    last, end = float(wheel.t[-1]), float(sources.t[-1])
    if not _moved_since(last, sources, states) or end - last < _SILENT_S:
        return sources
    since = max(last, float(sources.t[0]))  # older keyframes, and where they were, are forgotten
    return replace(sources, wheel=replace(wheel, gaps=np.concatenate([wheel.gaps, [[since, end]]])))


def _turned_s(sources: EventSources, states: States) -> float:
    """Return since when the wheel has been silent although the vehicle moved, s; infinite where it is not."""
    if sources.wheel is None:
        return np.inf
    turned = np.flatnonzero(np.diff(sources.wheel.distance))
    last = float(sources.wheel.t[turned[-1] + 1 if turned.size else 0])
    return last if _moved_since(last, sources, states) else np.inf


def _moved_since(t: float, sources: EventSources, states: States) -> bool:
    distance = states.odo.distance
    return bool(abs(distance[-1] - np.interp(t, sources.t, distance)) > _MOVED_M)

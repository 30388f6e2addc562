"""A stream reports its doubts while it runs, since it may never end: after 2, 4, 8 minutes and so on, then each hour.

Tests of the sigmas are over all that has come so far. Each look at them is another chance of a false alarm, so that
looks are far apart. A doubt is reported when it is new; at the end of the stream all are, with the factors of the
whole.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from trackfg.results.events import Event, doubt_event
from trackfg.results.verdict import Doubt

_FIRST_S = 120.0
"""Time from the first estimates to the first look, s: six times a lag of 20 s."""

_LONGEST_S = 3600.0
"""Longest time between looks, s."""

_NUMBER = re.compile(r"[-+]?\d+(\.\d+)?(e[-+]?\d+)?")


@dataclass
class DoubtReports:
    """The reports so far, and the time of the next.

    ``began_s``: when estimates began, ``next_s``: when doubts are looked for next, s; ``reported``: the subjects of
    those that were reported.
    """

    began_s: float = -np.inf
    next_s: float = -np.inf
    reported: tuple[str, ...] = ()

    def are_due(self, now_s: float) -> bool:
        """Return whether it is time to look for them; the first call begins to count."""
        if np.isinf(self.began_s):
            self.began_s, self.next_s = now_s, now_s + _FIRST_S
        if now_s < self.next_s:
            return False
        self.next_s = now_s + min(now_s - self.began_s, _LONGEST_S)
        return True

    def new(self, found: Iterable[Event]) -> tuple[Event, ...]:
        """Return those of the doubts ``found`` that are new."""
        new = tuple(event for event in found if subject_of(event) not in self.reported)
        self.reported += tuple(subject_of(event) for event in new)
        return new


def subject_of(event: Event) -> str:
    """Return what an event is about: its kind and its sentence without the numbers."""
    return f"{event.kind}: {_NUMBER.sub('', event.detail)}"


def event_of(doubt: Doubt, until_s: float) -> Event:
    """Return the event of a doubt as the batch has it, known at ``until_s``, s: a stream widens no written sigmas."""
    widened = f"multiply its sigmas by {doubt.factor:.1f}" if math.isfinite(doubt.factor) else "do not trust it"
    return doubt_event(doubt.quantities, doubt.reason, f"{widened}, or {doubt.hint}", t_s=until_s)

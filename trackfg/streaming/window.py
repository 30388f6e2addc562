"""The graph of the newest keyframes, as it moves along: one keyframe more in front, the oldest left behind.

Families, inertial measurements and solution are those of :mod:`trackfg.graph`; keyframes are numbered from the oldest
one that is in the window. What is left behind stays as one factor, :mod:`trackfg.factors.past`.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from trackfg.elimination import Conditionals, eliminate_leaving
from trackfg.factors.family import Family, LinearFactors
from trackfg.factors.imu import Preintegration, linearize_imu_factors
from trackfg.factors.past import past
from trackfg.factors.states import States
from trackfg.frames import Array
from trackfg.inertial_factors import graph_of
from trackfg.square_root import SquareRoot


class Interval(NamedTuple):
    """What the time from the newest keyframe (number 0) to the next one (number 1) brings.

    ``bias`` (6,) over the interval, what the calibration adds included; ``response`` (6, 21) to it. ``ahead``: the next
    keyframe as predicted, alone.
    """

    t: float
    bias: Array
    ahead: States
    measured: Preintegration
    response: Array
    families: tuple[Family, ...]


class Gone(NamedTuple):
    """Keyframes left behind: when, their conditionals, and where these were linearised, next keyframe included; and the
    factors that went with them.
    """

    t: Array
    conditionals: Conditionals
    origin: States
    families: tuple[Family, ...] = ()


@dataclass(frozen=True)
class Window:
    """Keyframes at ``t`` (n,), s; the first keyframe's past is among the ``families``."""

    t: Array
    states: States
    measured: tuple[Preintegration, ...]
    response: Array
    families: tuple[Family, ...]

    def __len__(self) -> int:
        return len(self.t)

    def with_families(self, *families: Family) -> Window:
        """With these in the place of those of the same names."""
        names = {family.name for family in families}
        kept = (family for family in self.families if family.name not in names)
        return replace(self, families=(*kept, *(family for family in families if len(family))))

    def extended(self, *intervals: Interval) -> Window:
        """With the next keyframes."""
        known = {family.name: [family] for family in self.families}
        for last, interval in enumerate(intervals, len(self) - 1):
            for family in interval.families:
                known.setdefault(family.name, []).append(family.shifted(last))
        response = [self.response[:-1], *(interval.response[None] for interval in intervals)]
        bias = np.concatenate([self.states.bias[:-1], *(interval.bias[None] for interval in intervals)])
        states = self.states.joined(*(interval.ahead for interval in intervals))
        return Window(
            np.append(self.t, [interval.t for interval in intervals]),
            replace(states, bias=np.concatenate([bias, states.bias[-1:]])),
            (*self.measured, *(interval.measured for interval in intervals)),
            np.concatenate([*response, np.zeros_like(self.response[:1])]),
            tuple(same[0].joined(*same[1:]) if len(same) > 1 else same[0] for same in known.values()),
        )

    def linearized(self) -> list[LinearFactors]:
        """All factors at the window's states."""
        inertial = linearize_imu_factors(graph_of(self.measured), self.states.to_gtsam())
        return [inertial, *(family.linearize(self.states) for family in self.families)]

    def moved(self, gone: Collection[int] = ()) -> Stepped:
        """One Gauss-Newton step on; for each of ``gone`` so many of the first keyframes can be left behind then.

        Raises ``UnsolvableError`` where the states are not determined, ``ValueError`` where they leave all bounds.
        """
        root, left = eliminate_leaving(self.linearized(), len(self), gone)
        if not np.isfinite(root.length):
            raise ValueError("the step is not finite")
        return Stepped(replace(self, states=self.states.moved(root.solution())), root, left, self.states)


class Stepped(NamedTuple):
    """A window after a step, the square root of its information, and for some numbers of first keyframes what these
    leave for the rest (:func:`~trackfg.elimination.eliminate_leaving`); both as linearised at ``origin``.
    """

    window: Window
    root: SquareRoot
    left: Mapping[int, Array]
    origin: States

    def without(self, gone: int) -> tuple[Window, Gone]:
        """Without the first ``gone`` keyframes, and what went."""
        window, root, origin = self.window, self.root, self.origin
        kept = [
            family.following(later, window.states).shifted(-gone)
            for family in window.families
            if (later := np.flatnonzero(family.first_keyframe >= gone)).size
        ]
        rest = Window(
            window.t[gone:],
            window.states.take(slice(gone, None)),
            window.measured[gone:],
            window.response[gone:],
            (past(self.left[gone], origin.take(slice(gone, gone + 1))), *kept),
        )
        conditionals = Conditionals(root.R[:gone], root.S[:gone], root.d[:gone])
        left = tuple(family.take(family.first_keyframe < gone) for family in window.families)
        return rest, Gone(window.t[:gone], conditionals, origin.take(slice(0, gone + 1)), left)

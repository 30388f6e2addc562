"""The graph of the newest keyframes, as it moves along: one keyframe more in front, the oldest left behind.

Families, inertial measurements and solution are those of :mod:`trackfg.graph`; keyframes are numbered from the oldest
one that is in the window. What is left behind stays as one factor, :mod:`trackfg.factors.past`.
"""

from __future__ import annotations

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
    """Keyframes left behind: when, their conditionals, and where these were linearised, next keyframe included."""

    t: Array
    conditionals: Conditionals
    origin: States


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

    def extended(self, interval: Interval) -> Window:
        """With the next keyframe."""
        last = len(self) - 1
        known = {family.name: family for family in self.families}
        for family in interval.families:
            later = family.shifted(last)
            known[family.name] = known[family.name].joined(later) if family.name in known else later
        response = np.concatenate([self.response[:-1], interval.response[None], np.zeros_like(self.response[:1])])
        bias = np.concatenate([self.states.bias[:-1], interval.bias[None]])
        return Window(
            np.append(self.t, interval.t),
            replace(self.states, bias=bias).joined(interval.ahead),
            (*self.measured, interval.measured),
            response,
            tuple(known.values()),
        )

    def linearized(self) -> list[LinearFactors]:
        """All factors at the window's states."""
        inertial = linearize_imu_factors(graph_of(self.measured), self.states.to_gtsam())
        return [inertial, *(family.linearize(self.states) for family in self.families)]

    def moved(self, gone: int) -> tuple[Window, SquareRoot, Array]:
        """One Gauss-Newton step on: the window, the square root of the information, and what its first ``gone``
        keyframes leave for the rest (:func:`~trackfg.elimination.eliminate_leaving`), linearised before the step.

        Raises ``UnsolvableError`` where the states are not determined, ``ValueError`` where they leave all bounds.
        """
        root, left = eliminate_leaving(self.linearized(), len(self), gone)
        if not np.isfinite(root.length):
            raise ValueError("the step is not finite")
        return replace(self, states=self.states.moved(root.solution())), root, left

    def without(self, gone: int, root: SquareRoot, left: Array, origin: States) -> tuple[Window, Gone]:
        """Without the first ``gone`` keyframes, and what went; ``root`` and what is ``left`` as linearised at
        ``origin``.
        """
        kept = [
            family.take(later).shifted(-gone)
            for family in self.families
            if (later := np.flatnonzero(family.first_keyframe >= gone)).size
        ]
        window = Window(
            self.t[gone:],
            self.states.take(slice(gone, None)),
            self.measured[gone:],
            self.response[gone:],
            (past(left, origin.take(slice(gone, gone + 1))), *kept),
        )
        conditionals = Conditionals(root.R[:gone], root.S[:gone], root.d[:gone])
        return window, Gone(self.t[:gone], conditionals, origin.take(slice(0, gone + 1)))

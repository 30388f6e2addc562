"""The graph of the newest keyframes, as it moves along: one keyframe more in front, the oldest left behind.

Families, inertial measurements and solution are those of :mod:`trackfg.graph.build`; keyframes are numbered from the
oldest one that is in the window. What is left behind stays as one factor, :mod:`trackfg.factors.marginal_prior`.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.linalg.lapack import dtrtrs

from trackfg.factors.factor_type import FactorType
from trackfg.factors.family import Family, changed
from trackfg.factors.imu import Preintegration, linearize_imu_factors
from trackfg.factors.linear import LinearFactors
from trackfg.factors.loss import SwitchChain
from trackfg.factors.marginal_prior import marginal_prior, rebased_to_interval_bias, retract_in_chart, step_from
from trackfg.factors.states import States, Step
from trackfg.graph.inertial import graph_of
from trackfg.numerics.arrays import Array
from trackfg.solver.elimination import Conditionals, eliminate_with_marginals
from trackfg.solver.square_root import SquareRoot


class Interval(NamedTuple):
    """What the time from the newest keyframe (number 0) to the next one (number 1) brings.

    ``bias`` (6,) over the interval, what the calibration adds included; ``response`` (6, dim) to it. ``ahead``: the
    next keyframe as predicted, alone.
    """

    t: float
    bias: Array
    ahead: States
    measured: Preintegration
    response: Array
    families: tuple[Family, ...]

    def found(self, states: States) -> Interval:
        """With both keyframes where they were found to be: ``states`` of the two."""
        return self._replace(bias=states.bias[0], ahead=states.take(slice(1, 2)))


class Gone(NamedTuple):
    """Keyframes left behind: when, their conditionals, and where these were linearised, next keyframe included; and the
    factors that went with them.
    """

    t: Array
    conditionals: Conditionals
    origin: States
    families: tuple[Family, ...] = ()

    @classmethod
    def of(cls, t: Array, root: SquareRoot, origin: States, count: int) -> Gone:
        """The first so many of keyframes at ``t``, with the square root of their information, linearised at ``origin``;
        without factors.
        """
        conditionals = Conditionals(root.R[:count], root.S[:count], root.d[:count])
        return cls(t[:count], conditionals, origin.take(slice(0, count + 1)))

    def before(self, later: States) -> States:
        """They themselves, given the next keyframe: the first of ``later``. (Rauch, Tung and Striebel.)"""
        n, found = len(self.t), []
        step = step_from(self.origin.take(slice(n, None)), later.take(slice(0, 1)))
        x = step.keyframes[0]
        for k in reversed(range(n)):
            R, S, d = (part[k] for part in self.conditionals)
            x = dtrtrs(R, d - S @ np.concatenate([x, step.shared]))[0]
            found.append(x)
        return retract_in_chart(self.origin.take(slice(0, n)), Step(np.array(found[::-1]), step.shared))


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

    @property
    def cost(self) -> float:
        """Of the graph at these states."""
        inertial = float(graph_of(self.measured).error(self.states.inertial_to_gtsam()))
        return inertial + sum(family.cost(self.states) for family in self.families)

    @property
    def doubts_wheel(self) -> bool:
        """Whether it is as likely as not that the wheel slipped somewhere."""
        return any((family.weights(self.states) < 0.5).any() for family in self.families if family.is_chained)

    @property
    def wheel_belief(self) -> float:
        """How likely it is, after the last interval, that the wheel rolls; 1 where there is none."""
        losses = (family.loss for family in self.families)
        return min((loss.inlier_before for loss in losses if isinstance(loss, SwitchChain)), default=1.0)

    def with_families(self, *families: Family) -> Window:
        """With these in the place of those of the same types."""
        types = {family.type for family in families}
        kept = (family for family in self.families if family.type not in types)
        return replace(self, families=(*kept, *(family for family in families if len(family))))

    def extended(self, *intervals: Interval) -> Window:
        """With the next keyframes."""
        families = self.families
        if len(self) == 1:  # what is known of the keyframe is known of its bias as no interval has it
            response = intervals[0].response
            families = changed(
                families, FactorType.MARGINAL_PRIOR, lambda family: rebased_to_interval_bias(family, response)
            )
        later = [family.shifted(last) for last, new in enumerate(intervals, len(self) - 1) for family in new.families]
        responses = [self.response[:-1], *(interval.response[None] for interval in intervals)]
        bias = np.concatenate([self.states.bias[:-1], *(interval.bias[None] for interval in intervals)])
        states = self.states.joined(*(interval.ahead for interval in intervals))
        return Window(
            np.append(self.t, [interval.t for interval in intervals]),
            replace(states, bias=np.concatenate([bias, states.bias[-1:]])),
            (*self.measured, *(interval.measured for interval in intervals)),
            np.concatenate([*responses, np.zeros_like(self.response[:1])]),
            _joined([*families, *later]),
        )

    def joined(self, families: Sequence[Family]) -> Window:
        """With these factors too."""
        return replace(self, families=_joined([*self.families, *families]))

    def linearized(self, left_out: Collection[FactorType] = ()) -> list[LinearFactors]:
        """All factors at the window's states, but families of the types ``left_out``."""
        inertial = linearize_imu_factors(graph_of(self.measured), self.states.inertial_to_gtsam())
        return [inertial, *(one.linearize(self.states) for one in self.families if one.type not in left_out)]

    def moved(self, gone: Collection[int] = ()) -> Stepped:
        """One Gauss-Newton step on; for each of ``gone`` so many of the first keyframes can be left behind then.

        Raises ``UnsolvableError`` where the states are not determined, ``ValueError`` where they leave all bounds.
        """
        root, left = eliminate_with_marginals(self.linearized(), len(self), gone)
        return Stepped(self.by(root), root, left, self.states)

    def by(self, root: SquareRoot) -> Window:
        """After the step of a linear system at the window's states. Raises as :meth:`moved` does."""
        if not np.isfinite(root.length):
            raise ValueError("the step is not finite")
        return replace(self, states=self.states.moved(root.solution()))


def _joined(families: Sequence[Family]) -> tuple[Family, ...]:
    """Those of one type and label as one, if they can be stacked."""
    groups: dict[tuple[FactorType, str] | int, list[Family]] = {}
    for family in families:
        groups.setdefault((family.type, family.label) if family.type.stackable else id(family), []).append(family)
    return tuple(same[0].joined(*same[1:]) if len(same) > 1 else same[0] for same in groups.values())


class Stepped(NamedTuple):
    """A window after a step, the square root of its information, and for some numbers of first keyframes what these
    leave for the rest (:func:`~trackfg.solver.elimination.eliminate_with_marginals`); both as linearised at ``origin``.
    """

    window: Window
    root: SquareRoot
    left: Mapping[int, Array]
    origin: States

    def rest(self, gone: int) -> Window:
        """Without the first ``gone`` keyframes.

        Of factors in a row the family stays though all are gone: it knows what the next ones follow.
        """
        if not gone:
            return self.window
        window = self.window
        kept = [
            family.tail_of_chain(later, window.states).shifted(-gone)
            for family in window.families
            if (later := family.first_keyframe >= gone).any() or family.is_chained
        ]
        return Window(
            window.t[gone:],
            window.states.take(slice(gone, None)),
            window.measured[gone:],
            window.response[gone:],
            (marginal_prior(self.left[gone], self.origin.take(slice(gone, gone + 1))), *kept),
        )

    def gone(self, gone: int) -> Gone:
        """The first ``gone`` keyframes."""
        left = tuple(family.take(family.first_keyframe < gone) for family in self.window.families)
        return Gone.of(self.window.t, self.root, self.origin, gone)._replace(families=left)

"""The window: a factor graph of consecutive keyframes, its Gauss-Newton step, and the marginalisation of its oldest.

Factor families, inertial measurements and states are those of :mod:`trackfg.graph.build`; keyframe 0 is the oldest in
the window. Earlier keyframes act through one factor on keyframe 0 and the shared variables, the marginal prior
(:mod:`trackfg.factors.marginal_prior`).

**Two biases.** A keyframe at which an interval begins carries the interval's mean bias: its own plus what the IMU's
calibration adds over the interval, ``response @ calibration``. The newest keyframe begins none and carries its own;
when the window is extended, that keyframe's marginal prior is expressed by the mean bias
(``rebased_to_interval_bias``), and its ``response``, zero until then, becomes the interval's.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from trackfg.errors import UnsolvableError
from trackfg.factors.factor_type import FactorType
from trackfg.factors.family import Family, changed
from trackfg.factors.imu import InertialFactors, Preintegration
from trackfg.factors.linear import LinearFactors
from trackfg.factors.loss import SwitchChain
from trackfg.factors.marginal_prior import marginal_prior, rebased_to_interval_bias, retract_in_chart, step_from
from trackfg.factors.states import Nav, Odo, States, Step
from trackfg.numerics.arrays import Array
from trackfg.numerics.kernels import compiled_kernels, kernel_argument
from trackfg.solver.elimination import Conditionals, eliminate_with_marginals
from trackfg.solver.square_root import SquareRoot

FAILURES = (UnsolvableError, ValueError, np.linalg.LinAlgError, RuntimeError)
"""What a step raises that fails; the last are GTSAM's."""
_MOST_STEPS = 4
"""Gauss-Newton steps of a window before it counts as unsettled."""

_OF_KEYFRAMES = 5
"""How many of :attr:`States.arrays` have a row for each keyframe: those of NAV, BIAS and ODO."""


@dataclass(frozen=True)
class Window:
    """The graph of the keyframes at ``t`` (n,), s, at the linearisation point ``states``.

    ``measured``: preintegrated inertial measurements of the n - 1 intervals. ``response`` (n, 6, IMU): derivative of
    each keyframe's bias by the IMU's calibration. ``families``: all other factors, the marginal prior among them.
    """

    t: Array
    states: States
    measured: tuple[Preintegration, ...]
    response: Array
    families: tuple[Family, ...]

    def __len__(self) -> int:
        return len(self.t)

    @cached_property
    def inertial(self) -> InertialFactors:
        """The inertial factors."""
        return InertialFactors(self.measured)

    @property
    def initial(self) -> States:
        """The states from which a batch solution begins."""
        return self.states

    @property
    def cost(self) -> float:
        """The negative logarithm of the posterior at these states, up to a constant."""
        return self.inertial.cost(self.states) + sum(family.cost(self.states) for family in self.families)

    @property
    def suspects_slip(self) -> bool:
        """Return whether it is as likely as not that the wheel slipped in some interval."""
        return any((family.weights(self.states) < 0.5).any() for family in self.families if family.is_chained)

    @property
    def rolling_probability(self) -> float:
        """The probability that the wheel rolls after the last interval; 1 without a wheel."""
        losses = (family.loss for family in self.families)
        return min((loss.inlier_before for loss in losses if isinstance(loss, SwitchChain)), default=1.0)

    def with_families(self, *families: Family) -> Window:
        """Return the window with these families in the place of those of the same types."""
        types = {family.type for family in families}
        kept = (family for family in self.families if family.type not in types)
        return replace(self, families=(*kept, *(family for family in families if len(family))))

    def with_factors(self, families: Sequence[Family]) -> Window:
        """Return the window with these factors added."""
        merged = _merge_by_type([(family, 0) for family in (*self.families, *families)])
        return Window(self.t, self.states, self.measured, self.response, merged)

    def extended(self, *intervals: Interval) -> Window:
        """Return the window with the next keyframes added, each at the end of one interval; itself without any."""
        if not intervals:
            return self
        families = self.families
        if len(self) == 1:  # the marginal prior of a newest keyframe is of its bias without the calibration's part
            response = intervals[0].response
            families = changed(
                families, FactorType.MARGINAL_PRIOR, lambda family: rebased_to_interval_bias(family, response)
            )
        later = [(family, last) for last, new in enumerate(intervals, len(self) - 1) for family in new.families]
        responses = [self.response[:-1], *(interval.response[None] for interval in intervals)]
        bias = np.concatenate([self.states.bias[:-1], *(interval.bias[None] for interval in intervals)])
        states = self.states.joined(*(interval.predicted for interval in intervals))
        return Window(
            np.concatenate([self.t, [interval.t for interval in intervals]]),
            states.with_bias(np.concatenate([bias, states.bias[-1:]])),
            (*self.measured, *(interval.measured for interval in intervals)),
            np.concatenate([*responses, np.zeros_like(self.response[:1])]),
            _merge_by_type([*((family, 0) for family in families), *later]),
        )

    def linear_factors(self) -> list[LinearFactors]:
        """Return all factors linearised at the window's states."""
        return [self.inertial.linearize(self.states), *(family.linearize(self.states) for family in self.families)]

    def gauss_newton_step(self, marginalise: Collection[int] = ()) -> WindowStep:
        """Take one Gauss-Newton step; ``marginalise``: numbers of first keyframes that may be marginalised after it.

        Raises ``UnsolvableError`` where the states are not determined, ``ValueError`` where the step is not finite.
        """
        root, marginals = eliminate_with_marginals(self.linear_factors(), len(self), marginalise)
        return WindowStep(self.updated_by(root), root, marginals, self.states)

    def settled_step(self, marginalise: Collection[int], longest: float) -> WindowStep:
        """Take Gauss-Newton steps until one is shorter than ``longest`` posterior sigmas.

        Raises as :meth:`gauss_newton_step` does, and ``ValueError`` where none of the first four is.
        """
        window = self
        for _ in range(_MOST_STEPS):
            step = window.gauss_newton_step(marginalise)
            if step.root.length < longest:
                return step
            window = step.window
        raise ValueError(
            f"Gauss-Newton step {_MOST_STEPS} of the window was still {step.root.length:.2g} posterior sigmas long"
        )

    def updated_by(self, root: SquareRoot) -> Window:
        """Return the window after the step of a linear system at its states.

        Raises ``ValueError`` where the step is not finite.
        """
        if not math.isfinite(root.length):
            raise ValueError("the step is not finite")
        return Window(self.t, self.states.moved(root.solution()), self.measured, self.response, self.families)


class Interval(NamedTuple):
    """The next interval of a window: all that it adds, from the newest keyframe (number 0) to the next one (number 1),
    at ``t``, s.

    ``bias`` (6,): mean IMU bias over the interval, the calibration's contribution included; ``response`` (6, IMU): its
    derivative by the calibration. ``predicted``: the state of the next keyframe, alone.
    """

    t: float
    bias: Array
    predicted: States
    measured: Preintegration
    response: Array
    families: tuple[Family, ...]

    def at(self, states: States) -> Interval:
        """Return the interval with both keyframes at ``states`` of the two."""
        return self._replace(bias=states.bias[0], predicted=states.take(slice(1, 2)))


class WindowStep(NamedTuple):
    """A window after a Gauss-Newton step: ``root`` is the square root of its information, ``marginals`` the marginal
    priors by number of marginalised keyframes; both are linearised at ``linearisation_point``.
    """

    window: Window
    root: SquareRoot
    marginals: Mapping[int, Array]
    linearisation_point: States

    def window_without_first(self, count: int) -> Window:
        """Return the window with its first ``count`` keyframes replaced by their marginal prior.

        An emptied chained family is kept: its loss holds the switch probability from which the next factor starts.
        """
        if not count:
            return self.window
        window = self.window
        kept = [
            family.tail_of_chain(_run_of(later), window.states).shifted(-count)
            for family in window.families
            if (later := family.first_keyframe >= count).any() or family.is_chained
        ]
        point = self.linearisation_point.take(slice(count, count + 1))
        return Window(
            window.t[count:],
            window.states.take(slice(count, None)),
            window.measured[count:],
            window.response[count:],
            (marginal_prior(self.marginals[count], point), *kept),
        )

    def marginalised_first(self, count: int) -> MarginalisedKeyframes:
        """Return the first ``count`` keyframes, as conditionals, with their factors."""
        families = tuple(family.take(_run_of(family.first_keyframe < count)) for family in self.window.families)
        marginalised = MarginalisedKeyframes.first(self.window.t, self.root, self.linearisation_point, count)
        return marginalised._replace(families=families)


class MarginalisedKeyframes(NamedTuple):
    """Consecutive keyframes that were eliminated: times ``t`` (m,), s, each one's conditional on the next and on the
    shared variables, the ``linearisation_point`` of these (next keyframe included), and the factors they had.
    """

    t: Array
    conditionals: Conditionals
    linearisation_point: States
    families: tuple[Family, ...] = ()

    @classmethod
    def first(cls, t: Array, root: SquareRoot, point: States, count: int) -> MarginalisedKeyframes:
        """Return the first ``count`` of the keyframes at ``t``, from the square root of their information at ``point``;
        without factors.
        """
        conditionals = Conditionals(root.R[:count], root.S[:count], root.d[:count])
        return cls(t[:count], conditionals, point.take(slice(0, count + 1)))

    def back_substitute(self, next_state: States) -> States:
        """Return the keyframes' states given the next keyframe, the first of ``next_state`` (Rauch, Tung, Striebel).

        Raises ``UnsolvableError`` where a conditional is singular.
        """
        states = self._by_kernel(next_state) if compiled_kernels() else self._by_arrays(next_state)
        if states is None:
            singular = (np.diagonal(self.conditionals.R, axis1=1, axis2=2) == 0.0).any(axis=1)
            raise UnsolvableError(f"the conditional of the keyframe at {self.t[singular][-1]:.3f} s is singular")
        return states

    def _by_kernel(self, next_state: States) -> States | None:
        """Do as :meth:`_by_arrays`, in ``kernels/chart.cpp``."""
        from trackfg.numerics import compiled

        n, point = len(self.t), self.linearisation_point
        keyframes = (np.empty((n, *values.shape[1:])) for values in point.arrays[:_OF_KEYFRAMES])
        out = (*keyframes, *map(np.empty_like, point.arrays[_OF_KEYFRAMES:]))
        sensors = (next_state.sensor - point.sensor).ravel()
        R, S, d = map(kernel_argument, self.conditionals)
        if not compiled.marginalised_states(R, S, d, point.arrays, next_state.arrays, sensors, out):
            return None
        R, p, v, bias, odo, mount, clock, imu, wheel = out
        return States(Nav(R, p, v), bias, Odo(odo), mount, clock, imu, wheel, next_state.sensor)

    def _by_arrays(self, next_state: States) -> States | None:
        """Return the states, None where a conditional is singular."""
        n, (R, S, d) = len(self.t), self.conditionals
        if not np.diagonal(R, axis1=1, axis2=2).all():
            return None
        step = step_from(self.linearisation_point.take(slice(n, None)), next_state.take(slice(0, 1)))
        behind = np.concatenate([step.keyframes[0], step.shared])[:, None]
        root = SquareRoot(R, S, d, np.eye(len(step.shared)), step.shared, np.zeros(n, dtype=np.int64))
        keyframes, _ = root.back_substituted(d[:, :, None].copy(), behind)
        return retract_in_chart(self.linearisation_point.take(slice(0, n)), Step(keyframes[:, :, 0], step.shared))


def _run_of(mask: np.ndarray) -> slice | np.ndarray:
    """Return a mask (m,) as a slice where it is one run, since slices take no copies; itself elsewhere."""
    count, first = int(np.count_nonzero(mask)), int(mask.argmax()) if mask.size else 0
    run = slice(first, first + count)
    return run if mask[run].all() else mask


def _merge_by_type(families: Iterable[tuple[Family, int]]) -> tuple[Family, ...]:
    """Return the families of each type and label as one, if they can be stacked; each is given with the number of
    keyframes by which it moves on.
    """
    groups: dict[tuple[FactorType, str] | int, list[tuple[Family, int]]] = {}
    for family, by in families:
        groups.setdefault((family.type, family.label) if family.type.stackable else id(family), []).append((family, by))
    return tuple([_merged(*same) for same in groups.values()])


def _merged(first: tuple[Family, int], *later: tuple[Family, int]) -> Family:
    family = first[0].shifted(first[1])
    return family.joined(*(other for other, _ in later), shifts=[by for _, by in later]) if later else family

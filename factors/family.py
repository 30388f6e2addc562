"""A family: all factors of one sort in a graph, with one residual-and-Jacobian function written over arrays.

From that one function come the batch linearisation (:meth:`Family.linearize`), the cost (:meth:`Family.cost`), a
``gtsam.CustomFactor`` per factor (:meth:`Family.custom_factors`) and the numerical check that every family's test runs
(:func:`check_jacobians`). There is no second formula anywhere.

The residual is whitened by a sigma per row. A robust loss acts on the norm of a factor's whitened residual; it is
minimised by iteratively reweighted least squares (Zhang, "Parameter estimation techniques", 1997, table 1).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from typing import NamedTuple

import gtsam
import numpy as np
from scipy.special import expit

from trackfg.factors.states import Kind, Nav, States, Step, Value, retract
from trackfg.factors.switching import OUTLIER_SIGMAS, Chain, after_row, row_cost, row_weights
from trackfg.numerics.arrays import Array

Evaluate = Callable[..., tuple[Array, tuple[Array, ...]]]
"""``evaluate(*values, *data) -> (residual (m, d), one Jacobian (m, d, dim) per slot)``."""


@dataclass(frozen=True)
class Slot:
    """Which variable of ``kind`` each of the m factors touches: ``index``, shape (m,)."""

    kind: Kind
    index: np.ndarray

    @property
    def keys(self) -> list[int]:
        """The GTSAM keys, in factor order."""
        keys: list[int] = self.kind.keys(self.index).tolist()
        return keys


def first_keyframe(slots: Sequence[Slot], factors: int) -> np.ndarray:
    """The first keyframe that each of so many factors touches, -1 where these touch shared variables alone. (m,)."""
    return _keyframe(slots, factors, np.minimum)


def last_keyframe(slots: Sequence[Slot], factors: int) -> np.ndarray:
    """The last one, likewise."""
    return _keyframe(slots, factors, np.maximum)


def _keyframe(slots: Sequence[Slot], factors: int, choose: Callable[..., np.ndarray]) -> np.ndarray:
    own = [slot.index for slot in slots if not slot.kind.shared]
    return reduce(choose, own) if own else np.full(factors, -1)


class LinearFactors(NamedTuple):
    """m linear factors ``A d = b``, whitened: ``rows`` (m, r, c + 1) are [A b], A slot by slot."""

    slots: tuple[Slot, ...]
    rows: Array

    @property
    def jacobian(self) -> Array:
        """Jacobians by all slots, shape (m, r, c)."""
        return self.rows[:, :, :-1]

    @property
    def b(self) -> Array:
        """Right-hand sides, shape (m, r)."""
        return self.rows[:, :, -1]

    @property
    def jacobians(self) -> list[Array]:
        """One per slot, (m, r, dim)."""
        ends = np.cumsum([slot.kind.dim for slot in self.slots])
        return np.split(self.jacobian, ends[:-1], axis=2)

    def take(self, index: np.ndarray) -> LinearFactors:
        """Some of the factors."""
        return LinearFactors(tuple(Slot(slot.kind, slot.index[index]) for slot in self.slots), self.rows[index])

    def seen_from(self, step: Step) -> LinearFactors:
        """For steps from where the values were before this one led to where they are linearised."""
        d = np.concatenate([step.of(slot.kind)[slot.index] for slot in self.slots], axis=1)
        rows = self.rows.copy()
        rows[:, :, -1] += (self.jacobian @ d[:, :, None])[:, :, 0]
        return LinearFactors(self.slots, rows)


@dataclass(frozen=True)
class Loss:
    """A robust loss with tuning constant ``width``, in sigmas.

    ``"huber"`` grows linearly beyond the width; ``"cauchy"`` grows with the logarithm and lets gross errors go;
    ``"switch"`` is the negative logarithm of a mixture, of the measurement's own normal distribution and of one
    :data:`~trackfg.factors.switching.OUTLIER_SIGMAS` as wide, which are equally likely at the width: below it errors
    count in full, beyond it they count for nothing, so that many of one sign do not pull together. Its weight is all
    but the probability that the error is the measurement's own (a switch variable, averaged over). ``"row"`` is the
    same for factors that follow each other in time, whose switches hold for some time
    (:mod:`trackfg.factors.switching`): an outlier makes its neighbours doubtful, and errors that last need not be
    large; ``interval_s`` is the time from one to the next, ``before`` the probability that the one before the first was
    none. While the values are far from the solution there is no loss at all, or Huber's where errors are too many and
    too large.
    """

    kind: str
    width: float
    huber_at_start: bool = False
    interval_s: float = 1.0
    before: float = 1.0

    @property
    def chain(self) -> Chain:
        """Of a row."""
        return Chain(self.width, self.interval_s, self.before)

    def after(self, norm: Array) -> Loss:
        """The loss of those that follow factors with these norms (m,) in a row."""
        return replace(self, before=after_row(norm, self.chain).before) if self.kind == "row" else self

    @property
    def at_start(self) -> Loss | None:
        """The loss that stands in while the values are far from the solution: convex, so that no outlier traps them."""
        return Loss("huber", self.width) if self.huber_at_start else None

    def weight(self, norm: Array) -> Array:
        """The weight of a whitened residual of this norm: rho'(e)/e."""
        if self.kind == "huber":
            return np.minimum(1.0, self.width / np.maximum(norm, 1e-12))
        if self.kind == "row":
            return row_weights(norm, self.chain)
        if self.kind == "switch":
            outlier = expit(-0.5 * self.width**2 + 0.5 * (1.0 - OUTLIER_SIGMAS**-2) * norm**2)
            return np.asarray(1.0 - outlier * (1.0 - OUTLIER_SIGMAS**-2))
        return 1.0 / (1.0 + (norm / self.width) ** 2)

    def to_gtsam(self) -> gtsam.noiseModel.mEstimator.Base:
        """The same loss for GTSAM's own optimisers, which know no rows: there each factor has a switch of its own."""
        losses = gtsam.noiseModel.mEstimator
        if self.kind == "row":
            return Loss("switch", self.width).to_gtsam()
        if self.kind == "switch":
            return losses.Custom(lambda e: float(self.weight(np.array(e))), lambda e: float(self.cost(np.array(e))))
        return (losses.Huber if self.kind == "huber" else losses.Cauchy).Create(self.width)

    def cost(self, norm: Array) -> Array:
        """rho(e), which is e^2/2 for small e; of a row the sum."""
        c = self.width
        if self.kind == "row":
            return np.asarray(row_cost(norm, self.chain))
        if self.kind == "huber":
            return np.where(norm <= c, 0.5 * norm**2, c * (norm - 0.5 * c))
        if self.kind == "switch":
            outlier = -0.5 * c**2 - 0.5 * (norm / OUTLIER_SIGMAS) ** 2
            return np.asarray(np.log1p(np.exp(-0.5 * c**2)) - np.logaddexp(-0.5 * norm**2, outlier))
        return 0.5 * c**2 * np.log1p((norm / c) ** 2)


@dataclass(frozen=True)
class Family:
    """m factors of one sort.

    ``data`` holds the measurements, arrays with leading dimension m; ``sigma`` the 1-sigma of each residual row,
    shape (m, d), in the residual's units. Raises ``ValueError`` for wrong shapes, for values that are not finite and
    for sigmas that are not positive: GTSAM answers these with a crash of the interpreter.
    """

    name: str
    evaluate: Evaluate
    slots: tuple[Slot, ...]
    data: tuple[Array, ...]
    sigma: Array
    loss: Loss | None = None
    doubtful: np.ndarray | None = None
    """Which measurements are taken for outliers while the values are far from the solution, shape (m,) of bool."""

    def __post_init__(self) -> None:
        m = len(self)
        for slot in self.slots:
            if slot.index.shape != (m,):
                raise ValueError(f"{self.name}: slot {slot.kind.name} has {slot.index.shape}, expected ({m},)")
        for array in self.data:
            if len(array) != m or not _finite(array):
                raise ValueError(f"{self.name}: measurements must be finite, {m} rows; got shape {array.shape}")
        if self.sigma.ndim != 2 or not (_finite(self.sigma) and (self.sigma > 0).all()):
            raise ValueError(f"{self.name}: sigmas must be positive and finite, shape ({m}, d)")

    def __len__(self) -> int:
        return len(self.sigma)

    @property
    def in_a_row(self) -> bool:
        """Whether the loss of a factor depends on those before it."""
        return self.loss is not None and self.loss.kind == "row"

    @property
    def rows(self) -> int:
        """Number of scalar residuals."""
        return self.sigma.size

    def take(self, index: np.ndarray | slice) -> Family:
        """Some of the factors, as a family."""
        slots = tuple(Slot(slot.kind, slot.index[index]) for slot in self.slots)
        data = tuple(array[index] for array in self.data)
        doubtful = None if self.doubtful is None else self.doubtful[index]
        return self._like(slots, data, self.sigma[index], doubtful)

    def with_data(self, data: tuple[Array, ...]) -> Family:
        """With other measurements, made from these."""
        return self._like(self.slots, data, self.sigma, self.doubtful)

    def following(self, first: np.ndarray | slice, states: States) -> Family:
        """:meth:`take` of the last of the factors; the loss is that of a row which began before."""
        rest = self.take(first)
        if self.loss is None or not self.in_a_row:
            return rest
        gone = np.linalg.norm(self.whitened(states), axis=1)[: len(self) - len(rest)]
        return replace(rest, loss=self.loss.after(gone))

    def shifted(self, by: int) -> Family:
        """The same factors on the keyframes that are ``by`` later."""
        slots = (slot if slot.kind.shared else Slot(slot.kind, slot.index + by) for slot in self.slots)
        return self._like(tuple(slots), self.data, self.sigma, self.doubtful)

    def _like(
        self, slots: tuple[Slot, ...], data: tuple[Array, ...], sigma: Array, doubtful: np.ndarray | None
    ) -> Family:
        """Of this sort, from what families of it hold: it has been checked, and a stream makes hundreds a second."""
        family = object.__new__(Family)
        family.__dict__.update(self.__dict__, slots=slots, data=data, sigma=sigma, doubtful=doubtful)
        return family

    def joined(self, *later: Family) -> Family:
        """These factors, then those of families of the same sort."""
        every = [family for family in (self, *later) if len(family)]
        if len(every) < 2:
            (only,) = every or [self]
            return self._like(only.slots, only.data, only.sigma, only.doubtful)
        slots = (
            Slot(same[0].kind, np.concatenate([slot.index for slot in same]))
            for same in zip(*(family.slots for family in every), strict=True)
        )
        data = (np.concatenate(same) for same in zip(*(family.data for family in every), strict=True))
        doubts = [family.doubtful for family in every if family.doubtful is not None]
        doubtful = np.concatenate(doubts) if len(doubts) == len(every) else None
        sigma = np.concatenate([family.sigma for family in every])
        return self._like(tuple(slots), tuple(data), sigma, doubtful)

    @property
    def first_keyframe(self) -> np.ndarray:
        """The first keyframe that each factor touches, -1 where it touches shared variables alone. Shape (m,)."""
        return first_keyframe(self.slots, len(self))

    @property
    def last_keyframe(self) -> np.ndarray:
        """The last one, likewise."""
        return last_keyframe(self.slots, len(self))

    def at_start(self) -> Family:
        """What stands in while the values are far from the solution: gentler losses, no weight on what is doubtful."""
        sigma = self.sigma
        if self.doubtful is not None:
            sigma = np.where(self.doubtful[:, None], OUTLIER_SIGMAS, 1.0) * sigma
        return replace(self, loss=None if self.loss is None else self.loss.at_start, sigma=sigma)

    def values(self, states: States) -> tuple[Value, ...]:
        """The values that the factors touch, one entry per slot."""
        return tuple(states.of(slot.kind)[slot.index] for slot in self.slots)

    def residual(self, states: States) -> Array:
        """Residuals in their own units, shape (m, d)."""
        return self._checked(self._evaluated(self.values(states))[0])

    def whitened(self, states: States) -> Array:
        """Residuals in sigmas, before any robust weight, shape (m, d)."""
        return self.residual(states) / self.sigma

    def weights(self, states: States) -> Array:
        """The robust weight of each factor, 1 without a loss. Shape (m,)."""
        if self.loss is None:
            return np.ones(len(self))
        return self.loss.weight(np.linalg.norm(self.whitened(states), axis=1))

    def cost(self, states: States) -> float:
        """Half the sum of squared whitened residuals, or of the loss."""
        norm = np.linalg.norm(self.whitened(states), axis=1)
        return float(np.sum(0.5 * norm**2 if self.loss is None else self.loss.cost(norm)))

    def linearize(self, states: States) -> LinearFactors:
        """Whitened and weighted."""
        residual, jacobians = self._evaluated(self.values(states))
        rows = self._checked(np.concatenate([*jacobians, -residual[:, :, None]], axis=2))
        scale = 1.0 / self.sigma
        if self.loss is not None:
            norm = np.linalg.norm(residual * scale, axis=1)
            scale = scale * np.sqrt(self.loss.weight(norm))[:, None]
        rows *= scale[:, :, None]
        return LinearFactors(self.slots, rows)

    def custom_factors(self) -> list[gtsam.CustomFactor]:
        """One ``gtsam.CustomFactor`` per factor, for GTSAM's own optimisers and fixed-lag smoothers."""
        return [self._custom_factor(i) for i in range(len(self))]

    def _custom_factor(self, i: int) -> gtsam.CustomFactor:
        one = self.take(slice(i, i + 1))

        def error(this: gtsam.CustomFactor, values: gtsam.Values, H: list[Array] | None) -> Array:
            keys = this.keys()
            residual, jacobians = one._evaluated(
                tuple(_from_gtsam(slot.kind, values, key) for slot, key in zip(one.slots, keys, strict=True))
            )
            if H is not None:
                for j, jacobian in enumerate(jacobians):
                    H[j] = np.asfortranarray(one._checked(jacobian)[0])
            return np.asarray(one._checked(residual)[0])

        model: gtsam.noiseModel.Base = gtsam.noiseModel.Diagonal.Sigmas(self.sigma[i])
        if self.loss is not None:
            model = gtsam.noiseModel.Robust.Create(self.loss.to_gtsam(), model)
        return gtsam.CustomFactor(model, [slot.keys[0] for slot in one.slots], error)

    def _evaluated(self, values: Sequence[Value]) -> tuple[Array, tuple[Array, ...]]:
        residual, jacobians = self.evaluate(*values, *self.data)
        m, d = self.sigma.shape
        if residual.shape != (m, d):
            raise ValueError(f"{self.name}: residual has shape {residual.shape}, expected {(m, d)}")
        for slot, jacobian in zip(self.slots, jacobians, strict=True):
            if jacobian.shape != (m, d, slot.kind.dim):
                raise ValueError(f"{self.name}: Jacobian of {slot.kind.name} has shape {jacobian.shape}")
        return residual, jacobians

    def _checked(self, array: Array) -> Array:
        if not _finite(array):
            raise ValueError(f"{self.name}: residual or Jacobian is not finite")
        return array


def _finite(array: Array) -> bool:
    """Whether all values are finite, and none is beyond all bounds: their squares are added up, in one pass."""
    flat = array.ravel()
    return math.isfinite(flat @ flat)


def _from_gtsam(kind: Kind, values: gtsam.Values, key: int) -> Value:
    """One variable as a value with leading dimension 1."""
    if kind is Kind.NAV:
        state = values.atNavState(key)
        return Nav(state.attitude().matrix()[None], state.position()[None], state.velocity()[None])
    if kind is Kind.BIAS:
        return np.asarray(values.atConstantBias(key).vector())[None]
    return np.asarray(values.atVector(key))[None]


def numerical_jacobians(family: Family, states: States, step: float = 1e-5) -> tuple[Array, ...]:
    """Central differences of the residual along each tangent direction of each slot."""
    values = family.values(states)
    jacobians = []
    for j, slot in enumerate(family.slots):
        columns = []
        for c in range(slot.kind.dim):
            delta = np.zeros((len(family), slot.kind.dim))
            delta[:, c] = step
            ahead = family.evaluate(*values[:j], retract(values[j], delta), *values[j + 1 :], *family.data)[0]
            behind = family.evaluate(*values[:j], retract(values[j], -delta), *values[j + 1 :], *family.data)[0]
            columns.append((ahead - behind) / (2.0 * step))
        jacobians.append(np.stack(columns, axis=-1))
    return tuple(jacobians)


def check_jacobians(family: Family, states: States, rtol: float = 1e-6, atol: float = 1e-7) -> None:
    """Raise ``AssertionError``, naming factor, row and column, where a Jacobian differs from the numerical one."""
    analytic = family.evaluate(*family.values(states), *family.data)[1]
    for slot, ours, numeric in zip(family.slots, analytic, numerical_jacobians(family, states), strict=True):
        wrong = np.abs(ours - numeric) > atol + rtol * np.abs(numeric)
        if wrong.any():
            i, r, c = np.argwhere(wrong)[0]
            raise AssertionError(
                f"{family.name}: d residual[{r}] / d {slot.kind.name}[{c}] of factor {i} is {ours[i, r, c]:.9g}, "
                f"numerically {numeric[i, r, c]:.9g}"
            )

"""A family holds all factors of one type in a graph, with one residual-and-Jacobian function written over arrays.

Where compiled kernels are in use, one may compute the same (:func:`in_kernel`); the function stays its reference.

From that one function come the batch linearisation (:meth:`Family.linearize`), the cost (:meth:`Family.cost`), a
``gtsam.CustomFactor`` per factor (:func:`trackfg.factors.gtsam_bridge.custom_factors`) and the numerical check that
every family's test runs (:func:`trackfg.factors.checking.check_jacobians`).

The residual is whitened by a sigma per row. A robust loss (:mod:`trackfg.factors.loss`) acts on the norm of a factor's
whitened residual.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from trackfg.factors.factor_type import FactorType
from trackfg.factors.linear import LinearFactors, Slot, first_keyframe, last_keyframe
from trackfg.factors.loss import Loss, SwitchChain
from trackfg.factors.states import States, Value
from trackfg.factors.switching import OUTLIER_SIGMAS
from trackfg.numerics.arrays import Array
from trackfg.numerics.kernels import compiled_kernels, kernel_argument
from trackfg.numerics.key_figures import Outlined

Evaluate = Callable[..., tuple[Array, tuple[Array, ...]]]
"""``evaluate(*values, **data) -> (residual (m, d), one Jacobian (m, d, dim) per slot)``."""

Kernel = Callable[["Family", States, float, Array], bool]
"""``kernel(family, states, width, rows) -> whether all numbers are finite``: writes rows [A b] (m, d, c + 1) of the
whitened factors, or b alone into (m, d, 1), weighted by the loss of that ``width`` (:attr:`Loss.kernel_width`).
"""

_KERNELS: dict[Evaluate, Kernel] = {}


def in_kernel(kernel: Kernel) -> Callable[[Evaluate], Evaluate]:
    """Return a decorator that has a kernel compute what the decorated function does, and the rows from it."""

    def registered(evaluate: Evaluate) -> Evaluate:
        _KERNELS[evaluate] = kernel
        return evaluate

    return registered


@dataclass(frozen=True)
class LinearRows:
    """The kernel of that ``name`` in ``kernels/factors.cpp``, which takes these ``data`` of a family in this order."""

    name: str
    data: tuple[str, ...]

    def arguments(self, family: Family) -> tuple[tuple[np.ndarray, ...], tuple[Array, ...], Array]:
        """Return what the kernel takes of a family: indices, data and sigma."""
        indices = tuple([np.ascontiguousarray(slot.index, dtype=np.int64) for slot in family.slots])
        measured = tuple([kernel_argument(family.data[column]) for column in self.data])
        return indices, measured, kernel_argument(family.sigma)

    def __call__(self, family: Family, states: States, width: float, rows: Array) -> bool:
        """See :data:`Kernel`."""
        from trackfg.numerics import compiled

        return compiled.linear_rows(self.name, states.arrays, *self.arguments(family), width, rows)


def linear_rows(name: str, *data: str) -> Kernel:
    """Return the kernel of that name, with the data of a family that it takes, in this order."""
    return LinearRows(name, data)


def kernel_of(family: Family) -> Kernel | None:
    """Return the kernel of a family's type, if there is one."""
    return _KERNELS.get(family.evaluate)


@dataclass(frozen=True, repr=False)
class Family(Outlined):
    """A family is m factors of one type.

    ``data`` holds the measurements by name, arrays with leading dimension m; ``sigma`` the 1-sigma of each residual
    row, shape (m, d), in the residual's units. Raises ``ValueError`` for wrong shapes, for values that are not finite
    and for sigmas that are not positive: GTSAM answers these with a crash of the interpreter. Raises ``TypeError`` for
    lists and lone numbers in the place of arrays.
    """

    type: FactorType
    evaluate: Evaluate
    slots: tuple[Slot, ...]
    data: Mapping[str, Array]
    sigma: Array
    loss: Loss | None = None
    doubtful: np.ndarray | None = None
    """Which measurements are taken for outliers while the values are far from the solution, shape (m,) of bool."""
    label: str = ""
    """What reports call it, if not by its type."""

    @classmethod
    def sound(
        cls, kind: FactorType, evaluate: Evaluate, slots: tuple[Slot, ...], data: Mapping[str, Array], sigma: Array
    ) -> Family:
        """Return a family without a loss, of parts that are known to be sound: a stream makes hundreds a second."""
        family = object.__new__(cls)
        family.__dict__.update(
            type=kind, evaluate=evaluate, slots=slots, data=data, sigma=sigma, loss=None, doubtful=None, label=""
        )
        return family

    def __post_init__(self) -> None:
        self._check_array("sigma", self.sigma)
        m = len(self.sigma)
        for what, given in self.data.items():
            self._check_array(what, given)
            if len(given) != m or not _finite(given):
                raise ValueError(f"{self.name}: measurements must be finite, {m} rows; got shape {given.shape}")
        for slot in self.slots:
            self._check_array(f"slot {slot.kind.name}", slot.index)
            if slot.index.shape != (m,):
                raise ValueError(f"{self.name}: slot {slot.kind.name} has {slot.index.shape}, expected ({m},)")
        self._check_sigma()

    def _check_array(self, what: str, given: object) -> None:
        if not isinstance(given, np.ndarray):
            raise TypeError(f"{self.name}: {what} is a {type(given).__name__}; expected an array of numpy")

    def _check_sigma(self) -> None:
        if self.sigma.ndim != 2 or not (_finite(self.sigma) and (self.sigma > 0).all()):
            raise ValueError(f"{self.name}: sigmas must be positive and finite, shape ({len(self)}, d)")

    def __len__(self) -> int:
        return len(self.sigma)

    @property
    def name(self) -> str:
        """The name that reports and messages have for the factors."""
        return self.label or self.type.value

    @property
    def is_chained(self) -> bool:
        """Return whether the loss of a factor depends on those before it."""
        return isinstance(self.loss, SwitchChain)

    @property
    def rows(self) -> int:
        """Number of scalar residuals."""
        return self.sigma.size

    def take(self, index: np.ndarray | slice) -> Family:
        """Return some of the factors, as a family."""
        slots = tuple(Slot(slot.kind, slot.index[index]) for slot in self.slots)
        data = {name: array[index] for name, array in self.data.items()}
        doubtful = None if self.doubtful is None else self.doubtful[index]
        return self._with(slots=slots, data=data, sigma=self.sigma[index], doubtful=doubtful)

    def measured(self, sigma: Array, **data: Array) -> Family:
        """Return the family with these sigmas, and this data in the place of its own, all known to be sound."""
        return self._with(sigma=sigma, data={**self.data, **data})

    def with_data(self, **data: Array) -> Family:
        """Return the family with other measurements, given by name."""
        return self._with(data={**self.data, **data})

    def with_sigma(self, sigma: Array) -> Family:
        """Return the family with other sigmas (m, d). Raises ``ValueError`` where these are not positive or finite."""
        family = self._with(sigma=sigma)
        family._check_sigma()
        return family

    def with_loss(self, loss: Loss | None) -> Family:
        """Return the family with another robust loss."""
        return self._with(loss=loss)

    def tail_of_chain(self, last: np.ndarray | slice, states: States) -> Family:
        """Return the ``last`` of the factors; a chained loss goes on from the states of those before."""
        rest = self.take(last)
        if not isinstance(self.loss, SwitchChain):
            return rest
        norm = row_norms(self.whitened(states))[: len(self) - len(rest)]
        return rest._with(loss=self.loss.after(norm))

    def shifted(self, by: int) -> Family:
        """Return the same factors on the keyframes that are ``by`` later."""
        if not by or not len(self):
            return self
        slots = tuple(slot if slot.kind.shared else Slot(slot.kind, slot.index + by) for slot in self.slots)
        return self._with(slots=slots)

    def _with(self, **parts: Any) -> Family:
        """Return the family with other parts, which were checked before: a stream makes hundreds a second."""
        family = object.__new__(Family)
        family.__dict__.update(self.__dict__, **parts)
        return family

    def joined(self, *later: Family, shifts: Sequence[int] | None = None) -> Family:
        """Return these factors, then those of ``later`` families of the same type.

        ``shifts``: by how many keyframes those of each of the later families move on.
        """
        moves = (0, *(shifts or [0] * len(later)))
        filled = [(family, by) for family, by in zip((self, *later), moves, strict=True) if len(family)]
        every = [family for family, _ in filled]
        if len(every) < 2:
            (only,) = [family.shifted(by) for family, by in filled] or [self]
            return self._with(slots=only.slots, data=only.data, sigma=only.sigma, doubtful=only.doubtful)
        slots = _joined_slots([family.slots for family in every], [by for _, by in filled])
        data = {name: np.concatenate([family.data[name] for family in every]) for name in self.data}
        doubts = [family.doubtful for family in every if family.doubtful is not None]
        doubtful = np.concatenate(doubts) if len(doubts) == len(every) else None
        sigma = np.concatenate([family.sigma for family in every])
        return self._with(slots=slots, data=data, sigma=sigma, doubtful=doubtful)

    @property
    def first_keyframe(self) -> np.ndarray:
        """The first keyframe that each factor touches, -1 where it touches shared variables alone. Shape (m,)."""
        return first_keyframe(self.slots, len(self))

    @property
    def last_keyframe(self) -> np.ndarray:
        """The last keyframe that each factor touches, likewise."""
        return last_keyframe(self.slots, len(self))

    def convex_start(self) -> Family:
        """Return what stands in while the values are far from the solution: convex losses, doubtful ones unweighted."""
        sigma = self.sigma
        if self.doubtful is not None:
            sigma = np.where(self.doubtful[:, None], OUTLIER_SIGMAS, 1.0) * sigma
        return replace(self, loss=None if self.loss is None else self.loss.convex, sigma=sigma)

    def values(self, states: States) -> tuple[Value, ...]:
        """Return the values that the factors touch, one entry per slot."""
        return tuple(states.of(slot.kind)[slot.index] for slot in self.slots)

    def residual(self, states: States) -> Array:
        """Return the residuals in their own units, shape (m, d)."""
        return self._checked(self.evaluated(self.values(states))[0])

    def whitened(self, states: States) -> Array:
        """Return the residuals in sigmas, before any robust weight, shape (m, d)."""
        rows = self._rows_by_kernel(states, 1, 0.0)
        if rows is not None:
            return -rows[:, :, 0]
        return self.residual(states) / self.sigma

    def weights(self, states: States) -> Array:
        """Return the robust weight of each factor, 1 without a loss. Shape (m,)."""
        if self.loss is None:
            return np.ones(len(self))
        return self.loss.weight(row_norms(self.whitened(states)))

    def cost(self, states: States) -> float:
        """Return half the sum of squared whitened residuals, or of the loss."""
        norm = row_norms(self.whitened(states))
        return float(np.sum(0.5 * norm**2 if self.loss is None else self.loss.cost(norm)))

    def linearize(self, states: States) -> LinearFactors:
        """Return the factors linearised at ``states``, whitened and weighted."""
        columns = 1 + sum(slot.kind.dim for slot in self.slots)
        width = 0.0 if self.loss is None else self.loss.kernel_width
        rows = self._rows_by_kernel(states, columns, width)
        if rows is None:
            residual, jacobians = self.evaluated(self.values(states))
            rows = self._checked(np.concatenate([*jacobians, -residual[:, :, None]], axis=2))
            rows *= (1.0 / self.sigma)[:, :, None]
            width = 0.0
        if self.loss is not None and not width:
            rows *= np.sqrt(self.loss.weight(row_norms(rows[:, :, -1])))[:, None, None]
        return LinearFactors(self.slots, rows)

    def _rows_by_kernel(self, states: States, columns: int, width: float) -> Array | None:
        """Return the rows that a compiled kernel writes; None where none does."""
        kernel = kernel_of(self) if compiled_kernels() else None
        if kernel is None:
            return None
        rows = np.empty((*self.sigma.shape, columns))
        if not kernel(self, states, width, rows):
            raise ValueError(f"{self.name}: residual or Jacobian is not finite")
        return rows

    def evaluated(self, values: Sequence[Value]) -> tuple[Array, tuple[Array, ...]]:
        """Return residuals and Jacobians at ``values``, one entry per slot; ``ValueError`` for wrong shapes."""
        residual, jacobians = self.evaluate(*values, **self.data)
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


def _joined_slots(slots: Sequence[tuple[Slot, ...]], shifts: Sequence[int]) -> tuple[Slot, ...]:
    """Return the slots of several families of one type as those of one, each family's keyframes later by its shift."""
    moved = np.repeat(shifts, [len(of_family[0].index) for of_family in slots]) if any(shifts) else 0
    joined = ((same[0].kind, np.concatenate([slot.index for slot in same])) for same in zip(*slots, strict=True))
    return tuple(Slot(kind, index if kind.shared else index + moved) for kind, index in joined)


def changed(families: Iterable[Family], kind: FactorType, change: Callable[[Family], Family]) -> tuple[Family, ...]:
    """Return the families with a ``change`` to each one of type ``kind``."""
    return tuple(change(family) if family.type is kind else family for family in families)


def family_of(families: Iterable[Family], kind: FactorType) -> Family | None:
    """Return the first family of type ``kind``; None where there is none."""
    return next((family for family in families if family.type is kind), None)


def row_norms(rows: Array) -> Array:
    """Return the norm of each row (m, d), (m,)."""
    return np.asarray(np.sqrt(np.vecdot(rows, rows)))


def _finite(array: Array) -> bool:
    """Return whether all values are finite and none is beyond all bounds: their squares are added up, in one pass."""
    flat = array.ravel()
    return math.isfinite(flat @ flat)

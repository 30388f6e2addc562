"""A batch of linear factors has the variables that it touches, and its whitened rows there."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import reduce
from typing import NamedTuple

import numpy as np

from trackfg.factors.states import Kind, Step, offset_in_keyframe
from trackfg.numerics.arrays import Array


@dataclass(frozen=True)
class Slot:
    """A slot names which variable of ``kind`` each of m factors touches: ``index``, shape (m,)."""

    kind: Kind
    index: np.ndarray

    @property
    def keys(self) -> list[int]:
        """The GTSAM keys, in factor order."""
        keys: list[int] = self.kind.keys(self.index).tolist()
        return keys


def slot_columns(slot: Slot) -> np.ndarray:
    """Return the columns of a slot's variable in a keyframe's tangent with the shared ones after it, (dim,).

    All factors touch the same further sensor, if any.
    """
    which = int(slot.index[0]) if slot.kind is Kind.SENSOR else 0
    return np.asarray(offset_in_keyframe(slot.kind) + slot.kind.dim * which + np.arange(slot.kind.dim))


def first_keyframe(slots: Sequence[Slot], factors: int) -> np.ndarray:
    """Return the first keyframe that each factor touches, -1 where it touches shared variables alone. Shape (m,)."""
    return _keyframe(slots, factors, np.minimum)


def last_keyframe(slots: Sequence[Slot], factors: int) -> np.ndarray:
    """Return the last keyframe that each factor touches, likewise."""
    return _keyframe(slots, factors, np.maximum)


def _keyframe(slots: Sequence[Slot], factors: int, choose: Callable[..., np.ndarray]) -> np.ndarray:
    indices = [slot.index for slot in slots if not slot.kind.shared]
    return reduce(choose, indices) if indices else np.full(factors, -1)


class LinearFactors(NamedTuple):
    """Each of m linear factors says ``A d = b``, whitened: ``rows`` (m, r, c + 1) are [A b], A slot by slot."""

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
        """Return one Jacobian per slot, (m, r, dim)."""
        ends = np.cumsum([slot.kind.dim for slot in self.slots])
        return np.split(self.jacobian, ends[:-1], axis=2)

    def take(self, index: np.ndarray | slice) -> LinearFactors:
        """Return some of the factors."""
        return LinearFactors(tuple(Slot(slot.kind, slot.index[index]) for slot in self.slots), self.rows[index])

    def relative_to_step_start(self, step: Step) -> LinearFactors:
        """Return the same factors for steps d that begin where ``step`` began; these begin where it led."""
        d = np.concatenate([step.of(slot.kind)[slot.index] for slot in self.slots], axis=1)
        rows = self.rows.copy()
        rows[:, :, -1] += (self.jacobian @ d[:, :, None])[:, :, 0]
        return LinearFactors(self.slots, rows)

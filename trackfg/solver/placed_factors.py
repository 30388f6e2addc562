"""Linear factors are placed in the windows of a chain: the columns that each fills, and rows stacked by keyframe.

The window of keyframe k is (x_k, y_k), as :mod:`trackfg.solver.elimination` has it.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from trackfg.factors.linear import LinearFactors, Slot, first_keyframe, last_keyframe
from trackfg.factors.states import KEYFRAME_DIM, SHARED_DIM, Kind, offset_in_keyframe
from trackfg.numerics.arrays import Array
from trackfg.numerics.kernels import kernel_argument
from trackfg.solver.square_root import NAV_DIM

PAIR = 2 * KEYFRAME_DIM
"""Columns of two keyframes in a row."""


class PlacedFactors(NamedTuple):
    """Factors are placed in order of the first keyframe that each touches.

    ``first`` (m,) is -1 for shared variables alone; ``last`` (m,); ``places`` (m, slots) are those of :func:`_places`.
    """

    factors: LinearFactors
    first: np.ndarray
    last: np.ndarray
    places: np.ndarray

    @classmethod
    def of(cls, factors: LinearFactors) -> PlacedFactors:
        """Return linear factors in that order."""
        slots, count = factors.slots, len(factors.rows)
        first, last = first_keyframe(slots, count), last_keyframe(slots, count)
        if (first[1:] < first[:-1]).any():
            order = np.argsort(first, kind="stable")
            factors, first, last = factors.take(order), first[order], last[order]
        return cls(factors, first, last, _places(factors.slots, first, last))

    def between(self, begin: int, end: int) -> PlacedFactors:
        """Return those whose first keyframe is one from ``begin`` to ``end``, counted from ``begin``."""
        some = slice(*np.searchsorted(self.first, [begin, end]).tolist())
        # The slots keep their indices, which the places stand for.
        factors = LinearFactors(self.factors.slots, self.factors.rows[some])
        return PlacedFactors(factors, self.first[some] - begin, self.last[some] - begin, self.places[some])

    def as_arrays(self) -> tuple[np.ndarray, ...]:
        """Return those that touch a keyframe, as the kernel takes a family."""
        alone = int(np.searchsorted(self.first, 0))
        dims = np.array([slot.kind.dim for slot in self.factors.slots])
        return kernel_argument(self.factors.rows[alone:]), self.first[alone:], self.places[alone:], dims

    def columns(self, widths: np.ndarray, tail: int) -> np.ndarray:
        """Return the columns that the factors fill of windows of ``widths`` (m,), (m, c + 1), right-hand side last."""
        dims = [slot.kind.dim for slot in self.factors.slots]
        begin = np.where(self.places >= 0, self.places, widths[:, None] - 1 - self.places)
        at = np.repeat(begin, dims, axis=1) + np.concatenate([np.arange(dim) for dim in dims])
        return np.column_stack([at, widths + tail - 1])


def _places(slots: Sequence[Slot], first: np.ndarray, last: np.ndarray) -> np.ndarray:
    """Return the column in the window of its first keyframe at which each slot begins, (m, slots).

    Of shared variables, which are behind the window, -1 - the column there.
    """
    places = np.empty((len(first), len(slots)), dtype=np.int64)
    reaches_far = bool((last > first + 1).any())
    for slot, place in zip(slots, places.T, strict=True):
        kind, start = slot.kind, offset_in_keyframe(slot.kind)
        if kind.shared:
            place[:] = KEYFRAME_DIM - 1 - start - (kind.dim * slot.index if kind is Kind.SENSOR else 0)
            continue
        later = slot.index - first
        place[:] = start + KEYFRAME_DIM * later
        if reaches_far and (far := later >= 2).any():
            if kind is not Kind.NAV:
                raise ValueError(f"{kind.name} is touched from {later.max()} keyframes before; only NAV may be")
            place[far] = PAIR + NAV_DIM * (later[far] - 2)
    return places


def shared_dim_of(factors: Sequence[LinearFactors]) -> int:
    """Return the dimension of the shared variables: each further sensor has a factor, its prior or what that has
    become.
    """
    sensors = (
        slot.index for linear in factors for slot in linear.slots if slot.kind is Kind.SENSOR and slot.index.size
    )
    return SHARED_DIM + Kind.SENSOR.dim * max((int(index.max()) + 1 for index in sensors), default=0)


def reach_ahead(factors: Sequence[PlacedFactors], keyframes: int) -> np.ndarray:
    """Return how many navigation states after x_{k+1} each window has to reach, shape (n,)."""
    last = np.arange(1, keyframes + 1)
    for _, first, farthest, _ in factors:
        far = farthest > first + 1
        if far.any():
            np.maximum.at(last, first[far], farthest[far])
    return np.asarray(np.maximum.accumulate(last) - np.arange(keyframes) - 1)


def rows_of_shared_alone(factors: Sequence[PlacedFactors], tail: int) -> Array:
    """Return the rows of shared variables alone."""
    shared = [placed.between(-1, 0) for placed in factors if placed.first.size and placed.first[0] < 0]
    return stacked(shared, np.array([PAIR]), tail)[0][:, PAIR:]


def stacked(factors: Sequence[PlacedFactors], widths: np.ndarray, tail: int) -> tuple[Array, list[int]]:
    """Return the rows of keyframes whose windows have these ``widths`` (n,), in order, and where those of each start.

    Shape (m, widest window), and n + 1 starts.
    """
    factors = [placed for placed in factors if len(placed.first)]
    none = np.zeros(0, dtype=np.int64)
    tall = (np.full(len(placed.first), placed.factors.rows.shape[1]) for placed in factors)
    heights = np.concatenate([none, *tall])
    by_keyframe = np.concatenate([none, *(placed.first for placed in factors)])
    order = np.argsort(by_keyframe, kind="stable")
    ends = np.cumsum(heights[order])
    begins = np.empty(len(order), dtype=np.int64)
    begins[order] = ends - heights[order]
    starts = np.append(0, ends)[np.searchsorted(by_keyframe[order], np.arange(len(widths) + 1))]

    rows = np.zeros((int(ends[-1]) if len(ends) else 0, int(widths.max()) + tail))
    end = 0
    for placed in factors:
        begin, end = end, end + len(placed.first)
        row = begins[begin:end, None] + np.arange(placed.factors.rows.shape[1])
        column = placed.columns(widths[placed.first], tail)
        rows[row[:, :, None], column[:, None, :]] = placed.factors.rows
    return rows, starts.tolist()


def stacked_pair(factors: Sequence[LinearFactors], sensors: int | None = None) -> Array:
    """Return rows [A b] over (x_0, x_1, s) of factors of two keyframes.

    ``sensors``: how many further ones the run has, if these factors do not touch them all.
    """
    shared_dim = shared_dim_of(factors) if sensors is None else SHARED_DIM + Kind.SENSOR.dim * sensors
    rows = np.zeros((sum(linear.rows.shape[0] * linear.rows.shape[1] for linear in factors), PAIR + shared_dim + 1))
    begin = 0
    for slots, members in factors:
        kinds, indices = tuple(slot.kind for slot in slots), tuple(slot.index.tobytes() for slot in slots)
        for factor, columns in zip(members, _columns_of_pair(kinds, indices, shared_dim + 1), strict=True):
            rows[begin : begin + len(factor), columns] = factor
            begin += len(factor)
    return rows


@lru_cache(maxsize=256)
def _columns_of_pair(kinds: tuple[Kind, ...], indices: tuple[bytes, ...], tail: int) -> np.ndarray:
    """Return which columns of (x_0, x_1, s | b) each factor fills, shape (m, c + 1).

    ``indices`` are those of the slots, as bytes of 64-bit integers. Columns once found are kept: the factors of every
    keyframe of a stream have the same few layouts.
    """
    slots = tuple(Slot(kind, np.frombuffer(index, np.int64)) for kind, index in zip(kinds, indices, strict=True))
    first = np.zeros(len(slots[0].index), dtype=np.int64)
    factors = LinearFactors(slots, np.zeros((len(first), 0, 0)))
    return PlacedFactors(factors, first, first, _places(slots, first, first)).columns(first + PAIR, tail)

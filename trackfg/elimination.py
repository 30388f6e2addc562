"""Elimination of a chain of keyframes by QR: one small dense factorisation per keyframe.

All linear factors ``A d = b`` of keyframe k (those whose first keyframe it is) are rows over the window (x_k, y_k) with
``y_k = (x_{k+1}, nav_{k+2}, ..., nav_{k+w}, s)``: tangents x of keyframes, the variables s that the run shares, and,
where a factor ties keyframes further apart (two passes of lasers over one place), the navigation states it reaches.
With what earlier keyframes left over for this window, their QR is

    [ R_k  S_k  d_k ]    the conditional of x_k: ``R_k x_k + S_k y_k = d_k + e``, e ~ N(0, I)
    [  0    .    .  ]    what is left for the next keyframe
    [  0    s    .  ]    rows of shared variables alone, set aside until the end.

It works on A, not on A'A with the square of its condition number, which in a long open chain runs out of double
precision. (Bierman, "Factorization Methods for Discrete Sequential Estimation", 1977.)
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy.linalg.lapack import dgeqrf

from trackfg.errors import UnsolvableError
from trackfg.factors.family import LinearFactors, Slot, first_keyframe, last_keyframe
from trackfg.factors.states import KEYFRAME_DIM, SHARED_DIM, Kind, offset_in_keyframe
from trackfg.frames import Array
from trackfg.one_thread import one_thread
from trackfg.square_root import NAV, NAV_DIM, SIZE, SquareRoot

_PAIR = 2 * KEYFRAME_DIM
_TAIL = SHARED_DIM + 1
"""Columns of the shared variables and of the right-hand side."""

_AT_A_TIME = 256
"""Keyframes whose rows are stacked together."""

_INDETERMINATE = 1e-14
"""Part of a column that is left once all earlier ones are taken out: below this it is rounding."""

_UNDETERMINED = "the measurements do not determine the states"


class Conditionals(NamedTuple):
    """``R`` (n, 19, 19), ``S`` (n, 19, 49 + ...) and ``d`` (n, 19) of keyframes, as :class:`SquareRoot` has them."""

    R: Array
    S: Array
    d: Array


def eliminate(factors: Sequence[LinearFactors], keyframes: int) -> SquareRoot:
    """Eliminate keyframe by keyframe, shared variables last. Raises ``UnsolvableError`` where they are not determined.

    Shared variables have index 0. Cost is linear in the number of keyframes.
    """
    return eliminate_leaving(factors, keyframes, ())[0]


def eliminate_leaving(
    factors: Sequence[LinearFactors], keyframes: int, gone: Collection[int]
) -> tuple[SquareRoot, dict[int, Array]]:
    """As :func:`eliminate`, and for each number of keyframes ``gone`` what the factors that touch the first so many of
    a chain, or the shared variables alone, say of the rest: rows [A b] of ``A (x_gone, s) = b``, shape (49, 50).

    Raises ``ValueError`` where keyframes go and factors reach further than to the next one.
    """
    ahead = _ahead(factors, keyframes)
    if gone and ahead.any():
        raise ValueError("factors that tie keyframes further apart: these cannot be left behind one by one")
    widths = _PAIR + NAV_DIM * ahead
    with one_thread():
        conditional, alone, left = _factored(_systems(factors, widths), widths, gone)
        shared = _triangle(alone)[:SHARED_DIM]
        if len(shared) < SHARED_DIM:
            raise UnsolvableError(_UNDETERMINED)
        R, sign = _positive(np.triu(shared[:, :-1]))
        return SquareRoot(*_conditionals(conditional, ahead), R, shared[:, -1] * sign, ahead), left


def _factored(
    systems: Iterator[Array], widths: np.ndarray, gone: Collection[int]
) -> tuple[Array, Array, dict[int, Array]]:
    """Rows [R_k S_k d_k] of each keyframe (n, 19, widest window), laid out as its window; rows of the shared variables
    alone; what the first keyframes leave, as :func:`eliminate_leaving` says.
    """
    keyframes = len(widths)
    conditional = np.zeros((keyframes, KEYFRAME_DIM, int(widths.max()) + _TAIL))
    alone = [next(systems)]
    left, left_by_gone = np.zeros((0, 0)), {}
    place: np.ndarray | slice = slice(0)
    for k, own in enumerate(systems):
        width, carried = int(widths[k]), len(left)
        system = np.zeros((carried + len(own), width + _TAIL), order="F")
        system[:carried, place] = left
        system[carried:] = own
        if len(system) < KEYFRAME_DIM:
            raise UnsolvableError(_UNDETERMINED)
        triangle = dgeqrf(system, overwrite_a=True)[0]
        conditional[k, :, : width + _TAIL] = triangle[:KEYFRAME_DIM]
        rest = triangle[KEYFRAME_DIM:, KEYFRAME_DIM:]
        rest = rest * _upper(*rest.shape)  # below the diagonal dgeqrf keeps the reflections
        after = width - KEYFRAME_DIM if k + 1 < keyframes else 0
        alone.append(rest[after:, width - KEYFRAME_DIM :].copy())
        left = rest[:after]
        place = _columns_in_next(width, int(widths[min(k + 1, keyframes - 1)]))
        if k + 1 in gone:
            left_by_gone[k + 1] = _left(left, np.concatenate(alone))
    return conditional, np.concatenate(alone), left_by_gone


def _left(left: Array, alone: Array) -> Array:
    """Rows over (x, s | b) of both, (49, 50)."""
    shared = np.triu(_triangle(alone)[:SHARED_DIM])
    rest = np.zeros((SIZE, SIZE + 1))
    rest[: len(left)] = left
    rest[KEYFRAME_DIM : KEYFRAME_DIM + len(shared), KEYFRAME_DIM:] = shared
    return rest


def _conditionals(conditional: Array, ahead: np.ndarray) -> Conditionals:
    """From what :func:`_factored` gives."""
    R, sign = _positive(conditional[:, :, :KEYFRAME_DIM] * _upper(KEYFRAME_DIM, KEYFRAME_DIM))
    later = _PAIR - KEYFRAME_DIM + SHARED_DIM
    S = np.zeros((len(ahead), KEYFRAME_DIM, conditional.shape[2] - KEYFRAME_DIM - 1))
    d = np.empty((len(ahead), KEYFRAME_DIM))
    for count in np.unique(ahead).tolist():  # the shared variables before the later navigation states
        own, end = np.flatnonzero(ahead == count), _PAIR + NAV_DIM * count
        S[own, :, : _PAIR - KEYFRAME_DIM] = conditional[own, :, KEYFRAME_DIM:_PAIR]
        S[own, :, _PAIR - KEYFRAME_DIM : later] = conditional[own, :, end : end + SHARED_DIM]
        S[own, :, later : later + NAV_DIM * count] = conditional[own, :, _PAIR:end]
        d[own] = conditional[own, :, end + SHARED_DIM]
    S *= sign[:, :, None]
    return Conditionals(R, S, d * sign)


def _positive(R: Array) -> tuple[Array, Array]:
    """Triangles with a positive diagonal, and the signs that their rows were multiplied by.

    The sign of a row is arbitrary; so R is unique, and so are samples drawn with it. Raises ``UnsolvableError`` where a
    triangle is singular.
    """
    if not _determined(R):
        raise UnsolvableError(_UNDETERMINED)
    sign = np.copysign(1.0, np.diagonal(R, axis1=-2, axis2=-1))
    return R * sign[..., None], sign


def _triangle(rows: Array) -> Array:
    """R of the QR of many rows: of some at a time, then of their Rs, and so on."""
    some, columns = 4 * rows.shape[1], rows.shape[1]
    while len(rows) > some:
        padded = np.concatenate([rows, np.zeros((-len(rows) % some, columns))])
        rows = np.asarray(np.linalg.qr(padded.reshape(-1, some, columns), mode="r")).reshape(-1, columns)
    return np.asarray(np.linalg.qr(rows, mode="r"))


def _determined(R: Array) -> bool:
    diagonal = np.abs(np.diagonal(R, axis1=-2, axis2=-1))
    return bool((diagonal > _INDETERMINATE * np.linalg.norm(R, axis=-2)).all())


@lru_cache
def _upper(rows: int, columns: int) -> Array:
    return np.triu(np.ones((rows, columns)))


@lru_cache
def _columns_in_next(width: int, next_width: int) -> np.ndarray:
    """Where the columns of y_k are in the window of keyframe k + 1."""
    x = np.arange(KEYFRAME_DIM)
    nav = KEYFRAME_DIM + np.arange(NAV.start, NAV.stop)[: width - _PAIR]
    later = np.arange(_PAIR, width - NAV_DIM)
    return np.concatenate([x, nav, later, next_width + np.arange(_TAIL)])


def _ahead(factors: Sequence[LinearFactors], keyframes: int) -> np.ndarray:
    """How many navigation states after x_{k+1} each window has to reach, shape (n,)."""
    last = np.arange(1, keyframes + 1)
    for slots, _, b in factors:
        first, farthest = first_keyframe(slots, len(b)), last_keyframe(slots, len(b))
        far = farthest > first + 1
        if far.any():
            np.maximum.at(last, first[far], farthest[far])
    return np.asarray(np.maximum.accumulate(last) - np.arange(keyframes) - 1)


def _systems(factors: Sequence[LinearFactors], widths: np.ndarray) -> Iterator[Array]:
    """Rows of shared variables alone, then those of each keyframe, laid out as its window, the right-hand side last.

    Stacked some keyframes at a time: windows differ, and at the widest all rows together would fill the memory.
    """
    sorted_ = [_by_first(one) for one in factors]
    shared = [(one, first) for one, first in sorted_ if first.size and first[0] < 0]
    yield _stacked(shared, -1, 0, np.array([_PAIR]))[0][:, _PAIR:]
    own = [(one, first) for one, first in sorted_ if first.size and first[0] >= 0]
    for begin in range(0, len(widths), _AT_A_TIME):
        end = min(begin + _AT_A_TIME, len(widths))
        rows, starts = _stacked(own, begin, end, widths[begin:end])
        for k, width in enumerate(widths[begin:end].tolist()):
            yield rows[starts[k] : starts[k + 1], : width + _TAIL]


def _by_first(factors: LinearFactors) -> tuple[LinearFactors, np.ndarray]:
    """Factors in order of the first keyframe of each, -1 for shared variables alone, and these keyframes (m,)."""
    slots, jacobians, b = factors
    first = first_keyframe(slots, len(b))
    if (first[1:] >= first[:-1]).all():
        return factors, first
    order = np.argsort(first, kind="stable")
    slots = tuple(Slot(slot.kind, slot.index[order]) for slot in slots)
    return LinearFactors(slots, tuple(one[order] for one in jacobians), b[order]), first[order]


def _stacked(
    factors: Sequence[tuple[LinearFactors, np.ndarray]], begin: int, end: int, widths: np.ndarray
) -> tuple[Array, np.ndarray]:
    """The rows of the keyframes from ``begin`` to ``end``, in order (m, widest window); where those of each start."""
    parts = []
    for (slots, jacobians, b), first in factors:
        some = slice(*np.searchsorted(first, [begin, end]).tolist())
        if some.stop > some.start:
            parts.append((slots, jacobians, b, first, some))
    number = [first[some] - begin for *_, first, some in parts]
    none = np.zeros(0, dtype=np.int64)
    tall = (np.full(len(k), b.shape[1]) for k, (_, _, b, _, _) in zip(number, parts, strict=True))
    heights = np.concatenate([none, *tall])
    by_keyframe = np.concatenate([none, *number])
    order = np.argsort(by_keyframe, kind="stable")
    ends = np.cumsum(heights[order])
    begins = np.empty(len(order), dtype=np.int64)
    begins[order] = ends - heights[order]
    starts = np.append(0, ends)[np.searchsorted(by_keyframe[order], np.arange(len(widths) + 1))]

    rows = np.zeros((int(ends[-1]) if len(ends) else 0, int(widths.max()) + _TAIL))
    after = 0
    for k, (slots, jacobians, b, first, some) in zip(number, parts, strict=True):
        before, after = after, after + len(k)
        row = begins[before:after, None] + _counted(b.shape[1])
        width = widths[k]
        rows[row, (width + SHARED_DIM)[:, None]] = b[some]
        for slot, jacobian in zip(slots, jacobians, strict=True):
            column = _column(slot.kind, slot.index[some] - first[some], width)[:, None] + _counted(slot.kind.dim)
            rows[row[:, :, None], column[:, None, :]] = jacobian[some]
    return rows, starts


def _column(kind: Kind, later: np.ndarray, width: np.ndarray) -> np.ndarray:
    """Where variables of a kind begin in windows of some ``width``, ``later`` keyframes after their first. All (m,)."""
    at = offset_in_keyframe(kind)
    if kind.shared:
        return width + (at - KEYFRAME_DIM)
    near = later < 2
    if near.all():
        return np.asarray(KEYFRAME_DIM * later + at)
    if kind is not Kind.NAV:
        raise ValueError(f"{kind.name} is touched from {later.max()} keyframes before; only NAV may be")
    return np.asarray(np.where(near, KEYFRAME_DIM * later + at, _PAIR + NAV_DIM * (later - 2)))


@lru_cache
def _counted(length: int) -> np.ndarray:
    return np.arange(length)

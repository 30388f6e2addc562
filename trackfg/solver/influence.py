"""Each group of residuals accounts for a part of a quantity's error, held against what the model expects.

With whitened rows A, residuals r and the covariance P = (A'A)^-1, the estimate of a linear function c of the states
errs by ``w'e``, ``w = A P c``, where e is the measurements' error: white, of variance 1, if the model is right. Then
the variance is ``w'w``, and a group of rows has the share ``sum w_i^2`` of it. Residuals ``r = (I - A P A') e`` are
what can be seen of e. So for each group the sum over blocks of time

    sum_b (sum_{i in b} w_i r_i)^2

is held against its mean over residuals of drawn white errors. It is the variance that a jackknife over blocks gives
(Efron, "The jackknife, the bootstrap and other resampling plans", 1982, ch. 3), each group on its own: larger where
levels are wrong, and over long blocks where errors last.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from trackfg.factors.factor_type import FactorType
from trackfg.factors.linear import LinearFactors, Slot, first_keyframe, last_keyframe
from trackfg.factors.states import KEYFRAME_DIM, Kind, offset_in_keyframe
from trackfg.solver.covariance import Functions, times_covariance

if TYPE_CHECKING:
    from trackfg.graph.build import Problem
    from trackfg.numerics.arrays import Array
    from trackfg.solver.gauss_newton import Solution
    from trackfg.solver.square_root import SquareRoot

_DRAWS = 24
"""Drawn errors: the mean of one square over so many errs by sqrt(2 / 24), 29 %; most are over many blocks, too."""

_FACTORS = 512
"""Factors whose products with drawn errors are made at a time: of 13 variables and 24 draws 1 MB."""

_AT_A_TIME = 64
"""Factors whose products of gains and errors are made at a time: of 88 functions and 25 errors 1 MB, which stays in the
processor's cache."""

_GROUPS = {
    FactorType.NON_HOLONOMIC: "motion",
    FactorType.PATH: "path",
    FactorType.TACH_DISTANCE: "tach",
    FactorType.TACH_READING: "tach",
    FactorType.TACH_INCREMENT: "tach",
    FactorType.SPEED_DISTANCE: "speed",
    FactorType.ABSOLUTE_FIX: "fixes",
    FactorType.LANDMARK: "map",
    FactorType.GNSS_POSITION: "gnss",
    FactorType.GNSS_SPEED: "gnss speed",
    FactorType.BIAS_WALK: "biases",
    FactorType.AT_REST: "rests",
    FactorType.STANDSTILL: "rests",
}
"""Families whose residuals are judged, and what reports call them; inertial factors are "gyro" and "accel"."""

_PRIORS = {
    FactorType.PRIOR_BIAS: "bias prior",
    FactorType.PRIOR_IMU: "calibration prior",
    FactorType.PRIOR_MOUNT: "mounting prior",
    FactorType.PRIOR_WHEEL: "wheel prior",
    FactorType.PRIOR_SENSOR: "sensor prior",
}
"""Priors of sensors, whose rows have one level each: where some variables are far from a prior, the sensor is not of
the grade that was declared, and those that nothing else determines may be as far.
"""


class Columns(NamedTuple):
    """Vectors over all states: ``keyframes`` (n, KEYFRAME_DIM, m) and ``shared`` (s, m)."""

    keyframes: Array
    shared: Array


@dataclass(frozen=True)
class GroupRows:
    """Linear factors of a group, with residuals of errors drawn from the model (f, r, draws).

    ``keyframe`` (f,): where each begins, the first one for those of shared variables alone.
    """

    group: str
    linear: LinearFactors
    keyframe: np.ndarray
    drawn: Array
    has_one_level: bool = False

    @property
    def reach(self) -> int:
        """The number of keyframes ahead that the factors reach."""
        return int(np.max(last_keyframe(self.linear.slots, len(self.keyframe)) - self.keyframe, initial=0))

    def between(self, begin: int, end: int) -> GroupRows:
        """Return the factors of keyframes from ``begin`` to before ``end``, which count from ``begin`` on in them."""
        inside = np.flatnonzero((self.keyframe >= begin) & (self.keyframe < end))
        run = slice(int(inside[0]), int(inside[-1]) + 1) if len(inside) else slice(0, 0)
        some = run if run.stop - run.start == len(inside) else inside  # slices take no copies
        slots, rows = self.linear
        moved = [replace(slot, index=slot.index[some] - (0 if slot.kind.shared else begin)) for slot in slots]
        linear = LinearFactors(tuple(moved), rows[some])
        return replace(self, linear=linear, keyframe=self.keyframe[some], drawn=self.drawn[some])


class Misfit(NamedTuple):
    """The part of some functions' variances that a group's residuals account for.

    ``share`` is the group's by the model, its mean over the functions; ``seen`` (b,) what residuals over blocks sum up
    to for each division into blocks, and ``drawn`` (b, draws) the same of drawn errors.
    """

    group: str
    share: float
    seen: Array
    drawn: Array

    @property
    def ratio(self) -> Array:
        """Seen over expected variance for each division into blocks, shape (b,)."""
        return np.asarray(self.seen / self.drawn.mean(axis=1))

    @property
    def degrees(self) -> Array:
        """The degrees of freedom of what is seen (Satterthwaite, 1946), from the spread of the draws, shape (b,)."""
        return np.asarray(2.0 * self.drawn.mean(axis=1) ** 2 / self.drawn.var(axis=1))


def all_rows(problem: Problem, solution: Solution, rng: np.random.Generator) -> list[GroupRows]:
    """Return the rows of all factors at the solution, with residuals of drawn errors."""
    inertial = problem.inertial.linearize(solution.states)
    parts = [
        ("gyro", LinearFactors(inertial.slots, inertial.rows[:, :3])),
        ("accel", LinearFactors(inertial.slots, inertial.rows[:, 3:])),
    ]
    named = _GROUPS | _PRIORS
    parts += [(named.get(family.type, ""), family.linearize(solution.states)) for family in problem.families]
    drawn = [rng.standard_normal((*linear.b.shape, _DRAWS)) for _, linear in parts]
    n, shared = len(solution.states), solution.root.size - KEYFRAME_DIM
    score = Columns(np.zeros((n, KEYFRAME_DIM, _DRAWS)), np.zeros((shared, _DRAWS)))
    of_factors = [
        (linear.take(some), errors[some])
        for (_, linear), errors in zip(parts, drawn, strict=True)
        for some in _in_cache(len(errors))
    ]
    for linear, errors in of_factors:
        _add_transposed(score, linear, errors)
    moved = Columns(*times_covariance(solution.root, *score))
    for linear, errors in of_factors:
        errors -= _applied(linear, moved)
    return [
        GroupRows(group, linear, _begins(linear), errors, group in _PRIORS.values())
        for (group, linear), errors in zip(parts, drawn, strict=True)
        if group
    ]


def _in_cache(count: int) -> Iterator[slice]:
    """Yield so many of ``count`` factors at a time that what is computed of them stays in the processor's cache."""
    yield from (slice(begin, begin + _FACTORS) for begin in range(0, count, _FACTORS))


def _begins(linear: LinearFactors) -> np.ndarray:
    begins: np.ndarray = np.maximum(first_keyframe(linear.slots, len(linear.rows)), 0)
    return begins


class GainPart(NamedTuple):
    """Gains at the keyframes that those factors touch which begin from keyframe ``begin`` to before ``end``.

    ``columns`` has the keyframes from ``begin`` on, with those beyond ``end`` that the factors reach.
    """

    begin: int
    end: int
    columns: Columns


def gains(root: SquareRoot, functions: Functions, ends: Sequence[int], reach: int) -> Iterator[GainPart]:
    """Yield ``P c / sqrt(c' P c)`` of each of m functions c of the states, in parts of the chain, the last one first.

    ``ends``: before which keyframe each part ends, ascending; ``reach``: how many keyframes factors reach ahead. R' and
    R are solved as in :func:`~trackfg.solver.covariance.times_covariance`. Solved forwards, each part but the last is
    forgotten, and solved again from what is carried into it: the columns of a day would be 1.3 GB.
    """
    parts = [_Part(root, functions, begin, end, reach) for begin, end in pairwise([0, *ends])]
    into: list[Array | None] = [None]
    variance = np.zeros(len(functions.keyframe))
    for part in parts:
        y, out = part.whitened(into[-1])
        variance += np.einsum("nkm,nkm->m", y[: part.length], y[: part.length])
        into.append(out)
    carried = into.pop()
    assert carried is not None
    of_shared = root.shared_inverse.T @ (functions.by_shared.T + carried[KEYFRAME_DIM : root.size])
    sd = np.sqrt(variance + np.sum(of_shared**2, axis=0))
    of_shared = root.shared_inverse @ of_shared
    behind, later = root.behind(of_shared), y[:0]
    for part, carried in zip(reversed(parts), reversed(into), strict=True):
        columns = y if part is parts[-1] else part.whitened(carried)[0]
        _, behind = part.root.back_substituted(columns[: part.length], behind)
        columns[part.length :] = later[: len(columns) - part.length]
        later = columns[:reach].copy()
        columns /= sd
        yield GainPart(part.begin, part.begin + part.length, Columns(columns, of_shared / sd))


class _Part:
    """Some keyframes of a chain, and functions of all; columns have rows for those that factors reach beyond, too."""

    def __init__(self, root: SquareRoot, functions: Functions, begin: int, end: int, reach: int) -> None:
        self.root, self._functions, self.begin, self.length = root.part(begin, end), functions, begin, end - begin
        self._rows = min(end + reach, len(root.R)) - begin

    def whitened(self, carried: Array | None) -> tuple[Array, Array]:
        """Return the solution of the transposed system, and what it adds to that of later keyframes, (p, m).

        ``carried`` (p, m) is what earlier ones add.
        """
        columns = np.zeros((self._rows, KEYFRAME_DIM, len(self._functions.keyframe)))
        self._functions.add_to(columns[: self.length], self.begin)
        _, out = self.root.forward_substituted(columns[: self.length], carried)
        return columns, out


def misfits(
    rows: Sequence[GroupRows], gain: Iterable[GainPart], blocks: Sequence[np.ndarray], kinds: int = 1
) -> list[list[Misfit]]:
    """Return the misfit of each group in m functions of the states, given by their :func:`gains`.

    ``blocks``: divisions into blocks of time, each the block of every keyframe (n,), ascending; no part of the gains
    ends within one. ``kinds``: of how many kinds the functions are, as many of each, in a row; each kind has a list of
    misfits.
    """
    totals: list[_Sums] = []
    for part in gain:
        sums = [_sums(group_rows.between(part.begin, part.end), part.columns, blocks) for group_rows in rows]
        totals = [total + more for total, more in zip(totals, sums, strict=True)] if totals else sums
    parts: dict[str, list[list[Misfit]]] = {}
    for group_rows, total in zip(rows, totals, strict=True):
        parts.setdefault(group_rows.group, []).append(_misfits(group_rows, total, kinds))
    merged = [[_joined(same) for same in zip(*of_group, strict=True)] for of_group in parts.values()]
    return [list(of_kind) for of_kind in zip(*merged, strict=True)]


def _joined(same: Sequence[Misfit]) -> Misfit:
    """Return the misfit of a group from those of its families."""
    return Misfit(same[0].group, *(sum(column) for column in list(zip(*same, strict=True))[1:]))


@dataclass(frozen=True)
class _Sums:
    """Sums over factors for m functions: ``share`` (m,) of w^2, ``squares`` (b, m, 1 + draws) of the squared sums over
    blocks of w e, seen and drawn.
    """

    share: Array
    squares: Array

    def __add__(self, other: _Sums) -> _Sums:
        return _Sums(self.share + other.share, self.squares + other.squares)


def _sums(rows: GroupRows, gain: Columns, blocks: Sequence[np.ndarray]) -> _Sums:
    w = _applied(rows.linear, gain)
    share = np.einsum("frm,frm->m", w, w)
    if rows.has_one_level:
        return _Sums(share, np.zeros(len(blocks)))
    errors = np.concatenate([rows.linear.b[:, :, None], rows.drawn], axis=2)
    edges = [np.flatnonzero(np.diff(block[rows.keyframe], prepend=-1)) for block in blocks]
    return _Sums(share, np.array([_squares(w, errors, edge) for edge in edges]))


def _misfits(rows: GroupRows, sums: _Sums, kinds: int) -> list[Misfit]:
    share = sums.share.reshape(kinds, -1).mean(axis=1)
    if rows.has_one_level:
        squares, drawn = np.sum(rows.linear.b**2), np.sum(rows.drawn**2, axis=(0, 1))
        divisions = len(sums.squares)
        return [
            Misfit(rows.group, float(part), np.full(divisions, squares), np.tile(drawn, (divisions, 1)))
            for part in share
        ]
    divisions, _, count = sums.squares.shape
    of_kind = sums.squares.reshape(divisions, kinds, -1, count).sum(axis=2)
    return [Misfit(rows.group, float(share[i]), of_kind[:, i, 0], of_kind[:, i, 1:]) for i in range(kinds)]


def _squares(w: Array, errors: Array, edges: np.ndarray) -> Array:
    """Return the sums over blocks of factors, beginning at ``edges``, of squared sums of w e over each. Shape (m, s).

    ``w`` (f, r, m), ``errors`` (f, r, s).
    """
    total = np.zeros((w.shape[2], errors.shape[2]))
    if len(edges) == len(w):
        for begin in range(0, len(w), _AT_A_TIME):
            some = slice(begin, begin + _AT_A_TIME)
            products = w[some].swapaxes(1, 2) @ errors[some]
            total += np.einsum("fms,fms->ms", products, products)
        return total
    ends = [*(w.shape[1] * edges).tolist(), w.shape[0] * w.shape[1]]
    w, errors = w.reshape(-1, w.shape[2]), errors.reshape(-1, errors.shape[2])
    for begin, end in pairwise(ends):
        total += (w[begin:end].T @ errors[begin:end]) ** 2
    return total


def _applied(linear: LinearFactors, columns: Columns) -> Array:
    """Return A x of the factors, shape (f, r, m)."""
    total = np.zeros((*linear.b.shape, columns.shared.shape[1]))
    for slot, jacobian in zip(linear.slots, linear.jacobians, strict=True):
        total += jacobian @ _of_slot(columns, slot)
    return total


def _of_slot(columns: Columns, slot: Slot) -> Array:
    """Return the part of a slot's variables, (f, dim, m); of a variable that all factors share, (1, dim, m)."""
    if slot.kind.shared:
        return np.asarray(columns.shared[_shared_rows(slot)])
    start = offset_in_keyframe(slot.kind)
    return columns.keyframes[slot.index, start : start + slot.kind.dim]


def _shared_rows(slot: Slot) -> np.ndarray:
    """Return the rows of a slot's variables among the shared ones, (f, dim); (1, dim) where they are the same."""
    start = offset_in_keyframe(slot.kind) - KEYFRAME_DIM
    index = slot.index if slot.kind is Kind.SENSOR else np.zeros(1, dtype=np.int64)
    return np.asarray(start + slot.kind.dim * index[:, None] + np.arange(slot.kind.dim))


def _add_transposed(columns: Columns, linear: LinearFactors, errors: Array) -> None:
    """Add A' e of the factors, e of shape (f, r, m)."""
    for slot, jacobian in zip(linear.slots, linear.jacobians, strict=True):
        part = np.swapaxes(jacobian, 1, 2) @ errors
        if slot.kind.shared:
            rows = _shared_rows(slot)
            np.add.at(columns.shared, rows, part if len(rows) == len(part) else part.sum(axis=0, keepdims=True))
        else:
            start = offset_in_keyframe(slot.kind)
            into = columns.keyframes[:, start : start + slot.kind.dim]
            if np.all(np.diff(slot.index) > 0):
                into[slot.index] += part  # each keyframe once: three times as fast
            else:
                np.add.at(into, slot.index, part)

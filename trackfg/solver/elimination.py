"""A chain of keyframes is eliminated by QR: one small dense factorisation per keyframe.

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
from trackfg.factors.linear import LinearFactors
from trackfg.factors.states import KEYFRAME_DIM
from trackfg.numerics.arrays import Array
from trackfg.numerics.blas_threads import one_thread
from trackfg.numerics.kernels import compiled_kernels, kernel_argument
from trackfg.solver.placed_factors import (
    PAIR,
    PlacedFactors,
    reach_ahead,
    rows_of_shared_alone,
    shared_dim_of,
    stacked,
)
from trackfg.solver.square_root import NAV, NAV_DIM, SquareRoot, begins_beyond

_AT_A_TIME = 256
"""Keyframes whose rows are stacked together: at the widest window all rows at once would fill the memory."""

_INDETERMINATE = 1e-14
"""Part of a column that is left once all earlier ones are taken out: below this it is rounding."""

_UNDETERMINED = "the measurements do not determine the states"


class Conditionals(NamedTuple):
    """The conditionals are ``R``, ``S`` and ``d`` of keyframes along a chain, as :class:`SquareRoot` has them."""

    R: Array
    S: Array
    d: Array


class _WithBeyond(NamedTuple):
    """Conditionals and their rows ``beyond`` the next keyframe, as :class:`SquareRoot` has them."""

    R: Array
    S: Array
    d: Array
    beyond: Array

    @classmethod
    def empty(cls, ahead: np.ndarray, shared_dim: int) -> _WithBeyond:
        """Return room for those of keyframes that reach so far ``ahead`` (n,)."""
        R = np.zeros((len(ahead), KEYFRAME_DIM, KEYFRAME_DIM))
        S = np.empty((len(ahead), KEYFRAME_DIM, KEYFRAME_DIM + shared_dim))
        return cls(R, S, np.empty((len(ahead), KEYFRAME_DIM)), np.empty((NAV_DIM * int(ahead.sum()), KEYFRAME_DIM)))


def eliminate(factors: Sequence[LinearFactors], keyframes: int) -> SquareRoot:
    """Eliminate keyframe by keyframe, shared variables last. Raises ``UnsolvableError`` where they are not determined.

    Shared variables have index 0. Cost is linear in the number of keyframes.
    """
    return eliminate_with_marginals(factors, keyframes, ())[0]


def eliminate_with_marginals(
    factors: Sequence[LinearFactors], keyframes: int, leading_counts: Collection[int]
) -> tuple[SquareRoot, dict[int, Array]]:
    """Eliminate as :func:`eliminate` does, and return the marginals of the first keyframes as well.

    For each count n of ``leading_counts``: what the factors that touch the first n keyframes of a chain, or the shared
    variables alone, say about the rest, as rows [A b] of ``A (x_n, s) = b``, shape (SIZE, SIZE + 1).

    Raises ``ValueError`` where keyframes go and factors reach further than to the next one.
    """
    placed, shared_dim = [PlacedFactors.of(linear) for linear in factors], shared_dim_of(factors)
    ahead = reach_ahead(placed, keyframes)
    if leading_counts and ahead.any():
        raise ValueError("factors that tie keyframes further apart: these cannot be marginalised one by one")
    with one_thread():
        whole, alone, marginals = _factored(placed, ahead, shared_dim, leading_counts)
    R, d = _conditional_of_shared(alone, shared_dim)
    return SquareRoot(whole.R, whole.S, whole.d, R, d, ahead, whole.beyond), marginals


def eliminated_blocks(factors: Sequence[LinearFactors], keyframes: int) -> Iterator[SquareRoot]:
    """Eliminate as :func:`eliminate` does, and yield the conditionals of some keyframes after the other; only the last
    has the shared variables' own.

    What is done with them, and not their number, decides how much memory they take.
    """
    placed, shared_dim = [PlacedFactors.of(linear) for linear in factors], shared_dim_of(factors)
    ahead = reach_ahead(placed, keyframes)
    alone, remainder = rows_of_shared_alone(placed, shared_dim + 1), np.zeros((0, KEYFRAME_DIM + shared_dim + 1))
    chain = _Chain.of(placed, ahead)
    for begin in range(0, keyframes, _AT_A_TIME):
        some = ahead[begin : begin + _AT_A_TIME]
        block = _WithBeyond.empty(some, shared_dim)
        with one_thread():
            remainder, rest = _block_factored(chain, begin, remainder, block)
            alone = _triangle(np.concatenate([alone, rest]))
        is_last = begin + len(some) == keyframes
        shared = _conditional_of_shared(alone, shared_dim) if is_last else (np.zeros((0, 0)), np.zeros(0))
        yield SquareRoot(block.R, block.S, block.d, *shared, some, block.beyond, int(ahead[begin - 1]) if begin else 0)


def _conditional_of_shared(alone: Array, shared_dim: int) -> tuple[Array, Array]:
    """Return R and d of the shared variables, from rows of them alone."""
    with one_thread():
        shared = _triangle(alone)[:shared_dim]
        if len(shared) < shared_dim:
            raise UnsolvableError(_UNDETERMINED)
        R, sign = _positive(np.triu(shared[:, :-1]))
        return R, shared[:, -1] * sign


def compressed(rows: Array) -> Array:
    """Return R of the rows' QR: equivalent rows, at most as many as columns."""
    with one_thread():
        return _triangle(rows)


def eliminate_pair(triangle: Array, further: Array) -> tuple[SquareRoot, Array]:
    """Return the square root of the information in rows of :func:`stacked_pair`, and the marginal of (x_1, s).

    Of the rows a part has been :func:`compressed` to a ``triangle``, and ``further`` ones have not. The marginal are
    rows [A b]; both come from one dense QR.
    """
    pair = _pair_compiled if compiled_kernels() else _pair_by_lapack
    return pair(triangle, further, triangle.shape[1] - 1 - PAIR)


def _pair_compiled(triangle: Array, further: Array, shared: int) -> tuple[SquareRoot, Array]:
    """Do as :func:`_pair_by_lapack`, in ``kernels/elimination.cpp``."""
    from trackfg.numerics import compiled

    dim, behind = KEYFRAME_DIM, KEYFRAME_DIM + shared
    R, S, d = np.empty((2, dim, dim)), np.empty((2, dim, behind)), np.empty((2, dim))
    R_shared, d_shared, marginal = np.empty((shared, shared)), np.empty(shared), np.empty((behind, behind + 1))
    parts = R, S, d, R_shared, d_shared
    first, last = kernel_argument(triangle), kernel_argument(further)
    if not compiled.eliminate_pair(first, last, _INDETERMINATE, *parts, marginal):
        raise UnsolvableError(_UNDETERMINED)
    return SquareRoot(*parts, np.zeros(2, dtype=np.int64)), marginal


def _pair_by_lapack(triangle: Array, further: Array, shared: int) -> tuple[SquareRoot, Array]:
    """Do as :func:`eliminate_pair`; ``shared``: how many variables the run shares."""
    variables, dim = PAIR + shared, KEYFRAME_DIM
    R = compressed(np.concatenate([triangle, further]))[:variables]
    if len(R) < variables:
        raise UnsolvableError(_UNDETERMINED)
    R = R * _positive(R[:, :-1])[1][:, None]
    first, second, last = slice(0, dim), slice(dim, PAIR), slice(PAIR, variables)
    S = np.zeros((2, dim, dim + shared))
    S[0], S[1, :, dim:] = R[first, dim:-1], R[second, PAIR:-1]
    root = SquareRoot(
        np.array([R[first, first], R[second, second]]),
        S,
        R[:PAIR, -1].reshape(2, dim),
        R[last, last],
        R[last, -1],
        np.zeros(2, dtype=np.int64),
    )
    return root, R[dim:, dim:]


def _factored(
    factors: Sequence[PlacedFactors], ahead: np.ndarray, shared_dim: int, leading_counts: Collection[int]
) -> tuple[_WithBeyond, Array, dict[int, Array]]:
    """Return conditionals of all keyframes, rows of the shared variables alone, and the marginals by their counts.

    ``ahead`` is that of :class:`SquareRoot`; the marginals are those of :func:`eliminate_with_marginals`.
    """
    keyframes, tail, begins = len(ahead), shared_dim + 1, begins_beyond(ahead)
    whole = _WithBeyond.empty(ahead, shared_dim)
    alone, marginals = [rows_of_shared_alone(factors, tail)], {}
    remainder = np.zeros((0, PAIR - KEYFRAME_DIM + tail))
    at_a_time = keyframes if compiled_kernels() else _AT_A_TIME
    chain = _Chain.of(factors, ahead)
    ends = sorted({*range(at_a_time, keyframes, at_a_time), keyframes, *leading_counts})
    for begin, end in zip([0, *ends], ends, strict=False):
        rows = whole.beyond[begins[begin] : begins[end]]
        out = _WithBeyond(whole.R[begin:end], whole.S[begin:end], whole.d[begin:end], rows)
        remainder, rest = _block_factored(chain, begin, remainder, out)
        alone.append(rest)
        if end in leading_counts:
            marginals[end] = _left(remainder, np.concatenate(alone), shared_dim)
    return whole, np.concatenate(alone), marginals


class _Chain(NamedTuple):
    """All factors of a chain; the same as ``arrays`` for the kernel, none without it; and the ``widths`` (n,) of the
    windows, without the columns of the shared variables.
    """

    factors: Sequence[PlacedFactors]
    arrays: Sequence[np.ndarray]
    widths: np.ndarray

    @classmethod
    def of(cls, factors: Sequence[PlacedFactors], ahead: np.ndarray) -> _Chain:
        filled = [placed for placed in factors if placed.factors.rows.size] if compiled_kernels() else []
        return cls(factors, [array for placed in filled for array in placed.as_arrays()], PAIR + NAV_DIM * ahead)


def _block_factored(chain: _Chain, begin: int, remainder: Array, out: _WithBeyond) -> tuple[Array, Array]:
    """Write the conditionals of as many keyframes as ``out`` has, from ``begin`` on; return what is left over, and rows
    of the shared variables alone.
    """
    end, tail = begin + len(out.R), out.S.shape[2] - KEYFRAME_DIM + 1
    block = _Block(chain, begin, _around(chain.widths, begin, end), remainder, tail)
    return (_block_compiled if compiled_kernels() else _block_by_lapack)(block, out)


class _Block(NamedTuple):
    """A block has some keyframes of a ``chain`` in a row, from number ``begin`` on.

    ``widths`` (n + 2,) without the columns of the shared variables, beginning with the keyframe before and ending with
    the one after, 0 where there is none; ``remainder`` is what the keyframe before left; ``tail`` counts the shared
    variables and the right-hand side.
    """

    chain: _Chain
    begin: int
    widths: np.ndarray
    remainder: Array
    tail: int


def _around(widths: np.ndarray, begin: int, end: int) -> np.ndarray:
    preceding = widths[begin - 1 : begin] if begin else [PAIR]
    following = widths[end : end + 1] if end < len(widths) else [0]
    return np.concatenate([preceding, widths[begin:end], following])


def _block_compiled(block: _Block, out: _WithBeyond) -> tuple[Array, Array]:
    """Do as :func:`_block_by_lapack`, in ``kernels/elimination.cpp``."""
    from trackfg.numerics import compiled

    tail, most = block.tail, int(block.widths.max()) - KEYFRAME_DIM
    remainder = np.empty(most * (most + tail))
    remainder[: block.remainder.size] = block.remainder.ravel()
    alone = np.empty((tail, tail))
    layout = block.begin, block.widths, (NAV.start, NAV_DIM)
    done = compiled.eliminate(
        *layout, _INDETERMINATE, remainder, len(block.remainder), *out, alone, *block.chain.arrays
    )
    if done is None:
        raise UnsolvableError(_UNDETERMINED)
    columns = int(block.widths[-2]) - KEYFRAME_DIM + tail
    return remainder[: done[0] * columns].reshape(-1, columns), alone[: done[1]]


def _block_by_lapack(block: _Block, out: _WithBeyond) -> tuple[Array, Array]:
    """Write the conditionals of a block, and return what is left over and rows of the shared variables alone."""
    widths, remainder, tail, alone = block.widths.tolist(), block.remainder, block.tail, []
    factors = [placed.between(block.begin, block.begin + len(out.R)) for placed in block.chain.factors]
    rows, starts = stacked(factors, block.widths[1:-1], tail)
    begins = begins_beyond((block.widths[1:-1] - PAIR) // NAV_DIM).tolist()
    for k, (preceding, width, following) in enumerate(zip(widths, widths[1:], widths[2:], strict=False)):
        new_rows = rows[starts[k] : starts[k + 1], : width + tail]
        count = len(new_rows)
        system = np.zeros((count + len(remainder), width + tail), order="F")
        system[:count] = new_rows
        # Below them, since LAPACK leaves out the zeros at the end of a column.
        system[count:, _columns_in_next(preceding, width, tail)] = remainder
        if len(system) < KEYFRAME_DIM:
            raise UnsolvableError(_UNDETERMINED)
        triangle = dgeqrf(system, overwrite_a=True)[0]
        conditional, rest = triangle[:KEYFRAME_DIM], triangle[KEYFRAME_DIM:, KEYFRAME_DIM:]
        out.R[k], out.S[k, :, :KEYFRAME_DIM] = conditional[:, :KEYFRAME_DIM], conditional[:, KEYFRAME_DIM:PAIR]
        out.S[k, :, KEYFRAME_DIM:], out.d[k] = conditional[:, width:-1], conditional[:, -1]
        out.beyond[begins[k] : begins[k + 1]] = conditional[:, PAIR:width].T
        rest = rest * _upper(*rest.shape)  # below the diagonal dgeqrf keeps the reflections
        next_height = width - KEYFRAME_DIM if following else 0
        alone.append(rest[next_height:, width - KEYFRAME_DIM :].copy())
        remainder = rest[:next_height]
    out.R[:], sign = _positive(out.R * _upper(KEYFRAME_DIM, KEYFRAME_DIM))
    out.S[:], out.d[:] = out.S * sign[:, :, None], out.d * sign
    out.beyond[:] *= np.repeat(sign, np.diff(begins), axis=0)
    return remainder, np.concatenate(alone)


def _left(remainder: Array, alone: Array, shared_dim: int) -> Array:
    """Return the rows of both over (x, s | b), of the size of (x, s) and one column more."""
    shared, size = _triangle(alone)[:shared_dim], KEYFRAME_DIM + shared_dim
    rest = np.zeros((size, size + 1))
    rest[: len(remainder)] = remainder
    rest[KEYFRAME_DIM : KEYFRAME_DIM + len(shared), KEYFRAME_DIM:] = shared
    return rest


def _positive(R: Array) -> tuple[Array, Array]:
    """Return triangles with a positive diagonal, and the signs that their rows were multiplied by.

    The sign of a row is arbitrary; so R is unique, and so are samples drawn with it. Raises ``UnsolvableError`` where a
    triangle is singular.
    """
    if not _determined(R):
        raise UnsolvableError(_UNDETERMINED)
    sign = np.copysign(1.0, np.diagonal(R, axis1=-2, axis2=-1))
    return R * sign[..., None], sign


def _triangle(rows: Array) -> Array:
    """Return R of the QR of many rows: of some at a time, then of their Rs, and so on."""
    some, columns = 16 * rows.shape[1], rows.shape[1]
    while len(rows) > some:
        padded = np.concatenate([rows, np.zeros((-len(rows) % some, columns))])
        rows = np.asarray(np.linalg.qr(padded.reshape(-1, some, columns), mode="r")).reshape(-1, columns)
    if compiled_kernels():
        from trackfg.numerics import compiled

        out = np.empty((min(len(rows), columns), columns))
        compiled.triangle(kernel_argument(rows), out)
        return out
    triangle = dgeqrf(rows)[0][:columns]
    return np.asarray(triangle * _upper(*triangle.shape))


def _determined(R: Array) -> bool:
    diagonal, squares = np.abs(np.diagonal(R, axis1=-2, axis2=-1)), np.einsum("...ij,...ij->...j", R, R)
    return bool((diagonal > _INDETERMINATE * np.sqrt(squares)).all())


@lru_cache
def _upper(rows: int, columns: int) -> Array:
    return np.triu(np.ones((rows, columns)))


@lru_cache
def _columns_in_next(width: int, next_width: int, tail: int) -> np.ndarray:
    """Return where the columns of y_k are in the window of keyframe k + 1."""
    x = np.arange(KEYFRAME_DIM)
    nav = KEYFRAME_DIM + np.arange(NAV.start, NAV.stop)[: width - PAIR]
    later = np.arange(PAIR, width - NAV_DIM)
    return np.concatenate([x, nav, later, next_width + np.arange(tail)])

"""The compiled kernels refuse what they would read or write beyond, and no value ends the process."""

from __future__ import annotations

import os
from contextlib import suppress
from typing import Any, NamedTuple

import numpy as np
import pytest

from trackfg.numerics.arrays import Array

compiled = pytest.importorskip("trackfg.numerics.compiled")

_REFUSED = (ValueError, TypeError, BufferError)
"""The last is Python's, of memory that may not be written."""
_LARGEST = np.iinfo(np.int64).max


class Call(NamedTuple):
    """A kernel with sound arguments, which of them are counts, and which lengths may be shorter (argument, axis)."""

    kernel: Any
    arguments: tuple[Any, ...]
    free: frozenset[tuple[int, int]] = frozenset()

    @property
    def arrays(self) -> list[int]:
        """Return which arguments are arrays."""
        return [i for i, argument in enumerate(self.arguments) if isinstance(argument, np.ndarray)]

    def copied(self) -> list[Any]:
        """Return the arguments, with arrays of their own."""
        return [argument.copy() if isinstance(argument, np.ndarray) else argument for argument in self.arguments]

    def replaced(self, i: int, argument: object) -> object:
        """Return what the kernel gives with another argument ``i``."""
        arguments = self.copied()
        arguments[i] = argument
        return self.kernel(*arguments)


def _delta() -> Array:
    delta = np.zeros(compiled.DELTA_SIZE)
    compiled.preintegrate(*_INCREMENTS, delta)
    return delta


def _states(count: int) -> tuple[Array, ...]:
    return np.tile(np.eye(3), (count, 1, 1)), np.zeros((count, 3)), np.ones((count, 3)), np.zeros((count, 6))


_INCREMENTS = (
    np.array([9.8, 0.0, 0.0, 1e-4]),
    np.zeros(6),
    np.full(7, 1e-3),
    np.full(3, 0.01),
    np.full((3, 3), 1e-4),
    np.full((3, 3), 0.1),
)
_ELIMINATED = (
    np.random.default_rng(0).normal(size=(5, 5)),  # of one keyframe of two columns and the shared right-hand side
    np.array([0, 5]),
    np.array([4, 4, 0]),
    (0, 1),
    1e-14,
    np.zeros(6),
    0,
    np.zeros((1, 2, 2)),
    np.zeros((1, 2, 2)),
    np.zeros((1, 2)),
    np.zeros((5, 1)),
)
_STARTS, _WIDTHS, _NAV, _LEFT_ROWS, _ALONE = 1, 2, 3, 6, 10
R, p, v, bias = _states(2)
_CALLS = (
    Call(compiled.eliminate, _ELIMINATED, frozenset({(_ALONE, 1)})),  # which says how many variables are shared
    Call(compiled.preintegrate, (*_INCREMENTS, np.zeros(compiled.DELTA_SIZE))),
    Call(compiled.inertial_factors, (_delta()[None], R, p, v, bias, np.zeros((1, 9, 25)))),
    Call(compiled.predict, (_delta(), R[0], p[0], v[0], bias[0], np.zeros(15))),
)
calls = pytest.mark.parametrize("call", _CALLS, ids=[call.kernel.__name__ for call in _CALLS])


def _misaligned(array: np.ndarray) -> memoryview:
    """Return a copy one byte beyond an address that a processor reads at once."""
    room = bytearray(array.nbytes + 16)
    address = np.frombuffer(room, dtype=np.uint8).ctypes.data
    begin = -address % 8 + 1
    view = memoryview(room)[begin : begin + array.nbytes]
    view[:] = array.tobytes()
    return view.cast(array.dtype.char if array.dtype.char in "dlq" else "q", shape=array.shape)


@calls
def test_sound_arguments_are_taken(call: Call) -> None:
    arguments = call.copied()
    call.kernel(*arguments)
    assert all(np.isfinite(arguments[i]).all() for i in call.arrays)


@calls
def test_other_shapes_are_refused(call: Call) -> None:
    for i in call.arrays:
        array = call.arguments[i]
        for other in (array[None], array.ravel()[0], array.astype(np.longdouble), array.astype("S1"), None, 1.0):
            with pytest.raises(_REFUSED):
                call.replaced(i, other)
        for axis in range(array.ndim):
            if (i, axis) not in call.free:
                with pytest.raises(_REFUSED):
                    call.replaced(i, np.ascontiguousarray(np.delete(array, -1, axis)))


@calls
def test_views_that_are_not_contiguous_are_refused(call: Call) -> None:
    for i in call.arrays:
        every_second = np.repeat(call.arguments[i], 2, axis=-1)[..., ::2]
        assert not every_second.flags.c_contiguous
        with pytest.raises(_REFUSED):
            call.replaced(i, every_second)


@calls
def test_arrays_that_are_not_aligned_are_refused(call: Call) -> None:
    for i in call.arrays:
        with pytest.raises(ValueError, match="at an address that is a multiple of"):
            call.replaced(i, _misaligned(call.arguments[i]))
        view = np.frombuffer(_misaligned(call.arguments[i]), dtype=call.arguments[i].dtype)
        with pytest.raises(_REFUSED):
            call.replaced(i, view.reshape(call.arguments[i].shape))


@calls
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1e308, 0.0])
def test_no_value_ends_the_process(call: Call, value: float) -> None:
    for i in call.arrays:
        if call.arguments[i].dtype == np.float64:
            with suppress(ValueError):  # of a covariance that is not positive definite
                call.replaced(i, np.full_like(call.arguments[i], value))


@pytest.mark.parametrize("count", [-1, -_LARGEST, 3, _LARGEST])
def test_rows_left_over_are_none_or_more_and_fit(count: int) -> None:
    with pytest.raises(ValueError, match="do not belong together: rows left over"):
        _CALLS[0].replaced(_LEFT_ROWS, count)


@pytest.mark.parametrize("nav", [(-1, 1), (0, 0), (0, -1), (1, 2), (_LARGEST, 1), (1, _LARGEST)])
def test_columns_of_the_motion_lie_within_a_keyframe(nav: tuple[int, int]) -> None:
    with pytest.raises(ValueError, match="do not belong together: keyframes"):
        _CALLS[0].replaced(_NAV, nav)


@pytest.mark.parametrize("i", [_STARTS, _WIDTHS])
@pytest.mark.parametrize("count", [-1, -_LARGEST, 1000, _LARGEST])
def test_counts_that_no_array_has_are_refused(i: int, count: int) -> None:
    for at in range(len(_ELIMINATED[i])):
        counts = _ELIMINATED[i].copy()
        counts[at] = count
        with pytest.raises(ValueError, match="do not belong together"):
            _CALLS[0].replaced(i, counts)


@pytest.mark.skipif(not hasattr(os, "memfd_create"), reason="arrays lie in a file under Linux alone")
def test_the_file_of_arrays_takes_no_negative_counts_and_nothing_else_than_numpys_table() -> None:
    from numpy._core.multiarray import _ARRAY_API

    for budget, limit in ((-1, 0), (0, -1), (-_LARGEST, -_LARGEST)):
        with pytest.raises(ValueError, match="0 bytes or more"):
            compiled.spill(_ARRAY_API, 0, budget, limit)
    with pytest.raises(OSError, match="Bad file descriptor"):
        compiled.spill(_ARRAY_API, -1, 1, 1)
    for other in (None, 1, b"table", np.zeros(400)):
        with pytest.raises(_REFUSED):
            compiled.spill(other, 0, 1, 1)
        with pytest.raises(_REFUSED):
            compiled.unspill(other, None)
        with pytest.raises(_REFUSED):
            compiled.unspill(_ARRAY_API, other)

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
    """A kernel with sound arguments."""

    kernel: Any
    arguments: tuple[Any, ...]

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
    0,
    np.array([4, 5, 0]),  # of windows: of one keyframe of two columns, the next one's and one beyond
    (0, 1),
    1e-14,
    np.zeros(15),
    0,
    np.zeros((1, 2, 2)),
    np.zeros((1, 2, 3)),
    np.zeros((1, 2)),
    np.zeros((1, 2)),
    np.zeros((2, 2)),  # a shared variable and the right-hand side
    np.random.default_rng(0).normal(size=(7, 1, 7)),
    np.zeros(7, dtype=np.int64),
    np.tile([0, 4, -1], (7, 1)),
    np.array([4, 1, 1]),
)
_FLOOR = (
    np.arange(41) / 100.0,
    *np.random.default_rng(0).normal(size=(2, 40, 3)),
    np.zeros(40, dtype=bool),
    np.array([0, 8]),
    32,
    0.01,
    np.ones(11),
    np.zeros((2, 6)),
    np.zeros(40, dtype=np.int64),
    np.zeros((40, 6)),
    np.zeros(40, dtype=np.int64),
    np.zeros((40, 6)),
)
_BLOCKS, _LENGTH = 4, 5
_SAMPLES = np.arange(6) / 100.0, np.full((5, 3), 0.1), np.ones((5, 3))
_GROUPS, _NO_BIAS = np.array([0, 2, 5]), np.zeros(3)
_COMPRESSED = (*_SAMPLES, _GROUPS, _NO_BIAS, np.zeros(2), np.zeros((2, 3)), np.zeros((2, 3)))
_TURNED = (*_SAMPLES[:2], _GROUPS, _NO_BIAS, np.arange(6.0), 1e-3, *np.zeros((3, 2, 3, 3)))
_AROUND = (np.array([0.02, 0.03]), 0.01, _SAMPLES[0], _SAMPLES[1], np.zeros((2, 3)))
_DIMENSIONS = {"bias": 6, "odo": 4, "mount": 5, "clock": 3, "imu": 29, "wheel": 5}


def _values(keyframes: int) -> tuple[Array, ...]:
    """Return values of all variables, as ``States.arrays`` has them."""
    counts = {name: keyframes if name in ("bias", "odo") else 1 for name in _DIMENSIONS}
    return (*_states(keyframes)[:3], *(np.full((counts[name], dim), 0.1) for name, dim in _DIMENSIONS.items()))


_EARLIER = np.arange(2)
_PATH = (
    "path",
    _values(3),
    (_EARLIER, _EARLIER + 1, *np.zeros((2, 2), dtype=np.int64)),
    (*np.tile(np.eye(3), (3, 2, 1, 1)), *np.ones((2, 2, 3))),
    np.ones((2, 2)),
    1.0,
    np.zeros((2, 2, 53)),
)
_DIM = 9 + sum(_DIMENSIONS.values()) + 2
_PAST = (
    _values(3),
    np.zeros((1, 2)),
    1,
    _values(1),
    np.zeros((1, 2)),
    np.ones((7, _DIM)),
    np.ones(7),
    np.ones(7),
    np.zeros((7, _DIM + 1)),
)
_CHAIN = (np.ones(4), np.full((2, 2), 0.5), 1.0, 30.0, 1.0, np.zeros(4))
_STEP = np.full((3, 19), 0.1), np.full(42, 0.1)
_RETRACTED = (_values(3), *_STEP, True, _values(3))
_STEPPED = (_values(3), _values(3), *_STEP)
_MARGINALISED = (
    np.tile(np.eye(19), (2, 1, 1)),
    np.full((2, 19, 63), 0.1),
    np.full((2, 19), 0.1),
    _values(3),
    _values(1),
    np.zeros(2),
    _values(2),
)
_QUANTITIES = (np.tile(np.eye(3), (3, 1, 1)), np.ones((3, 3)), np.zeros(5), np.ones(3), np.zeros((3, 8, 61)))
_NOISE = (
    np.arange(4.0),
    np.arange(3.0),
    np.ones((2, 6)),
    np.ones(6),
    1.2,
    *(np.ones(2), np.ones((2, 6))) * 2,
    np.zeros((3, 6)),
)
_VALUES, _INDICES, _DATA, _KEYFRAME, _ORIGINS = 1, 2, 3, 2, 3
_BEGIN, _WIDTHS, _NAV, _LEFT_ROWS, _FIRST, _PLACES, _DIMS = 0, 1, 2, 5, 12, 13, 14
_CONDITIONALS = (  # two keyframes of two columns with two shared variables, and one column beyond the first one's next
    np.tile([[1.0, 0.5], [0.0, 1.0]], (2, 1, 1)),
    np.ones((2, 2, 4)),
    np.ones((1, 2)),
    np.array([1, 0]),
    (0, 1),
)
R, p, v, bias = _states(2)
_CALLS = (
    Call(compiled.eliminate, _ELIMINATED),
    Call(compiled.back_substitute, (*_CONDITIONALS, 0, np.ones((5, 3)), np.ones((2, 2, 3)))),
    Call(compiled.forward_substitute, (*_CONDITIONALS, 0, np.ones((5, 3)), np.ones((2, 2, 3)))),
    Call(
        compiled.covariances,
        (
            *_CONDITIONALS,
            np.ones((4, 4)),
            np.zeros((2, 2, 4)),
            np.zeros((2, 2, 2)),
            np.array([0, 1]),
            np.zeros(5**2 + 4**2),
        ),
    ),
    Call(
        compiled.resample,
        (
            np.arange(5),
            np.arange(4.0),
            np.arange(4.0),
            np.ones((2, 4)),
            4,
            0.125,
            8,
            np.full(9, 1.0 / 9.0),
            np.zeros((2, 1)),
        ),
    ),
    Call(compiled.preintegrate, (*_INCREMENTS, np.zeros(compiled.DELTA_SIZE))),
    Call(compiled.inertial_factors, (_delta()[None], R, p, v, bias, np.zeros((1, 9, 25)))),
    Call(compiled.predict, (_delta(), R[0], p[0], v[0], bias[0], np.zeros(15))),
    Call(compiled.compress, _COMPRESSED),
    Call(compiled.turning, _TURNED),
    Call(compiled.means_around, _AROUND),
    Call(compiled.linear_rows, _PATH),
    Call(compiled.marginal_prior, _PAST),
    Call(compiled.switch_chain, _CHAIN),
    Call(compiled.cauchy_fit, (np.eye(4, 2), np.arange(4.0), np.ones(2), 0.1, 1.0, np.ones(4), np.zeros((2, 2)))),
    Call(compiled.triangle, (np.ones((3, 5)), np.zeros((3, 5)))),
    Call(compiled.retract, _RETRACTED),
    Call(compiled.step_from, _STEPPED),
    Call(compiled.marginalised_states, _MARGINALISED),
    Call(compiled.quantities, _QUANTITIES),
    Call(compiled.white_noise, _NOISE),
    Call(compiled.ahead_of_a_steady_turn, (*np.tile(np.eye(3), (3, 2, 1, 1)), 1e-6, np.zeros((2, 3)))),
    Call(compiled.interpolate_columns, (np.ones(2), np.arange(3.0), np.ones((3, 4)), np.zeros((2, 4)))),
    Call(compiled.add_weighted_rows, (np.ones((3, 4)), np.array([[0, 2], [1, 1]]), np.ones((2, 2)), np.zeros((2, 4)))),
    Call(compiled.noise_floor, _FLOOR),
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
        if call.arguments[i].itemsize == 1:  # truth values may lie at any address
            continue
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


@pytest.mark.parametrize("count", [-1, -_LARGEST, 4, _LARGEST])
def test_rows_left_over_are_none_or_more_and_fit(count: int) -> None:
    with pytest.raises(ValueError, match="do not belong together: rows left over"):
        _CALLS[0].replaced(_LEFT_ROWS, count)


@pytest.mark.parametrize("nav", [(-1, 1), (0, 0), (0, -1), (1, 2), (_LARGEST, 1), (1, _LARGEST)])
def test_columns_of_the_motion_lie_within_a_keyframe(nav: tuple[int, int]) -> None:
    with pytest.raises(ValueError, match="do not belong together: keyframes"):
        _CALLS[0].replaced(_NAV, nav)


@pytest.mark.parametrize("i", [_WIDTHS, _DIMS])
@pytest.mark.parametrize("count", [-1, -_LARGEST, 1000, _LARGEST])
def test_counts_that_no_array_has_are_refused(i: int, count: int) -> None:
    for at in range(len(_ELIMINATED[i])):
        counts = _ELIMINATED[i].copy()
        counts[at] = count
        with pytest.raises(ValueError, match="do not belong together"):
            _CALLS[0].replaced(i, counts)


@pytest.mark.parametrize("first", [[-1, 0, 0], [0, 0, -1], [0, 1, 0], [_LARGEST, 0, 0]])
def test_factors_are_of_keyframes_in_order(first: list[int]) -> None:
    keyframes = np.concatenate([first, np.full(4, max(first[-1], 0))])
    with pytest.raises(ValueError, match="do not belong together: factors of a family"):
        _CALLS[0].replaced(_FIRST, keyframes)


def test_factors_of_other_keyframes_are_left_out() -> None:
    """The same keyframe as the second of a longer chain, with factors of those before and after it."""
    alone, within = _CALLS[0].copied(), list(_CALLS[0].copied())
    for i in range(_FIRST - 1, _DIMS):
        others = 9.0 * np.ones_like(within[i][:1]) if i == _FIRST - 1 else within[i][:1]
        within[i] = np.concatenate([others, within[i], others])
    within[_FIRST] = np.array([0, *np.ones(7, dtype=np.int64), 2])
    within[_BEGIN] = 1
    assert compiled.eliminate(*alone) == compiled.eliminate(*within)
    for ours, theirs in zip(alone[4 : _FIRST - 1], within[4 : _FIRST - 1], strict=True):
        np.testing.assert_array_equal(ours, theirs)


@pytest.mark.parametrize("begin", [-1, -_LARGEST, _LARGEST])
def test_the_first_keyframe_is_one(begin: int) -> None:
    with pytest.raises(ValueError, match="do not belong together: the first keyframe"):
        _CALLS[0].replaced(_BEGIN, begin)


@pytest.mark.parametrize("length", [-32, 0, 8, 31, 64, _LARGEST])
def test_blocks_are_as_long_as_the_spectrum_takes_and_the_record_is(length: int) -> None:
    with pytest.raises(ValueError, match="do not belong together: blocks"):
        _CALLS[-1].replaced(_LENGTH, length)


@pytest.mark.parametrize("starts", [[-1, 8], [0, 9], [0, _LARGEST]])
def test_blocks_lie_within_the_record(starts: list[int]) -> None:
    with pytest.raises(ValueError, match="do not belong together: blocks"):
        _CALLS[-1].replaced(_BLOCKS, np.array(starts))


@pytest.mark.parametrize("place", [-1, -_LARGEST, 2, _LARGEST])
def test_places_beyond_the_window_are_refused(place: int) -> None:
    places = _ELIMINATED[_PLACES].copy()
    places[-1, 0] = place  # of four columns
    with pytest.raises(ValueError, match="do not belong together: factors of a family"):
        _CALLS[0].replaced(_PLACES, places)


@pytest.mark.parametrize(
    ("arguments", "kernel", "i"),
    [
        (_PATH, compiled.linear_rows, _VALUES),
        (_PATH, compiled.linear_rows, _INDICES),
        (_PATH, compiled.linear_rows, _DATA),
        (_PAST, compiled.marginal_prior, 0),
        (_PAST, compiled.marginal_prior, _ORIGINS),
        (_RETRACTED, compiled.retract, 0),
        (_RETRACTED, compiled.retract, 4),
        (_STEPPED, compiled.step_from, 0),
        (_STEPPED, compiled.step_from, 1),
    ],
)
def test_arrays_in_tuples_are_refused_likewise(arguments: tuple[Any, ...], kernel: Any, i: int) -> None:
    call, arrays = Call(kernel, arguments), arguments[i]
    for other in (arrays[:-1], (*arrays, arrays[-1]), list(arrays), (), None, (None,) * len(arrays), arrays * 20):
        with pytest.raises(_REFUSED):
            call.replaced(i, other)
    for j, array in enumerate(arrays):
        others = [
            array.astype("S1"),
            np.repeat(array, 2, axis=-1)[..., ::2],
            array[()] if array.ndim == 0 else array[..., :0],
        ]
        others += [_misaligned(array)] if array.itemsize > 1 else []
        for other in others:
            with pytest.raises(_REFUSED):
                call.replaced(i, (*arrays[:j], other, *arrays[j + 1 :]))


@pytest.mark.parametrize("index", [-1, 3, _LARGEST, -_LARGEST])
def test_factors_touch_variables_that_there_are(index: int) -> None:
    for slot in range(3):
        indices = [own.copy() for own in _PATH[_INDICES]]
        indices[slot][1] = index
        with pytest.raises(ValueError, match="do not belong together: slots"):
            Call(compiled.linear_rows, _PATH).replaced(_INDICES, tuple(indices))
    with pytest.raises(ValueError, match="do not belong together: values"):
        Call(compiled.marginal_prior, _PAST).replaced(_KEYFRAME, index)


def test_a_type_of_factors_without_a_kernel_is_refused() -> None:
    with pytest.raises(ValueError, match="no kernel"):
        Call(compiled.linear_rows, _PATH).replaced(0, "other")


@pytest.mark.parametrize("starts", [[-1, 2, 5], [0, 2, 6], [0, 3, 2], [0, -_LARGEST, 5], [0, 2, _LARGEST]])
@pytest.mark.parametrize("call", [Call(compiled.compress, _COMPRESSED), Call(compiled.turning, _TURNED)])
def test_groups_follow_each_other_within_the_record(call: Call, starts: list[int]) -> None:
    i = next(i for i, argument in enumerate(call.arguments) if argument is _GROUPS)
    with pytest.raises(ValueError, match="do not belong together"):
        call.replaced(i, np.array(starts))


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


@pytest.mark.parametrize("row", [-1, 3, _LARGEST])
def test_rows_that_are_not_there_are_not_summed(row: int) -> None:
    with pytest.raises(_REFUSED):
        compiled.add_weighted_rows(np.ones((3, 4)), np.array([[row]]), np.ones((1, 1)), np.zeros((1, 4)))

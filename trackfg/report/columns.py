"""Long columns of numbers inside a page: every row, in about a byte each.

Values are whole multiples of a decimal step. Their first or second differences (whichever are smaller) are small where
a curve is smooth; written with the sign in the lowest bit and as planes of bytes, lowest first, most planes are all
zeros, which deflate packs into nothing. The text of a column is the base64 of the zlib stream of

    plane 0, ..., plane ``planes`` - 1, and where ``gaps`` is set one byte per row that is 1 where there is no value

and ``columns.js`` undoes it. A gap repeats the value before it.
"""

from __future__ import annotations

import base64
import zlib
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from trackfg.numerics.arrays import Array

_OF_SIGMA, _OF_RANGE, _OF_SIZE = 20.0, 1e5, 200.0
"""Values are rounded to these parts of their median sigma or of their range, sigmas to the last, of their quartile."""
_DRAWN = 1e3
"""Values are rounded at most to this part of their range: about a pixel of a tall panel. A sigma may be much wider than
the range, where a quantity is not to be trusted or has a large constant error, and its curve is drawn all the same.
"""
_LARGEST = 2**28
"""Whole numbers up to this have second differences of 32 bits."""
_FINEST = -300.0
"""Power of ten: below are numbers without all their digits."""

_SQUEEZE = 6
"""Level of the compression: zlib's default."""


@dataclass(frozen=True, eq=False)
class Column:
    """``numbers`` rounded to multiples of ``step``; ``order`` of the differences. No column equals another."""

    numbers: Array
    step: float
    order: int
    planes: int
    gaps: bool
    text: str


@dataclass(frozen=True, eq=False)
class ColumnDifference:
    """``first - second``, row by row, taken when it is drawn."""

    first: Column
    second: Column

    @property
    def numbers(self) -> Array:
        """Return the numbers as drawn, but for the rounding."""
        return self.first.numbers - self.second.numbers

    @property
    def step(self) -> float:
        """Return the step of the coarser one."""
        return max(self.first.step, self.second.step)


def packed_value(values: Array, sigmas: Array | None = None) -> Column:
    """Return values (n,) to a twentieth of their median sigma, at most to 1e-3 of their range, or where there is no
    sigma to 1e-5 of their range.
    """
    finite = values[np.isfinite(values)]
    span = float(np.ptp(finite)) if finite.size else 0.0
    positive = np.empty(0) if sigmas is None else sigmas[np.isfinite(sigmas) & (sigmas > 0.0)]
    if positive.size:
        accuracy = float(np.median(positive)) / _OF_SIGMA
        return packed(values, min(accuracy, span / _DRAWN) if span > 0.0 else accuracy)
    return packed(values, span / _OF_RANGE if finite.size else 1.0)


def packed_sigma(sigmas: Array) -> Column:
    """Return sigmas (n,) to half a percent of their lower quartile."""
    finite = sigmas[np.isfinite(sigmas) & (sigmas > 0.0)]
    return packed(sigmas, float(np.quantile(finite, 0.25)) / _OF_SIZE if finite.size else 1.0)


def packed(values: Array, accuracy: float) -> Column:
    """Return values (n,), not finite where there is none, to the largest power of ten that is not above ``accuracy``.

    To a coarser one where the numbers would not fit.
    """
    gap = ~np.isfinite(values)
    filled = _filled(values, gap)
    largest = float(np.abs(filled).max(initial=0.0))
    exponent = np.floor(np.log10(accuracy)) if accuracy > 0.0 else -np.inf
    if largest > 0.0:
        exponent = max(exponent, np.ceil(np.log10(largest) - np.log10(_LARGEST)))
    step = 10.0 ** max(float(exponent), _FINEST) if np.isfinite(exponent) else 1.0
    whole = np.rint(filled / step).astype(np.int64)
    once = np.diff(whole, prepend=0)
    twice = np.diff(once, prepend=0)
    order, differences = (1, once) if np.abs(once).sum() <= np.abs(twice).sum() else (2, twice)
    folded = ((differences << 1) ^ (differences >> 63)).astype("<u4")
    planes = int(np.ceil(max(int(folded.max(initial=0)).bit_length(), 1) / 8))
    content = folded.view(np.uint8).reshape(-1, 4)[:, :planes].T.tobytes()
    if gap.any():
        content += gap.astype(np.uint8).tobytes()
    text = base64.b64encode(zlib.compress(content, _SQUEEZE)).decode("ascii")
    return Column(values, step, order, planes, bool(gap.any()), text)


def _filled(values: Array, gap: NDArray[np.bool_]) -> Array:
    """Fill the gaps: each repeats the value before it, one at the start the first there is."""
    finite_rows = np.flatnonzero(~gap)
    if finite_rows.size == 0:
        return np.zeros(len(values))
    lower = np.searchsorted(finite_rows, np.arange(len(values)), side="right") - 1
    filled: Array = values[finite_rows[np.clip(lower, 0, None)]]
    return filled

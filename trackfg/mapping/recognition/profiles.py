"""What is compared of two measured profiles: features on whole rows, their short waves and their curves.

A feature is kept on every row of 0.25 m between the first and the last, NaN where nothing was measured. For the search
both profiles are condensed to cells of 1 m, the mean of four rows:

* **short waves**, of every feature: ``(1 - A)^2 x``, ``A`` the mean over 25 m. A constant and a slope (the roll offset
  of the sensor, the bias of a gyro, a cant ramp) are gone, waves below 25 m stay. They are clipped at four robust
  sigmas, so that neither the corner of a ramp nor one defect outweighs all the rest.
* **curves**: curvature's mean over 20 m. What irregularities leave in it is told by its second differences over 20 m
  (``sigma = 1.4826 median |d| / sqrt(6)``), which circles, straights and clothoids do not have but at their ends.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from trackfg.errors import BadInputError
from trackfg.geometry.grid import window_sums
from trackfg.numerics.arrays import Array

STEP_M = 0.25
ROWS_PER_CELL = 4
"""A cell is 1 m."""
CURVATURE, CROSS_LEVEL = "curvature_1pm", "cross_level_mm"
FEATURES = (CURVATURE, CROSS_LEVEL, "versine_level_mm")
"""Independent of each other. The versine of alignment would say at short waves what curvature says."""
LONG_M = 20
"""Base of the mean of curvature."""

_DETREND_M = 25
_FILL_M = 2
"""Longest hole that is bridged by a straight line before the short waves are taken."""
_CLIP = 4.0
_MAD = 1.4826
"""Sigma of a normal variable over its median absolute deviation."""


@dataclass(frozen=True)
class Profile:
    """A table on whole rows: row ``i`` is at ``(first + i) * 0.25`` m, ``first`` a multiple of 4.

    ``features`` and their ``sigmas`` by name, each (n,), n a multiple of 4; NaN where not known.
    """

    first: int
    features: dict[str, Array]
    sigmas: dict[str, Array]

    @property
    def rows(self) -> int:
        return len(next(iter(self.features.values())))

    @property
    def first_cell(self) -> int:
        """Chainage of the first cell's first row, m."""
        return self.first // ROWS_PER_CELL

    def claimed_variance(self, name: str) -> float:
        """By the median sigma of a feature; 0 where the table has none."""
        known = self.sigmas[name][np.isfinite(self.sigmas[name])]
        return float(np.median(known)) ** 2 if known.size else 0.0


def common_features(run: pd.DataFrame, reference: pd.DataFrame) -> tuple[str, ...]:
    """Those of :data:`FEATURES` that both tables know anywhere. Raises ``BadInputError`` if there are none."""
    names = tuple(
        name for name in FEATURES if all(name in table and table[name].notna().any() for table in (run, reference))
    )
    if not names:
        raise BadInputError(f"run and reference have no feature in common; expected one of {', '.join(FEATURES)}")
    return names


def profile_of(table: pd.DataFrame, features: Sequence[str], what: str) -> Profile:
    """Raises ``BadInputError``, naming ``what``, where chainage is not ascending on whole multiples of 0.25 m."""
    if "chainage_m" not in table:
        raise BadInputError(f"{what}: no column chainage_m")
    chainage = table["chainage_m"].to_numpy(dtype=np.float64)
    row = np.rint(chainage / STEP_M)
    if not (np.isfinite(chainage).all() and np.all(np.abs(chainage / STEP_M - row) < 1e-6)):
        raise BadInputError(f"{what}: chainage_m: expected whole multiples of {STEP_M} m")
    if np.any(np.diff(row) < 1.0):
        raise BadInputError(f"{what}: chainage_m: expected ascending places, each once")
    first = int(row[0]) // ROWS_PER_CELL * ROWS_PER_CELL
    count = -(-(int(row[-1]) + 1 - first) // ROWS_PER_CELL) * ROWS_PER_CELL
    index = row.astype(np.int64) - first

    def spread(name: str) -> Array:
        out = np.full(count, np.nan)
        if name in table:
            out[index] = table[name].to_numpy(dtype=np.float64)
        return np.where(np.isfinite(out), out, np.nan)

    return Profile(first, {name: spread(name) for name in features}, {name: spread(f"{name}_sd") for name in features})


def cells(values: Array) -> Array:
    """Means of four rows, NaN where one of them is. Shape (4 n,) to (n,)."""
    return np.asarray(values.reshape(-1, ROWS_PER_CELL).mean(axis=1))


def short_waves(values: Array) -> Array:
    """``(1 - A)^2 x`` of cells, not yet clipped; NaN within 25 m of an end or of a hole. Shape (n,) to (n,)."""
    x = _bridged(values)
    for _ in range(2):
        x = x - centred_mean(x, _DETREND_M)
    return x


def clipped(run: Array, reference: Array) -> tuple[Array, Array]:
    """Both clipped at four of their common robust sigmas."""
    known = np.abs(np.concatenate([run[np.isfinite(run)], reference[np.isfinite(reference)]]))
    limit = _CLIP * _MAD * float(np.median(known)) if known.size else np.inf
    return np.clip(run, -limit, limit), np.clip(reference, -limit, limit)


def centred_mean(x: Array, count: int) -> Array:
    """Mean over ``count`` (odd) neighbours, NaN where one is missing. Shape (n,) to (n,)."""
    out = np.full(len(x), np.nan)
    half = count // 2
    if len(x) >= count:
        out[half : len(x) - half] = window_sums(x, count) / count
    return out


def forward_mean(x: Array, count: int) -> Array:
    """Mean of cell ``i`` and the ``count - 1`` after it, NaN where one is missing. Shape (n,) to (n,)."""
    out = np.full(len(x), np.nan)
    if len(x) >= count:
        out[: len(x) - count + 1] = window_sums(x, count) / count
    return out


def irregularity(mean_curvature: Array) -> float:
    """Sigma of what is not curves in means of curvature over 20 m, (n,) at every cell; 0 where nothing can be told."""
    lag = LONG_M
    bend = mean_curvature[: -2 * lag] - 2.0 * mean_curvature[lag:-lag] + mean_curvature[2 * lag :]
    bend = bend[np.isfinite(bend)]
    return _MAD * float(np.median(np.abs(bend))) / np.sqrt(6.0) if bend.size else 0.0


def _bridged(x: Array) -> Array:
    """Holes of up to 2 m filled by straight lines."""
    known = np.flatnonzero(np.isfinite(x))
    out = x.copy()
    for hole in np.flatnonzero((np.diff(known) > 1) & (np.diff(known) <= _FILL_M + 1)):
        begin, end = known[hole], known[hole + 1]
        out[begin : end + 1] = np.linspace(x[begin], x[end], end - begin + 1)
    return out


def sections_of(x: Array, first: NDArray[np.int64], length: int) -> Array:
    """Pieces of ``x`` from each ``first`` on, NaN beyond the ends. Shape (k, length)."""
    index = first[:, None] + np.arange(length)
    return np.where((index >= 0) & (index < len(x)), x[np.clip(index, 0, len(x) - 1)], np.nan)


def piece(x: NDArray[np.floating], begin: int, stop: int) -> NDArray[np.floating]:
    """``x[begin:stop]``, NaN beyond the ends."""
    out = np.full(stop - begin, np.nan, dtype=x.dtype)
    low, high = max(begin, 0), min(stop, len(x))
    if low < high:
        out[low - begin : high - begin] = x[low:high]
    return out

"""Two measured profiles on one grid, and the signals that are compared of them: short waves and curves.

A feature is kept on every row of the grid between the first and the last, NaN where nothing was measured. For the
search both profiles are condensed to cells of 1 m, the mean of the rows in it:

* **Short waves**, of every feature x: ``(1 - A)^2 x`` with ``A`` the mean over 25 m. This removes a constant and a
  slope (the sensor's roll offset, the bias of a gyro, a cant ramp) and keeps waves below 25 m. They are clipped at four
  robust sigmas, so that neither the corner of a ramp nor one defect outweighs all the rest.
* **Curves**: the mean of curvature over 20 m. The second difference d over 20 m of such means is zero on circles,
  straights and clothoids but at their ends, so the track's irregularities in them have the sigma
  ``robust_sd(d) / sqrt(6)`` (the weights 1, -2, 1 have the sum of squares 6).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from trackfg.errors import BadInputError
from trackfg.geometry.grid import window_sums
from trackfg.numerics.arrays import Array
from trackfg.numerics.robust import robust_sd

CELL_M = 1
"""Length of a cell of the search, m. The accuracy is that of the fine match, which works on the rows."""
CURVATURE, CROSS_LEVEL = "curvature_1pm", "cross_level_mm"
FEATURES = (CURVATURE, CROSS_LEVEL, "versine_level_mm")
"""Columns that are compared with a map. They are independent of each other; at short waves the versine of alignment has
the same information as curvature."""
KINDS = (
    (CURVATURE, "versine_alignment_mm", "alignment_mm"),
    (CROSS_LEVEL, "twist_mm", "level_difference_mm"),
    ("versine_level_mm", "level_mm"),
    ("gauge_mm", "alignment_difference_mm"),
)
"""Columns that are compared of any two tables: of each kind the first that both have. The kinds, the rails' middle and
their difference, sideways and upwards, are independent of each other; columns of one kind have the same information."""
SECTION_M = 100
"""Usual length of a section, m: its short waves differ from those of other places, and its scale hardly
changes within it."""
LONG_M = 20
"""Base of the mean of curvature, m: twice the usual base of curvature itself."""

COHERENT_M = 4.0
"""Wavelength, m, from which on two runs of recording cars are coherent: two public runs over one line, 34 days apart,
have a magnitude-squared coherence of 0.5 there, 0.9 at 8 m and 0.2 at 3 m (docs/overlay.md)."""
_KERNEL_REACH = 3.0
"""Reach of the low-pass in its own sigmas: 0.3 % of a Gaussian is beyond."""
_DETREND_M = 25
"""Base of the mean that short waves are free of, m: the longest wavelength of the band D1 of EN 13848-1."""
_FILL_M = 2
"""Longest hole that a straight line bridges before the short waves are taken, m."""
_CLIP = 4.0
"""Short waves are clipped at so many robust sigmas: one normal value in 16,000 is beyond."""
_ON_GRID = 1e-6
"""A chainage is on the grid within this share of a step: rounding of float64 at 1000 km is 1e-9."""


@dataclass(frozen=True)
class FeatureProfile:
    """The features of a table on every row of its grid: row ``i`` is at ``(first + i) * step_m``.

    ``features`` and their ``sigmas`` by name, each (n,), NaN where not known. The first row begins a cell, and n rows
    are whole cells.
    """

    step_m: float
    first: int
    features: dict[str, Array]
    sigmas: dict[str, Array]

    @property
    def rows(self) -> int:
        """The number n of rows."""
        return len(next(iter(self.features.values())))

    @property
    def rows_per_cell(self) -> int:
        """The number of rows in a cell of 1 m."""
        return round(CELL_M / self.step_m)

    @property
    def first_cell(self) -> int:
        """The chainage of the first row, m."""
        return self.first // self.rows_per_cell

    def cells(self, name: str) -> Array:
        """Return the means of a feature over the cells, NaN where a row is missing. Shape (n / rows per cell,)."""
        return cell_means(self.features[name], self.rows_per_cell)

    def low_passed(self) -> FeatureProfile:
        """Return the profile without what is shorter than :data:`COHERENT_M`, where its gain is a half.

        The low-pass is a Gaussian, ``exp(-(W s)^2 / 2)``, NaN where it reaches into a hole or over an end.
        """
        s = np.sqrt(2.0 * np.log(2.0)) * COHERENT_M / (2.0 * np.pi) / self.step_m
        reach = int(np.ceil(_KERNEL_REACH * s))
        kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) / s) ** 2)
        kernel /= kernel.sum()
        padded = {name: np.pad(values, reach, constant_values=np.nan) for name, values in self.features.items()}
        return replace(self, features={name: np.convolve(x, kernel, mode="valid") for name, x in padded.items()})

    def between(self, begin_m: float, end_m: float) -> FeatureProfile:
        """Return the rows from the cell of ``begin_m`` to that of ``end_m``, as far as there are any."""
        first = int(np.clip(np.floor(begin_m) - self.first_cell, 0, self.rows // self.rows_per_cell - 1))
        stop = int(np.clip(np.ceil(end_m) - self.first_cell, first + 1, self.rows // self.rows_per_cell))
        rows = slice(first * self.rows_per_cell, stop * self.rows_per_cell)
        features, sigmas = ({name: x[rows] for name, x in of.items()} for of in (self.features, self.sigmas))
        return FeatureProfile(self.step_m, self.first + rows.start, features, sigmas)

    def claimed_variance(self, name: str) -> float:
        """Return the square of the median sigma that the table gives for a feature; 0 where it gives none."""
        finite = self.sigmas[name][np.isfinite(self.sigmas[name])]
        return float(np.median(finite)) ** 2 if finite.size else 0.0


def common_step(run: pd.DataFrame, reference: pd.DataFrame) -> float:
    """Return the step of the grid that both tables are on: the least distance between neighbouring rows, m.

    Raises ``BadInputError`` where there is no column of the chainage, or where a cell of 1 m is no whole number of
    steps.
    """
    for what, table in (("run", run), ("reference", reference)):
        if "chainage_m" not in table:
            raise BadInputError(f"{what}: no column chainage_m")
    tables = (table["chainage_m"].to_numpy(dtype=np.float64) for table in (run, reference))
    apart = np.abs(np.concatenate([np.diff(chainage) for chainage in tables]))
    apart = apart[apart > 0.0]
    if not apart.size:
        return float(CELL_M)
    rows = round(CELL_M / float(apart.min()))
    if rows == 0 or abs(rows * float(apart.min()) - CELL_M) > _ON_GRID * rows:
        raise BadInputError(f"chainage_m: rows are {apart.min():g} m apart; expected a whole part of {CELL_M} m")
    return CELL_M / rows


def common_features(run: pd.DataFrame, reference: pd.DataFrame) -> tuple[str, ...]:
    """Return of each of :data:`KINDS` the first column that both tables know anywhere.

    Raises ``BadInputError`` if there are none.
    """
    common = [
        [name for name in kind if all(name in table and table[name].notna().any() for table in (run, reference))]
        for kind in KINDS
    ]
    names = tuple(kind[0] for kind in common if kind)
    if not names:
        expected = ", ".join(name for kind in KINDS for name in kind)
        raise BadInputError(f"run and reference have no feature in common; expected one of {expected}")
    return names


def profile_of(table: pd.DataFrame, features: Sequence[str], step_m: float, what: str) -> FeatureProfile:
    """Return a table's features on every row of the grid with this step.

    Raises ``BadInputError``, naming ``what``, where there are no rows, where chainage is not ascending on whole
    multiples of the step, or where no two rows are one step apart: on a coarser grid no cell would be known.
    """
    if "chainage_m" not in table or table.empty:
        raise BadInputError(f"{what}: no column chainage_m, or no rows")
    chainage = table["chainage_m"].to_numpy(dtype=np.float64)
    row = np.rint(chainage / step_m)
    if not (np.isfinite(chainage).all() and np.all(np.abs(chainage / step_m - row) < _ON_GRID)):
        raise BadInputError(f"{what}: chainage_m: expected whole multiples of {step_m:g} m")
    if np.any(np.diff(row) < 1.0):
        raise BadInputError(f"{what}: chainage_m: expected ascending places, each once")
    if len(row) > 1 and np.diff(row).min() > 1.0:
        apart_m = step_m * np.diff(row).min()
        raise BadInputError(f"{what}: chainage_m: rows are {apart_m:g} m apart; expected {step_m:g} m as in the other")
    per_cell = round(CELL_M / step_m)
    first = int(row[0]) // per_cell * per_cell
    count = -(-(int(row[-1]) + 1 - first) // per_cell) * per_cell
    index = row.astype(np.int64) - first

    def on_grid(name: str) -> Array:
        values = np.full(count, np.nan)
        if name in table:
            values[index] = table[name].to_numpy(dtype=np.float64)
        return np.where(np.isfinite(values), values, np.nan)

    columns, sigmas = ({name: on_grid(f"{name}{suffix}") for name in features} for suffix in ("", "_sd"))
    return FeatureProfile(step_m, first, columns, sigmas)


def cell_means(values: Array, rows_per_cell: int) -> Array:
    """Return the means of the rows of each cell, NaN where one of them is. Shape (m n,) to (n,)."""
    return np.asarray(values.reshape(-1, rows_per_cell).mean(axis=1))


def short_waves(values: Array) -> Array:
    """Return ``(1 - A)^2 x`` of cells, not yet clipped, NaN within 25 m of an end or of a hole. Shape (n,) to (n,)."""
    x = _bridged(values)
    for _ in range(2):
        x = x - centred_mean(x, _DETREND_M)
    return x


def clipped(run: Array, reference: Array) -> tuple[Array, Array]:
    """Return both signals, clipped at four of their common robust sigmas."""
    values = np.concatenate([run[np.isfinite(run)], reference[np.isfinite(reference)]])
    limit = _CLIP * robust_sd(values) if values.size else np.inf
    return np.clip(run, -limit, limit), np.clip(reference, -limit, limit)


def centred_mean(x: Array, count: int) -> Array:
    """Return means over ``count`` (odd) neighbours, NaN where one is missing. Shape (n,) to (n,)."""
    out = np.full(len(x), np.nan)
    half = count // 2
    if len(x) >= count:
        out[half : len(x) - half] = window_sums(x, count) / count
    return out


def forward_mean(x: Array, count: int) -> Array:
    """Return means of value ``i`` and the ``count - 1`` after it, NaN where one is missing. Shape (n,) to (n,)."""
    out = np.full(len(x), np.nan)
    if len(x) >= count:
        out[: len(x) - count + 1] = window_sums(x, count) / count
    return out


def irregularity(mean_curvature: Array) -> float:
    """Return the sigma of what is not curves in means of curvature over 20 m, (n,) one for each cell; 0 if unknown."""
    lag = LONG_M
    bend = mean_curvature[: -2 * lag] - 2.0 * mean_curvature[lag:-lag] + mean_curvature[2 * lag :]
    bend = bend[np.isfinite(bend)]
    return robust_sd(bend) / np.sqrt(6.0) if bend.size else 0.0


def _bridged(x: Array) -> Array:
    """Return the values with holes of up to 2 m filled by straight lines."""
    finite_rows = np.flatnonzero(np.isfinite(x))
    out = x.copy()
    for hole in np.flatnonzero((np.diff(finite_rows) > 1) & (np.diff(finite_rows) <= _FILL_M + 1)):
        begin, end = finite_rows[hole], finite_rows[hole + 1]
        out[begin : end + 1] = np.linspace(x[begin], x[end], end - begin + 1)
    return out


def sections_of(x: Array, first: NDArray[np.int64], length: int) -> Array:
    """Return pieces of ``x`` from each ``first`` on, NaN beyond the ends. Shape (k, length)."""
    index = first[:, None] + np.arange(length)
    return np.where((index >= 0) & (index < len(x)), x[np.clip(index, 0, len(x) - 1)], np.nan)


def piece(x: NDArray[np.floating], begin: int, stop: int) -> NDArray[np.floating]:
    """Return ``x[begin:stop]``, NaN beyond the ends."""
    out = np.full(stop - begin, np.nan, dtype=x.dtype)
    low, high = max(begin, 0), min(stop, len(x))
    if low < high:
        out[low - begin : high - begin] = x[low:high]
    return out

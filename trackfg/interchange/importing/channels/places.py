"""The places of a channel table's rows: chainages that rise or fall, brought to whole multiples of one step."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from trackfg.errors import BadInputError
from trackfg.geometry.resampling import resample
from trackfg.interchange.importing.geometry_reading import GeometryReading
from trackfg.interchange.importing.source_table import SourceTable
from trackfg.interchange.importing.stations import quoted, read_stations
from trackfg.numerics.arrays import Array
from trackfg.numerics.splines import spline_at

_ON_GRID = 0.02
"""Share of a step within which a row counts as lying on the grid: rounding of places to 5 mm at 0.25 m."""
_USUAL_STEP_M = 0.25
"""Step that rows without a usable one of their own are brought to, m (EN 13848-1: 0.25 m or less)."""


_LEAST_STEP_M = 0.01
"""Rows of track geometry are no closer, m: recording cars have 0.05 to 1 m."""
_HOLE_M = 1.0
"""Rows further apart than this, m, and than two usual steps, have nothing between them: level bends within 3 m."""


@dataclass(frozen=True)
class Places:
    """Chainages (n,), m, in the order of the rows, and the direction in which they go: 1 rising, -1 falling.

    ``rows`` (n,) are those of the table; rows that are written twice are left out.
    """

    chainage_m: Array
    direction: Literal[1, -1]
    rows: np.ndarray

    def on_grid(self, values: Array, step_m: float | None) -> tuple[Array, Array, float]:
        """Return channels (c, n) at whole multiples of a step: chainage (m,), values (c, m) and the step.

        Rows that lie there stay what they are. Others are brought there by a spline, where they are evenly spaced,
        or by averaging and a low-pass. Where rows are missing values are NaN. ``step_m`` is that of the rows unless
        given; it is a whole part of 1 m.
        """
        x, values = self.chainage_m[:: self.direction], values[:, :: self.direction]
        apart = float(np.median(np.diff(x)))
        step = step_m or _whole_part(apart)
        row = np.rint(x / step)
        if np.all(np.abs(x / step - row) < _ON_GRID) and np.all(np.diff(row) >= 1.0):
            grid = np.arange(row[0], row[-1] + 1.0)
            out = np.full((len(values), len(grid)), np.nan)
            out[:, (row - row[0]).astype(np.int64)] = values
            return grid * step, out, step
        hole_m = max(_HOLE_M, 2.0 * apart)
        even = np.diff(x) / apart
        if abs(apart - step) < _ON_GRID * step and np.all(np.abs(even - np.rint(even)) < _ON_GRID):
            grid = np.arange(np.ceil(x[0] / step), np.floor(x[-1] / step) + 1.0) * step
            upper = np.clip(np.searchsorted(x, grid), 1, len(x) - 1)
            inside = x[upper] - x[upper - 1] > hole_m
            moved = np.stack([spline_at(x, row_values, grid) for row_values in values])
            return grid, np.where(inside, np.nan, moved), step
        columns = [resample(x, row_values, step, max_hole_m=hole_m) for row_values in values]
        first, last = min(grid[0] for grid, _ in columns), max(grid[-1] for grid, _ in columns)
        every = np.arange(round(first / step), round(last / step) + 1) * step
        out = np.full((len(columns), len(every)), np.nan)
        for i, (grid, column) in enumerate(columns):
            begin = round((grid[0] - first) / step)
            out[i, begin : begin + len(grid)] = column
        return every, out, step


def refuse_single(table: SourceTable, places: Array) -> None:
    """Raise :class:`BadInputError` where there are fewer than two places (n,)."""
    if len(places) < 2:
        raise BadInputError(f"{table.name}: {len(places)} different places; expected a profile")


def places_of(table: SourceTable, reading: GeometryReading) -> Places:
    """Read the places of a table. Raises :class:`BadInputError` with the row that has none, or that turns back."""
    chainage = read_stations(table, reading.place, reading.chainage_unit)
    what = quoted(reading.place)
    missing = ~np.isfinite(chainage)
    if missing.any():
        row = table.first_row + int(np.argmax(missing))
        raise BadInputError(f"{table.name}: column {what}, row {row}: is empty; expected a place in every row")
    refuse_single(table, chainage)
    if not isinstance(reading.place, str):
        chainage = _along_the_track(chainage, *(table.numbers(name) for name in reading.place))
    rows = np.flatnonzero(~_repeated(table, chainage))
    chainage = chainage[rows]
    refuse_single(table, chainage)
    apart = np.diff(chainage)
    if 0.0 < (usual := float(np.median(np.abs(apart)))) < _LEAST_STEP_M:
        raise BadInputError(
            f"{table.name}: column {what}: rows are {usual:.2g} m apart; expected {_LEAST_STEP_M} m or more. Hint: if "
            'the numbers are kilometres, state chainage_unit = "km" under [geometry] in a mapping'
        )
    direction: Literal[1, -1] = 1 if np.median(apart) > 0.0 else -1
    wrong = direction * apart <= 0.0
    if wrong.any():
        at = int(np.argmax(wrong)) + 1
        raise BadInputError(
            f"{table.name}: column {what}, row {table.first_row + int(rows[at])}: {chainage[at]:.2f} m after "
            f"{chainage[at - 1]:.2f} m; expected places that {'rise' if direction == 1 else 'fall'} from row to row, "
            "as most do. Hint: give each pass a file of its own; where the kilometrage jumps, cut there"
        )
    return Places(chainage, direction, rows)


def _along_the_track(chainage: Array, post: Array, rest: Array) -> Array:
    """Return chainages (n,) that run on past each post as the rows do: miles need not have 5280 ft.

    The first row keeps its place. A length from a post that begins again within a row's usual step shows that no row is
    missing there, so that this row is one step on.
    """
    apart = np.diff(chainage)
    step = float(np.median(apart))
    at_post = np.where(step > 0.0, rest[1:], rest[:-1])
    usual = float(np.median(np.abs(np.diff(rest))))
    passed = (np.abs(np.diff(post)) == 1.0) & (np.abs(at_post) < usual)
    return np.asarray(chainage + np.append(0.0, np.cumsum(np.where(passed, step - apart, 0.0))))


def _repeated(table: SourceTable, chainage: Array) -> np.ndarray:
    """Return which rows (n,) say the same as the one before, as where a system begins its next file or buffer."""
    repeated = np.append(False, np.diff(chainage) == 0.0)
    for row in np.flatnonzero(repeated):
        repeated[row] = table.frame.iloc[row].equals(table.frame.iloc[row - 1].set_axis(table.frame.columns))
    return repeated


def _whole_part(apart_m: float) -> float:
    """Return the whole part of 1 m that rows so far apart lie on, else the usual step."""
    count = round(1.0 / apart_m) if apart_m > 0.0 else 0
    return 1.0 / count if count and abs(1.0 / apart_m - count) < _ON_GRID * count else _USUAL_STEP_M

"""The overlay has a run and a map at the same cells, in the columns' units.

The run's rows lie at ``to_map(chainage of the run)``; between them its values are a quintic spline, as everywhere where
runs are compared (:mod:`trackfg.evaluation.geometry_errors`). The map's twist is taken from its cross-level.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pandas as pd

from trackfg.geometry.twist import twist
from trackfg.numerics.arrays import Array
from trackfg.numerics.chainage.chainage_grid import cells_of
from trackfg.numerics.splines import spline_through
from trackfg.results.summary import GeometryConventions

QUANTITIES = (
    "curvature_1pm",
    "gradient_permille",
    "cross_level_mm",
    "twist_mm",
    "versine_level_mm",
    "versine_alignment_mm",
)
"""Columns that are compared."""

SUMMARY_M = 200.0
"""Length of line, m, that a row of a summary table covers."""


@dataclass(frozen=True)
class Overlay:
    """A run and a map at all whole steps (n,) of the map's chainage that both cover, holes included.

    ``run_chainage``: where the run was there, by its own chainage; ``stretch`` its derivative by the map's.
    ``shift_sd_m``: the sigma of that. ``grid`` has a row per cell, NaN in the holes of the map.
    """

    chainage: Array
    step_m: float
    run_chainage: Array
    stretch: Array
    shift_sd_m: Array
    run: pd.DataFrame
    grid: pd.DataFrame
    run_splines: dict[str, Callable[[Array], Array]]
    grid_splines: dict[str, Callable[[Array], Array]]

    def before(self, quantity: str) -> Array:
        """Return the map's values, (n,)."""
        return self.grid[quantity].to_numpy(dtype=np.float64)

    def before_at(self, quantity: str, shift: Array) -> Array:
        """Return the map's values ``shift`` m (n,) ahead of each cell."""
        return self.grid_splines[quantity](self.chainage + shift)

    def after_at(self, quantity: str, shift: Array) -> Array:
        """Return the run's values ``shift`` m (n,), by the map's chainage, ahead of each cell."""
        return self.run_splines[quantity](self.run_chainage + self.stretch * shift)

    def run_column(self, name: str) -> Array:
        """Return any column of the run, such as its sigmas or its speed, interpolated linearly, (n,)."""
        values = np.interp(self.run_chainage, self.run["chainage_m"].to_numpy(), self.run[name].to_numpy())
        return np.asarray(values, dtype=np.float64)


def overlay(
    run: pd.DataFrame,
    grid: pd.DataFrame,
    *,
    conventions: GeometryConventions,
    to_map: Callable[[Array], Array],
    shift_sd_m: Array,
) -> Overlay:
    """Lay ``run``, a result's geometry, over ``grid``, a map's. ``shift_sd_m`` has a value per row of ``run``.

    ``conventions`` are those of both.

    Raises ``ValueError`` where ``to_map`` does not rise all along the run, or for sigmas of another number than rows.
    """
    chainage = run["chainage_m"].to_numpy(dtype=np.float64)
    if np.shape(shift_sd_m) != chainage.shape:
        raise ValueError(f"shift_sd_m {np.shape(shift_sd_m)}: expected a value for each of {chainage.size} rows")
    on_map = np.asarray(to_map(chainage), dtype=np.float64)
    if not (np.isfinite(on_map).all() and np.all(np.diff(on_map) > 0.0)):
        raise ValueError("to_map: expected finite chainages of the map that rise with those of the run")
    step_m = conventions.step_m
    whole = without_gaps(grid, step_m, conventions)
    cells, both = whole.index.to_numpy(), np.zeros(0, dtype=np.int64)
    if cells.size and on_map.size:
        first = max(int(cells[0]), int(np.ceil(on_map[0] / step_m)))
        both = np.arange(first, min(int(cells[-1]), int(np.floor(on_map[-1] / step_m))) + 1)
    along = np.asarray(cells * step_m, dtype=np.float64)
    places = np.asarray(both * step_m, dtype=np.float64)
    run_chainage = np.interp(places, on_map, chainage) if both.size else places
    return Overlay(
        chainage=places,
        step_m=step_m,
        run_chainage=run_chainage,
        stretch=np.gradient(run_chainage, step_m) if both.size > 1 else np.ones(both.size),
        shift_sd_m=np.interp(places, on_map, shift_sd_m) if both.size else places,
        run=run,
        grid=whole.reindex(both).reset_index(drop=True),
        run_splines={name: spline_through(chainage, run[name].to_numpy(dtype=np.float64)) for name in QUANTITIES},
        grid_splines={name: spline_through(along, whole[name].to_numpy()) for name in QUANTITIES},
    )


def without_gaps(grid: pd.DataFrame, step_m: float, twists: GeometryConventions) -> pd.DataFrame:
    """Return a map's grid with twist, and a row for each cell from the first to the last; the index counts cells."""
    cells = cells_of(grid, step_m)
    every = np.arange(cells[0], cells[-1] + 1) if cells.size else cells
    whole = grid.set_index(cells).reindex(every).astype(np.float64)
    level = whole["cross_level_mm"].to_numpy()
    whole["twist_mm"] = twist(level, step_m, twists.twist_base_m, twists.twist_anchor)
    return whole

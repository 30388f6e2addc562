"""Merging of profiles on one grid: weighted means with their sigmas.

The errors of different runs are independent, so a cell's value is the mean weighted by inverse variances, which needs
no more of the earlier runs than their mean and its sigma. Cross-level is different, because most of its error is one
offset per run. It is taken apart: its means over the anchors' stretches come from the joint solution
(:mod:`trackfg.mapping.joining.joint_solution`), and what is merged here is the shape in between, whose error is local.
"""

from __future__ import annotations

import numpy as np
import pandas as pd

from trackfg.numerics.arrays import Array
from trackfg.numerics.chainage.chainage_grid import cells_of, step_of

MERGED = ("curvature_1pm", "gradient_permille", "cross_level_mm", "versine_level_mm", "versine_alignment_mm")
"""Columns that are merged, each with its ``_sd``."""

_LEAST_SD = 1e-9
"""Least sigma of a weight, in the unit of the column: keeps it finite."""
_ON_AN_EDGE_M = 1e-6
"""A row this near to the edge of a stretch, m, lies on it: places that were stored come back with rounding."""
_STEEP_OVER_M = 10.0
"""Length over which the slope of a profile is taken as rms, m: a base of curvature and versines."""
_WALK_SHARE = 8.0
"""Variance of a random walk pinned every 250 m, as a multiple of that of its change over 5 m: 250 / 5 / 6."""


def local_cross_level_sd(run: pd.DataFrame) -> Array:
    """Return the sigma of a run's cross-level against its means over the anchors' stretches, mm, for each row.

    A tilt's error wanders like a random walk, whose change over the twist's base the run knows.
    """
    return np.asarray(np.minimum(run["cross_level_mm_sd"], np.sqrt(_WALK_SHARE) * run["twist_mm_sd"]))


def with_place_noise(run: pd.DataFrame, place_sd_m: Array | float) -> pd.DataFrame:
    """Return the run with sigmas that contain an error of the place, of 1-sigma ``place_sd_m`` for each row.

    Its share is the slope of the profile times that, the slope as rms over 10 m: what counts is how steep the profile
    is thereabouts, not at one point.
    """
    step, columns = step_of(run), {}
    for name in MERGED:
        slope = pd.Series(np.gradient(run[name].to_numpy(), step) ** 2)
        steep = slope.rolling(round(_STEEP_OVER_M / step) + 1, center=True, min_periods=1).mean().to_numpy()
        columns[f"{name}_sd"] = np.sqrt(run[f"{name}_sd"] ** 2 + steep * np.square(place_sd_m))
    return run.assign(**columns)


def merged(grid: pd.DataFrame, run: pd.DataFrame) -> pd.DataFrame:
    """Return the weighted mean of a grid and a run, wherever either of them is known.

    Both have ``chainage_m`` on multiples of one step, the columns :data:`MERGED` with sigmas and ``observations``; the
    sigma of the cross-level is the local one.
    """
    step = min(step_of(grid), step_of(run))
    cells = [cells_of(table, step) for table in (grid, run)]
    first, last = min(c[0] for c in cells), max(c[-1] for c in cells)
    row = [c - first for c in cells]
    n = last - first + 1
    out: dict[str, Array] = {"chainage_m": np.arange(first, last + 1) * step}
    for name in MERGED:
        weight, weighted = np.zeros(n), np.zeros(n)
        for table, at in zip((grid, run), row, strict=True):
            value, sd = table[name].to_numpy(), table[f"{name}_sd"].to_numpy()
            known = np.isfinite(value) & np.isfinite(sd)
            w = np.maximum(sd[known], _LEAST_SD) ** -2
            weight[at[known]] += w
            weighted[at[known]] += w * value[known]
        with np.errstate(invalid="ignore", divide="ignore"):
            out[name] = np.where(weight > 0.0, weighted / weight, np.nan)
            out[f"{name}_sd"] = np.where(weight > 0.0, weight**-0.5, np.nan)
    observations = np.zeros(n, dtype=np.int64)
    for table, at in zip((grid, run), row, strict=True):
        observations[at] += table["observations"].to_numpy()
    out["observations"] = observations
    return pd.DataFrame(out)[observations > 0].reset_index(drop=True)


def window_means(grid: pd.DataFrame, name: str, centres: Array, length_m: float) -> Array:
    """Return means of a column over stretches about ``centres`` (m,); NaN where less than half of one is known.

    A row at the first edge of a stretch is in it, one at the last edge is not, whatever the rounding of a centre.
    """
    step, x = step_of(grid), grid["chainage_m"].to_numpy()
    value = grid[name].to_numpy()
    known = np.isfinite(value)
    total = np.concatenate([[0.0], np.cumsum(np.where(known, value, 0.0))])
    count = np.concatenate([[0], np.cumsum(known)])
    edges = (centres + side * 0.5 * length_m - _ON_AN_EDGE_M for side in (-1.0, 1.0))
    low, high = (np.searchsorted(x, edge) for edge in edges)
    number = count[high] - count[low]
    enough = number >= 0.5 * length_m / step
    return np.where(enough, (total[high] - total[low]) / np.maximum(number, 1), np.nan)

"""The difference of two maps lists what moved, by how much, and by how many sigmas.

Let ``a``, ``b`` be the two estimates of one quantity, ``P_a``, ``P_b`` their variances. The variance of ``b - a`` is
``P_a + P_b - 2 cov(a, b)``, and the covariance follows from the runs in each (known by their content, so that it does
not matter in which order or file they were joined), as the table in docs/maps-storage.md has it. Where b has all runs
of a and more, it is the best estimate from more data, so its error is not correlated with what it gained over a (an
efficient estimator's error is uncorrelated with every unbiased estimate of zero): ``cov(a, b) = P_b``. With some runs
in common ``P_a + P_b`` is an upper bound; with the same ones ``P_b`` is a yardstick, no test.

A map's chainage errs by itself, smoothly, and by some centimetres from version to version: laid over each other by
chainage alone, steep profiles would differ by that. So the grid of a is first brought to b's chainage where its track
is recognised there (:mod:`trackfg.mapping.recognition.recognition`).

``P_a - P_b`` holds where both maps have the same sigmas. Where they do not (other settings), ``P_a - P_b`` can be
negative; the sigma of the difference is NaN then, and so is the number of sigmas.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import pandas as pd

from trackfg.mapping.changes.overlay import SUMMARY_M
from trackfg.mapping.recognition.conventions import recognised_near
from trackfg.mapping.recognition.warp import warped
from trackfg.maps.feature_map import GRID_QUANTITIES, FeatureMap
from trackfg.numerics.arrays import Array
from trackfg.numerics.chainage.chainage_grid import cells_of
from trackfg.numerics.key_figures import Outlined

Relation = Literal["extended", "reduced", "disjoint", "overlapping", "same"]

LANDMARK_QUANTITIES = ("chainage_m", "radius_m", "transition_length_m", "arc_length_m", "cant_mm")
"""Quantities of landmarks that are compared."""

_RATE_SD = 1e-4
"""Of one map's scale against another's: fixes some kilometres apart have settled both."""

_ROUNDING = 1e-9
"""Of a variance, relative: less than this is what is left of equal numbers."""


@dataclass(frozen=True, repr=False)
class Difference(Outlined):
    """The difference of two maps, b less a.

    ``moved``: one row per landmark in both maps and quantity that both know: ``landmark_id, kind, name, quantity`` (its
    name has the unit), ``a, b, difference`` (b - a), ``difference_sd, sigmas``.

    ``added``, ``removed``: the landmarks that only b or only a has. ``sections``: one row per 200 m and grid quantity
    with cells in both maps: ``start_m, end_m, quantity, cells, mean, rms, largest`` (with its sign), ``largest_at_m,
    rms_sigmas, largest_sigmas``, of b - a. ``cells_added``, ``cells_removed``: grid cells that only b or only a has.

    Examples
    --------
    >>> from trackfg.mapping import difference
    >>> from trackfg.maps import read_map
    >>> line = read_map("line.gpkg")
    >>> same = difference(line, line)
    >>> len(same.added), len(same.removed)
    (0, 0)
    """

    relation: Relation
    moved: pd.DataFrame
    added: pd.DataFrame
    removed: pd.DataFrame
    sections: pd.DataFrame
    cells_added: int
    cells_removed: int


def difference(a: FeatureMap, b: FeatureMap) -> Difference:
    """Compare two maps: landmarks are the same where their ids are, grid cells where their track is.

    Parameters
    ----------
    a
        A map, or a version of one.
    b
        Another.

    Returns
    -------
    Difference
        What moved, m and mm with sigmas, what was added and removed, and the grid by sections of 200 m.

    Raises
    ------
    ValueError
        Where the grids have different steps.

    Examples
    --------
    >>> from trackfg.mapping import difference
    >>> from trackfg.maps import read_map
    >>> line = read_map("line.gpkg")
    >>> difference(line, line).relation
    'same'
    """
    if a.conventions.step_m != b.conventions.step_m:
        raise ValueError(f"grids of {a.conventions.step_m:g} m and {b.conventions.step_m:g} m: expected the same step")
    relation = _relation(a, b)
    in_a = a.landmarks["landmark_id"].isin(b.landmarks["landmark_id"])
    in_b = b.landmarks["landmark_id"].isin(a.landmarks["landmark_id"])
    step, grid_a = a.conventions.step_m, _on_chainage_of(b, a)
    cells_a, cells_b = cells_of(grid_a, step), cells_of(b.grid, step)
    common, at_a, at_b = np.intersect1d(cells_a, cells_b, assume_unique=True, return_indices=True)
    return Difference(
        relation=relation,
        moved=_moved(relation, a.landmarks, b.landmarks),
        added=b.landmarks[~in_b].reset_index(drop=True),
        removed=a.landmarks[~in_a].reset_index(drop=True),
        sections=_sections(relation, grid_a.iloc[at_a], b.grid.iloc[at_b]),
        cells_added=len(cells_b) - len(common),
        cells_removed=len(cells_a) - len(common),
    )


def _relation(a: FeatureMap, b: FeatureMap) -> Relation:
    in_a, in_b = set(a.runs["content_sha256"]), set(b.runs["content_sha256"])
    if in_a == in_b:
        return "same"
    if in_a < in_b:
        return "extended"
    if in_b < in_a:
        return "reduced"
    return "overlapping" if in_a & in_b else "disjoint"


def _sigma(relation: Relation, sd_a: Array, sd_b: Array) -> Array:
    """Return the sigma of b - a. Rounding of two equal variances is taken as zero; a variance below zero gives NaN."""
    va, vb = sd_a**2, sd_b**2
    match relation:
        case "extended":
            variance = va - vb
        case "reduced":
            variance = vb - va
        case "same":
            variance = vb
        case _:
            variance = va + vb
    variance = np.where(np.abs(variance) <= _ROUNDING * np.maximum(va, vb), 0.0, variance)
    with np.errstate(invalid="ignore"):
        return np.asarray(np.sqrt(variance))


def _in_sigmas(change: Array, sd: Array) -> Array:
    """Return the change in sigmas; 0 where nothing has moved, also where the difference is known exactly."""
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.abs(change) / sd
    return np.where((change == 0.0) & (sd == 0.0), 0.0, ratio)


def _on_chainage_of(b: FeatureMap, a: FeatureMap) -> pd.DataFrame:
    """Return the grid of a by the chainage of b, unchanged if its track is not recognised there."""
    if a.grid.empty or b.grid.empty:
        return a.grid
    map_sd = float(b.grid["chainage_m_sd"].median())
    to_b = recognised_near(a.grid, b.grid, map_sd, rate_sd=_RATE_SD, direction=1).warp
    return a.grid if to_b is None else warped(a.grid, to_b, a.conventions.step_m)


def _moved(relation: Relation, a: pd.DataFrame, b: pd.DataFrame) -> pd.DataFrame:
    both = a.merge(b, on="landmark_id", suffixes=("_of_a", "_of_b"))
    tables = []
    for quantity in LANDMARK_QUANTITIES:
        of_a, of_b = (both[f"{quantity}_of_{which}"].to_numpy() for which in "ab")
        sd = _sigma(relation, *(both[f"{quantity}_sd_of_{which}"].to_numpy() for which in "ab"))
        change = of_b - of_a
        table = pd.DataFrame(
            {
                "landmark_id": both["landmark_id"],
                "kind": both["kind_of_b"],
                "name": both["name_of_b"],
                "quantity": quantity,
                "a": of_a,
                "b": of_b,
                "difference": change,
                "difference_sd": sd,
                "sigmas": _in_sigmas(change, sd),
            }
        )
        tables.append(table[np.isfinite(change)])
    in_order: pd.DataFrame = pd.concat(tables).sort_index(kind="stable", ignore_index=True)
    return in_order


def _sections(relation: Relation, a: pd.DataFrame, b: pd.DataFrame) -> pd.DataFrame:
    """Return the rows of ``Difference.sections``, by ``reduceat`` over the rows of each section, which are in order."""
    tables = []
    chainage = b["chainage_m"].to_numpy()
    for quantity in GRID_QUANTITIES:
        change = b[quantity].to_numpy() - a[quantity].to_numpy()
        known = np.isfinite(change)
        sd = _sigma(relation, a[f"{quantity}_sd"].to_numpy(), b[f"{quantity}_sd"].to_numpy())
        ratio = _in_sigmas(change, sd)[known]
        change, place = change[known], chainage[known]
        section = np.floor(place / SUMMARY_M)
        starts = np.flatnonzero(np.diff(section, prepend=-np.inf) > 0)
        cells = np.diff(np.r_[starts, section.size])
        largest = _first_largest(np.abs(change), starts, cells)
        tables.append(
            pd.DataFrame(
                {
                    "start_m": section[starts] * SUMMARY_M,
                    "end_m": (section[starts] + 1.0) * SUMMARY_M,
                    "quantity": quantity,
                    "cells": cells,
                    "mean": np.add.reduceat(change, starts) / cells,
                    "rms": np.sqrt(np.add.reduceat(change**2, starts) / cells),
                    "largest": change[largest],
                    "largest_at_m": place[largest],
                    "rms_sigmas": np.sqrt(np.add.reduceat(ratio**2, starts) / cells),
                    "largest_sigmas": np.maximum.reduceat(ratio, starts),
                }
            )
        )
    return pd.concat(tables).sort_values("start_m", kind="stable", ignore_index=True)


def _first_largest(size: Array, starts: np.ndarray, cells: np.ndarray) -> np.ndarray:
    """Return the index of the first largest entry of each section."""
    top = np.repeat(np.maximum.reduceat(size, starts), cells)
    at = np.flatnonzero(size == top)
    return np.asarray(at[np.searchsorted(at, starts)])

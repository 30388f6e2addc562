"""Spans: runs of true entries, times inside spans, and the entries of a grid nearest to values."""

from __future__ import annotations

import numpy as np

from trackfg.numerics.arrays import Array
from trackfg.numerics.robust import median


def true_runs(mask: np.ndarray) -> np.ndarray:
    """Return first index and index after the last of each run of true entries, in order. Shape (n,) of bool to (k,
    2).
    """
    padded = np.concatenate([[False], mask, [False]]).astype(np.int8)
    return np.flatnonzero(np.diff(padded)).reshape(-1, 2)


def true_stretches(mask: np.ndarray, together: int) -> np.ndarray:
    """Return :func:`true_runs` as (k, 2), those as one that have fewer than ``together`` false entries between them."""
    runs = true_runs(mask)
    if len(runs) == 0:
        return runs
    first = np.flatnonzero(np.r_[True, runs[1:, 0] - runs[:-1, 1] >= together])
    return np.stack([runs[first, 0], runs[np.r_[first[1:], len(runs)] - 1, 1]], axis=1)


def within(t: Array, spans: Array) -> np.ndarray:
    """Return which times lie in one of the spans (m, 2), in order and disjoint. Ends included."""
    if len(spans) == 0:
        return np.zeros(len(t), dtype=bool)
    k = np.searchsorted(spans[:, 0], t, side="right") - 1
    inside: np.ndarray = (k >= 0) & (t <= spans[np.maximum(k, 0), 1])
    return inside


def nearest(grid: Array, values: Array) -> np.ndarray:
    """Return the index of the entry of the increasing ``grid`` nearest to each of the values."""
    right = np.clip(np.searchsorted(grid, values), 1, len(grid) - 1)
    return right - (values - grid[right - 1] < grid[right] - values)


def distance_to_nearest(places: Array, others: Array) -> Array:
    """Return the distance from each place (n,) to the nearest of the others (m,); infinity without any of these."""
    if len(others) == 0:
        return np.full(len(places), np.inf)
    others = np.sort(others)
    right = np.clip(np.searchsorted(others, places), 0, len(others) - 1)
    left = np.maximum(right - 1, 0)
    return np.asarray(np.minimum(np.abs(places - others[left]), np.abs(places - others[right])))


def subtract(spans: Array, breaks: Array) -> Array:
    """Return spans (m, 2), ordered and disjoint, without what lies in ``breaks`` (b, 2): one may become two."""
    for begin, end in breaks:
        head = np.column_stack([spans[:, 0], np.minimum(spans[:, 1], begin)])
        tail = np.column_stack([np.maximum(spans[:, 0], end), spans[:, 1]])
        parts = np.concatenate([head, tail])
        spans = parts[parts[:, 1] > parts[:, 0]]
        spans = spans[np.argsort(spans[:, 0], kind="stable")]
    return spans


def union(spans: Array) -> Array:
    """Return spans (m, 2) in order, those that overlap or touch as one."""
    if len(spans) == 0:
        return spans
    ordered = spans[np.argsort(spans[:, 0], kind="stable")]
    until = np.maximum.accumulate(ordered[:, 1])
    first = np.append(True, ordered[1:, 0] > until[:-1])
    return np.stack([ordered[first, 0], until[np.append(first[1:], True)]], axis=1)


def median_interval(t: Array) -> float:
    """Return the median interval of times that grow, s; 0 where there are fewer than two."""
    return median(t[1:] - t[:-1]) if t.size > 1 else 0.0


Span = tuple[float, float]
"""Start and end of a span of time, s: the start belongs to it, the end does not."""

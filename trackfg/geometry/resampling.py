"""Bring samples at any places to a uniform step, neither inventing nor losing wavelengths.

Samples taken at a steady rate lie close where the vehicle is slow and far apart where it is fast. In three steps:

1. The samples are sorted and those within one cell (an eighth of a step) averaged, places and values alike. Where
   neighbouring cells are both taken, a node is moved (along the local slope) off the cell's edge, so that no two nodes
   are nearer than half a cell and noise is not differentiated.
2. A cubic spline through the nodes is evaluated at every cell.
3. A linear-phase low-pass (Kaiser window, 60 dB) that passes wavelengths above 3.2 steps and stops those below 2 steps
   is applied and every eighth cell kept: what the new grid cannot show does not fold back into what it can.

With a step of 0.25 m and samples up to 0.05 m apart, sines of 0.8 m and more come back within 0.5 % and those below 0.5
m with at most 3 % of their amplitude (0.2 % above 0.25 m). With samples 0.1 m apart it is 1 % from 1 m up, with 0.2 m
1 % from 2 m up: there the spline decides. :func:`resampling_response` is the low-pass's, which dense samples attain.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from trackfg.errors import BadInputError
from trackfg.geometry.grid import wave_number
from trackfg.numerics.arrays import Array
from trackfg.numerics.hermite import hermite_at, spline_velocities
from trackfg.numerics.kernels import compiled_kernels, kernel_argument

FEWEST_SAMPLES = 4
"""Samples that a cubic spline without given slopes at its ends needs."""
_CELLS = 8
"""Cells per step."""
_PASS_STEPS, _STOP_STEPS = 3.2, 2.0
"""Edges of the low-pass, wavelengths in steps."""
_ATTENUATION_DB = 60.0
"""Attenuation of the low-pass in its stop band, dB: an amplitude of 0.1 % is left."""
_CHUNK = 2_000
"""Steps evaluated at a time: their cells stay in the cache."""
_SAMPLES = 32_768
"""Samples, and nodes of them, looked at a time: what is needed on the way stays in the cache."""
_MAX_HOLE_M = 1.0
"""Samples further apart leave a hole."""
_BEYOND = 64
"""Nodes to either side of a chunk that its spline runs through: what is beyond a node has at most half the influence
that it has there (de Boor, *A Practical Guide to Splines* (1978), ch. XIII), 2^-64 in all, which is below rounding.
"""


def resample(
    chainage_m: ArrayLike, values: ArrayLike, step_m: float = 0.25, *, max_hole_m: float = _MAX_HOLE_M
) -> tuple[Array, Array]:
    """Return whole multiples of ``step_m`` (m,) and values (..., m) there, from values (..., n) at places in any order.

    NaN where the low-pass reaches (2.4 m with 0.25 m) beyond an end, or into a hole: two samples more than
    ``max_hole_m`` apart. A sample that is NaN in any row is left out. Raises ``BadInputError`` for fewer than four
    samples that are apart, a place that is not finite, or shapes that do not fit.
    """
    place, value = _checked(chainage_m, values)
    return _resampled(place, lambda rows: value[..., rows], value.shape[:-1], step_m, max_hole_m)


def resample_computed(
    chainage_m: Array, values: Callable[[np.ndarray | slice], Array], count: int, step_m: float
) -> tuple[Array, Array]:
    """Return the same as :func:`resample` of values that are computed as they are needed, so that they take no memory.

    ``values`` returns ``count`` finite ones (count, k) of k samples.
    """
    place = _finite(chainage_m)
    if not np.any(place[1:] < place[:-1]):
        return _resampled(place, values, (count,), step_m, _MAX_HOLE_M)
    order = np.argsort(place, kind="stable")
    return _resampled(place[order], lambda rows: values(order[rows]), (count,), step_m, _MAX_HOLE_M)


def _resampled(
    place: Array, values: Callable[[slice], Array], shape: tuple[int, ...], step_m: float, max_hole_m: float
) -> tuple[Array, Array]:
    """Do as :func:`resample` with samples at ascending places, whose values (*shape, k) a function returns."""
    if not 0.0 < step_m < np.inf:
        raise BadInputError(f"step_m is {step_m!r}; expected a length above 0")
    cell = step_m / _CELLS
    nodes = _Nodes.of(place, cell)
    node = nodes.place
    if len(node) < FEWEST_SAMPLES:
        raise BadInputError(f"{len(node)} samples that are apart; expected at least {FEWEST_SAMPLES}")

    taps = _low_pass()
    reach = len(taps) // 2
    first, last = int(np.ceil(node[0] / step_m)), int(np.floor(node[-1] / step_m))
    grid: Array = step_m * np.arange(first, last + 1, dtype=np.float64)
    out = np.full((*shape, len(grid)), np.nan)
    if len(grid) == 0:
        return grid, out
    for begin in range(0, len(grid), _CHUNK):
        part = out[..., begin : begin + _CHUNK]
        start = (first + begin) * _CELLS - reach
        end = start + (part.shape[-1] - 1) * _CELLS + 2 * reach
        low, high = np.searchsorted(node, np.clip([start * cell, end * cell], node[0], node[-1])).tolist()
        near = slice(max(low - _BEYOND, 0), high + _BEYOND)
        if compiled_kernels():
            part[...] = nodes.resampled(values, near, start, cell, taps, part.shape[-1])
            continue
        # What stands beyond the ends is not used: see `known`.
        fine = np.clip(np.arange(start, end + 1) * cell, node[0], node[-1])
        at_nodes = nodes.values(values, near)
        cells = hermite_at(fine, node[near], at_nodes, spline_velocities(node[near], at_nodes))
        part[...] = _decimate(cells, taps)
    reach_m = reach * cell
    known = (grid - reach_m >= node[0] - 0.5 * cell) & (grid + reach_m <= node[-1] + 0.5 * cell)
    for hole in np.flatnonzero(np.diff(node) > max_hole_m):
        begin, end = np.searchsorted(grid, [node[hole] - reach_m, node[hole + 1] + reach_m], side="left")
        known[begin:end] = False
    out[..., ~known] = np.nan
    return grid, out


def resampling_response(wavelength_m: ArrayLike, step_m: float = 0.25) -> Array:
    """Return response of :func:`resample` where samples are dense, real: that of its low-pass."""
    taps = _low_pass()
    half = len(taps) // 2
    phase = wave_number(wavelength_m)[..., None] * step_m / _CELLS * np.arange(1, half + 1)
    return np.asarray(taps[half] + 2.0 * (np.cos(phase) @ taps[half + 1 :]))


def _checked(chainage_m: ArrayLike, values: ArrayLike) -> tuple[Array, Array]:
    """Return places and values, sorted, without those that are NaN in a row."""
    place, value = np.asarray(chainage_m, dtype=np.float64), np.asarray(values, dtype=np.float64)
    if place.ndim != 1 or value.shape[-1:] != place.shape:
        raise BadInputError(f"{value.shape} values at {place.shape} places; expected one column of values per place")
    place = _finite(place)
    whole = np.isfinite(value).all(axis=tuple(range(value.ndim - 1)))
    if not whole.all():
        place, value = place[whole], value[..., whole]
    if np.any(place[1:] < place[:-1]):
        order = np.argsort(place, kind="stable")
        place, value = place[order], value[..., order]
    return place, value


def _finite(place: Array) -> Array:
    if not np.isfinite(place).all():
        raise BadInputError(f"chainage of sample {int(np.argmin(np.isfinite(place))) + 1} is not finite")
    return place


@dataclass(frozen=True)
class _Nodes:
    """There is one node per cell that has samples, no two nearer than half a cell.

    Node i, at ``place`` (k,), stands for the samples from ``edges[i]`` (k + 1,) on, whose ``mean`` place (k,) is near.
    """

    edges: np.ndarray
    mean: Array
    place: Array

    @classmethod
    def of(cls, place: Array, cell: float) -> _Nodes:
        """Return the nodes of samples at ascending places."""
        begins = range(0, len(place), _SAMPLES)
        starts = [_starts(place[max(begin - 1, 0) : begin + _SAMPLES], cell, begin) for begin in begins]
        edges = np.concatenate([*starts, [len(place)]])
        count = len(edges) - 1
        mean, at = np.empty((2, count))
        for begin in range(0, count, _SAMPLES):
            some = slice(begin, begin + _SAMPLES)
            # With the node before and the one behind, which say how far each may lie.
            near = slice(max(begin - 1, 0), min(some.stop + 1, count))
            within = slice(begin - near.start, some.stop - near.start)
            mean[some], at[some] = (part[within] for part in _means(place, edges[near.start : near.stop + 1], cell))
        return cls(edges, mean, at)

    def resampled(
        self, samples: Callable[[slice], Array], some: slice, start: int, cell: float, taps: Array, steps: int
    ) -> Array:
        """Return the spline through some of the nodes, four or more, at cells from number ``start`` on, low-passed, at
        every step (..., steps), in ``kernels/resampling.cpp``. ``samples`` returns values of some samples (..., k).
        """
        from trackfg.numerics import compiled

        mean, place = self.mean[some], self.place[some]
        edges = self.edges[some.start : some.start + len(mean) + 1]
        near = samples(slice(int(edges[0]), int(edges[-1])))
        out = np.empty((*near.shape[:-1], steps))
        rows, written = kernel_argument(near).reshape(-1, near.shape[-1]), out.reshape(-1, steps)
        compiled.resample(edges - edges[0], mean, place, rows, start, cell, _CELLS, taps, written)
        return out

    def values(self, samples: Callable[[slice], Array], some: slice) -> Array:
        """Return values at some of the nodes, three or more, from those that a function returns of samples (..., k)."""
        mean, place = self.mean[some], self.place[some]
        edges = self.edges[some.start : some.start + len(mean) + 1]
        near = samples(slice(int(edges[0]), int(edges[-1])))
        value = np.add.reduceat(near, edges[:-1] - edges[0], axis=-1) / np.diff(edges)
        slope = np.empty_like(value)
        slope[..., 1:-1] = (value[..., 2:] - value[..., :-2]) / (mean[2:] - mean[:-2])
        slope[..., 0], slope[..., -1] = slope[..., 1], slope[..., -2]
        return np.asarray(value + slope * (place - mean))


def _starts(place: Array, cell: float, begin: int) -> np.ndarray:
    """Return which samples are the first of their cells, numbers from ``begin`` on; ``place`` has the one before that,
    if there is one.
    """
    first = np.flatnonzero(np.diff(np.floor(place / cell)) != 0.0) + max(begin, 1)
    return first if begin else np.concatenate([[0], first])


def _means(place: Array, edges: np.ndarray, cell: float) -> tuple[Array, Array]:
    """Return the mean place of the samples from each edge to the next, and the places of their nodes."""
    first, counts = edges[:-1], np.diff(edges)
    number = np.floor(place[first] / cell)
    origin = cell * number
    beyond = place[edges[0] : edges[-1]] - np.repeat(origin, counts)
    mean = origin + np.add.reduceat(beyond, first - edges[0]) / counts
    adjacent, middle = np.diff(number) == 1.0, (number + 0.5) * cell
    low = np.where(np.concatenate([[False], adjacent]), middle - 0.25 * cell, -np.inf)
    high = np.where(np.concatenate([adjacent, [False]]), middle + 0.25 * cell, np.inf)
    return mean, np.clip(mean, low, high)


def _decimate(fine: Array, taps: Array) -> Array:
    """Return the low-pass of ``fine`` (..., cells), where it fits, at every step.

    Taps and cells are cut into steps: the products of each step's cells with all steps of taps are one matrix.
    """
    count, steps = (fine.shape[-1] - len(taps)) // _CELLS + 1, -(-len(taps) // _CELLS)
    of_step = np.zeros((*fine.shape[:-1], -(-fine.shape[-1] // _CELLS), _CELLS))
    of_step.reshape(*fine.shape[:-1], -1)[..., : fine.shape[-1]] = fine
    products = np.pad(taps, (0, -len(taps) % _CELLS)).reshape(steps, _CELLS) @ np.swapaxes(of_step, -1, -2)
    total = np.zeros((*fine.shape[:-1], count))
    for step in range(steps):
        total += products[..., step, step : step + count]
    return total


@lru_cache(maxsize=1)
def _low_pass() -> Array:
    """Return taps at the cells, symmetrical, of sum one (Kaiser's design rules)."""
    pass_edge, stop_edge = 1.0 / (_PASS_STEPS * _CELLS), 1.0 / (_STOP_STEPS * _CELLS)  # cycles per cell
    transition = 2.0 * np.pi * (stop_edge - pass_edge)
    half = int(np.ceil((_ATTENUATION_DB - 7.95) / (2.285 * transition) / 2.0))
    beta = 0.1102 * (_ATTENUATION_DB - 8.7)
    cut = pass_edge + stop_edge  # twice the cut-off
    taps = cut * np.sinc(cut * np.arange(-half, half + 1)) * np.kaiser(2 * half + 1, beta)
    taps /= taps.sum()
    taps.flags.writeable = False
    return np.asarray(taps)

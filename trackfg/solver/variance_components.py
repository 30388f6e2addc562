"""Variance components from the residuals of a solution show whether the assumed noise levels are true.

For a group of whitened residual rows e with leverages h (the diagonal of ``J P J'``, P the posterior covariance), the
expected sum of squares is the redundancy ``sum(1 - h)`` if the assumed sigmas are right. The square root of the ratio
is the factor by which they are too small. Foerstner, "Ein Verfahren zur Schaetzung von Varianz- und
Kovarianzkomponenten" (1979); robust weights enter as in Koch, "Parameter estimation and hypothesis testing in linear
models" (1999), ch. 3.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from trackfg.factors.factor_type import FactorType
from trackfg.factors.family import Family, family_of
from trackfg.factors.linear import LinearFactors, first_keyframe, last_keyframe, slot_columns
from trackfg.factors.states import KEYFRAME_DIM, States
from trackfg.numerics.kernels import compiled_kernels, kernel_argument

if TYPE_CHECKING:
    from trackfg.numerics.arrays import Array
    from trackfg.solver.covariance import Covariance
    from trackfg.solver.gauss_newton import Graph

LEAST_REDUNDANCY = 20.0
"""Groups that the rest of the graph hardly checks say nothing about their own noise."""

_AT_A_TIME = 128
"""Keyframes whose covariances are taken out at a time: they stay in the processor's cache (0.4 MB per 128 of 20
columns)."""

GROUPS = {
    FactorType.NON_HOLONOMIC: "motion",
    FactorType.PATH: "path",
    FactorType.TACH_DISTANCE: "tach",
    FactorType.GNSS_POSITION: "gnss",
    FactorType.GNSS_SPEED: "gnss speed",
}
"""Families whose level is judged, and the name of their group; the inertial factors are "gyro" and "accel"."""


@dataclass(frozen=True)
class Residuals:
    """Whitened residuals of a group's factors with robust weights, ``values`` (m, d), and their ``redundancy`` (m, d).

    Each factor begins at ``keyframe`` (m,).
    """

    keyframe: np.ndarray
    values: Array
    redundancy: Array

    @property
    def ratio(self) -> float:
        """Actual over assumed noise; NaN where the rest of the graph hardly checks it."""
        squares, redundancy = float(np.sum(self.values**2)), float(np.sum(self.redundancy))
        return float(np.sqrt(squares / redundancy)) if redundancy > LEAST_REDUNDANCY else np.nan


def group_residuals(graph: Graph, states: States, covariance: Covariance, bridged: np.ndarray) -> dict[str, Residuals]:
    """Return the residuals of each group that the graph has.

    ``bridged`` (n - 1,): which of its intervals the inertial sensors' noise is not of.
    """
    groups = _inertial_residuals(graph, states, covariance, np.flatnonzero(~bridged))
    for family in graph.families:
        if family.type in GROUPS:
            groups[GROUPS[family.type]] = _family_residuals(family, states, covariance)
    return groups


def walk_residuals(graph: Graph, states: States, covariance: Covariance) -> Residuals | None:
    """Return the residuals of the walk of the biases, accelerometer first; None where the graph has none."""
    walk = family_of(graph.families, FactorType.BIAS_WALK)
    return None if walk is None else _family_residuals(walk, states, covariance)


def ratios_of(groups: Mapping[str, Residuals]) -> dict[str, float]:
    """Return actual over assumed noise of the groups that can be judged."""
    ratios = {name: group.ratio for name, group in groups.items()}
    return {name: ratio for name, ratio in ratios.items() if np.isfinite(ratio)}


def _inertial_residuals(graph: Graph, states: States, covariance: Covariance, used: np.ndarray) -> dict[str, Residuals]:
    """Return the residuals of gyro (rows 0-2 of inertial factors) and accelerometer of the intervals ``used``."""
    if used.size == 0:
        return {}
    linear = graph.inertial.linearize(states).take(used)
    e, free = linear.b.copy(), 1.0 - _spread(linear, covariance)  # a view would hold all rows
    return {"gyro": Residuals(used, e[:, :3], free[:, :3]), "accel": Residuals(used, e[:, 3:], free[:, 3:])}


def _family_residuals(family: Family, states: States, covariance: Covariance) -> Residuals:
    """Return the residuals of a family whose slots lie in at most two neighbouring keyframes."""
    linear = family.linearize(states)
    free = family.weights(states)[:, None] - _spread(linear, covariance)
    return Residuals(family.first_keyframe, linear.b.copy(), free)


def _spread(linear: LinearFactors, covariance: Covariance) -> Array:
    """Return the diagonals of ``J P J'``, (m, r), of factors whose slots lie in at most two neighbouring keyframes."""
    first, last = (of(linear.slots, len(linear.rows)) for of in (first_keyframe, last_keyframe))
    later = [not slot.kind.shared and bool((slot.index != first).any()) for slot in linear.slots]
    if compiled_kernels():
        return _spread_by_kernel(linear, first, last, later, covariance)
    parts: dict[bool, list[tuple[Array, np.ndarray]]] = {False: [], True: []}
    for slot, jacobian, is_later in zip(linear.slots, linear.jacobians, later, strict=True):
        parts[is_later].append((jacobian, slot_columns(slot)))
    sides = (
        _Side(np.concatenate([J for J, _ in blocks], axis=2), np.concatenate([c for _, c in blocks]))
        if blocks
        else _Side(np.zeros((*linear.b.shape, 0)), np.zeros(0, dtype=np.int64))
        for blocks in parts.values()
    )
    return _spread_by_arrays(covariance, first, last, *sides)


def _spread_by_kernel(
    linear: LinearFactors, first: np.ndarray, last: np.ndarray, later: list[bool], covariance: Covariance
) -> Array:
    """Do as :func:`_spread_by_arrays`, in ``kernels/spread.cpp``."""
    from trackfg.numerics import compiled

    columns = np.concatenate([slot_columns(slot) for slot in linear.slots])
    of_last = np.repeat(later, [slot.kind.dim for slot in linear.slots])
    first, last = (np.ascontiguousarray(index, dtype=np.int64) for index in (first, last))
    parts = (linear.rows, covariance.of_keyframes, covariance.of_shared, covariance.cross)
    rows, of_keyframes, of_shared, cross = map(kernel_argument, parts)
    spread = np.empty(rows.shape[:2])
    compiled.spread(rows, first, last, columns, of_last, of_keyframes, of_shared, cross, spread)
    return spread


class _Side(NamedTuple):
    """Jacobians (m, r, c) of factors by these ``columns`` (c,) of a keyframe's tangent."""

    jacobian: Array
    columns: np.ndarray


def _spread_by_arrays(
    covariance: Covariance, first: np.ndarray, last: np.ndarray, side: _Side, next_side: _Side
) -> Array:
    """Return the diagonals of ``J P J'``, (m, r), of factors of keyframes ``first`` and their next ones ``last``."""
    spread = np.empty(side.jacobian.shape[:2])
    for begin in range(0, len(spread), _AT_A_TIME):
        rows = slice(begin, begin + _AT_A_TIME)
        J, K = side.jacobian[rows], next_side.jacobian[rows]
        at_first = covariance.rows(first[rows], side.columns)[:, :, side.columns]
        spread[rows] = np.sum((J @ at_first) * J, axis=2)
        if next_side.columns.size:
            at_last = covariance.rows(last[rows], next_side.columns)
            spread[rows] += np.sum((K @ at_last[:, :, next_side.columns]) * K, axis=2)
            with_next = _cross(covariance, first[rows], side.columns, next_side.columns, at_last)
            spread[rows] += 2.0 * np.sum((J @ with_next) * K, axis=2)
    return spread


def _cross(covariance: Covariance, first: np.ndarray, rows: np.ndarray, columns: np.ndarray, at_next: Array) -> Array:
    """Return the covariance of ``rows`` (r,) of keyframes ``first`` (m,) with ``columns`` (c,) of their next ones.

    ``at_next`` (m, c, d): that of the columns with all of their own keyframe and the shared variables.
    """
    k, in_keyframe = np.minimum(first, len(covariance.cross) - 1), rows < KEYFRAME_DIM
    cross = np.empty((len(first), rows.size, columns.size))
    cross[:, in_keyframe] = covariance.cross[k[:, None, None], rows[in_keyframe, None], columns]
    cross[:, ~in_keyframe] = at_next[:, :, rows[~in_keyframe]].swapaxes(1, 2)
    return cross

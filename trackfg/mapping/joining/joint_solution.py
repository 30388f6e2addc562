"""The joint estimate of a map's variables from the information of all its runs.

A run gives rows ``R_r x = d_r + e``, ``e ~ N(0, I)``, on the variables x that it touches
(:mod:`trackfg.mapping.joining.anchors`). The runs' errors are independent, so the joint estimate is the least-squares
solution of all rows stacked, by QR. It equals that of the joint graph of all states of all runs, since the order of
elimination does not change the solution.

So runs can be pooled one by one: after each, its own variables (its offset, the roll of a sensor without an id) are
eliminated, and a triangle on the variables that runs share is left, whose size does not grow with the number of runs.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import solve_triangular

from trackfg.maps.feature_map import RunInformation
from trackfg.numerics.arrays import Array
from trackfg.numerics.blas_threads import one_thread

_HELD_SD = 1e-3
"""Sigma of the offset of the first run, m, where no run had a fix: the map counts from its start."""


@dataclass(frozen=True)
class JointSolution:
    """The variables by name, their estimates ``x`` (n,) and ``covariance`` (n, n)."""

    names: tuple[str, ...]
    x: Array
    covariance: Array

    @cached_property
    def index(self) -> dict[str, int]:
        """The number of each variable, by name."""
        return {name: i for i, name in enumerate(self.names)}

    def rows(self, names: Sequence[str]) -> np.ndarray:
        """Return the numbers of these variables, (m,). Raises ``KeyError`` for an unknown one."""
        return np.array([self.index[name] for name in names], dtype=np.int64)


def joint_solution(information: Iterable[RunInformation]) -> JointSolution:
    """Solve the rows of all runs. The first run's offset is held at 0 where no run had a fix.

    Every variable must be determined by the rows: an anchor by the run that defined it, a roll by its prior, an offset
    by an anchor that another run has sighted too.
    """
    runs = list(information)
    names = tuple(dict.fromkeys(name for run in runs for name in run.variables))
    column = {name: i for i, name in enumerate(names)}
    rows = [_widened(run, column) for run in runs]
    offsets = [name for name in names if name.endswith("/offset_m")]
    if len(offsets) == len(runs):
        rows.append(np.zeros((1, len(names) + 1)))
        rows[-1][0, column[offsets[0]]] = 1.0 / _HELD_SD
    with one_thread():
        triangle = np.asarray(np.linalg.qr(np.concatenate(rows), mode="r"))
    R, d = triangle[: len(names), :-1], triangle[: len(names), -1]
    inverse = solve_triangular(R, np.eye(len(names)))
    return JointSolution(names, inverse @ d, inverse @ inverse.T)


def pooled(some: RunInformation, more: RunInformation, alone: Collection[str] = ()) -> RunInformation:
    """Return the information of both as an upper triangle, with the variables ``alone`` eliminated from it."""
    names = sorted(dict.fromkeys((*some.variables, *more.variables)), key=lambda name: name not in alone)
    column = {name: i for i, name in enumerate(names)}
    with one_thread():
        rows = np.concatenate([_widened(some, column), _widened(more, column)])
        triangle = np.asarray(np.linalg.qr(rows, mode="r"))
    first = len(set(names).intersection(alone))
    kept = triangle[first : len(names), first:]
    return RunInformation(tuple(names[first:]), kept[:, :-1], kept[:, -1])


def _widened(information: RunInformation, column: dict[str, int]) -> Array:
    out = np.zeros((len(information.d), len(column) + 1))
    out[:, [column[name] for name in information.variables]] = information.R
    out[:, -1] = information.d
    return out

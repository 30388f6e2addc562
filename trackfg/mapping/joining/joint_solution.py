"""The estimate of a map's variables from what all its runs say.

A run says ``R_r x = d_r + e``, ``e ~ N(0, I)``, of the variables x that it touches
(:mod:`trackfg.mapping.joining.anchors`). The runs' errors are independent, so that the joint estimate is the
least-squares solution of all rows stacked, by QR: what the full joint graph of all runs would give, since eliminating a
run's own states first changes nothing.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import solve_triangular

from trackfg.maps.feature_map import RunInformation
from trackfg.numerics.arrays import Array
from trackfg.numerics.blas_threads import one_thread

_HELD_SD = 1e-3
"""Of the offset of one run, m, where no run knows where on the line it was."""


@dataclass(frozen=True)
class Joint:
    """Variables by name, their estimates ``x`` (n,) and ``covariance`` (n, n)."""

    names: tuple[str, ...]
    x: Array
    covariance: Array

    @cached_property
    def index(self) -> dict[str, int]:
        """Where each variable is."""
        return {name: i for i, name in enumerate(self.names)}

    def rows(self, names: Sequence[str]) -> np.ndarray:
        """Where these variables are, shape (m,). Raises ``KeyError`` for an unknown one."""
        return np.array([self.index[name] for name in names], dtype=np.int64)


def joint_solution(said: Iterable[RunInformation]) -> Joint:
    """From all runs. Where none knows where it was, the first one's offset is held at 0."""
    said = list(said)
    names = tuple(dict.fromkeys(name for information in said for name in information.variables))
    column = {name: i for i, name in enumerate(names)}
    rows = [_widened(information, column) for information in said]
    offsets = [name for name in names if name.endswith("/offset_m")]
    if len(offsets) == len(said):
        rows.append(np.zeros((1, len(names) + 1)))
        rows[-1][0, column[offsets[0]]] = 1.0 / _HELD_SD
    with one_thread():
        triangle = np.asarray(np.linalg.qr(np.concatenate(rows), mode="r"))
    R, d = triangle[: len(names), :-1], triangle[: len(names), -1]
    inverse = solve_triangular(R, np.eye(len(names)))
    return Joint(names, inverse @ d, inverse @ inverse.T)


def _widened(information: RunInformation, column: dict[str, int]) -> Array:
    out = np.zeros((len(information.d), len(column) + 1))
    out[:, [column[name] for name in information.variables]] = information.R
    out[:, -1] = information.d
    return out

"""Increments from cell to cell as they were measured, and the cells that a defect disturbs.

A defect of the track (a kick of the alignment, a kink, a step of cross-level) is none of the irregularities, which are
the same all along a line, and none of the curves. It disturbs the mean of one cell, or the step from one to the next.
Both are tried for every cell at once by a score test: with the whitened residuals ``r``, free of what the curves'
parameters can explain, and ``g`` the whitened disturbance of size 1, likewise, allowing it lowers ``chi^2`` by ``(g^T
r)^2 / g^T g``; its size is ``g^T r / g^T g``. A cell that is disturbed, or was not measured, has an infinite variance,
and so carries no information.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from trackfg.curves.increment_noise import IncrementNoise
from trackfg.numerics.arrays import Array

DISTURBED_FROM, PER_DISTURBANCE = 25.0, 15.0
"""Least gain, in chi-square, of a disturbance (five sigmas), and its price where it competes with curves. Chosen on
simulated lines; see Assumptions in docs/engine.md."""

_SILENT = 1e6
"""Variance without information, as a multiple of the noise's level: finite, to spare the rest from rounding."""
_OTHERWISE = 0.01
"""Least share of a disturbance that the curves' parameters do not explain."""


@dataclass(frozen=True)
class CellIncrements:
    """Increments from cell to cell, ``measured`` (n,), and their variances.

    ``known`` (n,): variances of the steps. ``between`` (n + 1,): variances of the means of the cells. ``least``: the
    least size of a disturbance. ``disturbances``: the number that were allowed. A variance is infinite where there is
    no information.
    """

    measured: Array
    known: Array
    between: Array
    least: float
    disturbances: int = 0

    def part(self, rows: slice) -> CellIncrements:
        """Return those of some rows, without the number of disturbances."""
        cells = slice(rows.start, rows.stop + 1)
        return CellIncrements(self.measured[rows], self.known[rows], self.between[cells], self.least)

    def with_part(self, rows: slice, part: CellIncrements) -> CellIncrements:
        """Return the increments with the disturbances of a part of them, too."""
        step_variance, between = self.known.copy(), self.between.copy()
        cells = slice(rows.start, rows.stop + 1)
        step_variance[rows] = np.maximum(step_variance[rows], part.known)
        between[cells] = np.maximum(between[cells], part.between)
        return replace(self, known=step_variance, between=between)

    @property
    def freedom(self) -> int:
        """The number of values that carry information."""
        silent = [int(np.isinf(variances).sum()) for variances in (self.known, self.between)]
        return len(self.measured) - sum(silent)

    @property
    def telling(self) -> np.ndarray:
        """True where an increment carries information by itself, (n,)."""
        silent = np.isinf(self.between)
        return np.asarray(~(np.isinf(self.known) | silent[1:] | silent[:-1]))


@dataclass(frozen=True)
class Observed:
    """Increments and their noise."""

    increments: CellIncrements
    noise: IncrementNoise

    @cached_property
    def white(self) -> Array:
        """The matrix (n, n) that whitens the increments."""
        # What says nothing must not drown the rest in rounding.
        most = _SILENT * self.noise.level
        step_variance, between = (np.minimum(v, most) for v in (self.increments.known, self.increments.between))
        return self.noise.whitener(step_variance, between)

    def most_disturbed(self, residuals: Array, slopes: Array) -> tuple[float, Observed]:
        """Return the greatest gain of a disturbance, and the increments with it allowed.

        ``residuals`` (n,) are whitened, of a fit with the whitened derivatives ``slopes`` (n, p).
        """
        n = len(residuals)
        steps = self.white
        cells = np.zeros((n, n + 1))
        cells[:, 1:] += steps
        cells[:, :-1] -= steps
        tried = np.hstack([steps, cells])
        size = np.einsum("ij,ij->j", tried, tried)
        if slopes.shape[1]:
            q = np.linalg.qr(slopes)[0]
            residuals = residuals - q @ (q.T @ residuals)
            explained = q.T @ tried
            remainder = size - np.einsum("ij,ij->j", explained, explained)
        else:
            remainder = size
        informative = np.isfinite(np.concatenate([self.increments.known, self.increments.between]))
        # Not what says nothing yet, nor what the curves explain as well, nor less than a defect.
        along, remainder = residuals @ tried, np.maximum(remainder, 1e-300)
        free = informative & (remainder > _OTHERWISE * size) & (np.abs(along) > self.increments.least * remainder)
        gains = np.where(free, along**2 / remainder, 0.0)
        k = int(np.argmax(gains))
        step_variance, between = self.increments.known.copy(), self.increments.between.copy()
        if k < n:
            step_variance[k] = np.inf
        else:
            between[k - n] = np.inf
        allowed = replace(
            self.increments, known=step_variance, between=between, disturbances=self.increments.disturbances + 1
        )
        return float(gains[k]), replace(self, increments=allowed)

    def undisturbed(self, residuals: Array, slopes: Array) -> Observed:
        """Return the increments with the disturbances allowed that residuals show, the greatest first.

        ``residuals`` (n,) are those besides the derivatives ``slopes`` (n, p). No more than a tenth of the cells are
        allowed; it returns itself where there is none.
        """
        observed = self
        for _ in range(len(residuals) // 10):
            gain, candidate = observed.most_disturbed(observed.white @ residuals, observed.white @ slopes)
            if gain < DISTURBED_FROM:
                break
            observed = candidate
        return observed

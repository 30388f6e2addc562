"""A line without a hole: its cells, the groups of curves on them, and the noise that the curves leave."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from trackfg.curves.cells import Cells
from trackfg.curves.fit import Stretch, canted
from trackfg.curves.increment_noise import IncrementNoise, fitted_noise
from trackfg.curves.increments import CellIncrements, Observed
from trackfg.curves.model import CurveChain, tilts, turns
from trackfg.curves.structure import structured
from trackfg.numerics.arrays import Array
from trackfg.numerics.spans import true_runs

_AROUND_M = 300.0
"""Length of straight beside a group that is fitted with it, m."""
_CLEAR_M = 15.0
"""Distance that such a straight keeps from the next group, m."""
_TURN_FLOOR_RAD = 2e-6
"""Least sigma of the noise of heading, rad."""
_TILT_FLOOR_MM = 1e-3
"""Least sigma of the noise of cross-level, mm."""
_LEAST_CLEAR = 0.2
"""Least share of straights of which the noise is estimated; with less it is taken from all cells."""
_UNEXPLAINED = 10.0
"""A chain whose cant leaves more than so many median residuals does not explain the cross-level."""
_WINDOW, _SEEN_TWICE = 120, 10
"""Cells in which disturbances are sought at a time, and by which such windows overlap."""


@dataclass(frozen=True)
class LineNoise:
    """The noise of the increments of heading, and of cross-level if the profile has any."""

    turn: IncrementNoise
    tilt: IncrementNoise | None


@dataclass(frozen=True)
class CurvedLine:
    """The cells of a line, and the groups of curves on them."""

    cells: Cells
    chains: tuple[CurveChain, ...]

    def turn_residuals(self) -> Array:
        """Return what the chains do not explain of the turns, rad (n,)."""
        out = self.cells.turn.measured.copy()
        for k, chain in enumerate(self.chains):
            rows = self._rows(k, overlapping=False)
            out[rows] -= turns(chain, self.cells.edges[rows.start : rows.stop + 2])[0]
        return out

    def tilt_residuals(self) -> Array:
        """Return what the chains do not explain of the increments of cross-level, mm (n - 1,).

        NaN along chains that have no cant, or do not explain them; empty where the profile has no cross-level.
        """
        if self.cells.tilt is None:
            return np.zeros(0)
        out, telling = self.cells.tilt.measured.copy(), self.cells.tilt.telling
        usual = float(np.median(np.abs(out)))
        beside = self._clear_tilts()
        for k, chain in enumerate(self.chains):
            rows = self._rows(k, overlapping=False)
            edges = self.cells.edges[rows.start : rows.stop + 2]
            steps = slice(rows.start, rows.stop - 1)
            out[steps] -= tilts(chain, edges[:-1] + 0.5 * self.cells.base_m)[0]
            residual = np.where(telling[steps] & ~beside[steps], out[steps], 0.0)
            if not np.any(chain.cant) or np.abs(residual).max(initial=0.0) > _UNEXPLAINED * usual:
                out[steps] = np.where(beside[steps], out[steps], np.nan)
        return out

    def clear(self) -> np.ndarray:
        """Return which cells are away from all curves, bool (n,)."""
        free = np.ones(len(self.cells), dtype=bool)
        x = self.cells.centres
        for chain in self.chains:
            low = chain.points[0] if chain.straight[0] else -np.inf
            high = chain.points[-1] if chain.straight[-1] else np.inf
            free &= (x < low - 2 * self.cells.base_m) | (x > high + 2 * self.cells.base_m)
        return free

    def stretch(self, k: int, noise: LineNoise) -> Stretch:
        """Return the stretch of group k and of the straights beside it."""
        rows, cells = self._rows(k, overlapping=True), self.cells
        tilt = None
        if noise.tilt is not None and cells.tilt is not None:
            tilt = Observed(cells.tilt.part(slice(rows.start, rows.stop - 1)), noise.tilt)
        return Stretch(
            edges=cells.edges[rows.start : rows.stop + 2],
            turn=Observed(cells.turn.part(rows), noise.turn),
            tilt=tilt,
            curvature_known=cells.curvature_known[rows],
            cross_level_known=cells.cross_level_known[rows],
        )

    def structured(self, noise: LineNoise) -> CurvedLine:
        """Return the line with the chains that the curvature shows, and the disturbed cells besides."""
        chains, turn = [], self.cells.turn
        for k, chain in enumerate(self.chains):
            fit = structured(chain, self.stretch(k, noise).without_tilt())
            if fit is not None and fit.stretch.turn is not None:
                chains.append(fit.chain)
                turn = turn.with_part(self._rows(k, overlapping=True), fit.stretch.turn.increments)
        return CurvedLine(replace(self.cells, turn=turn), tuple(chains))

    def canted(self, noise: LineNoise) -> CurvedLine:
        """Return the line with the cants that fit the cross-level best, and the disturbed cells besides."""
        chains, tilt = [], self.cells.tilt
        for k, chain in enumerate(self.chains):
            chain_canted, stretch = canted(chain, self.stretch(k, noise))
            chains.append(chain_canted)
            if tilt is not None and stretch.tilt is not None:
                rows = self._rows(k, overlapping=True)
                tilt = tilt.with_part(slice(rows.start, rows.stop - 1), stretch.tilt.increments)
        return CurvedLine(replace(self.cells, tilt=tilt), tuple(chains))

    def undisturbed(self, noise: LineNoise) -> CurvedLine:
        """Return the line with the cells of the straights that a defect disturbs."""
        turn = _undisturbed(self.cells.turn, noise.turn, self.clear())
        tilt = self.cells.tilt
        if tilt is not None and noise.tilt is not None:
            tilt = _undisturbed(tilt, noise.tilt, self._clear_tilts())
        return replace(self, cells=replace(self.cells, turn=turn, tilt=tilt))

    def _clear_tilts(self) -> np.ndarray:
        clear = self.clear()
        return np.asarray(clear[1:] & clear[:-1])

    def _rows(self, k: int, *, overlapping: bool) -> slice:
        """Return the cells of group k: to the next groups if ``overlapping``, else to half way there."""
        x = self.cells.centres
        chain = self.chains[k]
        low, high = -np.inf, np.inf
        share = 1.0 if overlapping else 0.5
        clear = _CLEAR_M if overlapping else 0.0
        if chain.straight[0]:
            low = chain.points[0] - _AROUND_M if overlapping else -np.inf
            if k > 0:
                previous_end = self.chains[k - 1].points[-1]
                low = max(low, chain.points[0] - share * (chain.points[0] - previous_end) + clear)
        if chain.straight[-1]:
            high = chain.points[-1] + _AROUND_M if overlapping else np.inf
            if k + 1 < len(self.chains):
                next_begin = self.chains[k + 1].points[0]
                high = min(high, chain.points[-1] + share * (next_begin - chain.points[-1]) - clear)
        # Neighbours that were pulled over each other keep what is their own.
        low, high = min(low, chain.points[0]), max(high, chain.points[-1])
        rows = np.flatnonzero((x >= low) & (x < high))
        return slice(int(rows[0]), int(rows[-1]) + 1)


def turn_noise(lines: Sequence[CurvedLine], *, straights_only: bool) -> IncrementNoise:
    """Estimate the noise of heading from the residuals: on the straights only if the curves are still a guess."""
    stretches = []
    for line in lines:
        used = line.clear() if straights_only else np.ones(len(line.cells), dtype=bool)
        if used.mean() < _LEAST_CLEAR:
            used[:] = True
        turn = line.cells.turn
        stretches.append((np.where(used & turn.telling, line.turn_residuals(), np.nan), turn.known))
    return fitted_noise(stretches, _TURN_FLOOR_RAD)


def tilt_noise(lines: Sequence[CurvedLine]) -> IncrementNoise | None:
    """Estimate the noise of cross-level from the residuals; None without any cross-level.

    Those beside curves without cant and along curves that explain it are used: a curve whose cant has ramps of its own
    explains little.
    """
    stretches = [
        (np.where(line.cells.tilt.telling, line.tilt_residuals(), np.nan), line.cells.tilt.known)
        for line in lines
        if line.cells.tilt is not None
    ]
    return fitted_noise(stretches, _TILT_FLOOR_MM) if stretches else None


def _undisturbed(increments: CellIncrements, noise: IncrementNoise, clear: np.ndarray) -> CellIncrements:
    """Return the increments with the disturbances of the clear cells, which have no other cause."""
    for first, stop in true_runs(clear):
        count = max(1, round((stop - first) / _WINDOW))
        for low, high in itertools.pairwise(np.linspace(first, stop, count + 1).astype(int)):
            # A little is seen twice, so that nothing hides at a window's end.
            rows = slice(max(int(low) - _SEEN_TWICE, int(first)), int(high))
            observed = Observed(increments.part(rows), noise)
            disturbed = observed.undisturbed(observed.increments.measured, np.zeros((rows.stop - rows.start, 0)))
            if disturbed is not observed:
                increments = increments.with_part(rows, disturbed.increments)
    return increments

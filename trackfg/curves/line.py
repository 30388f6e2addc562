"""A line without a gap: its cells, the groups of curves on them, and the noise that the curves leave over."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from trackfg.curves.fit import Stretch, canted
from trackfg.curves.increment_noise import IncrementNoise, fitted_noise
from trackfg.curves.model import CurveChain, tilts, turns
from trackfg.curves.segments import Cells
from trackfg.curves.structure import structured
from trackfg.frames import Array

_AROUND_M = 300.0
_CLEAR_M = 15.0
_TURN_FLOOR_RAD = 2e-6
_TILT_FLOOR_MM = 1e-3
_LEAST_CLEAR = 0.2
_UNEXPLAINED = 10.0


@dataclass(frozen=True)
class LineNoise:
    turn: IncrementNoise
    tilt: IncrementNoise | None


@dataclass(frozen=True)
class CurvedLine:
    """Cells without a gap, and the groups of curves on them."""

    cells: Cells
    chains: tuple[CurveChain, ...]

    def turn_residuals(self) -> Array:
        """What the chains do not explain. Shape (n,)."""
        out = self.cells.turn.copy()
        for k, chain in enumerate(self.chains):
            rows = self._rows(k, overlapping=False)
            out[rows] -= turns(chain, self.cells.edges[rows.start : rows.stop + 2])[0]
        return out

    def tilt_residuals(self) -> Array | None:
        """What the chains do not explain of the increments of cross-level; NaN along chains that have no cant, or do
        not explain them. Shape (n - 1,).
        """
        if self.cells.cross_level is None:
            return None
        out = np.diff(self.cells.cross_level)
        usual = float(np.median(np.abs(out)))
        clear = self.clear()
        beside = clear[1:] & clear[:-1]
        for k, chain in enumerate(self.chains):
            rows = self._rows(k, overlapping=False)
            edges = self.cells.edges[rows.start : rows.stop + 2]
            here = slice(rows.start, rows.stop - 1)
            out[here] -= tilts(chain, edges[:-1] + 0.5 * self.cells.base_m)[0]
            left = np.where(beside[here], 0.0, out[here])
            if not np.any(chain.cant) or np.abs(left).max(initial=0.0) > _UNEXPLAINED * usual:
                out[here] = np.where(beside[here], out[here], np.nan)
        return out

    def clear(self) -> np.ndarray:
        """Cells away from all curves."""
        free = np.ones(len(self.cells.turn), dtype=bool)
        x = self.cells.centres
        for chain in self.chains:
            low = chain.points[0] if chain.straight[0] else -np.inf
            high = chain.points[-1] if chain.straight[-1] else np.inf
            free &= (x < low - 2 * self.cells.base_m) | (x > high + 2 * self.cells.base_m)
        return free

    def stretch(self, k: int, noise: LineNoise, with_tilt: bool) -> Stretch:
        """Group k and what of the straights beside it is near."""
        rows, cells = self._rows(k, overlapping=True), self.cells
        edges, known = cells.edges[rows.start : rows.stop + 2], cells.turn_known[rows]
        stretch = Stretch(edges, cells.turn[rows], noise.turn.whitener(known), known / cells.base_m**2)
        if not with_tilt or noise.tilt is None or cells.cross_level is None or cells.cross_level_known is None:
            return stretch
        tilt = np.diff(cells.cross_level[rows])
        white = noise.tilt.whitener(np.zeros(len(tilt)))
        return replace(stretch, tilt=tilt, tilt_white=white, cross_level_known=cells.cross_level_known[rows])

    def structured(self, noise: LineNoise, widest_radius_m: float) -> CurvedLine:
        """With the chains that the curvature shows."""
        stretches = [self.stretch(k, noise, False) for k in range(len(self.chains))]
        fits = [structured(c, stretch, widest_radius_m) for c, stretch in zip(self.chains, stretches, strict=True)]
        return replace(self, chains=tuple(fit.chain for fit in fits if fit is not None))

    def canted(self, noise: LineNoise) -> CurvedLine:
        """With the cants that fit the cross-level best."""
        stretches = [self.stretch(k, noise, True) for k in range(len(self.chains))]
        chains = tuple(canted(chain, stretch) for chain, stretch in zip(self.chains, stretches, strict=True))
        return replace(self, chains=chains)

    def _rows(self, k: int, *, overlapping: bool) -> slice:
        """The cells of group k: to the next groups if ``overlapping``, else to half way there."""
        x = self.cells.centres
        chain = self.chains[k]
        low, high = -np.inf, np.inf
        share = 1.0 if overlapping else 0.5
        clear = _CLEAR_M if overlapping else 0.0
        if chain.straight[0]:
            low = chain.points[0] - _AROUND_M if overlapping else -np.inf
            if k > 0:
                before = self.chains[k - 1].points[-1]
                low = max(low, chain.points[0] - share * (chain.points[0] - before) + clear)
        if chain.straight[-1]:
            high = chain.points[-1] + _AROUND_M if overlapping else np.inf
            if k + 1 < len(self.chains):
                after = self.chains[k + 1].points[0]
                high = min(high, chain.points[-1] + share * (after - chain.points[-1]) - clear)
        # Neighbours that were pulled over each other keep what is their own.
        low, high = min(low, chain.points[0]), max(high, chain.points[-1])
        rows = np.flatnonzero((x >= low) & (x < high))
        return slice(int(rows[0]), int(rows[-1]) + 1)


def turn_noise(lines: Sequence[CurvedLine], *, straights_only: bool) -> IncrementNoise:
    """Of heading, from what the curves leave over: on the straights alone if they are only guessed."""
    stretches = []
    for line in lines:
        used = line.clear() if straights_only else np.ones(len(line.cells.turn), dtype=bool)
        if used.mean() < _LEAST_CLEAR:
            used[:] = True
        stretches.append((np.where(used, line.turn_residuals(), np.nan), line.cells.turn_known))
    return fitted_noise(stretches, _TURN_FLOOR_RAD)


def tilt_noise(lines: Sequence[CurvedLine]) -> IncrementNoise | None:
    """Of cross-level, from what is left beside curves without cant and along those that explain it; None without any.

    A curve whose cant has ramps of its own explains little.
    """
    stretches = []
    for line in lines:
        residuals = line.tilt_residuals()
        if residuals is not None:
            stretches.append((residuals, np.zeros(len(residuals))))
    return fitted_noise(stretches, _TILT_FLOOR_MM) if stretches else None

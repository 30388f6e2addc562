"""A profile is condensed to cells as long as its curvature's base: turns and tilts from each cell to the next.

Holes of up to :data:`BRIDGED_M` are bridged: the change of heading and cross-level across them is unknown, but the
profile goes on. A longer hole, or the end of a profile, ends the cells.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd

from trackfg.curves.increments import CellIncrements
from trackfg.errors import BadInputError
from trackfg.numerics.arrays import Array
from trackfg.numerics.robust import robust_sd

BRIDGED_M = 30.0
"""Longest hole that is bridged, m."""
_FEWEST_CELLS = 12
"""Fewest cells of a stretch: with fewer no noise can be estimated."""
_LEAST_TURN_RAD, _LEAST_TILT_MM = 2e-4, 1.0
"""Least size of a defect, rad and mm. Chosen on simulated lines; see Assumptions in docs/engine.md."""


@dataclass(frozen=True)
class Cells:
    """A stretch of profile in cells of ``base_m``, with ``edges`` (n + 2,) m.

    ``turn`` (n), rad: the change of the mean heading from a cell to the next. ``tilt`` (n - 1), mm: that of the mean
    cross-level, None where the profile has none. ``curvature_known`` (n,), 1/m^2, and ``cross_level_known`` (n,), mm^2:
    the variances that the profile states for itself.
    """

    base_m: float
    edges: Array
    turn: CellIncrements
    tilt: CellIncrements | None
    curvature_known: Array
    cross_level_known: Array

    def __len__(self) -> int:
        return len(self.turn.measured)

    @property
    def centres(self) -> Array:
        """The middles of the cells, m (n,)."""
        return np.asarray(self.edges[1:-1])

    @property
    def curvature(self) -> Array:
        """The mean curvature of the cells, 1/m (n,)."""
        return np.asarray(self.turn.measured / self.base_m)

    @property
    def turn_sd(self) -> float:
        """The sigma of a turn, rad, from its deviations from the median of the eleven turns around it."""
        turn = self.turn.measured
        around = pd.Series(turn).rolling(11, center=True, min_periods=1).median().to_numpy()
        return robust_sd(turn - around)


def cells_of(profile: pd.DataFrame, base_m: float) -> list[Cells]:
    """Return the cells of a profile, one entry for each stretch without a long hole.

    ``profile`` has ``chainage_m`` ascending on a uniform grid (with holes, or NaN), ``curvature_1pm`` and its ``_sd``,
    and perhaps ``cross_level_mm`` (and its ``_sd``). Stretches shorter than twelve cells are left out.

    Raises :class:`BadInputError` where columns are missing, or the base is no whole multiple of the grid's step.
    """
    missing = [name for name in ("chainage_m", "curvature_1pm", "curvature_1pm_sd") if name not in profile]
    if missing:
        raise BadInputError(f"a profile without column {', '.join(missing)}; it has {', '.join(map(str, profile))}")
    chainage = profile["chainage_m"].to_numpy(dtype=np.float64)
    if len(chainage) < 2:
        return []
    step = float(np.diff(chainage).min())
    rows = round(base_m / step) if step > 0.0 else 0
    if step <= 0.0 or abs(rows * step - base_m) > 1e-6 * base_m:
        raise BadInputError(f"chainage in steps of {step:g} m; expected ascending, in a whole part of {base_m:g} m")
    place = np.round((chainage - chainage[0]) / step).astype(np.int64)
    names = ("curvature_1pm", "curvature_1pm_sd", "cross_level_mm", "cross_level_mm_sd")
    values = {name: profile[name].to_numpy(dtype=np.float64) for name in names if name in profile}
    for name in ("curvature_1pm", "cross_level_mm"):
        if f"{name}_sd" in values and not np.isfinite(values[f"{name}_sd"]).any():
            values[f"{name}_sd"] = np.zeros(len(chainage))  # nothing determines it: all noise is among the residuals
    known = np.isfinite(values["curvature_1pm"]) & np.isfinite(values["curvature_1pm_sd"])
    used = np.flatnonzero(known)
    far = np.flatnonzero(np.diff(place[used]) * step > BRIDGED_M + step)
    pieces = []
    for first, stop in zip([0, *(far + 1)], [*(far + 1), len(used)], strict=True):
        piece = used[first:stop]
        n = (place[piece[-1]] - place[piece[0]] + 1) // rows if piece.size else 0
        if n >= _FEWEST_CELLS:
            start = chainage[piece[0]] - 0.5 * (step + base_m)
            at = place - place[piece[0]]
            inside = (at >= 0) & (at < n * rows)
            pieces.append(_cells(start, n, rows, base_m, at[inside], {name: v[inside] for name, v in values.items()}))
    return pieces


def _cells(start: float, n: int, rows: int, base_m: float, at: np.ndarray, values: dict[str, Array]) -> Cells:
    """Return the cells of the rows ``at`` places from 0 to n rows - 1."""
    means, whole = {}, {}
    for name, value in values.items():
        measured = np.isfinite(value)
        if measured.any():
            everywhere = np.interp(np.arange(n * rows), at[measured], value[measured])
            means[name] = everywhere.reshape(n, rows).mean(axis=1)
            count = np.bincount(at[measured] // rows, minlength=n)
            whole[name] = count == rows
    curvature_known = means["curvature_1pm_sd"] ** 2
    turn = CellIncrements(
        measured=base_m * means["curvature_1pm"],
        known=np.where(whole["curvature_1pm"], base_m**2 * curvature_known, np.inf),
        between=np.zeros(n + 1),
        least=_LEAST_TURN_RAD,
    )
    tilt = None
    if "cross_level_mm" in means:
        between = np.where(whole["cross_level_mm"], 0.0, np.inf)
        tilt = CellIncrements(np.diff(means["cross_level_mm"]), np.zeros(n - 1), between, _LEAST_TILT_MM)
    cross_level_known = means.get("cross_level_mm_sd", np.zeros(n)) ** 2
    edges = start + base_m * np.arange(n + 2, dtype=np.float64)
    return Cells(base_m, edges, turn, tilt, curvature_known, cross_level_known)

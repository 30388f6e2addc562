"""Changes of the track: a run compared with the map, cell by cell.

The run is laid over the map (:mod:`trackfg.mapping.changes.overlay`), its residual shift is fitted
(:mod:`trackfg.mapping.changes.residual_shift`), and every quantity's difference, run less map, is compared with its
noise (:mod:`trackfg.mapping.changes.change_noise`). Cross-level and gradient carry the run's offset and wander: their
difference is taken without its running median over 150 m, smoothed over 50 m.

A cell has changed in a quantity if the difference is both

* significant: beyond the threshold that noise exceeds ``false_alarms_per_10_km`` times in 10 km, all quantities
  together, each having the same share of them;
* and large: ``floor_mm`` or more in cross-level, twist and versines, in gradient that over its base, in curvature that
  of a circle with such a versine over its base, ``8 floor / base^2``.

docs/maps.md says why.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import pandas as pd

from trackfg.mapping.changes.change_noise import WITHOUT_SLOW_PART, ChangeNoise, change_noise, slow_part, stated_sigmas
from trackfg.mapping.changes.overlay import QUANTITIES, SUMMARY_M, Overlay, overlay
from trackfg.mapping.changes.residual_shift import residual_shift
from trackfg.numerics.arrays import Array
from trackfg.numerics.key_figures import Outlined
from trackfg.numerics.spans import true_stretches
from trackfg.results.summary import GeometryConventions

Kind = Literal["dip", "kick", "twist", "curvature"]
CHANGE_COLUMNS = ("from_m", "to_m", "quantity", "change", "change_sd", "sigmas", "before", "after", "kind")

_TOGETHER_M = 10.0
"""Changed cells this near, m, are one change: the base of versines and curvature."""
_LONG_M = 30.0
"""Length, m, above which a lateral change is one of the curve and not of a place in it: three bases."""


@dataclass(frozen=True, repr=False)
class Changes(Outlined):
    """Changes of the track, and what would have been found.

    ``table``: one row per change, columns :data:`CHANGE_COLUMNS`: where, the quantity that changed most in mm (or,
    where none in mm did, of gradient and curvature the one that is larger by its floor), its change at the cell where
    it is largest, ``before`` in the map and ``after`` in the run, without the slow difference, in the quantity's unit.

    ``cells``: one row per cell of the map from the first to the last that the run covers: ``chainage_m, observations``,
    the ``shift_m`` that was fitted, and every quantity's change and sigma; NaN where run or map knows nothing.

    ``thresholds``: one row per quantity: ``quantity, sigmas, floor, noise_factor`` (by which the residuals raised the
    sigmas), ``compared_m``.

    ``coverage``: one row per 200 m: ``from_m, to_m, compared`` (share of the cells in which every quantity is known),
    ``observations`` (the fewest), and for every quantity the least change that would have been found everywhere there.

    ``other_track``: whether the run differs from the map by as much as the map's own irregularities, so that it is of
    another track with the same curves, or followed maintenance of the whole length; its differences count as noise.
    """

    table: pd.DataFrame
    cells: pd.DataFrame
    thresholds: pd.DataFrame
    coverage: pd.DataFrame
    other_track: bool = False

    def write(self, path: str | Path) -> None:
        """Write the table as CSV."""
        self.table.to_csv(path, index=False)


def changes(
    run: pd.DataFrame,
    grid: pd.DataFrame,
    *,
    conventions: GeometryConventions,
    to_map: Callable[[Array], Array],
    shift_sd_m: Array,
    floor_mm: float = 1.0,
    false_alarms_per_10_km: float = 0.1,
) -> Changes:
    """Compare the geometry of a run (:attr:`trackfg.results.result.Result.geometry`) with the grid of a map.

    Both must mean the same: ``conventions`` are the run's, and the map's. ``to_map`` turns the run's chainage into the
    map's, rising with it; ``shift_sd_m`` is its sigma, for each row of ``run``.

    Raises ``ValueError`` for a ``to_map`` that does not rise, or another number of sigmas than rows.
    """
    over = overlay(run, grid, conventions=conventions, to_map=to_map, shift_sd_m=shift_sd_m)
    stated = stated_sigmas(over, conventions.chord_m)
    shift, shift_sd = residual_shift(over, stated)
    alike = _like_a_millimetre(conventions)
    each = false_alarms_per_10_km / 1e4 / len(QUANTITIES)
    compared: dict[str, _Compared] = {}
    for name in QUANTITIES:
        change = over.after_at(name, shift) - over.before(name)
        if name in WITHOUT_SLOW_PART:
            change = change - slow_part(change, over.step_m)
        noise = change_noise(over, name, change, stated[name], shift_sd)
        compared[name] = _Compared(change, noise, noise.sigmas_for(each), alike[name], floor_mm)
    cells = {"chainage_m": over.chainage, "observations": over.grid["observations"].to_numpy(), "shift_m": shift}
    for name, part in compared.items():
        cells |= {name: part.change, f"{name}_sd": part.noise.sigma}
    return Changes(
        table=_table(over, compared),
        cells=pd.DataFrame(cells),
        thresholds=_thresholds(compared, over.step_m),
        coverage=_coverage(over, compared),
    )


@dataclass(frozen=True)
class _Compared:
    """One quantity: its change, (n,), its noise, and the threshold in sigmas and in size.

    ``like_a_mm``: the change of this quantity that counts as large as 1 mm.
    """

    change: Array
    noise: ChangeNoise
    sigmas: float
    like_a_mm: float
    floor_mm: float

    @property
    def floor(self) -> float:
        """The least size of a change, in the quantity's unit."""
        return self.floor_mm * self.like_a_mm

    @property
    def least(self) -> Array:
        """The least change that would be found, (n,)."""
        return np.where(np.isfinite(self.change), np.maximum(self.sigmas * self.noise.sigma, self.floor), np.nan)

    @property
    def changed(self) -> np.ndarray:
        """True where the quantity has changed, (n,)."""
        return np.asarray(np.abs(self.change) >= self.least)

    def largest(self, rows: slice) -> int:
        """Return the row within ``rows`` where the changed cells change most; -1 without one."""
        size = np.where(self.changed[rows], np.abs(self.change[rows]), -1.0)
        at = int(np.argmax(size))
        return rows.start + at if size[at] >= 0.0 else -1


def _like_a_millimetre(conventions: GeometryConventions) -> dict[str, float]:
    return dict.fromkeys(QUANTITIES, 1.0) | {
        "gradient_permille": 1.0 / conventions.gradient_base_m,
        "curvature_1pm": 8e-3 / conventions.curvature_base_m**2,
    }


def _table(over: Overlay, compared: dict[str, _Compared]) -> pd.DataFrame:
    changed = np.any([part.changed for part in compared.values()], axis=0)
    stretches = true_stretches(changed, round(_TOGETHER_M / over.step_m))
    rows = [_row(over, compared, slice(first, stop)) for first, stop in stretches]
    return pd.DataFrame(rows, columns=list(CHANGE_COLUMNS))


def _row(over: Overlay, compared: dict[str, _Compared], rows: slice) -> dict[str, object]:
    """Return one change as a row: cells ``rows``, the first and the last of them changed."""
    places = {name: at for name, part in compared.items() if (at := part.largest(rows)) >= 0}
    size = {name: abs(compared[name].change[at]) / compared[name].like_a_mm for name, at in places.items()}
    in_mm = [name for name in size if name.endswith("_mm")]
    name = max(in_mm or size, key=size.__getitem__)
    at, part = places[name], compared[name]
    change, sd, map_value = part.change[at], part.noise.sigma[at], over.before(name)[at]
    return {
        "from_m": over.chainage[rows.start],
        "to_m": over.chainage[rows.stop - 1],
        "quantity": name,
        "change": change,
        "change_sd": sd,
        "sigmas": abs(change) / sd,
        "before": map_value,
        "after": map_value + change,
        "kind": _kind(compared, size, rows, _LONG_M / over.step_m),
    }


def _kind(compared: dict[str, _Compared], size: dict[str, float], rows: slice, long: float) -> Kind:
    """Guess the kind of a change from the quantities that changed, ``size`` as if in mm.

    One rail that dips takes the cross-level to one side and the level with it; a twist takes it to both sides, or
    leaves the level alone.
    """
    lateral = max(size.get(name, 0.0) for name in ("versine_alignment_mm", "curvature_1pm"))
    level = max(size.get(name, 0.0) for name in ("versine_level_mm", "gradient_permille"))
    twist = max(size.get(name, 0.0) for name in ("twist_mm", "cross_level_mm"))
    if lateral > max(level, twist):
        spread = max(np.sum(compared[name].changed[rows]) for name in ("versine_alignment_mm", "curvature_1pm"))
        return "curvature" if spread > long else "kick"
    cross_level = compared["cross_level_mm"].change[rows]
    least, most = np.nanmin(cross_level, initial=0.0), np.nanmax(cross_level, initial=0.0)
    both_sides = min(-least, most) > 0.5 * max(-least, most)
    return "twist" if twist > level and (both_sides or level < 0.3 * twist) else "dip"


def _thresholds(compared: dict[str, _Compared], step_m: float) -> pd.DataFrame:
    return pd.DataFrame(
        {
            "quantity": list(compared),
            "sigmas": [part.sigmas for part in compared.values()],
            "floor": [part.floor for part in compared.values()],
            "noise_factor": [part.noise.factor for part in compared.values()],
            "compared_m": [step_m * np.isfinite(part.least).sum() for part in compared.values()],
        }
    )


def _coverage(over: Overlay, compared: dict[str, _Compared]) -> pd.DataFrame:
    least = pd.DataFrame({name: part.least for name, part in compared.items()})
    groups = least.assign(
        compared=least.notna().all(axis=1).astype(np.float64), observations=over.grid["observations"].to_numpy()
    ).groupby(np.floor(over.chainage / SUMMARY_M + 1e-9) * SUMMARY_M)
    table = pd.concat([groups["compared"].mean(), groups["observations"].min(), groups[list(compared)].max()], axis=1)
    table.insert(0, "to_m", table.index + SUMMARY_M)
    return table.rename_axis("from_m").reset_index()

"""A track geometry is held against its limits: where it exceeds them, and which could not be judged."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from trackfg.errors import BadInputError
from trackfg.geometry.curves import CURVED_FROM_1PM, curve_sense, mean_curvature
from trackfg.geometry.judged_quantities import ColumnLengths, JudgedQuantity, quantities, step_of
from trackfg.geometry.limits import Limit, listed_levels
from trackfg.geometry.statistics import peaks, section_statistics
from trackfg.numerics.arrays import Array
from trackfg.numerics.spans import true_runs

COLUMNS = (
    "standard",
    "level",
    "parameter",
    "quantity",
    "column",
    "kind",
    "chainage_m",
    "chainage_m_sd",
    "from_m",
    "to_m",
    "length_m",
    "value_mm",
    "value_mm_sd",
    "limit_mm",
    "speed_kmh",
)
"""An exceedance: the limit, also in words (``quantity``), the judged column, the place of the largest value with its
1-sigma, the stretch, the value with its 1-sigma, the limit's value and the line's speed. A sigma that the table does
not have is NaN."""
UNKNOWN_COLUMNS = ("level", "parameter", "quantity", "column", "kind", "from_m", "to_m", "length_m")
"""A stretch over which a limit holds and what it limits is not known: its first and last row, and the rows' length."""


COLUMN_LENGTHS = ColumnLengths()
"""D1, a chord of 10 m and twist over 5 m: the defaults of a result's geometry."""


@dataclass(frozen=True)
class Judgement:
    """The exceedances, the limits that could not be judged, and where the others could not be.

    ``found``: one row per exceedance with :data:`COLUMNS`, by chainage. ``not_judged``: the limits that the table does
    not suffice for, with the reason. ``unknown``: one row per stretch with :data:`UNKNOWN_COLUMNS`.
    """

    found: pd.DataFrame
    not_judged: tuple[tuple[Limit, str], ...]
    unknown: pd.DataFrame

    def not_judged_levels(self) -> dict[tuple[str, str], str]:
        """Group the limits that were not judged: (quantity, reason) to the levels that it concerns, as one text."""
        return _grouped(((limit.quantity, reason), limit.level) for limit, reason in self.not_judged)

    def unknown_levels(self) -> dict[tuple[str, str], str]:
        """Group what was not judged everywhere: (quantity, length not known in m) to its levels, as one text."""
        return _grouped(((quantity, f"{m:.0f}"), level) for (quantity, level), m in self.unknown_m().items())

    def unknown_m(self) -> dict[tuple[str, str], float]:
        """Return over which length a quantity of a level is not known, m; of several columns that of the worst."""
        return {
            (str(quantity), str(level)): float(stretches.groupby("column")["length_m"].sum().max())
            for (quantity, level), stretches in self.unknown.groupby(["quantity", "level"], sort=False)
        }


def _grouped(levels: Iterable[tuple[tuple[str, str], str]]) -> dict[tuple[str, str], str]:
    """Return for each key its levels as one text."""
    groups: dict[tuple[str, str], list[str]] = {}
    for key, level in levels:
        groups.setdefault(key, []).append(level)
    return {key: listed_levels(group) for key, group in groups.items()}


def exceedances(
    geometry: pd.DataFrame,
    limits: Iterable[Limit],
    *,
    speed_kmh: float | ArrayLike,
    gauge_m: float | None = None,
    curve_from_1pm: float = CURVED_FROM_1PM,
    lengths: ColumnLengths = COLUMN_LENGTHS,
) -> Judgement:
    """Hold a geometry table against limits.

    ``geometry`` has ``chainage_m`` in equal steps and any columns that :mod:`trackfg.geometry.judged_quantities` names.
    ``speed_kmh`` is the line's, one or one per row (NaN: no limit that has a speed applies). ``gauge_m`` is the nominal
    gauge, for limits of gauge. Track is curved where ``curvature_1pm``, averaged over 50 m, exceeds ``curve_from_1pm``.
    ``lengths`` are the band, the chord and the base of twist of the table's columns.

    A peak is one row per run beyond the limit, with its largest value; a standard deviation or mean one row per section
    of which at least half is judged, with the highest speed in it. Raises ``BadInputError`` for a table without
    ``chainage_m`` or not in equal steps, and for speeds that do not fit it.
    """
    if "chainage_m" not in geometry:
        raise BadInputError("geometry: no column 'chainage_m'; expected one")
    chainage = geometry["chainage_m"].to_numpy(dtype=np.float64)
    step = step_of(chainage)
    speed = np.asarray(speed_kmh, dtype=np.float64)
    if speed.ndim and speed.shape != chainage.shape:
        raise BadInputError(f"speed_kmh has shape {speed.shape}; expected one number, or one per row ({len(chainage)})")
    speed = np.broadcast_to(speed, chainage.shape)
    sd = np.full(len(chainage), np.nan)
    if "chainage_m_sd" in geometry:
        sd = geometry["chainage_m_sd"].to_numpy(dtype=np.float64)
    to_left, without_curvature = None, np.zeros(len(chainage), dtype=bool)
    if "curvature_1pm" in geometry:
        curvature = geometry["curvature_1pm"].to_numpy(dtype=np.float64)
        to_left = curve_sense(chainage, curvature, curve_from_1pm)
        without_curvature = np.isnan(mean_curvature(chainage, curvature))

    tables, unknown, not_judged = [], [], []
    for limit in limits:
        if to_left is None and (limit.track != "any" or limit.parameter == "reverse_cross_level"):
            not_judged.append((limit, "needs the column curvature_1pm, to separate curves from tangent track"))
            continue
        sides = np.zeros(len(chainage)) if to_left is None else to_left
        judged = quantities(geometry, limit, sides, gauge_m, lengths)
        if isinstance(judged, str):
            not_judged.append((limit, judged))
            continue
        for quantity in judged:
            place = np.rint((quantity.chainage_m - chainage[0]) / step).astype(np.int64)
            nearest = np.minimum(place, len(chainage) - 1)
            applies = _applies(limit, speed[nearest], sides[nearest])
            tables.append(_judge(limit, quantity, applies, speed[nearest], sd[nearest]))
            perhaps = _applies(limit, speed[nearest], None) & without_curvature[nearest]
            unknown += _unknown(limit, quantity, applies | perhaps)
    tables = [table for table in tables if len(table)]
    rows = pd.concat(tables) if tables else pd.DataFrame(columns=list(COLUMNS))
    return Judgement(
        rows.sort_values("chainage_m", ignore_index=True, kind="stable"),
        tuple(not_judged),
        pd.DataFrame(unknown, columns=list(UNKNOWN_COLUMNS)).drop_duplicates(ignore_index=True),
    )


def _applies(limit: Limit, speed: Array, to_left: Array | None) -> np.ndarray:
    """Return where the limit's speeds hold and, where curves are given, its track."""
    applies = np.ones(len(speed), dtype=bool)
    if limit.speed_from_kmh is not None:
        applies &= speed > limit.speed_from_kmh
    if limit.speed_to_kmh is not None:
        applies &= speed <= limit.speed_to_kmh
    if limit.track != "any" and to_left is not None:
        applies &= (to_left != 0.0) == (limit.track == "curved")
    return applies


def _unknown(limit: Limit, quantity: JudgedQuantity, applies: np.ndarray) -> list[tuple[str | float, ...]]:
    """Return the stretches of one quantity that are not known where the limit applies, with ``UNKNOWN_COLUMNS``."""
    chainage = quantity.chainage_m
    step = float(chainage[-1] - chainage[0]) / (len(chainage) - 1)
    head = (limit.level, limit.parameter, limit.quantity, quantity.name, limit.kind)
    return [
        (*head, float(chainage[first]), float(chainage[stop - 1]), float(stop - first) * step)
        for first, stop in true_runs(applies & np.isnan(quantity.value_mm))
    ]


def _repeated(places_m: Array, count: int, within_m: float) -> np.ndarray:
    """Return which of rising places are among ``count`` that lie within a distance."""
    first = np.flatnonzero(places_m[count - 1 :] - places_m[: max(len(places_m) - count + 1, 0)] <= within_m)
    repeated = np.zeros(len(places_m), dtype=bool)
    repeated[(first[:, None] + np.arange(count)).ravel()] = True
    return repeated


def _judge(
    limit: Limit, quantity: JudgedQuantity, applies: np.ndarray, speed: Array, chainage_sd: Array
) -> pd.DataFrame:
    """Return the exceedances of one quantity."""
    chainage = quantity.chainage_m
    value = np.where(applies, quantity.value_mm, np.nan)
    if limit.kind == "peak":
        if quantity.one_sided:
            value = np.where(value > 0.0, value, np.nan)
        table = peaks(chainage, value, limit.value_mm).rename(columns={"value": "value_mm"})
        if limit.within_m is not None:
            table = table[_repeated(table["chainage_m"].to_numpy(), limit.repeats, limit.within_m)].copy()
        at = np.searchsorted(chainage, table["chainage_m"])
        table["speed_kmh"] = speed[at]
        table["chainage_m_sd"] = chainage_sd[at]
        table["value_mm_sd"] = np.nan if quantity.value_mm_sd is None else quantity.value_mm_sd[at]
    else:
        table = section_statistics(chainage, value, section_m=limit.section_m)
        table["value_mm"] = table["sd" if limit.kind == "sd" else "mean"]
        size = table["value_mm"] if quantity.one_sided else table["value_mm"].abs()
        half = 0.5 * limit.section_m / (chainage[1] - chainage[0])
        table = table[(size > limit.value_mm) & (table["count"] >= half)].copy()
        table["chainage_m"] = 0.5 * (table["from_m"] + table["to_m"])
        table["length_m"] = limit.section_m
        table["chainage_m_sd"] = table["value_mm_sd"] = np.nan
        table["speed_kmh"] = [
            speed[applies & (chainage >= begin) & (chainage < end)].max()
            for begin, end in zip(table["from_m"], table["to_m"], strict=True)
        ]
    table["standard"], table["level"], table["parameter"] = limit.standard, limit.level, limit.parameter
    table["quantity"] = limit.quantity
    table["column"], table["kind"], table["limit_mm"] = quantity.name, limit.kind, limit.value_mm
    return table[list(COLUMNS)]

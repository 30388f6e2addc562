"""Exceedances in the order of severity, and what each kilometre has of them.

Of two levels of a limit the one with the larger limit is the severer: who sends a gang wants to see a place once, under
the severest level that it exceeds.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from trackfg.numerics.arrays import Array
from trackfg.plots.sheet import BAND
from trackfg.results.official_places import KM_COLUMN

_FAMILY = ["standard", "parameter", "column", "kind"]
"""Limits that agree in these are levels of one another."""


@dataclass(frozen=True)
class KilometreExceedances:
    """The exceedances of a kilometre: how many of each level, how long they are together, and the worst of them.

    ``worst`` is a row of the severest level, of those that are sure if any are: that of the greatest ``share`` of its
    limit.
    """

    km: str
    counts: Mapping[str, int]
    length_m: float
    worst: Mapping[Any, Any]
    share: float

    @property
    def count(self) -> int:
        """Return how many exceedances there are."""
        return sum(self.counts.values())

    @property
    def worst_text(self) -> str:
        """Return the worst exceedance in words: what it is, its share of the limit, its place."""
        return f"{quantity_text(self.worst)}, {100.0 * self.share:.0f} % at {place_text(self.worst)}"


def counts_text(counts: Mapping[str, int]) -> str:
    """Return numbers by level in words: ``3 of class 4, 1 of class 5``."""
    return ", ".join(f"{number} of {level}" for level, number in counts.items())


def quantity_text(row: Mapping[Any, Any]) -> str:
    """Return what an exceedance is of, with the rail where it is of one."""
    rail = next((f", {side} rail" for side in ("left", "right") if f"_{side}_" in row["column"]), "")
    return f"{row['quantity']}{rail}"


def place_text(row: Mapping[Any, Any]) -> str:
    """Return where the peak of an exceedance is: the official place, or the chainage in km."""
    return row.get(KM_COLUMN) or f"{1e-3 * row['chainage_m']:.3f}"


def value_text(row: Mapping[Any, Any]) -> str:
    """Return the value of an exceedance with its sigma where it has one; or that it is not to be trusted."""
    value, sd = f"{row['value_mm']:.2f}", row["value_mm_sd"]
    if not row.get("trusted", True):
        return f"{value} (not trusted)"
    return value if math.isnan(sd) else f"{value} ± {sd:.2f}"


def sure(found: pd.DataFrame) -> NDArray[np.bool_]:
    """Return which exceedances are of what is to be trusted, and by 1.96 sigma or more where they have a sigma."""
    beyond = found["value_mm"].abs() - found["limit_mm"]
    out: NDArray[np.bool_] = np.ones(len(found), dtype=bool)
    if "value_mm_sd" in found:
        out &= ~(beyond < BAND * found["value_mm_sd"]).to_numpy()
    if "trusted" in found:
        out &= found["trusted"].to_numpy(dtype=bool)
    return out


def unsure_text(found: pd.DataFrame) -> str:
    """Return in words how many exceedances of what is to be trusted are not sure; nothing where all are."""
    trusted = found[found["trusted"].astype(bool)] if "trusted" in found else found
    unsure = int((~sure(trusted)).sum())
    return f"{unsure} of them by less than 1.96 sigma: the limit may be kept there." if unsure else ""


def by_kilometre(found: pd.DataFrame) -> list[KilometreExceedances]:
    """Return what each kilometre has that has any exceedance, in order of chainage.

    Kilometres are official ones where the table has them. ``found`` has each place once, the severest first:
    :func:`by_severity`.
    """
    if found.empty:
        return []
    levels = list(dict.fromkeys(found["level"]))
    found = found.assign(sure=sure(found), order=np.arange(len(found)))
    found = found.sort_values("chainage_m", kind="stable")
    km = [place_text(row).replace("+", ".").split(".")[0] for row in found.to_dict("records")]
    out = []
    for name, rows in found.groupby(pd.Series(km, found.index), sort=False):
        count = rows["level"].value_counts()
        counts = {level: int(count[level]) for level in levels if level in count}
        candidates = rows[rows["sure"]] if rows["sure"].any() else rows
        worst = candidates.iloc[int(np.argmin(candidates["order"]))].to_dict()
        share = abs(worst["value_mm"]) / worst["limit_mm"]
        out.append(KilometreExceedances(str(name), counts, float(rows["length_m"].sum()), worst, share))
    return out


def by_severity(found: pd.DataFrame) -> pd.DataFrame:
    """Return exceedances, the severest first, without those that a severer level of the same limit overlaps.

    Levels of one limit that have the same number are one: the first of them stands for all. Of two others the one with
    the larger limit is the severer; over all quantities levels are ordered by the median of their limit over the least
    limit of the same family that is exceeded. Within a level those that are sure come first, each in the order of the
    peak over its limit.
    """
    if found.empty:
        return found
    found = found.drop_duplicates([*_FAMILY, "from_m", "to_m", "limit_mm"], ignore_index=True)
    severest = found[~_under_a_severer_one(found)]
    size = found["limit_mm"] / found.groupby(_FAMILY)["limit_mm"].transform("min")
    rank = size.groupby(found["level"]).median()
    order = pd.DataFrame(
        {
            "rank": severest["level"].map(rank),
            "sure": sure(severest),
            "ratio": severest["value_mm"].abs() / severest["limit_mm"],
        }
    ).sort_values(["rank", "sure", "ratio"], ascending=False, kind="stable")
    return severest.loc[order.index].reset_index(drop=True)


def _under_a_severer_one(exceedances: pd.DataFrame) -> NDArray[np.bool_]:
    """Return whether a larger limit of the same family is exceeded within the stretch of each row, bool (n,)."""
    out = np.zeros(len(exceedances), dtype=bool)
    for rows in exceedances.reset_index(drop=True).groupby(_FAMILY).indices.values():
        table = exceedances.iloc[rows]
        start, end, limit = (table[name].to_numpy() for name in ("from_m", "to_m", "limit_mm"))
        for value in np.unique(limit)[1:]:
            above, below = limit == value, limit < value
            out[rows[below]] |= _overlap(start[below], end[below], start[above], end[above])
    return out


def _overlap(start: Array, end: Array, others_start: Array, others_end: Array) -> NDArray[np.bool_]:
    """Return whether each stretch meets any of the others: more of them have begun at its end than ended before it."""
    begin_count = np.searchsorted(np.sort(others_start), end, side="right")
    end_count = np.searchsorted(np.sort(others_end), start, side="left")
    return np.asarray(begin_count > end_count)

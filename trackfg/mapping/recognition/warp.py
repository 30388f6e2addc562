"""A warp is a function from one chainage to another along one track; tables are brought along by it.

Two estimates of the chainage of one place differ by an error that changes slowly; a :class:`Warp` is its piecewise
linear form. A table on whole multiples of a step is brought to the other chainage's multiples by quintic splines.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd

from trackfg.numerics.arrays import Array
from trackfg.numerics.chainage.chainage_grid import multiples_between
from trackfg.numerics.spans import nearest
from trackfg.numerics.splines import spline_at

_IN_PLACE_M = 1e-6
"""Rows that are so near to multiples of the step, m, are on them: rounding would cost the first or the last of them."""


@dataclass(frozen=True)
class Warp:
    """A piecewise linear function from ``old`` (n,) to ``new`` (n,), m, both ascending.

    Beyond the ends it shifts as at the ends. Raises ``ValueError`` for chainages that do not ascend, or for none.
    """

    old: Array
    new: Array

    def __post_init__(self) -> None:
        if len(self.old) == 0 or np.any(np.diff(self.old) <= 0.0) or np.any(np.diff(self.new) <= 0.0):
            raise ValueError("a warp needs places that ascend in both chainages")

    def __call__(self, old: Array) -> Array:
        """Return the new chainages of old ones."""
        return old + np.interp(old, self.old, self.new - self.old)

    def inverse(self, new: Array) -> Array:
        """Return the old chainages of new ones."""
        return new - np.interp(new, self.new, self.new - self.old)


def warped(table: pd.DataFrame, warp: Warp, step_m: float) -> pd.DataFrame:
    """Return a table by new chainages, on multiples of the step.

    ``table`` has ``chainage_m`` ascending on multiples of the step, perhaps with gaps. Values are brought over by
    splines, sigmas (``_sd``) linearly, whole numbers from the nearest row. Rows that have no old row within a step are
    left out. A table that stays in its place, up to rounding, is returned as it is.
    """
    old = table["chainage_m"].to_numpy()
    new = warp(old)
    on_step = np.abs(np.diff(old).min(initial=step_m) - step_m) < _IN_PLACE_M
    if on_step and np.abs(new - step_m * np.round(old / step_m)).max(initial=0.0) < _IN_PLACE_M:
        return table.copy()
    chainage = multiples_between(new[0], new[-1], step_m)
    place = warp.inverse(chainage)
    row = nearest(old, place)
    inside = np.abs(place - old[row]) <= step_m
    place, row = place[inside], row[inside]
    columns: dict[str, Array] = {"chainage_m": chainage[inside]}
    splines: dict[bytes, list[str]] = {}  # columns known at the same rows have one matrix to be solved
    for name in table.columns.drop("chainage_m"):
        values = table[name].to_numpy()
        if values.dtype.kind in "iu":
            columns[name] = values[row]
        elif str(name).endswith("_sd"):
            columns[name] = np.interp(place, old, values)
        else:
            splines.setdefault(np.isfinite(values).tobytes(), []).append(name)
    for names in splines.values():
        columns |= dict(zip(names, spline_at(old, table[names].to_numpy(), place).T, strict=True))
    return pd.DataFrame(columns, columns=list(table.columns))

"""The differences of an estimator from the smoother are listed kilometre by kilometre."""

from __future__ import annotations

from collections.abc import Collection, Iterator

import numpy as np
import pandas as pd

from trackfg.comparison.table import QUANTITIES, Difference, Task
from trackfg.evaluation.scores import rms
from trackfg.numerics.arrays import Array


def differences(
    tasks: Collection[Task], geometry: pd.DataFrame, positions: pd.DataFrame, smoother: pd.DataFrame
) -> Iterator[Difference]:
    """Yield the rms difference of every quantity that one estimator is for over every kilometre.

    ``tasks`` are that estimator's. ``geometry`` and ``positions`` are its curves as :mod:`trackfg.comparison.table` has
    them, with the smoother's in place of the truth; ``smoother`` is the smoother's trajectory.
    """
    if len(geometry):
        yield from _by_kilometre(tasks, geometry, "_error", geometry["chainage_m"].to_numpy())
    if len(positions):
        place = np.interp(positions["t_s"], smoother["t_s"], smoother["chainage_m"])
        yield from _by_kilometre(tasks, positions, "", place)


def _by_kilometre(tasks: Collection[Task], table: pd.DataFrame, suffix: str, chainage: Array) -> Iterator[Difference]:
    case, name = str(table["case"].iloc[0]), str(table["estimator"].iloc[0])
    for quantity, meaning in QUANTITIES.items():
        if quantity + suffix not in table or meaning.task not in tasks:
            continue
        error = table[quantity + suffix].to_numpy(dtype=np.float64)
        known = np.isfinite(error) & np.isfinite(chainage)
        error, km = error[known], np.floor(1e-3 * chainage[known])
        if meaning.statistic == "sd" and error.size:
            error = error - error.mean()
        for start in np.unique(km):
            rms_there = rms(error[km == start])
            yield Difference(case=case, estimator=name, quantity=quantity, from_km=float(start), rms=rms_there)

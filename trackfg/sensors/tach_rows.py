"""The rows of a tach are counts of equal steps or speeds, at regular times or at the pulses' own."""

from __future__ import annotations

import numpy as np
import pandas as pd

from trackfg.numerics.arrays import Array


def tach_quantum_m(tach: pd.DataFrame) -> float:
    """Return the distance of one count in a ``tach`` table, m: the largest step of which all steps are multiples.

    0 where the distance is not quantised (or finer than 1 um), as with an integrated speed.
    """
    return common_step(np.diff(tach["distance_m"].to_numpy()))


def common_step(values: Array) -> float:
    """Return the largest number of which all ``values`` (n,) are multiples, to 1 %; 0 where there is none above 1e-6.

    Values are rounded to 1e-8, far above the rounding of the doubles.
    """
    distinct = np.unique(np.round(np.abs(values), 8))
    distinct = distinct[distinct > 0]
    if distinct.size == 0:
        return 0.0
    differences = np.diff(distinct, prepend=0.0)
    quantum = float(np.min(differences[differences > 1e-7], initial=np.inf))
    if not 1e-6 <= quantum < np.inf:
        return 0.0
    counts = np.rint(distinct / quantum)
    quantum = float(np.sum(distinct) / np.sum(counts))
    off = np.abs(distinct / quantum - np.rint(distinct / quantum))
    return quantum if off.max() < 0.01 else 0.0


def rows_are_pulses(t: Array, distance: Array, quantum: float) -> bool:
    """Rows at the pulses' own times: one pulse each, at irregular intervals, and none at rest.

    ``t`` (n,), s; ``distance`` (n,) and ``quantum``, the distance of one count, m; 0 where there are none.
    """
    if quantum == 0.0:
        return False
    interval, step = np.diff(t), np.abs(np.diff(distance))
    return bool(np.mean(np.abs(step - quantum) < 0.5 * quantum) > 0.95 and np.std(interval) > 0.1 * np.mean(interval))

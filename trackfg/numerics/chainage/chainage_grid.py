"""Tables whose ``chainage_m`` is on whole multiples of one step, rows perhaps missing."""

from __future__ import annotations

import numpy as np
import pandas as pd

from trackfg.numerics.arrays import Array


def step_of(table: pd.DataFrame) -> float:
    """Return the step, m, of two rows or more: the least distance between neighbours."""
    return float(np.diff(table["chainage_m"].to_numpy()).min())


def cells_of(table: pd.DataFrame, step_m: float) -> np.ndarray:
    """Return chainage in whole steps."""
    return np.rint(table["chainage_m"].to_numpy() / step_m).astype(np.int64)


def multiples_between(first_m: float, last_m: float, step_m: float) -> Array:
    """Return the whole multiples of a step from one place to another, both included."""
    return np.arange(np.ceil(first_m / step_m), np.floor(last_m / step_m) + 1.0) * step_m

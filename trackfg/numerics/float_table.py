"""A table of numbers alone is made at once: for the few rows of a stream pandas takes longer than all before it did."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache

import numpy as np
import pandas as pd

from trackfg.numerics.arrays import Array


def float_table(columns: Mapping[str, Array]) -> pd.DataFrame:
    """Return a table of these columns of equal length, of which each lies in memory in a row."""
    return pd.DataFrame(np.stack(list(columns.values())).T, columns=_index(tuple(columns)))


@lru_cache(maxsize=16)
def _index(names: tuple[str, ...]) -> pd.Index:
    return pd.Index(names)

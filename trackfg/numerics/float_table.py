"""Tables of numbers are made, and their columns taken out, all at once: for the few rows of a stream pandas takes
longer over each column than all before it did.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from trackfg.numerics.arrays import Array


def float_table(columns: Mapping[str, Array]) -> pd.DataFrame:
    """Return a table of these columns of equal length, of which each lies in memory in a row."""
    return pd.DataFrame(np.stack(list(columns.values())).T, columns=_index(tuple(columns)), copy=False)


def columns_of(table: pd.DataFrame) -> dict[str, NDArray[Any]]:
    """Return the columns as arrays: together where all are alike, ten times as fast as one by one."""
    # Lists: iterating over a column or an index of pandas takes longer than all else.
    if all(kind == np.float64 for kind in table.dtypes.tolist()):
        return dict(zip(map(str, table.columns.tolist()), table.to_numpy().T, strict=True))
    return {str(name): column.to_numpy() for name, column in table.items()}


@lru_cache(maxsize=16)
def _index(names: tuple[str, ...]) -> pd.Index:
    return pd.Index(names)

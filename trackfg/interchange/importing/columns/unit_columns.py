"""A unit that stands in a column of its own in every row, beside the vector that it is of, becomes that of its columns.

Messages of brokers have it so: ``{"ts": ..., "v": [0.1, 0.2, 9.8], "unit": "m/s2"}``.
"""

from __future__ import annotations

import re
from dataclasses import replace

import pandas as pd

from trackfg.interchange.importing.columns.column_names import axis_and_rest
from trackfg.interchange.importing.columns.written_units import QUANTITIES, factor_of
from trackfg.interchange.importing.source_table import SourceTable

_UNIT = re.compile(r"^(?P<stem>|.*[\s_.])(units?|einheit)$", re.IGNORECASE)
"""The name of such a column, behind what the names of the columns beside it begin with."""


def with_units_of_a_column(table: SourceTable) -> SourceTable:
    """Return a table whose numbers along axes have the unit that a column of text beside them states in all rows."""
    matches = [match for name in table.columns if (match := _UNIT.match(name))]
    units = dict(table.units)
    for match in matches if len(matches) == 1 else ():
        cells = table.frame[match.string].dropna()
        if not pd.api.types.is_string_dtype(cells) or cells.empty or (cells != cells.iloc[0]).any():
            continue
        unit = str(cells.iloc[0]).strip()
        if all(factor_of(unit, quantity) is None for quantity in QUANTITIES):
            continue
        beside = [name for name in table.columns if name.startswith(match["stem"]) and name not in units]
        numbers = [name for name in beside if pd.api.types.is_numeric_dtype(table.frame[name])]
        units |= {name: unit for name in numbers if axis_and_rest(name)[0] is not None}
    return replace(table, units=units) if units != table.units else table

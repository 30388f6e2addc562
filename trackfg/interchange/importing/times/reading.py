"""Times of a source become seconds on one clock.

Dates are kept as whole nanoseconds since 1970 (UTC) until the recording's start is taken off, so that nothing is lost
to rounding. Stamps that repeat, because they are written more coarsely than samples are taken, are spread again.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd

from trackfg.errors import BadInputError
from trackfg.interchange.importing.source_table import SourceTable
from trackfg.interchange.importing.times.clock import Times
from trackfg.interchange.importing.times.notation import TimeNotation
from trackfg.interchange.importing.times.numeric_times import times_of_numbers
from trackfg.interchange.importing.times.written_times import times_of_text


def times_by_keys(table: SourceTable, keys: Mapping[str, Any]) -> Times:
    """Read a table's times by the keys of a section of a mapping: ``time``, one column or several, and where there are
    such ``time_unit``, ``time_format``, ``time_zone`` and ``tick_s``. Raises as :func:`read_times` does.
    """
    columns = (keys["time"],) if isinstance(keys["time"], str) else tuple(keys["time"])
    names = {"unit": "time_unit", "format": "time_format", "zone": "time_zone", "tick_s": "tick_s"}
    return read_times(table, columns, TimeNotation(**{name: keys[key] for name, key in names.items() if key in keys}))


def read_times(table: SourceTable, columns: tuple[str, ...], notation: TimeNotation) -> Times:
    """Read the time of each row from one column, or from a date and a time of day in two.

    Raises :class:`BadInputError` that names file, column and row where one cannot be read.
    """
    series = [table.column(name) for name in columns]
    label = f"{table.name}: column {' and '.join(repr(name) for name in columns)}"
    if len(series) == 1 and not pd.api.types.is_string_dtype(series[0]) and notation.format is None:
        values = table.numbers(columns[0])
        _refuse_empty(~np.isfinite(values), label, table.first_row)
        return times_of_numbers(values, series[0], notation, label)
    text = series[0].astype("string").str.strip()
    for further in series[1:]:
        text = text + " " + further.astype("string").str.strip()
    _refuse_empty((text.isna() | (text == "")).to_numpy(dtype=bool, na_value=True), label, table.first_row)
    return times_of_text(text, notation, label, table.first_row)


def _refuse_empty(empty: np.ndarray, label: str, first_row: int) -> None:
    """Raise :class:`BadInputError` with the first of the rows (n,) that have no time."""
    if empty.any():
        raise BadInputError(f"{label}, row {first_row + int(np.argmax(empty))}: is empty; expected a time")

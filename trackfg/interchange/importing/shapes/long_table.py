"""A table with a row for each value, as decoded CAN traces have it, becomes tables with a column for each signal.

Signals with the same times, as those of one message, are columns of one table, named after the first of them.
"""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pandas as pd

from trackfg.interchange.importing.source_table import SourceTable

_SIGNAL = re.compile(
    r"^_?(signal|channel|variable|parameter|quantity|field|metric|series|kanal|gr(ö|oe)(ß|ss)e)([\s_.]?name)?$",
    re.IGNORECASE,
)
_VALUE = re.compile(
    r"^_?((physical|phys|decoded|signal|channel)[\s_.]?)?(value|wert)([\s_.]?\(?phys\w*\)?)?$", re.IGNORECASE
)
_UNIT = re.compile(r"^units?$|^einheit$", re.IGNORECASE)
_MOST_SIGNALS = 10_000
"""Signals of a trace: the network of a vehicle has some thousand."""


def wide_tables(table: SourceTable, time: str | None) -> list[SourceTable]:
    """Return tables with a column for each signal; the ``table`` itself where it is none of a row for each value.

    ``time`` is the name of its column of times.
    """
    signal, value, unit = (table.name_like(pattern) for pattern in (_SIGNAL, _VALUE, _UNIT))
    if time is None or signal is None or value is None:
        return [table]
    rows = table.frame[table.frame[signal].notna()]
    number, names = pd.factorize(rows[signal].astype("string").str.strip())
    if not 1 < len(names) <= min(_MOST_SIGNALS, len(table.frame) // 2):
        return [table]
    numbers = SourceTable(table.name, rows[[value]], first_row=table.first_row).numbers(value)
    order = np.argsort(number, kind="stable")
    ends = np.cumsum(np.bincount(number))[:-1]
    times = rows[time].to_numpy()[order]
    units = {} if unit is None else rows.drop_duplicates(signal).set_index(signal)[unit].dropna().to_dict()
    made: list[tuple[np.ndarray, dict[str, np.ndarray]]] = []
    for name, t, values in zip(names, np.split(times, ends), np.split(numbers[order], ends), strict=True):
        same = next((columns for row_times, columns in made if np.array_equal(row_times, t)), None)
        if same is None:
            made.append((t, {str(name): values}))
        else:
            same[str(name)] = values
    return [
        replace(
            table,
            name=f"{table.name}/{next(iter(columns))}",
            frame=pd.DataFrame({time: t, **columns}),
            units={column: str(units[column]) for column in columns if column in units}
            | ({time: table.units[time]} if time in table.units else {}),
        )
        for t, columns in made
    ]

"""Tables with a kind of row for each sensor, or with a file for each channel, get a column for each channel."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pandas as pd

from trackfg.interchange.importing.columns.column_meaning import stem_of
from trackfg.interchange.importing.columns.column_names import parts_of
from trackfg.interchange.importing.columns.time_columns import time_columns
from trackfg.interchange.importing.source_table import SourceTable

_SENSOR = re.compile(
    r"^(sensor|source|device|topic|type|kind|stream|msg|message)([\s_.]?(type|name|id))?$", re.IGNORECASE
)
"""Names of columns that say which sensor a row is of."""
_VALUE = re.compile(r"^(value|wert|data|val|reading)s?([\s_(\[].*)?$", re.IGNORECASE)
_INSTANCE = re.compile(
    r"^(i|inst(ance)?|imu|(sensor|device|source|imu|node|unit)[\s_.]?(id|nr|no|number|index))$", re.IGNORECASE
)
"""Names of columns with the numbers of sensors that write their rows in turn."""
_LETTER, _MOST_INSTANCES = re.compile(r"i|inst(ance)?", re.IGNORECASE), 8
"""A name that may be that of a current, too, and how many sensors a device has, which it counts from 0 or 1."""
_IN_TURN = 0.05
"""Share of the rows that are another sensor's than the row before: sensors write one row each in turn, or packets of up
to 20. What changes more seldom is a state of the whole table.
"""
_MOST_SENSORS = 50
"""Sensors of a log whose rows say which one they are of."""


def by_sensor(table: SourceTable) -> list[SourceTable]:
    """Return a table for each sensor, with the columns that it fills, where a column says which one a row is of."""
    for name in table.columns:
        if not _says_sensor(name, table.frame[name], table.units.get(name) or parts_of(name).unit):
            continue
        sensors = table.frame[name].astype("string").str.strip()
        kinds = [str(kind) for kind in sensors.dropna().unique()]
        if not 1 < len(kinds) <= _MOST_SENSORS:
            continue
        parts = {kind: table.frame[(sensors == kind).to_numpy(dtype=bool, na_value=False)] for kind in kinds}
        filled = {
            kind: [c for c in part.columns if c != name and part[c].notna().any()] for kind, part in parts.items()
        }
        if any(not columns for columns in filled.values()):
            return [table]
        return [
            replace(table, name=f"{table.name}/{kind}", frame=parts[kind][columns].reset_index(drop=True))
            for kind, columns in filled.items()
        ]
    return [table]


def _says_sensor(name: str, column: pd.Series, unit: str) -> bool:
    """Return whether a column says which sensor a row is of, by a word or by its number, which has no ``unit``."""
    if pd.api.types.is_string_dtype(column):
        return _SENSOR.match(name.strip()) is not None
    if not _INSTANCE.match(name.strip()) or not pd.api.types.is_integer_dtype(column) or unit:
        return False
    if _LETTER.fullmatch(name.strip()):
        numbers = sorted(column.unique())
        if len(numbers) > _MOST_INSTANCES or numbers[0] not in (0, 1) or numbers[-1] - numbers[0] >= len(numbers):
            return False
    return bool((np.diff(column.to_numpy()) != 0).mean() > _IN_TURN) if len(column) > 1 else False


def with_joined_channels(tables: Sequence[SourceTable]) -> list[SourceTable]:
    """Return the tables, of which those with times and one ``value`` on the same times are columns of one table.

    Such a column is named after its table: ``gyro_x.csv`` with ``time,value`` is the column ``gyro_x``.
    """
    groups: dict[bytes, list[tuple[str, SourceTable]]] = {}
    out: list[SourceTable | bytes] = []
    for table in tables:
        times, value = time_columns(table), _only_value(table)
        if times is None or len(times) != 1 or value is None or times == (value,):
            out.append(table)
            continue
        key = pd.util.hash_pandas_object(table.frame[times[0]], index=False).to_numpy().tobytes()
        if key not in groups:
            out.append(key)
        groups.setdefault(key, []).append((times[0], _renamed(table, value)))
    return [table if isinstance(table, SourceTable) else _in_one(groups[table]) for table in out]


def _only_value(table: SourceTable) -> str | None:
    """Return the column of values of a table that has times and one channel; None for other tables."""
    return table.name_like(_VALUE) if len(table.columns) == 2 else None


def _renamed(table: SourceTable, value: str) -> SourceTable:
    name = stem_of(table.name)
    units = {name if column == value else column: unit for column, unit in table.units.items()}
    return replace(table, frame=table.frame.rename(columns={value: name}), units=units)


def _in_one(parts: list[tuple[str, SourceTable]]) -> SourceTable:
    time, first = parts[0]
    channels = [table.frame[[name for name in table.columns if name != clock]] for clock, table in parts]
    taken = [str(channel.columns[0]) for channel in channels]
    if len(set(taken)) < len(taken):
        channels = [
            channel.set_axis([f"{name}.{i + 1}"], axis=1)
            for i, (name, channel) in enumerate(zip(taken, channels, strict=True))
        ]
    units = {name: unit for _, table in parts for name, unit in table.units.items()}
    frame = pd.concat([first.frame[[time]], *channels], axis=1)
    notes = tuple(note for _, table in parts for note in table.notes)
    return replace(first, frame=frame, units=units, notes=notes)

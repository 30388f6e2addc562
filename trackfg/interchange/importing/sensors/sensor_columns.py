"""The columns of a sensor that a mapping names, and which rows say something of it."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import count
from typing import Any

import numpy as np

from trackfg.errors import BadInputError
from trackfg.interchange.importing.mapping import MappedSensor
from trackfg.interchange.importing.source_table import SourceTable
from trackfg.interchange.importing.stations import read_stations
from trackfg.numerics.arrays import Array
from trackfg.numerics.chainage.kilometrage import Kilometrage

_COLUMN_KEYS = {
    "imu": ("gyro", "accel"),
    "tach": ("column",),
    "fixes": ("chainage", "sd"),
    "gnss": ("position", "sd"),
    "gnss_speed": ("column", "sd"),
    "speed": ("column",),
    "laser": ("column",),
}
"""Keys of each kind of sensor that name columns."""
_MAY_BE_ABSENT = {("gnss_speed", "sd")}
"""Keys that a description need not have."""
_FIX_COLUMNS = {"chainage": "chainage_m", "sd": "sd_m"}
"""Columns of fixes that need no name in a description."""
_PLACE = "chainage_m"
"""The column of places that the source has in two."""
CONSTANT = "constant_"
"""What the name of a column begins with that holds a number of the mapping in each row."""


def sensor_columns(
    sensor: MappedSensor, table: SourceTable, kilometrage: Kilometrage | None
) -> tuple[dict[str, Array], dict[str, Any]]:
    """Return the columns by name, and the section with a name for every constant."""
    columns: dict[str, Array] = {}
    keys, number = dict(sensor.keys), count(1)
    for key in _COLUMN_KEYS[sensor.kind]:
        default = _FIX_COLUMNS.get(key) if sensor.kind == "fixes" else None
        value = keys.get(key, default)
        if value is None and (sensor.kind, key) in _MAY_BE_ABSENT:
            continue
        if value is None:
            raise BadInputError(f"[{sensor.section}]: no key {key!r}; expected the name of a column")
        if key == "chainage" and isinstance(value, list):
            columns[_PLACE] = read_stations(table, _two(value), sensor.reading.chainage_unit, kilometrage)
            keys[key] = _PLACE
            continue
        several = isinstance(value, list | tuple)
        names = []
        for part in value if several else [value]:
            place = next(number)
            name = part if isinstance(part, str) else f"{CONSTANT}{place}"
            if key == "chainage" and isinstance(part, str):
                columns[name] = read_stations(table, part, sensor.reading.chainage_unit, kilometrage)
            else:
                columns[name] = column_or_number(sensor, table, part)
            names.append(name)
        if key in keys:
            keys[key] = names if several else names[0]
    return columns, keys


def _two(names: list[Any]) -> tuple[str, str]:
    """Return the columns of a post and of the length from it."""
    if len(names) != 2 or not all(isinstance(name, str) for name in names):
        raise BadInputError(f"chainage = {names!r}: expected a column, or those of the post and of the length from it")
    return names[0], names[1]


def column_or_number(sensor: MappedSensor, table: SourceTable, part: Any) -> Array:
    """Return the column of that name, or a number in every row."""
    if isinstance(part, str):
        return table.numbers(part)
    if isinstance(part, int | float) and not isinstance(part, bool):
        return np.full(len(table.frame), float(part))
    raise BadInputError(f"[{sensor.section}]: {part!r} is no column; expected a name or a number")


def rows_with_values(
    sensor: MappedSensor, table: SourceTable, columns: Mapping[str, Array]
) -> tuple[np.ndarray, tuple[str, ...]]:
    """Return which rows (n,) have values of a sensor, and a note on those of an IMU that have not all of them.

    These few are gaps, which are bridged. Where there are as many as others, the columns are not of one sensor.
    """
    empty = {name: np.isnan(values) for name, values in columns.items() if not name.startswith(CONSTANT)}
    keep = ~np.all(list(empty.values()), axis=0)
    partial = keep & np.any(list(empty.values()), axis=0)
    count = int(np.count_nonzero(partial))
    if sensor.kind != "imu" or not 0 < 2 * count < np.count_nonzero(keep):
        return keep, ()
    names = ", ".join(name for name, cells in empty.items() if (cells & partial).any())
    rows = f"{count} row{'s' if count > 1 else ''} without a value of {names}"
    return keep & ~partial, (f"{table.name}: {rows} left out of [{sensor.section}]: a short gap is bridged",)

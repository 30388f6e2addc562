"""Gyro and accelerometer that have a table each are brought to the times of one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from trackfg.errors import BadInputError
from trackfg.interchange.importing.columns.time_columns import time_columns, time_unit
from trackfg.interchange.importing.mapping import MappedSensor
from trackfg.interchange.importing.sensors.recorded_columns import in_recorded_units
from trackfg.interchange.importing.sensors.rows_in_order import in_order, times_of_rows
from trackfg.interchange.importing.sensors.sensor_columns import rows_with_values
from trackfg.interchange.importing.sensors.sensor_table import SensorTable
from trackfg.interchange.importing.source_table import ROW_NUMBER, SourceTable
from trackfg.interchange.importing.times.clock import Times


def _with_times_of(table: SourceTable, sensor: MappedSensor) -> MappedSensor:
    """Return the sensor as read from a table of two, whose column of times may have a name of its own."""
    columns = time_columns(table)
    if columns is None or not set(sensor.time_columns).isdisjoint((*table.columns, ROW_NUMBER)):
        return sensor
    time = columns[0] if len(columns) == 1 else (columns[0], columns[1])
    return replace(sensor, reading=sensor.reading.model_copy(update={"time": time, **time_unit(table, columns)}))


def merged_imu(sensor: MappedSensor, gyro: SourceTable, accel: SourceTable) -> SensorTable:
    """Bring gyro and accelerometer of two tables together: the slower one is interpolated at the faster one's times."""
    streams, notes = [], list[str]()
    for key, table in (("gyro", gyro), ("accel", accel)):
        value = sensor.keys.get(key)
        if not isinstance(value, list | tuple) or len(value) != 3:
            raise BadInputError(f"[{sensor.section}]: key {key!r} is {value!r}; expected three columns")
        table, times = in_order(table, _with_times_of(table, sensor))
        columns = {str(name): table.numbers(str(name)) for name in value}
        keep, left_out = rows_with_values(sensor, table, columns)
        notes += left_out
        times, columns = times_of_rows(times, keep), {name: values[keep] for name, values in columns.items()}
        columns, keys = in_recorded_units(sensor, times, columns, {f"{key}_unit": sensor.keys.get(f"{key}_unit")})
        streams.append((times, columns, keys))
    clocks = [times for times, *_ in streams]
    clocks = [times.beside(clocks) for times in clocks]
    first_ns = [times.first_ns for times in clocks if times.first_ns is not None]
    if len(first_ns) == 1:
        raise BadInputError(f"{gyro.name} and {accel.name}: one has dates and the other has not; expected one clock")
    zero = min(first_ns, default=None)
    t = [times.since(zero) for times in clocks]
    begin, end = max(t[0][0], t[1][0]), min(t[0][-1], t[1][-1])
    if begin >= end:
        raise BadInputError(f"{gyro.name} and {accel.name}: they do not overlap in time; expected one recording")
    faster = int(len(t[1]) > len(t[0]))
    kept = (t[faster] >= begin) & (t[faster] <= end)
    common = t[faster][kept]
    columns = {}
    keys = {key: value for key, value in sensor.keys.items() if key not in ("gyro_unit", "accel_unit")}
    for i, (prefix, (_, values, stream_keys)) in enumerate(zip(("gyro", "accel"), streams, strict=True)):
        for name, column in values.items():
            columns[f"{prefix}_{name}"] = column[kept] if i == faster else np.interp(common, t[i], column)
        keys[prefix] = [f"{prefix}_{name}" for name in values]
        keys |= {key: value for key, value in stream_keys.items() if value is not None}
    assumed = tuple(note for times in clocks for note in times.notes)
    merged = replace(Times.after(zero, common, clocks[faster].zone, assumed), of_hour=clocks[faster].of_hour)
    return SensorTable(sensor, merged, columns, keys, notes=tuple(notes))

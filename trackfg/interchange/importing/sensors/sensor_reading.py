"""The table of a sensor is read from the tables of a source, as a mapping says.

A table whose rows say nothing about a sensor, as in logs of one wide table, loses these rows for it; so it does with
the few rows in which an inertial sensor has not all of its values.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from trackfg.errors import BadInputError
from trackfg.interchange.importing.mapping import BALISES, MappedSensor, Mapping, table_named
from trackfg.interchange.importing.sensors.balise_passages import balise_passages
from trackfg.interchange.importing.sensors.pulse_levels import first_missed
from trackfg.interchange.importing.sensors.receiver_rows import OF_A_RECEIVER, known_rows, measured_rows, with_sigmas
from trackfg.interchange.importing.sensors.recorded_columns import in_recorded_units
from trackfg.interchange.importing.sensors.rows_in_order import in_order, times_of_rows
from trackfg.interchange.importing.sensors.sensor_columns import CONSTANT, rows_with_values, sensor_columns
from trackfg.interchange.importing.sensors.sensor_table import SensorTable
from trackfg.interchange.importing.sensors.two_tables import merged_imu
from trackfg.interchange.importing.source_table import SourceTable
from trackfg.numerics.arrays import Array
from trackfg.numerics.chainage.passes import only_falls


def read_sensor(sensor: MappedSensor, tables: Sequence[SourceTable], mapping: Mapping) -> SensorTable:
    """Return the table of a sensor. Raises :class:`BadInputError` with file, column and row for what cannot be read."""
    kilometrage = mapping.kilometrage
    if sensor.kind == BALISES:
        return balise_passages(sensor, tables, kilometrage)
    sources = [table_named(tables, pattern, sensor.section) for pattern in sensor.files]
    if len(sources) == 2:
        return merged_imu(sensor, *sources)
    table, times = in_order(sources[0], sensor)
    columns, keys = sensor_columns(sensor, table, kilometrage)
    keep, notes = rows_with_values(sensor, table, columns)
    if sensor.kind in OF_A_RECEIVER:
        beside = next((one for one in mapping.sensors if one.kind == "gnss" and one.files == sensor.files), None)
        measured = [values for name, values in columns.items() if not name.startswith(CONSTANT)]
        keep &= known_rows(sensor, measured)
        columns, keys, of_heights = with_sigmas(sensor, table, columns, keys, keep)
        keep, left_out = measured_rows(sensor, beside, table, times.since(times.first_ns), measured, keep)
        notes += (*of_heights, *left_out)
    if not keep.all():
        times, columns = times_of_rows(times, keep), {name: values[keep] for name, values in columns.items()}
    if not any(len(values) for values in columns.values()):
        raise BadInputError(f"{table.name}: the columns of [{sensor.section}] are empty; expected values")
    if sensor.reading.levels:
        _refuse_missed_pulses(sensor, table, columns, np.flatnonzero(keep))
    columns, keys = in_recorded_units(sensor, times, columns, keys)
    if sensor.kind == "tach" and keys.get("kind") != "speed" and not keys.get("signed"):
        columns, of_sense = _of_the_other_sense(table, columns)
        notes += of_sense
    whole = table if table is sources[0] and keep.all() else None
    return SensorTable(sensor, times, columns, keys, notes=notes, whole=whole)


def _of_the_other_sense(table: SourceTable, columns: dict[str, Array]) -> tuple[dict[str, Array], tuple[str, ...]]:
    """Return the columns with those that only fall turned round, and a note on each of them."""
    falling = [name for name, values in columns.items() if only_falls(values)]
    notes = (
        f"{table.name}: {name} only falls, and is taken for a counter of the other sense. Hint: if the vehicle ran "
        "backwards all the way, state signed = true in the mapping"
        for name in falling
    )
    return columns | {name: columns[name][0] - columns[name] for name in falling}, tuple(notes)


def _refuse_missed_pulses(
    sensor: MappedSensor, table: SourceTable, columns: dict[str, Array], rows: np.ndarray
) -> None:
    """Raise :class:`BadInputError` where pulses may lie between the levels in ``rows`` of a table."""
    for name, levels in columns.items():
        if (missed := first_missed(levels)) is not None:
            raise BadInputError(
                f"{table.name}: column {name!r}, row {table.first_row + rows[missed]}: from here on a level of the "
                "pulse signal lasts one row only, or none: pulses are lost; expected rows at least twice as often as "
                f"pulses. Hint: log a counter of pulses, or leave [{sensor.section}] out of the mapping"
            )

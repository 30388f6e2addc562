"""Passages of balises, with their planned places in the same table or in one of its own."""

from __future__ import annotations

from collections.abc import Sequence

import pandas as pd

from trackfg.interchange.importing.mapping import MappedSensor, table_named
from trackfg.interchange.importing.sensors.balise_places import COLUMNS, planned_places
from trackfg.interchange.importing.sensors.rows_in_order import in_order, times_of_rows
from trackfg.interchange.importing.sensors.sensor_table import SensorTable
from trackfg.interchange.importing.source_table import SourceTable
from trackfg.numerics.chainage.kilometrage import Kilometrage

PLACES_FILE = "balise_places.parquet"


def balise_passages(
    sensor: MappedSensor, tables: Sequence[SourceTable], kilometrage: Kilometrage | None
) -> SensorTable:
    """Return the passages of balises, with their planned places in the same table or in one of its own."""
    keys = dict(sensor.keys)
    table, times = in_order(table_named(tables, sensor.files[0], sensor.section), sensor)
    beside = None if "places" not in keys else table_named(tables, str(keys["places"]), sensor.section)
    places = planned_places(beside or table, keys, sensor.reading.chainage_unit, kilometrage)
    ids = table.column(keys.get("id", COLUMNS.id))
    keep = (ids.notna() & (ids.astype("string").str.strip() != "")).to_numpy()
    passages = pd.DataFrame({COLUMNS.id: ids}) if beside is not None or places is None else places
    columns = {str(name): column for name, column in passages[keep].items()}
    keys |= {"id": COLUMNS.id, "chainage": COLUMNS.chainage, "sd": COLUMNS.sd}
    if beside is None:
        return SensorTable(sensor, times_of_rows(times, keep), columns, keys)
    return SensorTable(sensor, times_of_rows(times, keep), columns, {**keys, "places": PLACES_FILE}, places)

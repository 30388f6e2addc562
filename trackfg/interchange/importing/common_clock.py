"""The tables of a recording are brought to one clock, and its zero gets a date where a source has one."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime

from trackfg.errors import BadInputError
from trackfg.interchange.importing.mapping import Mapping, table_named
from trackfg.interchange.importing.sensors.sensor_table import SensorTable
from trackfg.interchange.importing.source_table import SourceTable
from trackfg.interchange.importing.stated_start import stated_start
from trackfg.interchange.importing.times.clock import Times, as_datetime, as_ns, start_of, stated_day
from trackfg.interchange.importing.times.zones import zone_named


def on_one_clock(
    parts: Sequence[SensorTable], mapping: Mapping, tables: Sequence[SourceTable]
) -> tuple[list[SensorTable], int | None]:
    """Return the parts with times of one clock, and the date of t = 0, ns since 1970, if there is one.

    Raises :class:`BadInputError` where the clocks cannot be brought together.
    """
    clocks = [part.times for part in parts]
    zones = [times.zone for times in clocks if times.zone is not None]
    day = stated_day(table.remarks for table in tables)
    if day is not None and zones and len(zones) == len(clocks):  # times of day alone
        clocks.append(Times.noon_of(day, zones[0]))
    parts = [part._replace(times=part.times.beside(clocks)) for part in parts]
    if mapping.top.get("start") is None and all(table.start_ns is None for table in tables):
        parts = _dated_by_lines_above(parts, tables)
    return parts, _start(parts, mapping, next((t.start_ns for t in tables if t.start_ns is not None), None))


def _dated_by_lines_above(parts: Sequence[SensorTable], tables: Sequence[SourceTable]) -> list[SensorTable]:
    """Return the parts; clocks that count from zeros of their own get dates where lines above their tables state these.

    That is where other clocks have dates, or where the lines state several. One date counts for all.
    """
    undated = [part for part in parts if part.times.have_own_zero]
    starts = {}
    for sensor in (part.sensor for part in undated):
        table = table_named(tables, sensor.files[0], sensor.section)
        if (stated := stated_start(table)) is not None:
            starts[sensor.section] = stated.ns(zone_named(sensor.reading.time_zone, sensor.files[0]))
    dates = set(starts.values())
    if len(dates) < (1 if len(undated) < len(parts) else 2) or (len(dates) > 1 and len(starts) < len(undated)):
        return list(parts)
    out = []
    for part in parts:
        if part in undated:
            zero = starts.get(part.sensor.section, min(dates))
            date = f"{as_datetime(zero):%Y-%m-%d %H:%M:%S} UTC"
            note = f"{part.sensor.files[0]}: counts from {date}, which a line above a table states"
            part = part._replace(times=Times.after(zero, part.times.since(None), None, (*part.times.notes, note)))
        out.append(part)
    return out


def _start(parts: Sequence[SensorTable], mapping: Mapping, stated_ns: int | None) -> int | None:
    """Return the date of t = 0, ns since 1970: the mapping's, else the source's own where a clock has no dates, else
    that of the IMU's first whole second.

    Raises :class:`BadInputError` where some clocks have dates and others have not, and no ``start`` says when.
    """
    given = mapping.top.get("start")
    dated = [part.sensor.section for part in parts if part.times.ns is not None]
    undated = [part.sensor.section for part in parts if part.times.ns is None]
    if isinstance(given, datetime):
        return as_ns(given if given.tzinfo is not None else given.replace(tzinfo=UTC))
    if stated_ns is not None and undated:
        return stated_ns
    if dated and undated:
        raise BadInputError(
            f"{mapping.name}: [{dated[0]}] has dates and [{undated[0]}] counts from a zero of its own; expected one "
            f"clock. Hint: state start, the date at which [{undated[0]}] counts 0"
        )
    imu = next(part for part in parts if part.sensor.kind == "imu")
    return start_of(imu.times)

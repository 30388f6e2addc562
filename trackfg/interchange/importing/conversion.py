"""The tables of a source become a recording, as a mapping says.

The recording has the source's own columns, units and axes, so that a wrong axis or unit is corrected by one edit of its
``recording.toml``; only times (seconds on one clock), places (m) and units that a recording does not know are
converted. A table whose rows say nothing about a sensor, as in logs of one wide table, loses these rows for it; so it
does with the few rows in which an inertial sensor has not all of its values.
"""

from __future__ import annotations

from collections.abc import Mapping as Dictionary
from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from itertools import count
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import tomli_w

from trackfg.errors import BadInputError, did_you_mean
from trackfg.files.atomic_folder import replaced_folder
from trackfg.files.owned_folder import refuse_used
from trackfg.interchange.importing.balise_places import COLUMNS, planned_places
from trackfg.interchange.importing.columns.receiver_state import (
    RANGE_SD_M,
    UNKNOWN_HEIGHT_SD_M,
    range_sd_m,
    without_position,
)
from trackfg.interchange.importing.columns.time_columns import time_columns, time_unit
from trackfg.interchange.importing.mapping import BALISES, MappedSensor, Mapping, fits
from trackfg.interchange.importing.pulse_levels import first_missed
from trackfg.interchange.importing.recorded_columns import in_plan, in_recorded_units
from trackfg.interchange.importing.sample_stamps import repeated_rows, sorted_rows, spread_stamps, tick_s
from trackfg.interchange.importing.source_table import ROW_NUMBER, SourceTable
from trackfg.interchange.importing.stated_start import stated_start
from trackfg.interchange.importing.stations import read_stations
from trackfg.interchange.importing.times.clock import Times, as_datetime, as_ns, start_of, stated_day
from trackfg.interchange.importing.times.reading import read_times
from trackfg.interchange.importing.times.zones import zone_named
from trackfg.io.description_reader import FILE_NAME, FORMAT
from trackfg.io.reader import LoadedRecording, load
from trackfg.io.writer import write_table
from trackfg.numerics.arrays import Array
from trackfg.numerics.chainage.kilometrage import Kilometrage
from trackfg.numerics.chainage.passes import only_falls
from trackfg.recording.findings import Finding, errors
from trackfg.recording.interpolated_rows import interpolated_rows
from trackfg.recording.receiver_epochs import held_rows

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

_OF_A_RECEIVER = ("gnss", "gnss_speed")
"""Kinds of sensors whose rows a table may hold."""

_FIX_COLUMNS = {"chainage": "chainage_m", "sd": "sd_m"}
"""Columns of fixes that need no name in a description."""

_FINE_TICK_S = 0.1
"""A clock that ticks more seldom may be so far off that the smoother has to find it."""
_TIME_DIGITS = 9
"""Decimals of times, s: dates are whole nanoseconds."""
_PLACES_FILE = "balise_places.parquet"
_PLACE = "chainage_m"
"""The column of places that the source has in two."""
_MOST_NAMED = 5
"""Errors of a recording that are named."""
_FAR_FROM_ZERO = 10.0
"""Heights, as they are written, that are never below this are not near 0 for a while: a step is no way of a railway."""
_CONSTANT = "constant_"
"""What the name of a column begins with that holds a number of the mapping in each row."""


class _Part(NamedTuple):
    """The table of one sensor: its times, its columns, its section in the description, and a table beside it.

    ``notes`` say what was left out; ``whole`` is the source's table whose rows these are, None where they are others.
    """

    sensor: MappedSensor
    times: Times
    columns: Dictionary[str, Array | pd.Series]
    keys: dict[str, Any]
    places: pd.DataFrame | None = None
    notes: tuple[str, ...] = ()
    whole: SourceTable | None = None


@dataclass(frozen=True)
class Imported:
    """What an import made: the folder, what ``trackfg check`` says of its structure and values, and rows by table."""

    folder: Path
    loaded: LoadedRecording
    rows: dict[str, int]


@dataclass
class Conversion:
    """A recording in memory, until it is written: its description, its tables by file, and the mapping's name.

    ``notes`` say what was assumed and what was left out; ``origins`` are names of the user's own, by file, and
    ``clocks`` those of the columns of time: here, and the user's own.
    """

    description: dict[str, Any]
    files: dict[str, pd.DataFrame]
    mapping_name: str
    notes: tuple[str, ...]
    origins: dict[str, str]
    clocks: dict[str, tuple[str, str]]

    def write(self, folder: Path) -> Imported:
        """Write the recording, complete or not at all; each table is dropped from memory once it is written.

        Raises :class:`BadInputError` where the recording could not be read back.
        """
        refuse_used(folder, "recordings are never overwritten")
        rows = {name: len(frame) for name, frame in self.files.items()}
        with replaced_folder(folder) as new:
            for name in rows:
                write_table(self.files.pop(name), new / name)
            (new / FILE_NAME).write_text(tomli_w.dumps(self.description), encoding="utf-8")
            loaded = load(new)
            if loaded.recording is None:
                raise BadInputError(f"{self.mapping_name}: the recording would not be usable: {self._refusal(loaded)}")
        return Imported(folder, loaded, rows)

    def _refusal(self, loaded: LoadedRecording) -> str:
        """Return the errors, in the names of the user's own files and columns: the recording is not there yet.

        What is wrong in a table of several sensors is reported once.
        """
        faults = list({one.sentence: one for one in map(self._of_the_source, errors(loaded.findings))}.values())
        also = "; ".join(one.sentence for one in faults[1:_MOST_NAMED])
        more = f" ({len(faults) - _MOST_NAMED} more)" if len(faults) > _MOST_NAMED else ""
        return f"{faults[0]}" + (f". Also: {also}{more}" if also else "")

    def _of_the_source(self, finding: Finding) -> Finding:
        file = finding.file or ""
        clock_column, source_column = self.clocks.get(file, ("", ""))
        column = source_column if clock_column and finding.column == clock_column else finding.column
        return replace(finding, file=self.origins.get(file, finding.file), column=column)


def write_imported(tables: Sequence[SourceTable], mapping: Mapping, folder: Path, *, run_id: str) -> Imported:
    """Write the recording that ``mapping`` makes of ``tables``: :func:`converted`, then :meth:`Conversion.write`."""
    return converted(tables, mapping, run_id=run_id).write(folder)


def converted(tables: Sequence[SourceTable], mapping: Mapping, *, run_id: str) -> Conversion:
    """Return the recording that ``mapping`` makes of ``tables``, which are not needed afterwards.

    ``run_id`` is used where the mapping has no ``id``. Raises :class:`BadInputError` where a column is missing or
    unreadable, and where clocks cannot be brought together; the message names file, column and row.
    """
    parts = [_part(sensor, tables, mapping) for sensor in mapping.sensors]
    clocks = [part.times for part in parts]
    zones = [times.zone for times in clocks if times.zone is not None]
    day = stated_day(table.remarks for table in tables)
    if day is not None and zones and len(zones) == len(clocks):  # times of day alone
        clocks.append(Times.noon_of(day, zones[0]))
    parts = [part._replace(times=part.times.beside(clocks)) for part in parts]
    if mapping.top.get("start") is None and all(table.start_ns is None for table in tables):
        parts = _dated_by_lines_above(parts, tables)
    start_ns = _start(parts, mapping, next((t.start_ns for t in tables if t.start_ns is not None), None))
    description, files = _described(parts, mapping, start_ns, run_id)
    notes = dict.fromkeys(text for part in parts for text in (*part.times.notes, *part.notes))
    origins = {_file_of(part): _origin(part) for part in parts}
    clocks_of = {_file_of(part): (_time_of(part), " and ".join(part.sensor.time_columns)) for part in parts}
    return Conversion(description, files, mapping.name, tuple(notes), origins, clocks_of)


def _file_of(part: _Part) -> str:
    """Return the name of the file that a part becomes."""
    return f"{part.sensor.section.replace('[', '_').rstrip(']')}.parquet"


def _time_of(part: _Part) -> str:
    """Return the name of the column of time in the file that a part becomes."""
    return "t" if "t" not in part.columns else "t_s"


def _origin(part: _Part) -> str:
    """Return the user's name of a part's table, and of which table its rows are counted where that is another."""
    if part.whole is not None:
        return part.whole.name
    return f"{_file_of(part)} of {' and '.join(part.sensor.files)}"


def table_named(tables: Sequence[SourceTable], pattern: str, section: str) -> SourceTable:
    """Return the one table that a name or pattern means. Raises :class:`BadInputError` where it is none or several."""
    names = [table.name for table in tables]
    if pattern in names:
        return tables[names.index(pattern)]
    matches = [table for table in tables if fits(table.name, pattern)]
    if len(matches) == 1:
        return matches[0]
    if matches:
        raise BadInputError(
            f"[{section}] file = {pattern!r} means {len(matches)} tables: {', '.join(t.name for t in matches[:10])}; "
            "expected one"
        )
    near = did_you_mean(pattern, names)
    raise BadInputError(
        f"[{section}] file = {pattern!r}: no such table; expected one of {', '.join(names[:30])}"
        + (f". Hint: {near}" if near else "")
    )


def _part(sensor: MappedSensor, tables: Sequence[SourceTable], mapping: Mapping) -> _Part:
    kilometrage = mapping.kilometrage
    beside = next((one for one in mapping.sensors if one.kind == "gnss" and one.files == sensor.files), None)
    if sensor.kind == BALISES:
        return _balises(sensor, tables, kilometrage)
    sources = [table_named(tables, pattern, sensor.section) for pattern in sensor.files]
    if len(sources) == 2:
        return _merged_imu(sensor, *sources)
    table, times = _in_order(sources[0], sensor)
    columns, keys = _columns(sensor, table, kilometrage)
    measured = [values for name, values in columns.items() if not name.startswith(_CONSTANT)]
    keep, notes = _says_something(sensor, table, columns)
    if sensor.kind == "gnss":
        plan = np.stack(measured[:2])
        keep &= np.isfinite(plan).all(axis=0) & (plan != 0.0).any(axis=0)  # what receivers write without a fix
        columns = _by_quality(sensor, table, columns, keys)
        columns, keys, of_heights = _without_zero_heights(table, columns, keys, keep)
        notes += of_heights
    if sensor.kind == "gnss_speed":
        speed, *sd = measured
        # A phone writes a speed of -1 where it has none, and a sigma of 0 where it knows none.
        keep &= np.all([speed >= 0.0, *(one > 0.0 for one in sd)], axis=0)
    if sensor.reading.valid is not None and sensor.kind in _OF_A_RECEIVER:
        keep &= ~without_position(table.column(sensor.reading.valid))
    if sensor.kind in _OF_A_RECEIVER:
        rows = np.flatnonzero(keep)
        part = replace(table, frame=table.frame.iloc[rows])
        t = times.since(times.first_ns)[rows]
        values = [column[rows] for column in measured]
        for find, what in ((_held, "repeat the values of the row above"), (_interpolated, "are interpolated")):
            if (left_out := rows[find(sensor, part, t, values, beside)]).size:
                keep[left_out] = False
                counted = f"{len(left_out)} of {len(rows)} rows {what}"
                notes += (f"{table.name}: {counted}, and are left out of [{sensor.section}]",)
                break
    if not keep.all():
        times, columns = _rows(times, keep), {name: values[keep] for name, values in columns.items()}
    if not any(len(values) for values in columns.values()):
        raise BadInputError(f"{table.name}: the columns of [{sensor.section}] are empty; expected values")
    if sensor.reading.levels:
        _refuse_missed_pulses(sensor, table, columns, np.flatnonzero(keep))
    columns, keys = in_recorded_units(sensor, times, columns, keys)
    if sensor.kind == "tach" and keys.get("kind") != "speed" and not keys.get("signed"):
        falling = [name for name, values in columns.items() if only_falls(values)]
        columns = columns | {name: columns[name][0] - columns[name] for name in falling}
        notes += tuple(
            f"{table.name}: {name} only falls, and is taken for a counter of the other sense. Hint: if the vehicle ran "
            "backwards all the way, state signed = true in the mapping"
            for name in falling
        )
    return _Part(sensor, times, columns, keys, notes=notes, whole=table if table is sources[0] and keep.all() else None)


def _refuse_missed_pulses(
    sensor: MappedSensor, table: SourceTable, columns: Dictionary[str, Array], rows: np.ndarray
) -> None:
    """Raise :class:`BadInputError` where pulses may lie between the levels in ``rows`` of a table."""
    for name, levels in columns.items():
        if (missed := first_missed(levels)) is not None:
            raise BadInputError(
                f"{table.name}: column {name!r}, row {table.first_row + rows[missed]}: from here on a level of the "
                "pulse signal lasts one row only, or none: pulses are lost; expected rows at least twice as often as "
                f"pulses. Hint: log a counter of pulses, or leave [{sensor.section}] out of the mapping"
            )


def _held(
    sensor: MappedSensor, table: SourceTable, t: Array, measured: Sequence[Array], beside: MappedSensor | None
) -> np.ndarray:
    """Return which rows (n,) at times t (n,), s, of a receiver hold what is ``measured`` of a row before.

    ``beside``: the positions of the same table, by which speeds are held, too, unless they have changed by themselves.
    """
    values, positions = np.stack(measured, axis=1), sensor if sensor.kind == "gnss" else beside
    if positions is None:
        return held_rows(t, values)
    place = np.stack([_column(positions, table, part) for part in positions.keys["position"]], axis=1)
    both = values if positions is sensor else np.concatenate([place, values], axis=1)
    return held_rows(t, both, in_plan(positions, place))


def _interpolated(
    sensor: MappedSensor, table: SourceTable, t: Array, measured: Sequence[Array], beside: MappedSensor | None
) -> np.ndarray:
    """Return which rows (n,) of a receiver are interpolated between its measurements; arguments as of :func:`_held`."""
    values = np.stack(measured, axis=1)
    return interpolated_rows(t, in_plan(sensor, values) if sensor.kind == "gnss" else values[:, :1])


def _by_quality(
    sensor: MappedSensor, table: SourceTable, columns: dict[str, Array], keys: dict[str, Any]
) -> dict[str, Array]:
    """Return the columns of positions, with constant sigmas times the dilution of precision and by quality.

    That of a constant height stays: no quality says how far the vehicle is from it.
    """
    factor = np.ones(len(table.frame))
    if sensor.reading.dop is not None:
        dop = table.numbers(sensor.reading.dop)
        factor = np.where(dop > 0.0, dop, 1.0)  # 0 or nothing: not known
    if sensor.reading.quality is not None:
        factor = factor * range_sd_m(table.column(sensor.reading.quality)) / RANGE_SD_M
    scaled = [
        sd
        for place, sd in zip(keys["position"], keys["sd"], strict=False)
        if sd.startswith(_CONSTANT) and not place.startswith(_CONSTANT)
    ]
    return {name: values * factor if name in scaled else values for name, values in columns.items()}


def _without_zero_heights(
    table: SourceTable, columns: dict[str, Array], keys: dict[str, Any], keep: np.ndarray
) -> tuple[dict[str, Array], dict[str, Any], tuple[str, ...]]:
    """Return columns and keys of positions with a wide sigma where the height is exactly 0 beside others far from it.

    Receivers write 0 for the height of a fix in two dimensions. ``keep``: the rows (n,) that have a position.
    """
    height, sd = keys["position"][2], keys["sd"][2]
    values = columns[height]
    zero = (values == 0.0) & keep
    others = np.abs(values[keep & ~zero & np.isfinite(values)])
    if not zero.any() or not others.size or others.min() < _FAR_FROM_ZERO:
        return columns, keys, ()
    wide = f"{_CONSTANT}height_sd"
    columns = {**columns, wide: np.where(zero, UNKNOWN_HEIGHT_SD_M, columns[sd])}
    keys = {**keys, "sd": [*keys["sd"][:2], wide]}
    note = f"{table.name}: {np.count_nonzero(zero)} heights of exactly 0 beside others of {others.min():g} and more"
    return columns, keys, (f"{note} are taken for none: their sigma is {UNKNOWN_HEIGHT_SD_M:g} m",)


def _says_something(
    sensor: MappedSensor, table: SourceTable, columns: Dictionary[str, Array]
) -> tuple[np.ndarray, tuple[str, ...]]:
    """Return which rows (n,) have values of a sensor, and a note on those of an IMU that have not all of them.

    These few are gaps, which are bridged. Where there are as many as others, the columns are not of one sensor.
    """
    empty = {name: np.isnan(values) for name, values in columns.items() if not name.startswith(_CONSTANT)}
    keep = ~np.all(list(empty.values()), axis=0)
    partial = keep & np.any(list(empty.values()), axis=0)
    count = int(np.count_nonzero(partial))
    if sensor.kind != "imu" or not 0 < 2 * count < np.count_nonzero(keep):
        return keep, ()
    names = ", ".join(name for name, cells in empty.items() if (cells & partial).any())
    rows = f"{count} row{'s' if count > 1 else ''} without a value of {names}"
    return keep & ~partial, (f"{table.name}: {rows} left out of [{sensor.section}]: a short gap is bridged",)


def _balises(sensor: MappedSensor, tables: Sequence[SourceTable], kilometrage: Kilometrage | None) -> _Part:
    """Return the passages of balises, with their planned places in the same table or in one of its own."""
    keys = dict(sensor.keys)
    table, times = _in_order(table_named(tables, sensor.files[0], sensor.section), sensor)
    beside = None if "places" not in keys else table_named(tables, str(keys["places"]), sensor.section)
    places = planned_places(beside or table, keys, sensor.reading.chainage_unit, kilometrage)
    ids = table.column(keys.get("id", COLUMNS.id))
    keep = (ids.notna() & (ids.astype("string").str.strip() != "")).to_numpy()
    passages = pd.DataFrame({COLUMNS.id: ids}) if beside is not None or places is None else places
    columns = {str(name): column for name, column in passages[keep].items()}
    keys |= {"id": COLUMNS.id, "chainage": COLUMNS.chainage, "sd": COLUMNS.sd}
    if beside is None:
        return _Part(sensor, _rows(times, keep), columns, keys)
    return _Part(sensor, _rows(times, keep), columns, {**keys, "places": _PLACES_FILE}, places)


def _columns(
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
            name = part if isinstance(part, str) else f"{_CONSTANT}{place}"
            if key == "chainage" and isinstance(part, str):
                columns[name] = read_stations(table, part, sensor.reading.chainage_unit, kilometrage)
            else:
                columns[name] = _column(sensor, table, part)
            names.append(name)
        if key in keys:
            keys[key] = names if several else names[0]
    return columns, keys


def _two(names: list[Any]) -> tuple[str, str]:
    """Return the columns of a post and of the length from it."""
    if len(names) != 2 or not all(isinstance(name, str) for name in names):
        raise BadInputError(f"chainage = {names!r}: expected a column, or those of the post and of the length from it")
    return names[0], names[1]


def _column(sensor: MappedSensor, table: SourceTable, part: Any) -> Array:
    """Return the column of that name, or a number in every row."""
    if isinstance(part, str):
        return table.numbers(part)
    if isinstance(part, int | float) and not isinstance(part, bool):
        return np.full(len(table.frame), float(part))
    raise BadInputError(f"[{sensor.section}]: {part!r} is no column; expected a name or a number")


def _in_order(table: SourceTable, sensor: MappedSensor) -> tuple[SourceTable, Times]:
    """Return the table and the times of its rows: in sequence, and where samples are regular without repetitions.

    Rows that are written twice count once; other stamps that repeat are spread again, unless their rows are those of
    several sensors. Of positions at one time the last counts: a phone corrects its first ones.
    """
    times = read_times(table, sensor.time_columns, sensor.notation)
    since = times.since(times.first_ns)
    order = sorted_rows(since)
    if order is not None:
        table, times = _taken(table, times, order)
        since = times.since(times.first_ns)
    if (np.diff(since) == 0.0).any() and _are_of_several(table, since):
        return table, times
    if sensor.kind == "gnss":
        last = np.append(np.diff(since) != 0.0, True)
        if 2 * np.count_nonzero(last) > last.size and not last.all():
            return _taken(table, times, np.flatnonzero(last))
    if sensor.kind in ("fixes", BALISES) or (sensor.kind == "gnss" and last.all()):
        return table, times
    twice = repeated_rows(since, table.frame)
    if twice is not None:
        table, times = _taken(table, times, np.flatnonzero(~twice))
        since = times.since(times.first_ns)
    spread = spread_stamps(since)
    if spread is since:
        return table, times
    tick = tick_s(since)
    notes = times.notes
    if tick is not None and tick > _FINE_TICK_S:
        notes += (
            f"{table.name}: the clock ticks every {tick:.4g} s only: rows are spread, and may all be half of it off",
        )
    return table, replace(Times.after(times.first_ns, spread, times.zone, notes), of_hour=times.of_hour)


def _are_of_several(table: SourceTable, t: Array) -> bool:
    """Return whether rows with one time (n,), s, fill other columns: each sensor writes a row of its own."""
    return not table.frame.notna().assign(**{"": t}).duplicated().any()


def _taken(table: SourceTable, times: Times, rows: np.ndarray) -> tuple[SourceTable, Times]:
    return replace(table, frame=table.frame.iloc[rows].reset_index(drop=True)), _rows(times, rows)


def _rows(times: Times, keep: np.ndarray) -> Times:
    ns, seconds = (None if values is None else values[keep] for values in (times.ns, times.seconds))
    return replace(times, ns=ns, seconds=seconds)


def _with_times_of(table: SourceTable, sensor: MappedSensor) -> MappedSensor:
    """Return the sensor as read from a table of two, whose column of times may have a name of its own."""
    columns = time_columns(table)
    if columns is None or not set(sensor.time_columns).isdisjoint((*table.columns, ROW_NUMBER)):
        return sensor
    time = columns[0] if len(columns) == 1 else (columns[0], columns[1])
    return replace(sensor, reading=sensor.reading.model_copy(update={"time": time, **time_unit(table, columns)}))


def _merged_imu(sensor: MappedSensor, gyro: SourceTable, accel: SourceTable) -> _Part:
    """Bring gyro and accelerometer of two tables together: the slower one is interpolated at the faster one's times."""
    streams, notes = [], list[str]()
    for key, table in (("gyro", gyro), ("accel", accel)):
        value = sensor.keys.get(key)
        if not isinstance(value, list | tuple) or len(value) != 3:
            raise BadInputError(f"[{sensor.section}]: key {key!r} is {value!r}; expected three columns")
        table, times = _in_order(table, _with_times_of(table, sensor))
        columns = {str(name): table.numbers(str(name)) for name in value}
        keep, left_out = _says_something(sensor, table, columns)
        notes += left_out
        times, columns = _rows(times, keep), {name: values[keep] for name, values in columns.items()}
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
    return _Part(sensor, merged, columns, keys, notes=tuple(notes))


def _dated_by_lines_above(parts: Sequence[_Part], tables: Sequence[SourceTable]) -> list[_Part]:
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


def _start(parts: Sequence[_Part], mapping: Mapping, stated_ns: int | None) -> int | None:
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


def _described(
    parts: Sequence[_Part], mapping: Mapping, start_ns: int | None, run_id: str
) -> tuple[dict[str, Any], dict[str, pd.DataFrame]]:
    description: dict[str, Any] = {"format": FORMAT, "id": mapping.top.get("id", run_id)}
    if start_ns is not None:
        description["start"] = as_datetime(start_ns)
    description |= {key: mapping.top[key] for key in ("track", "kilometrage") if key in mapping.top}
    files: dict[str, pd.DataFrame] = {}
    for part in parts:
        file = _file_of(part)
        time = _time_of(part)
        columns = {name: np.asarray(values) for name, values in part.columns.items()}
        # No clock is finer than 1 ns, so that a time is the same however its source has written it.
        with np.errstate(over="ignore"):  # damaged times may be of any size
            columns = {time: np.round(part.times.since(start_ns), _TIME_DIGITS), **columns}
        files[file] = pd.DataFrame(columns, copy=False)
        if part.places is not None:
            files[_PLACES_FILE] = part.places
        section = {"file": file, "time": time, **part.keys}
        if "[" in part.sensor.section:
            description.setdefault(part.sensor.kind, []).append(section)
        else:
            description[part.sensor.kind] = section
    return description, files

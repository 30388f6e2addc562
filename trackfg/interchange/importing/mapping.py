"""Which columns of a source are which sensor's: the mapping, in the words of ``recording.toml``.

A mapping is a ``recording.toml`` whose tables are the source's, with a few more keys that say how these are written
(docs/importing.md). Everything else in it goes into the recording's description as it is.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from collections.abc import Mapping as Dictionary
from dataclasses import dataclass, field, replace
from datetime import datetime
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from trackfg.errors import BadInputError, did_you_mean, expected_one_of
from trackfg.files.small_file import read_toml, validated
from trackfg.interchange.importing.delimited.dialect import DialectOptions
from trackfg.interchange.importing.geometry_reading import GeometryOptions
from trackfg.interchange.importing.source_table import SourceTable
from trackfg.interchange.importing.times.notation import TimeNotation
from trackfg.io.formats.registry import FORMATS
from trackfg.numerics.chainage.kilometrage import Kilometrage
from trackfg.numerics.chainage.km_notation import Bare
from trackfg.recording.description import FurtherTach
from trackfg.recording.line_kilometrage import LineKilometrage

FORMAT = "trackfg-mapping/1"

BALISES = "balises"
SENSORS = (*(sensor.key for sensor in FORMATS if sensor.model is not FurtherTach), BALISES)
"""The sections that are sensors, as a mapping has them: several tachs are a list."""

_TOP = ("format", "id", "start", "source", "text", "track", "kilometrage", "geometry")


class _Reading(BaseModel):
    """How the table of a sensor is written, besides what the description says of it.

    ``file`` may be a pattern; two of them are the gyro's and the accelerometer's. ``time`` is a column, or the date's
    and the time of day's, or :data:`~trackfg.interchange.importing.source_table.ROW_NUMBER`. The keys of times are
    those of a :class:`~trackfg.interchange.importing.times.notation.TimeNotation`. ``crs`` is the reference system of
    easting and northing. ``valid`` is the column that says whether a position is one, ``dop`` that of the dilution of
    precision, by which constant sigmas are multiplied, ``quality`` that of NMEA's quality: constant sigmas are those of
    quality 1.
    """

    model_config = ConfigDict(extra="ignore", frozen=True)

    file: str | tuple[str, str]
    time: str | tuple[str, str] = "t"
    time_unit: Literal["s", "ms", "us", "ns", "ticks", "gps", "days", "hhmmss"] | None = None
    time_format: str | None = None
    time_zone: str = "UTC"
    tick_s: Annotated[float, Field(gt=0)] | None = None
    wraps_at: Annotated[float, Field(gt=0)] | None = None
    chainage_unit: Bare = "m"
    height_unit: str = "m"
    position_unit: str = "deg"
    crs: str | None = None
    increments: bool = False
    levels: bool = False
    valid: str | None = None
    dop: str | None = None
    quality: str | None = None


_CONSUMED = tuple(key for key in _Reading.model_fields if key != "file")
"""Keys that the recording's description does not get: its tables have seconds in a column ``t``, and metres."""


def fits(file: str, pattern: str) -> bool:
    """Return whether the name of a file fits a pattern; none fits an empty one."""
    return Path(pattern) != Path() and Path(file).match(pattern)


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
    hint = f"{near} A pattern, such as 'log*.csv', means a file of any such name" if near else None
    raise BadInputError(
        f"[{section}] file = {pattern!r}: no such table; expected one of {', '.join(names[:30])}"
        + (f". Hint: {hint}" if hint else "")
    )


@dataclass(frozen=True)
class MappedSensor:
    """One sensor of a mapping: ``section`` is its place (``"laser[2]"``), ``keys`` are what the description gets."""

    kind: str
    section: str
    reading: _Reading
    keys: dict[str, Any]

    @property
    def files(self) -> tuple[str, ...]:
        """The patterns of its tables: one, or the gyro's and the accelerometer's."""
        return (self.reading.file,) if isinstance(self.reading.file, str) else self.reading.file

    @property
    def time_columns(self) -> tuple[str, ...]:
        """The column of the time, or of date and time of day."""
        return (self.reading.time,) if isinstance(self.reading.time, str) else self.reading.time

    @property
    def count_wraps_at(self) -> float | None:
        """The modulus of a wheel's count, where ``wraps_at`` is not that of its times."""
        return None if self.reading.time_unit == "ticks" else self.reading.wraps_at

    @property
    def notation(self) -> TimeNotation:
        """How its times are written."""
        reading = self.reading
        return TimeNotation(reading.time_unit, reading.time_format, reading.time_zone, reading.tick_s, reading.wraps_at)


@dataclass(frozen=True)
class Mapping:
    """A mapping is checked as far as it can be without the source."""

    name: str
    source: str | None
    text: tuple[DialectOptions, ...]
    sensors: tuple[MappedSensor, ...]
    top: dict[str, Any] = field(default_factory=dict)
    """``id``, ``start``, ``track`` and ``kilometrage``, as far as they are given."""
    geometry: GeometryOptions | None = None
    """How a channel table is read: the source is then no recording but a geometry, and has no sensors."""
    kilometrage: Kilometrage | None = None
    """What official places mean in chainages; None where both are the same."""

    def dialect(self, file: str) -> DialectOptions | None:
        """Return what is stated of a text file's dialect: the first entry that matches."""
        return next((options for options in self.text if fits(file, options.files)), None)

    def of_source(self, tables: Sequence[SourceTable]) -> Mapping:
        """Return the mapping with the name of the source's file, where both are of one file only.

        The next log of a device has another name. Tables within a file are called ``file/table``.
        """
        stated_files = {_file_of(pattern) for pattern in self._patterns()}
        files = {_file_of(table.name) for table in tables}
        if len(stated_files) != 1 or len(files) != 1:
            return self
        (old,), (new,) = stated_files, files
        if not old or fits(new, old):
            return self
        sensors = tuple(_renamed(sensor, old, new) for sensor in self.sensors)
        if self.geometry is None:
            return replace(self, sensors=sensors)
        file = new + self.geometry.file.removeprefix(old)
        return replace(self, sensors=sensors, geometry=self.geometry.model_copy(update={"file": file}))

    def _patterns(self) -> Iterator[str]:
        """Yield the names of all tables, those of the places of balises too."""
        if self.geometry is not None:
            yield self.geometry.file
        for sensor in self.sensors:
            yield from sensor.files
            if "places" in sensor.keys:
                yield str(sensor.keys["places"])


def _file_of(name: str) -> str:
    return name.partition("/")[0]


def _renamed(sensor: MappedSensor, old: str, new: str) -> MappedSensor:
    """Return a sensor of the file ``new``, which is ``old`` in its mapping."""
    files = tuple(new + name.removeprefix(old) for name in sensor.files)
    reading = sensor.reading.model_copy(update={"file": files[0] if len(files) == 1 else files})
    places = sensor.keys.get("places")
    keys = sensor.keys if places is None else sensor.keys | {"places": new + str(places).removeprefix(old)}
    return replace(sensor, reading=reading, keys=keys)


def read_mapping(path: Path) -> Mapping:
    """Read a mapping. Raises :class:`BadInputError` that names the file, the key and what was expected."""
    return mapping_of(read_toml(path), path.name)


def mapping_of(data: Dictionary[str, Any], name: str) -> Mapping:
    """Return the mapping that ``data`` describe; ``name`` is the file's. Raises as :func:`read_mapping` does."""
    if data.get("format") != FORMAT:
        raise BadInputError(f"{name}: key format is {data.get('format')!r}; expected {FORMAT!r}")
    for key in data:
        if key not in (*_TOP, *SENSORS):
            raise BadInputError(f"{name}: unknown key {key!r}; {expected_one_of((*_TOP, *SENSORS), key)}")
    if "imu" not in data and "geometry" not in data:
        raise BadInputError(
            f"{name}: no section [imu] and no [geometry]; expected the columns of gyro and accelerometer, or the "
            "channels of a track geometry"
        )
    if "geometry" in data and (beside := [key for key in data if key in SENSORS]):
        raise BadInputError(f"{name}: section [{beside[0]}] beside [geometry]; expected a recording or a geometry")
    start = data.get("start")
    if start is not None and not isinstance(start, datetime):
        raise BadInputError(f"{name}: key start is {start!r}; expected a date with time, such as 2026-05-01T03:12:00Z")
    text = tuple(validated(DialectOptions, entry, f"{name}: ", "key ") for entry in data.get("text", ()))
    sensors = tuple(_sensor(*part) for part in _sections(data))
    geometry = validated(GeometryOptions, data["geometry"], f"{name}: ", "key ") if "geometry" in data else None
    kilometrage = None
    if "kilometrage" in data:
        if geometry is not None:
            raise BadInputError(f"{name}: section [kilometrage] beside [geometry]; expected it with a recording only")
        kilometrage = validated(LineKilometrage, data["kilometrage"], f"{name}: ", "key ").kilometrage()
    top = {key: data[key] for key in ("id", "start", "track", "kilometrage") if key in data}
    source = str(data["source"]) if data.get("source") is not None else None
    return Mapping(name, source, text, sensors, top, geometry, kilometrage)


def _sections(data: Dictionary[str, Any]) -> Iterator[tuple[str, str, dict[str, Any]]]:
    for kind in SENSORS:
        value = data.get(kind, [])
        parts = value if isinstance(value, list) else [value]
        for number, part in enumerate(parts, start=1):
            if not isinstance(part, dict):
                raise BadInputError(f"key {kind}: is {part!r}; expected a table [{kind}]")
            yield kind, f"{kind}[{number}]" if isinstance(value, list) else kind, part


def _sensor(kind: str, section: str, part: dict[str, Any]) -> MappedSensor:
    reading = validated(_Reading, part, "", f"[{section}] key ")
    keys = {key: value for key, value in part.items() if key not in (*_CONSUMED, "file")}
    return MappedSensor(kind, section, reading, keys)

"""Logs of phones: Sensor Logger and phyphox, as a folder or a zip of CSV files, and Sensor Logger's JSON.

Both have a file for acceleration without gravity beside, or instead of, the one with it. Roll and pitch are estimated
from gravity, so that only the latter is of use.
"""

from __future__ import annotations

import csv
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
import pandas as pd

from trackfg.errors import BadInputError
from trackfg.files.temporary_folder import temporary_folder
from trackfg.interchange.importing.columns.column_names import axis_and_rest
from trackfg.interchange.importing.delimited.text_table import read_text
from trackfg.interchange.importing.source_format import DialectFor, SourceFormat
from trackfg.interchange.importing.source_table import SourceTable
from trackfg.interchange.importing.sources.archives import first_lines, names_in, unpacked
from trackfg.interchange.importing.sources.sensor_json import described, is_sensor_json, read_sensor_json

SIGMA_OF_RADIUS = 1.0 / 1.515
"""Sigma of one coordinate over the radius that holds 68 % of positions, which phones state as accuracy (Rayleigh
distribution: ``sqrt(-2 ln 0.32)`` = 1.51)."""


class SensorLogger(SourceFormat):
    """Sensor Logger (Android, iOS): ``TotalAcceleration.csv``, ``Gyroscope.csv``, ``Location.csv``, times in ns."""

    key = "sensor-logger"
    title = "Sensor Logger (phones): a folder or zip with TotalAcceleration.csv and Gyroscope.csv, or its JSON"

    def recognises(self, path: Path) -> bool:
        """Return whether a file has the app's second column of times or describes its recording, or is its JSON."""
        marks = ("seconds_elapsed", "recording time")
        return any(mark in head for head in _heads(path) for mark in marks) or is_sensor_json(path)

    def tables(self, path: Path, dialect_for: DialectFor) -> Sequence[SourceTable]:
        """Read total acceleration, gyro and location; gravity is added to an acceleration without it.

        An iPhone's acceleration, with gravity or without, has the opposite sign unless the app is set to standardise
        (CROSSPLATFORM.md of tszheichoi/awesome-sensor-logger): -1 g upwards at rest.
        """
        wanted = ("TotalAcceleration", "Accelerometer", "Gravity", "Gyroscope", "Location", *_UNCALIBRATED)
        if is_sensor_json(path):
            named, about = read_sensor_json(path, wanted), described(path)
        else:
            with _files(path) as files:
                named, about = _read(files, wanted, dialect_for), _metadata(files)
        for raw, name in _UNCALIBRATED.items():
            if raw in named and name not in named:
                named[name] = replace(named[raw], name=name)
        if "TotalAcceleration" not in named and {"Accelerometer", "Gravity"} <= set(named):
            named["TotalAcceleration"] = _with_gravity(named["Accelerometer"], named["Gravity"])
        if "TotalAcceleration" not in named:
            raise BadInputError(
                f"{path.name}: Accelerometer.csv is without gravity, which roll and pitch need; expected "
                "TotalAcceleration.csv. Hint: switch on Total Acceleration, or Gravity, in the app's sensors"
            )
        if "Gyroscope" not in named:
            raise BadInputError(f"{path.name}: no Gyroscope.csv; expected it. Hint: switch on the Gyroscope in the app")
        if "Location" in named:
            named["Location"] = replace(named["Location"], units=dict.fromkeys(("speed", "speedAccuracy"), "m/s"))
        if about.get("platform") == "ios" and about.get("standardisation") != "true":
            named["TotalAcceleration"] = _turned_round(named["TotalAcceleration"])
        return [
            _with_sigmas(named[name], "horizontalAccuracy", "verticalAccuracy")
            for name in ("TotalAcceleration", "Gyroscope", "Location")
            if name in named
        ]

    def mapping(self, tables: Sequence[SourceTable]) -> dict[str, Any]:
        """Return which file is what; the axes are the phone's, and how it lay is asked."""
        files = {table.name.partition(".")[0]: table for table in tables}
        time = {"time": "time", "time_unit": "ns"}
        accel = files["TotalAcceleration"]
        size = float(np.median(np.linalg.norm([accel.numbers(axis) for axis in "xyz"], axis=0)))
        imu = _imu((files["Gyroscope"], [*"xyz"]), (accel, [*"xyz"]), time)
        sections: dict[str, Any] = {"imu": {**imu, "accel_unit": "g" if size < 3.0 else "m/s^2"}}
        if "Location" in files:
            sections["gnss"] = {"file": files["Location"].name, **time, **_POSITION}
        return sections


_UNCALIBRATED = {"AccelerometerUncalibrated": "TotalAcceleration", "GyroscopeUncalibrated": "Gyroscope"}
"""Raw sensors, which hold gravity, in place of those whose biases the phone has taken off."""
_POSITION = {"position": ["latitude", "longitude", "altitude"], "sd": ["sd_m", "sd_m", "sd_up_m"]}


class Phyphox(SourceFormat):
    """phyphox: a zip with one CSV file a sensor, and ``meta/time.csv``.

    Times are in s since the start without pauses; ``meta/time.csv`` of newer versions says when each part began.
    """

    key = "phyphox"
    title = "phyphox (phones): a folder or zip of its CSV export"

    def recognises(self, path: Path) -> bool:
        """Return whether it has a sensor's file beside phyphox's file of times, or with its column of times."""
        names = _names(path)
        of_sensor = bool(names & {*_PHYPHOX_FILES, "Raw Data.csv"})
        return of_sensor and ("time.csv" in names or any("Time (s)" in head for head in _heads(path)))

    def tables(self, path: Path, dialect_for: DialectFor) -> Sequence[SourceTable]:
        """Read gyroscope, accelerometer and location."""
        with _files(path) as files:
            named = _read(files, (*(name.removesuffix(".csv") for name in _PHYPHOX_FILES), "time"), dialect_for)
        if "Accelerometer" not in named and any(name.startswith("Linear") for name in _names(path)):
            raise BadInputError(
                f"{path.name}: the acceleration is without gravity, which roll and pitch need; expected the "
                "experiment 'Acceleration with g'"
            )
        for name in ("Gyroscope", "Accelerometer"):
            if name not in named:
                raise BadInputError(
                    f"{path.name}: no {name}.csv; expected it. Hint: record with the {name} switched on"
                )
        parts = _parts(named.get("time"))
        wanted = [named[name] for name in ("Gyroscope", "Accelerometer", "Location") if name in named]
        return [
            _on_calendar(_with_sigmas(table, "Horizontal Accuracy", "Vertical Accuracy"), parts) for table in wanted
        ]

    def mapping(self, tables: Sequence[SourceTable]) -> dict[str, Any]:
        """Return which column is what; the axes are the phone's, and how it lay is asked."""
        gyro, accel, *location = tables
        stamp = "time_ns" if "time_ns" in gyro.columns else "Time"
        time = {"time": stamp, "time_unit": "ns" if stamp == "time_ns" else "s"}
        imu = _imu((gyro, _axes(gyro)), (accel, _axes(accel)), time)
        sections: dict[str, Any] = {"imu": {**imu, "accel_unit": "m/s^2"}}
        if location:
            height = next((name for name in ("Height", "Altitude") if name in location[0].columns), 0.0)
            position = ["Latitude", "Longitude", height]
            sections["gnss"] = {"file": location[0].name, **time, "position": position, "sd": _POSITION["sd"]}
        return sections


def _imu(
    gyro: tuple[SourceTable, list[str]], accel: tuple[SourceTable, list[str]], time: dict[str, str]
) -> dict[str, Any]:
    """Return the section of two tables and their columns x, y, z, without the accelerometer's unit."""
    files = [table.name for table, _ in (gyro, accel)]
    return {"file": files, **time, "gyro": gyro[1], "gyro_unit": "rad/s", "accel": accel[1]}


def _axes(table: SourceTable) -> list[str]:
    """Return the columns x, y, z, which versions of the app name ``X`` or ``Gyroscope x``."""
    alike: dict[str, dict[str, str]] = {}
    for name in table.columns:
        axis, rest = axis_and_rest(name)
        if axis is not None:
            alike.setdefault(rest, {})[axis] = name
    names = next((axes for axes in alike.values() if len(axes) == len("xyz")), None)
    if names is None:
        raise BadInputError(f"{table.name}: columns {', '.join(table.columns)}; expected one each for x, y and z")
    return [names[axis] for axis in "xyz"]


def _parts(times: SourceTable | None) -> tuple[np.ndarray, np.ndarray] | None:
    """Return when the parts of a recording began: by its own clock, s, and by the phone's, ns since 1970."""
    if times is None or not {"event", "experiment time", "system time"} <= set(times.columns):
        return None
    begins = (times.column("event") == "START").to_numpy(dtype=bool)
    elapsed, system = times.numbers("experiment time")[begins], times.numbers("system time")[begins]
    return (elapsed, np.round(system * 1e3).astype(np.int64) * 1_000_000) if begins.any() else None


def _on_calendar(table: SourceTable, parts: tuple[np.ndarray, np.ndarray] | None) -> SourceTable:
    """Return a table with dates, ns since 1970, where its recording says when its parts began."""
    if parts is None:
        return table
    t = table.numbers("Time")
    part = np.clip(np.searchsorted(parts[0], t, side="right") - 1, 0, None)
    ns = parts[1][part] + np.round((t - parts[0][part]) * 1e9).astype(np.int64)
    return replace(table, frame=table.frame.drop(columns="Time").assign(time_ns=ns))


_PHYPHOX_FILES = ("Gyroscope.csv", "Accelerometer.csv", "Location.csv")


def _names(path: Path) -> set[str]:
    if path.is_dir():
        return {file.name for file in path.rglob("*.csv")}
    return {PurePosixPath(name).name for name in names_in(path)} if path.suffix.casefold() == ".zip" else set()


def _heads(path: Path) -> list[str]:
    """Return the first lines of the files of sensors that both apps have, and of metadata. Never raises."""
    if path.is_file() and path.suffix.casefold() != ".zip":
        return []
    names = ("Gyroscope", "Accelerometer", "TotalAcceleration", "Metadata", *_UNCALIBRATED)
    wanted = {f"{name}.csv" for name in names}
    return first_lines(path, lambda name: name in wanted)


@contextmanager
def _files(path: Path) -> Iterator[list[Path]]:
    """Unpack a zip for the block, and give its CSV files or those of a folder."""
    with temporary_folder() as folder:
        if path.is_dir():
            yield sorted(path.rglob("*.csv"))
        else:
            yield [file for _, file in unpacked(path, folder, lambda name: name.casefold().endswith(".csv"))]


def _read(files: Sequence[Path], wanted: Sequence[str], dialect_for: DialectFor) -> dict[str, SourceTable]:
    """Read the files of these names that have rows: a phone indoors has no location."""
    return {
        file.stem: read_text(file, dialect_for(file.name)) for file in files if file.stem in wanted and _has_rows(file)
    }


def _has_rows(file: Path) -> bool:
    with file.open("rb") as stream:
        return bool(stream.readline().strip() and stream.readline().strip())


def _metadata(files: Sequence[Path]) -> dict[str, str]:
    """Return what ``Metadata.csv`` says of the phone and of the app's settings, in lower case; nothing without it."""
    file = next((file for file in files if file.name == "Metadata.csv"), None)
    if file is None:
        return {}
    with file.open(encoding="utf-8-sig", errors="replace", newline="") as stream:
        row = next(csv.DictReader(stream), {})
    return {str(name): str(value).strip().casefold() for name, value in row.items()}


def _turned_round(accel: SourceTable) -> SourceTable:
    """Return an acceleration of the opposite sign, with a note."""
    note = f"{accel.name}: an iPhone's acceleration, which reads -1 g upwards at rest, is taken with the opposite sign"
    frame = accel.frame.assign(**{axis: -accel.numbers(axis) for axis in "xyz"})
    return replace(accel, frame=frame, notes=(*accel.notes, note))


def _with_gravity(free: SourceTable, gravity: SourceTable) -> SourceTable:
    """Return the sum of an acceleration without gravity and gravity, which the phone samples on one clock."""
    t, gravity_t = free.numbers("time"), gravity.numbers("time")
    total = {axis: free.numbers(axis) + np.interp(t, gravity_t, gravity.numbers(axis)) for axis in "xyz"}
    return replace(free, name="TotalAcceleration.csv", frame=free.frame.assign(**total))


def _with_sigmas(table: SourceTable, horizontal: str, vertical: str) -> SourceTable:
    """Return a table of positions with a sigma for each coordinate; another table as it is."""
    if horizontal not in table.columns:
        return table
    radius = table.numbers(horizontal)
    up = table.numbers(vertical) if vertical in table.columns else 2.0 * radius
    sd = pd.DataFrame({"sd_m": radius * SIGMA_OF_RADIUS, "sd_up_m": np.where(up > 0.0, up, 2.0 * radius)})
    known = radius > 0.0  # -1 where the phone has no position
    frame = pd.concat([table.frame.reset_index(drop=True), sd], axis=1)[known].reset_index(drop=True)
    return replace(table, frame=frame)

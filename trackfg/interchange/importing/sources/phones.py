"""Logs of phones: Sensor Logger and phyphox, as a folder or a zip of CSV files.

Both have a file for acceleration without gravity beside, or instead of, the one with it. Roll and pitch are estimated
from gravity, so that only the latter is of use.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
import pandas as pd

from trackfg.errors import BadInputError
from trackfg.files.temporary_folder import temporary_folder
from trackfg.interchange.importing.source_format import DialectFor, SourceFormat
from trackfg.interchange.importing.source_table import SourceTable
from trackfg.interchange.importing.sources.text import names_in, unpacked
from trackfg.interchange.importing.text_table import read_text

SIGMA_OF_RADIUS = 1.0 / 1.515
"""Sigma of one coordinate over the radius that holds 68 % of positions, which phones state as accuracy (Rayleigh
distribution: ``sqrt(-2 ln 0.32)`` = 1.51)."""


class SensorLogger(SourceFormat):
    """Sensor Logger (Android, iOS): ``TotalAcceleration.csv``, ``Gyroscope.csv``, ``Location.csv``, times in ns."""

    key = "sensor-logger"
    title = "Sensor Logger (phones): a folder or zip with TotalAcceleration.csv and Gyroscope.csv"

    def recognises(self, path: Path) -> bool:
        """Return whether it holds a gyroscope's file beside the app's own ones."""
        names = _names(path)
        return "Gyroscope.csv" in names and bool(names & {"TotalAcceleration.csv", "Accelerometer.csv", "Metadata.csv"})

    def tables(self, path: Path, dialect_for: DialectFor) -> Sequence[SourceTable]:
        """Read total acceleration, gyro and location; gravity is added to an acceleration without it."""
        named = _read(path, ("TotalAcceleration", "Accelerometer", "Gravity", "Gyroscope", "Location"), dialect_for)
        if "TotalAcceleration" not in named and {"Accelerometer", "Gravity"} <= set(named):
            named["TotalAcceleration"] = _with_gravity(named["Accelerometer"], named["Gravity"])
        if "TotalAcceleration" not in named:
            raise BadInputError(
                f"{path.name}: Accelerometer.csv is without gravity, which roll and pitch need; expected "
                "TotalAcceleration.csv. Hint: switch on Total Acceleration, or Gravity, in the app's sensors"
            )
        if "Gyroscope" not in named:
            raise BadInputError(f"{path.name}: no Gyroscope.csv; expected it. Hint: switch on the Gyroscope in the app")
        wanted = ("TotalAcceleration", "Gyroscope", "Location")
        return [_with_sigmas(named[name], "horizontalAccuracy", "verticalAccuracy") for name in wanted if name in named]

    def mapping(self, tables: Sequence[SourceTable]) -> dict[str, Any]:
        """Return which file is what; the axes are the phone's, and how it lay is asked."""
        files = {table.name.partition(".")[0]: table for table in tables}
        time = {"time": "time", "time_unit": "ns"}
        accel = files["TotalAcceleration"]
        size = float(np.median(np.linalg.norm([accel.numbers(axis) for axis in "xyz"], axis=0)))
        sections: dict[str, Any] = {
            "imu": {
                "file": [files["Gyroscope"].name, accel.name],
                **time,
                "gyro": ["x", "y", "z"],
                "gyro_unit": "rad/s",
                "accel": ["x", "y", "z"],
                "accel_unit": "g" if size < 3.0 else "m/s^2",
            }
        }
        if "Location" in files:
            sections["gnss"] = {"file": files["Location"].name, **time, **_POSITION}
        return sections


_POSITION = {"position": ["latitude", "longitude", "altitude"], "sd": ["sd_m", "sd_m", "sd_up_m"]}


class Phyphox(SourceFormat):
    """phyphox: a zip with one CSV file a sensor, and ``meta/time.csv``; times in s since the start."""

    key = "phyphox"
    title = "phyphox (phones): a folder or zip of its CSV export"

    def recognises(self, path: Path) -> bool:
        """Return whether it has phyphox's file of times, and a sensor's."""
        names = _names(path)
        return "time.csv" in names and bool(names & {*_PHYPHOX_FILES, "Raw Data.csv"})

    def tables(self, path: Path, dialect_for: DialectFor) -> Sequence[SourceTable]:
        """Read gyroscope, accelerometer and location."""
        named = _read(path, tuple(name.removesuffix(".csv") for name in _PHYPHOX_FILES), dialect_for)
        if "Accelerometer" not in named and "Linear Accelerometer" in named:
            raise BadInputError(
                f"{path.name}: the acceleration is without gravity, which roll and pitch need; expected the "
                "experiment 'Acceleration with g'"
            )
        for name in ("Gyroscope", "Accelerometer"):
            if name not in named:
                raise BadInputError(
                    f"{path.name}: no {name}.csv; expected it. Hint: record with the {name} switched on"
                )
        wanted = [named[name] for name in ("Gyroscope", "Accelerometer", "Location") if name in named]
        return [_with_sigmas(table, "Horizontal Accuracy", "Vertical Accuracy") for table in wanted]

    def mapping(self, tables: Sequence[SourceTable]) -> dict[str, Any]:
        """Return which column is what; the axes are the phone's, and how it lay is asked."""
        gyro, accel, *location = tables
        sections: dict[str, Any] = {
            "imu": {
                "file": [gyro.name, accel.name],
                "time": "Time",
                "time_unit": "s",
                "gyro": [f"Gyroscope {axis}" for axis in "xyz"],
                "gyro_unit": "rad/s",
                "accel": [f"Acceleration {axis}" for axis in "xyz"],
                "accel_unit": "m/s^2",
            }
        }
        if location:
            height = next((name for name in ("Height", "Altitude") if name in location[0].columns), 0.0)
            position = ["Latitude", "Longitude", height]
            own = {"file": location[0].name, "time": "Time", "time_unit": "s"}
            sections["gnss"] = {**own, "position": position, "sd": _POSITION["sd"]}
        return sections


_PHYPHOX_FILES = ("Gyroscope.csv", "Accelerometer.csv", "Linear Accelerometer.csv", "Location.csv")


def _names(path: Path) -> set[str]:
    if path.is_dir():
        return {file.name for file in path.rglob("*.csv")}
    return {PurePosixPath(name).name for name in names_in(path)} if path.suffix.casefold() == ".zip" else set()


def _read(path: Path, wanted: Sequence[str], dialect_for: DialectFor) -> dict[str, SourceTable]:
    """Read the CSV files of these names that are there and have rows."""
    with temporary_folder() as folder:
        files = sorted(path.rglob("*.csv")) if path.is_dir() else unpacked(path, folder)
        return {file.stem: read_text(file, dialect_for(file.name)) for file in files if file.stem in wanted}


def _with_gravity(free: SourceTable, gravity: SourceTable) -> SourceTable:
    """Return the sum of an acceleration without gravity and gravity, which the phone samples on one clock."""
    t, own = free.numbers("time"), gravity.numbers("time")
    total = {axis: free.numbers(axis) + np.interp(t, own, gravity.numbers(axis)) for axis in "xyz"}
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

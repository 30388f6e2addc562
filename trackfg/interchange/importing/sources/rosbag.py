"""Bags of ROS 1 and ROS 2, and MCAP files with ROS messages in CDR."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from trackfg.errors import BadInputError
from trackfg.files.libraries import library
from trackfg.interchange.importing.columns.receiver_state import UNKNOWN_HEIGHT_SD_M
from trackfg.interchange.importing.shapes.usual_shape import in_usual_shape_of_types
from trackfg.interchange.importing.source_format import DialectFor, SourceFormat, readable, refuse_empty, starts_with
from trackfg.interchange.importing.source_table import SourceTable
from trackfg.interchange.importing.sources.mcap_json import MCAP
from trackfg.interchange.importing.sources.messages import (
    SIGMAS,
    STAMP,
    MessageTables,
    cells_of,
    fields_of,
    measured_ns,
    sigmas_of,
)

IMU_COLUMNS = ("gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y", "accel_z")
FIX_COLUMNS = ("latitude", "longitude", "altitude", *SIGMAS)
TWIST_COLUMNS = ("speed_mps", "across_mps")
NO_FIX, UNKNOWN = -1, 0
"""Of ``NavSatFix``: the status without a position, and the type of a covariance that says nothing. A driver that sets
no status leaves -2 (ROS 2 Jazzy)."""
_ACROSS = 0.1
"""A vehicle on a track moves across it by less than this share of its speed: a velocity with more is not along x."""
RECEIVER = re.compile(r"gps|gnss|navsat|ublox|novatel", re.IGNORECASE)
"""In the names of topics and frames of receivers, whose velocity is east and north."""
_MOST_NUMBERS = 100
"""A message with longer arrays, an image or a scan, is none of a sensor of motion; covariances have 36 numbers."""


def _imu(message: Any) -> dict[str, float]:
    w, f = message.angular_velocity, message.linear_acceleration
    return dict(zip(IMU_COLUMNS, (w.x, w.y, w.z, f.x, f.y, f.z), strict=True))


def _fix(message: Any) -> dict[str, float]:
    known = message.position_covariance_type != UNKNOWN
    sd = sigmas_of(message.position_covariance if known else ())
    place = (message.latitude, message.longitude) if message.status.status != NO_FIX else (np.nan, np.nan)
    return dict(zip(FIX_COLUMNS, (*place, message.altitude, *sd), strict=True))


def _twist(message: Any) -> dict[str, float]:
    twist = message.twist
    linear = (twist.twist if hasattr(twist, "twist") else twist).linear
    return dict(zip(TWIST_COLUMNS, (linear.x, linear.y), strict=True))


_MESSAGES: dict[str, Callable[[Any], Mapping[str, float | str]]] = {
    "sensor_msgs/msg/Imu": _imu,
    "sensor_msgs/msg/NavSatFix": _fix,
    "nav_msgs/msg/Odometry": _twist,
    "geometry_msgs/msg/TwistStamped": _twist,
    "geometry_msgs/msg/TwistWithCovarianceStamped": _twist,
}
"""Columns and values of the types of messages whose meaning ROS defines."""


class RosBag(SourceFormat):
    """Each topic is a table of its name; what messages of other types than ROS's own mean, their fields' names say."""

    key = "ros"
    title = "ROS 1 bag (.bag), ROS 2 bag (a folder with metadata.yaml) or MCAP with CDR messages"

    def recognises(self, path: Path) -> bool:
        """Return whether it is a bag of either kind, or an MCAP file with ROS messages."""
        if path.is_dir():
            return (path / "metadata.yaml").is_file()
        return starts_with(path, b"#ROSBAG V") or starts_with(path, MCAP)

    def tables(self, path: Path, dialect_for: DialectFor) -> Sequence[SourceTable]:
        """Read the topics, stamped by their headers."""
        if path.is_dir() and not all(file.is_file() or file.is_dir() for file in path.iterdir()):
            raise BadInputError(f"{path.name}: holds a pipe or a device; expected the files of a ROS bag")
        anyreader, typesys = library("rosbags.highlevel", "ros"), library("rosbags.typesys", "ros")
        topics = MessageTables()
        receivers: set[str] = set()
        with readable(path, "a ROS bag or MCAP file"):
            store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
            with anyreader.AnyReader([path], default_typestore=store) as reader:
                wanted = [c for c in reader.connections if c.msgtype in _MESSAGES or _has_numbers(reader, c)]
                for connection, received_ns, raw in reader.messages(connections=wanted) if wanted else ():
                    message = reader.deserialize(raw, connection.msgtype)
                    cells = _MESSAGES.get(connection.msgtype, cells_of)(message)
                    topics.take(connection.topic, measured_ns(message, received_ns), cells)
                    frame = getattr(getattr(message, "header", None), "frame_id", "")
                    if RECEIVER.search(f"{connection.topic} {frame}"):
                        receivers.add(connection.topic)
        tables = in_usual_shape_of_types([_usable(table, table.name in receivers) for table in topics.tables()])
        return refuse_empty(tables, path, "messages with numbers")

    def mapping(self, tables: Sequence[SourceTable]) -> dict[str, Any]:
        """Take the topic with the most messages of each kind; ROS has x forward, y left, z up (REP 103).

        Where gravity contradicts that, the data and their owner say how the sensor lies.
        """
        imu, fix, speed = (_longest(tables, columns) for columns in (IMU_COLUMNS, FIX_COLUMNS, TWIST_COLUMNS[:1]))
        time = {"time": STAMP, "time_unit": "ns"}
        sections: dict[str, Any] = {}
        if imu is not None:
            sections["imu"] = {
                "file": imu.name,
                **time,
                "gyro": list(IMU_COLUMNS[:3]),
                "gyro_unit": "rad/s",
                "accel": list(IMU_COLUMNS[3:]),
                "accel_unit": "m/s^2",
            }
            force = np.array([np.nanmedian(imu.numbers(name)) for name in IMU_COLUMNS[3:]])
            if force[2] >= np.abs(force).max():  # else it lies in its frame as no frame of REP 103 does
                sections["imu"]["axes"] = "FLU"
        if fix is not None:
            position: list[Any] = list(FIX_COLUMNS[:3])
            sd: list[Any] = list(SIGMAS)
            if not np.isfinite(fix.numbers("altitude")).all():
                position[2], sd[2] = 0.0, UNKNOWN_HEIGHT_SD_M
            sections["gnss"] = {"file": fix.name, **time, "position": position, "sd": sd}
        if speed is not None:
            sections["tach"] = {"file": speed.name, **time, "column": "speed_mps", "kind": "speed"}
            sections["tach"] |= {"unit": "m/s", "signed": True}  # ROS has speeds negative backwards (REP 103)
        return sections


def _has_numbers(reader: Any, connection: Any) -> bool:
    """Return whether the first message of a topic has numbers and no long arrays; False where its type is unknown."""
    try:
        _, _, raw = next(reader.messages(connections=[connection]))
        message = reader.deserialize(raw, connection.msgtype)
    except (StopIteration, KeyError, ValueError):
        return False
    sizes = [len(value) for value in fields_of(message).values() if hasattr(value, "__len__")]
    return max(sizes, default=0) <= _MOST_NUMBERS and any(
        isinstance(cell, float) for cell in cells_of(message).values()
    )


def _usable(table: SourceTable, of_receiver: bool) -> SourceTable:
    """Return positions without the rows that have none, and a velocity that is not the vehicle's by other names."""
    if "latitude" in table.columns:
        frame = table.frame.dropna(subset=["latitude", "longitude"], ignore_index=True)
        table = replace(table, frame=frame)
    return with_velocity_along(table, of_receiver=of_receiver)


def with_velocity_along(table: SourceTable, *, of_receiver: bool) -> SourceTable:
    """Return a table with its velocity along the vehicle alone; a velocity that is not the vehicle's by other names."""
    frame = table.frame
    if not set(TWIST_COLUMNS) <= set(frame):
        return table
    along, across = (np.sqrt(np.nanmean(np.square(frame[name]))) for name in TWIST_COLUMNS)
    if of_receiver or across > _ACROSS * along:
        return replace(table, frame=frame.rename(columns=dict(zip(TWIST_COLUMNS, ("x_mps", "y_mps"), strict=True))))
    return replace(table, frame=frame.drop(columns=TWIST_COLUMNS[1]))


def _longest(tables: Sequence[SourceTable], columns: Sequence[str]) -> SourceTable | None:
    candidates = [table for table in tables if set(columns) <= set(table.columns)]
    return max(candidates, key=lambda table: len(table.frame), default=None)

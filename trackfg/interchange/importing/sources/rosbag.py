"""Bags of ROS 1 and ROS 2, and MCAP files with ROS messages in CDR."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from trackfg.errors import BadInputError, first_line
from trackfg.files.libraries import library
from trackfg.interchange.importing.source_format import DialectFor, SourceFormat, refuse_empty, starts_with
from trackfg.interchange.importing.source_table import SourceTable


def _imu(message: Any) -> tuple[float, ...]:
    w, f = message.angular_velocity, message.linear_acceleration
    return (w.x, w.y, w.z, f.x, f.y, f.z)


def _fix(message: Any) -> tuple[float, ...]:
    covariance = message.position_covariance
    sd = np.sqrt([covariance[0], covariance[4], covariance[8]])
    good = message.status.status >= 0
    return (message.latitude, message.longitude, message.altitude, *sd) if good else (np.nan,) * 6


def _odometry(message: Any) -> tuple[float, ...]:
    return (message.twist.twist.linear.x,)


def _twist(message: Any) -> tuple[float, ...]:
    twist = message.twist
    return ((twist.twist if hasattr(twist, "twist") else twist).linear.x,)


_IMU_COLUMNS = ("gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y", "accel_z")
_FIX_COLUMNS = ("latitude", "longitude", "altitude", "sd_east_m", "sd_north_m", "sd_up_m")

_MESSAGES: dict[str, tuple[tuple[str, ...], Callable[[Any], tuple[float, ...]]]] = {
    "sensor_msgs/msg/Imu": (_IMU_COLUMNS, _imu),
    "sensor_msgs/msg/NavSatFix": (_FIX_COLUMNS, _fix),
    "nav_msgs/msg/Odometry": (("speed_mps",), _odometry),
    "geometry_msgs/msg/TwistStamped": (("speed_mps",), _twist),
    "geometry_msgs/msg/TwistWithCovarianceStamped": (("speed_mps",), _twist),
}
"""Columns and values of each type of message that is read."""


class RosBag(SourceFormat):
    """Each topic with ``Imu``, ``NavSatFix``, ``Odometry`` or ``Twist...Stamped`` messages is a table of its name."""

    key = "ros"
    title = "ROS 1 bag (.bag), ROS 2 bag (a folder with metadata.yaml) or MCAP with CDR messages"

    def recognises(self, path: Path) -> bool:
        """Return whether it is a bag of either kind, or an MCAP file with ROS messages."""
        if path.is_dir():
            return (path / "metadata.yaml").is_file()
        return starts_with(path, b"#ROSBAG V") or starts_with(path, b"\x89MCAP")

    def tables(self, path: Path, dialect_for: DialectFor) -> Sequence[SourceTable]:
        """Read the topics, stamped by their headers."""
        if path.is_dir() and not all(file.is_file() or file.is_dir() for file in path.iterdir()):
            raise BadInputError(f"{path.name}: holds a pipe or a device; expected the files of a ROS bag")
        anyreader, typesys = library("rosbags.highlevel", "ros"), library("rosbags.typesys", "ros")
        rows: dict[str, list[tuple[float, ...]]] = {}
        stamps: dict[str, list[int]] = {}
        columns: dict[str, tuple[str, ...]] = {}
        try:
            store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
            with anyreader.AnyReader([path], default_typestore=store) as reader:
                wanted = [c for c in reader.connections if c.msgtype in _MESSAGES]
                for connection, _, raw in reader.messages(connections=wanted):
                    names, values_of = _MESSAGES[connection.msgtype]
                    message = reader.deserialize(raw, connection.msgtype)
                    stamp = message.header.stamp
                    columns[connection.topic] = names
                    stamps.setdefault(connection.topic, []).append(stamp.sec * 1_000_000_000 + stamp.nanosec)
                    rows.setdefault(connection.topic, []).append(values_of(message))
        except Exception as error:  # the library raises errors of many kinds for damaged bags
            raise BadInputError(
                f"{path.name}: cannot be read ({first_line(error)}); expected a ROS bag or MCAP file"
            ) from error
        tables = []
        for topic, values in rows.items():
            frame = pd.DataFrame(np.array(values), columns=list(columns[topic]))
            frame.insert(0, "stamp_ns", np.array(stamps[topic], dtype=np.int64))
            tables.append(SourceTable(topic, frame.dropna(ignore_index=True)))
        kinds = ", ".join(sorted(name.rpartition("/")[2] for name in _MESSAGES))
        return refuse_empty(tables, path, f"messages of the types {kinds}")

    def mapping(self, tables: Sequence[SourceTable]) -> dict[str, Any]:
        """Take the topic with the most messages of each kind; ROS has x forward, y left, z up (REP 103)."""
        imu, fix, speed = (_longest(tables, column) for column in ("gyro_x", "latitude", "speed_mps"))
        if imu is None:
            raise BadInputError("no topic with sensor_msgs/Imu messages; expected one")
        time = {"time": "stamp_ns", "time_unit": "ns"}
        sections: dict[str, Any] = {
            "imu": {
                "file": imu.name,
                **time,
                "gyro": list(_IMU_COLUMNS[:3]),
                "gyro_unit": "rad/s",
                "accel": list(_IMU_COLUMNS[3:]),
                "accel_unit": "m/s^2",
                "axes": "FLU",
            }
        }
        if fix is not None:
            known = bool((fix.numbers("sd_east_m") > 0.0).all())
            sd = list(_FIX_COLUMNS[3:]) if known else [3.0, 3.0, 6.0]
            sections["gnss"] = {"file": fix.name, **time, "position": list(_FIX_COLUMNS[:3]), "sd": sd}
        if speed is not None:
            sections["tach"] = {"file": speed.name, **time, "column": "speed_mps", "kind": "speed"}
            sections["tach"] |= {"unit": "m/s", "signed": True}  # ROS has speeds negative backwards (REP 103)
        return sections


def _longest(tables: Sequence[SourceTable], column: str) -> SourceTable | None:
    found = [table for table in tables if column in table.columns]
    return max(found, key=lambda table: len(table.frame), default=None)

"""Text of ``ros2 topic echo --csv``, which has the numbers of each message in a line and no names, gets its columns.

That is for messages whose number of cells and contents are those of no other: ``sensor_msgs/Imu`` has 40 (two of the
stamp, the frame, a quaternion, a rotation rate and a force, with nine of a covariance behind each),
``sensor_msgs/NavSatFix`` has 18, and ``nav_msgs/Odometry`` 89 (two frames, a position, a quaternion, 36 of a
covariance, a velocity, a rotation rate, and 36 again). ``rostopic echo -p`` of ROS 1 has names: of its messages
``Odometry`` and ``Twist`` the velocity along x is that of the vehicle likewise.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pandas as pd

from trackfg.interchange.importing.source_table import SourceTable
from trackfg.interchange.importing.sources.messages import STAMP, with_sigmas
from trackfg.interchange.importing.sources.rosbag import (
    FIX_COLUMNS,
    IMU_COLUMNS,
    NO_FIX,
    RECEIVER,
    TWIST_COLUMNS,
    UNKNOWN,
    with_velocity_along,
)
from trackfg.numerics.arrays import Array

_IMU_CELLS, _FIX_CELLS, _ODOMETRY_CELLS = 40, 18, 89
_SECOND_NS = 1_000_000_000
_QUATERNION, _RATE, _FORCE = slice(3, 7), slice(16, 19), slice(28, 31)
"""Where they stand in a line of an ``Imu``."""
_STATUS, _PLACE, _COVARIANCE, _KIND = 3, slice(5, 8), slice(8, 17), 17
"""Where they stand in a line of a ``NavSatFix``."""
_ORIENTATION, _VELOCITY = slice(7, 11), slice(47, 49)
"""Where they stand in a line of an ``Odometry``, whose velocity is that of its child frame: along x, across it y."""
_TWIST = re.compile(r"(?P<stem>.*\btwist[./]linear[./])[xyz]")
_FRAME = re.compile(r"frame_?id$")
"""Names of a velocity, and of the frames of a message, where they stand above the lines."""
_STATES, _KINDS = (-2.0, 2.0), (0.0, 3.0)
"""Least and greatest status of a fix, and kind of a covariance."""
_ROUNDING = 1e-3
"""A quaternion is of length 1 within this, or of length 0 where the driver has no orientation."""
_UNITS = dict.fromkeys(IMU_COLUMNS[:3], "rad/s") | dict.fromkeys(IMU_COLUMNS[3:], "m/s^2")


def with_columns_of_ros(table: SourceTable) -> SourceTable:
    """Return a table without names whose lines are messages ``Imu``, ``NavSatFix`` or ``Odometry`` with its columns.

    Others stay as they are.
    """
    if table.columns != [f"c{i + 1}" for i in range(len(table.columns))]:
        return _with_named_velocity(table)
    if not _has_stamps(table):
        return table
    frames = (2, 3) if len(table.columns) == _ODOMETRY_CELLS else (2,)
    others = [name for i, name in enumerate(table.columns) if i not in frames]
    if not all(pd.api.types.is_numeric_dtype(table.frame[name]) for name in others):
        return table
    cells = np.stack([np.zeros(len(table.frame)) if i in frames else table.numbers(name)
                      for i, name in enumerate(table.columns)], axis=1)  # fmt: skip
    if cells.shape[1] == _IMU_CELLS and _are_quaternions(cells[:, _QUATERNION]):
        columns = dict(zip(IMU_COLUMNS, np.concatenate([cells[:, _RATE], cells[:, _FORCE]], axis=1).T, strict=True))
        return _stamped(table, columns, "sensor_msgs/Imu", _UNITS)
    if cells.shape[1] == _FIX_CELLS and _are_fixes(cells):
        return with_sigmas(_stamped(table, _fixes(cells), "sensor_msgs/NavSatFix", {}))
    if cells.shape[1] == _ODOMETRY_CELLS and _are_quaternions(cells[:, _ORIENTATION]):
        columns = dict(zip(TWIST_COLUMNS, cells[:, _VELOCITY].T, strict=True))
        of_receiver = _is_of_receiver(table, [table.columns[i] for i in frames])
        return with_velocity_along(_stamped(table, columns, "nav_msgs/Odometry", {}), of_receiver=of_receiver)
    return table


def _with_named_velocity(table: SourceTable) -> SourceTable:
    """Return a table with the velocity along the vehicle alone of the three parts of a message's; another one as is."""
    stem = next((match["stem"] for name in table.columns if (match := _TWIST.fullmatch(name))), None)
    if stem is None or not {f"{stem}{axis}" for axis in "xyz"} <= set(table.columns):
        return table
    named = dict(zip((f"{stem}x", f"{stem}y"), TWIST_COLUMNS, strict=True))
    of_receiver = _is_of_receiver(table, [name for name in table.columns if _FRAME.search(name)])
    along = with_velocity_along(replace(table, frame=table.frame.rename(columns=named)), of_receiver=of_receiver)
    if TWIST_COLUMNS[0] not in along.columns:
        return table
    frame = along.frame.drop(columns=f"{stem}z").rename(columns={TWIST_COLUMNS[0]: f"{stem}x"})
    return replace(table, frame=frame, units={**table.units, f"{stem}x": "m/s"})


def _is_of_receiver(table: SourceTable, frames: Sequence[str]) -> bool:
    """Return whether the file, or one of the columns of frames, is named after a receiver."""
    names = [table.name, *(str(table.frame[name].iloc[0]) for name in frames)]
    return any(RECEIVER.search(name) for name in names)


def _has_stamps(table: SourceTable) -> bool:
    """Return whether a line begins with seconds, nanoseconds and the name of a frame, which may be empty."""
    if len(table.columns) not in (_IMU_CELLS, _FIX_CELLS, _ODOMETRY_CELLS):
        return False
    seconds, part, frame = (table.frame[name] for name in table.columns[:3])
    if not all(pd.api.types.is_integer_dtype(column) for column in (seconds, part)):
        return False
    named = frame.isna().all() or pd.api.types.is_string_dtype(frame)
    return bool(named and (seconds >= 0).all() and part.between(0, _SECOND_NS - 1).all())


def _are_quaternions(cells: Array) -> bool:
    length = np.linalg.norm(cells, axis=1)
    return bool(((np.abs(length - 1.0) < _ROUNDING) | (length == 0.0)).all())


def _are_fixes(cells: Array) -> bool:
    latitude, longitude, _ = cells[:, _PLACE].T
    known = np.isfinite(latitude) & np.isfinite(longitude)
    on_earth = (np.abs(latitude[known]) <= 90.0).all() and (np.abs(longitude[known]) <= 180.0).all()
    bounded = ((cells[:, _STATUS], _STATES), (cells[:, _KIND], _KINDS))
    whole = all(((part == np.floor(part)) & (part >= low) & (part <= high)).all() for part, (low, high) in bounded)
    return bool(on_earth and whole and (cells[:, _COVARIANCE][:, ::4] >= 0.0).all())


def _fixes(cells: Array) -> dict[str, Array]:
    place = np.where(cells[:, _STATUS : _STATUS + 1] == NO_FIX, np.nan, cells[:, _PLACE])
    sd = np.sqrt(np.where(cells[:, _KIND:] == UNKNOWN, 0.0, cells[:, _COVARIANCE][:, ::4]))
    return dict(zip(FIX_COLUMNS, (*place.T, *sd.T), strict=True))


def _stamped(table: SourceTable, columns: dict[str, Array], message: str, units: dict[str, str]) -> SourceTable:
    seconds, part = (table.frame[name].to_numpy(dtype=np.int64) for name in table.columns[:2])
    note = f"{table.name}: has no names of columns: its lines are read as messages {message} of ROS 2"
    frame = pd.DataFrame({STAMP: seconds * _SECOND_NS + part, **columns})
    return replace(table, frame=frame, units={STAMP: "ns", **units}, notes=(*table.notes, note))

"""Canonical rows, from a sensor's own units to SI, FLU and one clock: the formulas, over columns of any number of rows.

* time: ``t = raw * unit + time_offset_s``; an IMU stamp at the start or end of the interval that a sample averages is
  moved to its centre by half the median interval of its rate (not by each row's own, which would spread the stamps'
  jitter);
* IMU: ``x_body = R_mount A x_columns``, with A from ``axes`` and R_mount from ``mount_rpy_deg``;
* tach: pulses to ``count * pi * wheel_diameter_m / pulses_per_rev``; speed by the trapezoid rule, from 0;
* GNSS: geodetic to ENU about ``gnss.origin``, or the first row.

The formats of the sensors use them (:mod:`trackfg.io.formats`), on whole tables and on a few rows of a stream at a
time. A column that a formula does not change is handed back as it is, bit by bit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from trackfg.numerics import geodesy, rotations, units
from trackfg.numerics.arrays import Array
from trackfg.recording.description import Gnss, Imu, Laser, Table, Tach

Columns = Sequence[Array]


def seconds(part: Table, raw: Array) -> Array:
    """Return times as written (n,) in s on the sensor's own clock."""
    return raw * units.to_si("time", part.time_unit)


def on_common_clock(part: Table, t: Array, interval_s: float | Array = 0.0) -> Array:
    """Return times on the sensor's clock (n,), s, on that of the recording; ``interval_s`` is the IMU's median
    interval, of all rows or of each.
    """
    share = {"start": 0.5, "centre": 0.0, "end": -0.5}[part.stamp] if isinstance(part, Imu) else 0.0
    if share == 0.0:
        return t if part.time_offset_s == 0.0 else t + part.time_offset_s
    return np.asarray(t + (part.time_offset_s + share * interval_s))


def imu_rotation(part: Imu) -> Array:
    """Return the matrix from the file's columns to the vehicle's FLU axes, ``R_mount A``. Shape (3, 3)."""
    A = rotations.axes_matrix(part.axes)
    if not any(part.mount_rpy_deg):
        return A
    roll, pitch, yaw = np.radians(part.mount_rpy_deg)
    return rotations.matrix_from_rpy(roll, pitch, yaw) @ A


def imu_in_body(part: Imu, R: Array, columns: Columns) -> tuple[Array, ...]:
    """Return angular rate (rad/s) and specific force (m/s^2) in body axes, six columns (n,); ``R`` is that of
    :func:`imu_rotation`.
    """
    gyro = _rotated(columns[:3], R, units.to_si("angular rate", part.gyro_unit))
    accel = _rotated(columns[3:], R, units.to_si("acceleration", part.accel_unit))
    return (*gyro, *accel)


def _rotated(columns: Columns, R: Array, scale: float) -> list[Array]:
    """Return ``scale * R`` applied to three columns, without arithmetic where it would change nothing (values stay
    exact).
    """
    out = []
    for row in scale * R:
        used = np.flatnonzero(row)
        if used.size == 1:
            column = columns[used[0]]
            out.append(column if row[used[0]] == 1.0 else row[used[0]] * column)
        else:
            out.append(row[0] * columns[0] + row[1] * columns[1] + row[2] * columns[2])
    return out


@dataclass(frozen=True)
class TachReading:
    """The state of the integral of a speed: the last row's time (s), speed (m/s) and distance (m)."""

    t_s: float
    speed_mps: float
    distance_m: float


def tach_distance(part: Tach, t: Array, values: Array, last: TachReading | None = None) -> Array:
    """Return the cumulative nominal distance (n,), m, of ``values`` (n,) at ``t`` (n,), s. A speed is integrated on
    from ``last``, or from 0 at the first row.
    """
    if part.kind == "pulses":
        return values * pulse_m(part)
    if part.kind == "distance":
        return _scaled(values, units.to_si("length", part.unit))
    speed = tach_speed(part, values)
    if last is not None:
        t, speed = np.concatenate([[last.t_s], t]), np.concatenate([[last.speed_mps], speed])
    start = 0.0 if last is None else last.distance_m
    steps = np.diff(t) * 0.5 * (speed[1:] + speed[:-1])
    distance = np.cumsum(np.concatenate([[start], steps]))
    return distance if last is None else distance[1:]


def tach_speed(part: Tach, values: Array) -> Array:
    """Return the values (n,) of a tach of kind ``speed`` in m/s."""
    return _scaled(values, units.to_si("speed", part.unit))


def pulse_m(part: Tach) -> float:
    """Return the nominal distance of one pulse, m. Raises ``ValueError`` unless the tach counts pulses."""
    if part.kind != "pulses" or part.wheel_diameter_m is None or part.pulses_per_rev is None:
        raise ValueError(f"a tach of kind {part.kind!r} has no pulses")
    return float(np.pi * part.wheel_diameter_m / part.pulses_per_rev)


def gnss_origin(part: Gnss, columns: Columns) -> Array | None:
    """Return latitude (deg), longitude (deg) and height (m) of the frame's origin; None where that is not known."""
    if part.origin is not None:
        return np.array(part.origin)
    return np.array([column[0] for column in columns[:3]]) if part.frame == "geodetic" else None


def gnss_position(part: Gnss, origin: Array | None, columns: Columns) -> tuple[Array, ...]:
    """Return three columns (n,): east, north and up of the origin, m."""
    if part.frame == "local" or origin is None:
        return tuple(columns[:3])
    return tuple(geodesy.geodetic_to_enu(np.column_stack(list(columns[:3])), origin).T)


def laser_displacement(part: Laser, values: Array) -> Array:
    """Return displacements (n,) in m."""
    return _scaled(values, units.to_si("length", part.unit))


def _scaled(values: Array, factor: float) -> Array:
    return values if factor == 1.0 else values * factor

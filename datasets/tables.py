"""The canonical tables of a recording and their descriptions.

Whatever a source is like, what this package hands out is in the form in which a recording is written: SI, axes FLU,
IMU stamps at the centre of the sample's interval, columns named as in :mod:`trackfg.recording.model`.
"""

from __future__ import annotations

import numpy as np
import pandas as pd

from trackfg.numerics.arrays import Array
from trackfg.recording.description import RECEIVER_SPEED_SD_MPS, Fixes, Gnss, GnssSpeed, Imu, ImuNoise, Vector3
from trackfg.recording.model import (
    FIX_COLUMNS,
    GNSS_COLUMNS,
    GNSS_SPEED_COLUMNS,
    GNSS_SPEED_TABLE,
    IMU_COLUMNS,
    TACH_COLUMNS,
)

TRAJECTORY_COLUMNS = ("t_s", "east_m", "north_m", "up_m", "speed_mps", "roll_rad", "pitch_rad", "yaw_rad")


def clock(duration_s: float, rate_hz: float) -> Array:
    """Return times from 0, ``rate_hz`` a second, not beyond ``duration_s``. Shape (n,)."""
    return np.arange(int(duration_s * rate_hz * (1.0 + 1e-12)) + 1) / rate_hz


def table(names: tuple[str, ...], *columns: Array) -> pd.DataFrame:
    """Return the table with these columns, (n,) each."""
    return pd.DataFrame(dict(zip(names, columns, strict=True)))


def imu_table(t_s: Array, gyro: Array, accel: Array) -> pd.DataFrame:
    """Return the ``imu`` table from interval centres (n,), angular rates and specific forces (n, 3), FLU, SI."""
    return table(IMU_COLUMNS, t_s, *gyro.T, *accel.T)


def tach_table(t_s: Array, distance_m: Array) -> pd.DataFrame:
    """Return the ``tach`` table from times (n,) and cumulative nominal distances (n,)."""
    return table(TACH_COLUMNS, t_s, distance_m)


def integrated_speed(t_s: Array, speed_mps: Array) -> Array:
    """Return the distance (n,) that a speed tach stands for, by the trapezoid rule, 0 at the first sample."""
    steps = np.diff(t_s) * 0.5 * (speed_mps[1:] + speed_mps[:-1])
    return np.concatenate([[0.0], np.cumsum(steps)])


def gnss_table(t_s: Array, enu_m: Array, sd_m: Array) -> pd.DataFrame:
    """Return the ``gnss`` table from times (n,), east-north-up positions (n, 3) and their sigmas, (3,) or (n, 3)."""
    return table(GNSS_COLUMNS, t_s, *enu_m.T, *np.broadcast_to(sd_m, enu_m.shape).T)


def trajectory_table(t_s: Array, enu_m: Array, speed_mps: Array, rpy_rad: Array) -> pd.DataFrame:
    """Return a reference trajectory, columns :data:`TRAJECTORY_COLUMNS`; yaw is unwrapped along the rows."""
    roll, pitch, yaw = rpy_rad.T
    return table(TRAJECTORY_COLUMNS, t_s, *enu_m.T, speed_mps, roll, pitch, np.unwrap(yaw))


def imu_description(
    noise: ImuNoise,
    lever_arm_m: Vector3 = (0.0, 0.0, 0.0),
    *,
    rigid: bool,
    mount_roll_sd_rad: float = 0.0,
    sensor_id: str | None = None,
) -> Imu:
    """Return what ``recording.toml`` says of a canonical ``imu`` table; ``sensor_id``: that of sensor and mounting."""
    _, wx, wy, wz, fx, fy, fz = IMU_COLUMNS
    return Imu(
        file="imu.parquet",
        id=sensor_id,
        time="t_s",
        gyro=(wx, wy, wz),
        accel=(fx, fy, fz),
        noise=noise,
        lever_arm_m=lever_arm_m,
        rigid=rigid,
        mount_roll_sd_deg=float(np.degrees(mount_roll_sd_rad)),
    )


def gnss_description(origin: Array | None = None, lever_arm_m: Vector3 = (0.0, 0.0, 0.0)) -> Gnss:
    """Return what ``recording.toml`` says of a canonical ``gnss`` table, ENU about ``origin`` if that is known."""
    time, east, north, up, east_sd, north_sd, up_sd = GNSS_COLUMNS
    return Gnss(
        file="gnss.parquet",
        time=time,
        position=(east, north, up),
        sd=(east_sd, north_sd, up_sd),
        frame="local",
        origin=None if origin is None else (float(origin[0]), float(origin[1]), float(origin[2])),
        lever_arm_m=lever_arm_m,
    )


def gnss_speeds(t_s: Array, speed_mps: Array, sd_mps: float = RECEIVER_SPEED_SD_MPS) -> dict[str, pd.DataFrame]:
    """Return the ``gnss_speed`` table by its name, from times and speeds (n,), all with one sigma."""
    return {GNSS_SPEED_TABLE: table(GNSS_SPEED_COLUMNS, t_s, speed_mps, np.full(len(t_s), sd_mps))}


def gnss_speed_description() -> GnssSpeed:
    """Return what ``recording.toml`` says of a canonical ``gnss_speed`` table."""
    time, speed, sd = GNSS_SPEED_COLUMNS
    return GnssSpeed(file="gnss_speed.parquet", time=time, column=speed, sd=sd)


def fixes_description() -> Fixes:
    """Return what ``recording.toml`` says of a canonical ``fixes`` table."""
    time, chainage, sd = FIX_COLUMNS
    return Fixes(file="fixes.parquet", time=time, chainage=chainage, sd=sd)

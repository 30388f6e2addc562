"""The example segment of comma2k19: a phone's IMU, CAN wheel speeds, u-blox GNSS and an optimised pose; 60 s, 1 km.

See docs/datasets.md for the source, the licence and the measurements behind every constant here.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from trackfg.datasets import tables
from trackfg.datasets.real.real_run import RealRun, existing_files
from trackfg.numerics import geodesy, rotations
from trackfg.numerics.arrays import Array
from trackfg.recording.description import ImuNoise, RecordingDescription, Tach, Track
from trackfg.recording.model import Recording

MOUNT_PITCH_RAD, MOUNT_YAW_RAD = 0.0662, 0.0142
"""How the phone sits in the car: 3.79 deg nose-down, 0.82 deg to the left.

A calibration of the installation, from the direction of the pose's velocity in phone axes. Velocity does not show the
roll of the mount, which stays in the data.
"""

GNSS_SD_M = (0.15, 0.15, 0.15)
"""Scatter of the fixes against the pose within 5 s, the worst axis. Their offset of about 1 m and late clock are common
to all of them, and moving the path as a whole is not what this sigma is about."""

NOISE = ImuNoise(
    gyro_white=5e-4,
    accel_white=5e-2,
    gyro_bias_walk=2e-5,
    accel_bias_walk=1e-3,
    gyro_bias_sd=1e-3,
    accel_bias_sd=0.2,
)
"""The noise that is declared of the IMU; docs/datasets.md says where it is from."""

_FILES = (
    "processed_log/IMU/accelerometer/t",
    "processed_log/IMU/accelerometer/value",
    "processed_log/IMU/gyro/value",
    "processed_log/CAN/wheel_speed/t",
    "processed_log/CAN/wheel_speed/value",
    "processed_log/GNSS/live_gnss_ublox/t",
    "processed_log/GNSS/live_gnss_ublox/value",
    "global_pose/frame_times",
    "global_pose/frame_positions",
    "global_pose/frame_velocities",
    "global_pose/frame_orientations",
)


def load(folder: Path | str, *, speeds: bool = False) -> RealRun:
    """Return the segment in ``folder`` as a recording, on demand with the receiver's own speeds.

    Raises :class:`~trackfg.errors.BadInputError` where a file is missing.
    """
    paths = existing_files(folder, _FILES, "a segment of comma2k19 with processed_log/ and global_pose/")
    imu_t, accel, gyro, wheel_t, wheels, gnss_t, fixes, *pose = (np.load(path, allow_pickle=False) for path in paths)
    zero = float(imu_t[0])
    origin = fixes[0, [0, 1, 4]]
    R_vehicle_phone = rotations.matrix_from_rpy(*(np.array(a) for a in (0.0, MOUNT_PITCH_RAD, MOUNT_YAW_RAD)))
    to_vehicle = R_vehicle_phone @ rotations.axes_matrix("FRD")

    # The rear wheels are neither steered nor driven: their mean is the speed of the middle of the rear axle.
    rear_speed = wheels[:, 2:].mean(axis=1)
    tach_t = wheel_t - zero
    recording = Recording(
        description=RecordingDescription(
            id="comma2k19-b0c9d2329ad1606b-2018-08-02-40",
            track=Track(latitude_deg=float(origin[0])),
            imu=tables.imu_description(NOISE, rigid=False),
            tach=Tach(file="tach.parquet", time="t_s", column="speed_mps", kind="speed", unit="m/s", scale_sd=0.02),
            gnss=tables.gnss_description(origin),
            gnss_speed=tables.gnss_speed_description() if speeds else None,
        ),
        imu=tables.imu_table(imu_t - zero, gyro @ to_vehicle.T, accel @ to_vehicle.T),
        tach=tables.tach_table(tach_t, tables.integrated_speed(tach_t, rear_speed)),
        gnss=tables.gnss_table(
            gnss_t - zero, geodesy.geodetic_to_enu(fixes[:, [0, 1, 4]], origin), np.array(GNSS_SD_M)
        ),
        gnss_origin=origin,
        others=tables.gnss_speeds(gnss_t - zero, fixes[:, 2]) if speeds else {},
    )
    return RealRun(recording, _reference(*pose, zero=zero, origin=origin, to_vehicle=to_vehicle))


def _reference(
    t: Array, ecef: Array, velocity: Array, quaternion: Array, *, zero: float, origin: Array, to_vehicle: Array
) -> pd.DataFrame:
    """Return the pose in the trajectory columns. Its quaternion maps the phone's forward-right-down axes to ECEF."""
    to_enu = geodesy.ecef_from_enu(origin[0], origin[1]).T
    R_nb = to_enu @ rotations.matrix_from_quaternion(quaternion.T) @ to_vehicle.T
    enu = (ecef - geodesy.geodetic_to_ecef(origin)) @ to_enu.T
    return tables.trajectory_table(t - zero, enu, np.linalg.norm(velocity, axis=1), rotations.rpy_from_matrix(R_nb))

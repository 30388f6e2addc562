"""The KITTI drive that comes inside the gtsam wheel: 470 s, 3.7 km, IMU at 100 Hz and local positions at 1 Hz.

Vehicle axes x forward, y left, z up. Positions are X, Y, Z = east, north, up in a local frame. Clocks start at the
first IMU stamp. The file's ``dt`` is the time since the row before: a row stands for the interval that ends at its
stamp, so the interval's centre is half a sample earlier. There is no tachometer and no reference of its own: the
positions themselves are handed out a second time as ``reference``, so that withheld ones can be scored. See
docs/datasets.md.
"""

from __future__ import annotations

import gtsam
import numpy as np
import pandas as pd

from trackfg.datasets import tables
from trackfg.datasets.real.real_run import RealRun
from trackfg.recording.description import ImuNoise, RecordingDescription
from trackfg.recording.model import Recording

POSITION_SD_M = (0.07, 0.07, 0.07)
"""As in GTSAM's own example on these files."""


SAMPLE_S = 0.01
"""The IMU's nominal interval; one is 1.92 s long, the first, and its row stands for no more than the others."""


def load() -> RealRun:
    """Return the drive as a recording; ``reference`` has ``t_s, east_m, north_m, up_m`` of every position."""
    raw_imu = np.loadtxt(_path("KittiEquivBiasedImu.txt"), skiprows=1)
    raw_gnss = np.loadtxt(_path("KittiGps_converted.txt"), skiprows=1, delimiter=",")
    stamps, accel, gyro = raw_imu[:, 0], raw_imu[:, 2:5], raw_imu[:, 5:8]
    origin = stamps[0]
    gnss_t = raw_gnss[:, 0] - origin
    recording = Recording(
        description=RecordingDescription(
            id="kitti-equiv-biased-imu",
            imu=tables.imu_description(_noise(), rigid=False),
            gnss=tables.gnss_description(),
        ),
        imu=tables.imu_table(stamps - origin - 0.5 * SAMPLE_S, gyro, accel),
        gnss=tables.gnss_table(gnss_t, raw_gnss[:, 1:4], np.array(POSITION_SD_M)),
    )
    reference = tables.table(("t_s", "east_m", "north_m", "up_m"), gnss_t, *raw_gnss[:, 1:4].T)
    return RealRun(recording, reference)


def _noise() -> ImuNoise:
    """Return the densities of the metadata file (its sigmas are continuous-time: GTSAM's example squares them as
    such).
    """
    table = pd.read_csv(_path("KittiEquivBiasedImu_metadata.txt"), sep=r"\s+").iloc[0]
    return ImuNoise(
        gyro_white=table["GyroscopeSigma"],
        accel_white=table["AccelerometerSigma"],
        gyro_bias_walk=table["GyroscopeBiasSigma"],
        accel_bias_walk=table["AccelerometerBiasSigma"],
        gyro_bias_sd=5e-4,
        accel_bias_sd=0.1,
        gyro_scale_sd=1e-4,
        accel_scale_sd=1e-4,
        misalignment_sd_rad=1e-4,
        g_sensitivity_sd=1e-6,
    )


def _path(name: str) -> str:
    return str(gtsam.findExampleDataFile(name))  # type: ignore[no-untyped-call]

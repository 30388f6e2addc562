"""The Kingston downtown drive: IMU at 10 Hz, OBD-II speed, GNSS, and a NovAtel SPAN reference; 3529 s, 22 km.

See docs/datasets.md for the source, the licence and the measurements behind every constant here.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

import numpy as np
import pandas as pd
import scipy.io

from trackfg.datasets import tables
from trackfg.datasets.real.real_run import RealRun, existing_files
from trackfg.errors import BadInputError
from trackfg.numerics import geodesy, units
from trackfg.numerics.arrays import Array
from trackfg.recording.description import ImuNoise, RecordingDescription, Tach, Track
from trackfg.recording.model import Recording

GEOID_UNDULATION_M = -33.80
"""Ellipsoidal less orthometric height: the GNSS tables give the second, the reference the first."""

BESTPOS_SD_M = (0.05, 0.05, 0.05)
"""BESTPOS carries no sigma: twice its rms difference from INSPVA (its absolute error is larger, and common to both)."""

HALF_SPEED_STEP_MPS = 0.5 * units.KMH
"""The car reports whole km/h, cut off below: on average it goes this much faster than it says."""

LEVER_ARM_M = (0.69, 0.0, 0.0)
"""The unit, to which all positions refer, is this far ahead of the point that does not slip sideways in bends.

From the first 660 s: its sideways velocity is 0.69 m times the yaw rate (scatter 0.118 m/s before, 0.032 m/s after).
"""

SAMPLE_S = 0.1
"""The IMU stamps mark the end of the interval that a sample averages."""

NOISE = ImuNoise(
    gyro_white=5e-5,
    accel_white=2e-3,
    gyro_bias_walk=5e-8,
    accel_bias_walk=1e-5,
    gyro_bias_sd=2e-5,
    accel_bias_sd=0.01,
    gyro_scale_sd=1e-4,
    accel_scale_sd=1e-4,
    misalignment_sd_rad=1e-4,
    g_sensitivity_sd=1e-6,
)
"""The noise that is declared of the IMU; docs/datasets.md says where it is from."""

_FILES = ("f_w_IMSseconds_dt.mat", "CarChip_Speed_interpolated.mat", "BESTPOS.mat", "BESTGPSPOS.mat", "INSPVA.mat")


def load(
    folder: Path | str,
    gnss: Literal["BESTPOS", "BESTGPSPOS"] = "BESTPOS",
    *,
    centre_speed: bool = False,
    speeds: bool = False,
) -> RealRun:
    """Return the drive in ``folder`` as a recording, with positions from the table ``gnss``.

    ``BESTPOS`` is the receiver's INS-aided position, ``BESTGPSPOS`` GPS alone (urban multipath, errors to 79 m) with
    its own sigmas. ``centre_speed`` adds half a step to every speed but zero, which undoes the cut-off; without it the
    speed is as recorded, and the wheel's scale seems to depend on the speed. ``speeds``: with those of GPS alone,
    BESTGPSVEL. Raises
    :class:`~trackfg.errors.BadInputError` where a file is missing or ``gnss`` is neither.
    """
    if gnss not in ("BESTPOS", "BESTGPSPOS"):
        raise BadInputError(f"gnss {gnss!r}: expected 'BESTPOS' or 'BESTGPSPOS'")
    paths = existing_files(folder, _FILES, "the folder 2008-06-23_Downtown_Kingston of Full_IMU_Mechanization")
    imu, speed, bestpos, gps, ins = (scipy.io.loadmat(path, squeeze_me=True) for path in paths)
    zero = float(imu["IMU_second"][0])
    origin = np.array([bestpos["BP_Lat"][0], bestpos["BP_Long"][0], bestpos["BP_Alt"][0] + GEOID_UNDULATION_M])

    tach_t, car_speed = speed["CarChip_second_1HZ"] - zero, speed["CarChip_Speed_1HZ"]
    if centre_speed:
        car_speed = np.where(car_speed > 0, car_speed + HALF_SPEED_STEP_MPS, 0.0)
    if gnss == "BESTPOS":
        gnss_t, geodetic, sd = bestpos["BP_second"] - zero, _columns(bestpos, "BP_Lat", "BP_Long", "BP_Alt"), None
    else:
        gnss_t, geodetic = gps["BGP_second"] - zero, _columns(gps, "BGP_Lat", "BGP_Long", "BGP_Alt")
        sd = _columns(gps, "BGP_Long_std", "BGP_Lat_std", "BGP_Alt_std")
    geodetic[:, 2] += GEOID_UNDULATION_M

    recording = Recording(
        description=RecordingDescription(
            id=f"kingston-2008-06-23-{gnss.lower()}",
            track=Track(latitude_deg=float(origin[0])),
            imu=tables.imu_description(NOISE, LEVER_ARM_M, rigid=False),
            tach=Tach(file="tach.parquet", time="t_s", column="speed_mps", kind="speed", unit="m/s", scale_sd=0.02),
            gnss=tables.gnss_description(origin, LEVER_ARM_M),
            gnss_speed=tables.gnss_speed_description() if speeds else None,
        ),
        imu=tables.imu_table(imu["IMU_second"] - zero - 0.5 * SAMPLE_S, _flu(imu["w"]), _flu(imu["f"])),
        tach=tables.tach_table(tach_t, tables.integrated_speed(tach_t, car_speed)),
        gnss=tables.gnss_table(
            gnss_t, geodesy.geodetic_to_enu(geodetic, origin), np.array(BESTPOS_SD_M) if sd is None else sd
        ),
        gnss_origin=origin,
        others=_speeds(Path(folder), zero) if speeds else {},
    )
    return RealRun(recording, _reference(ins, zero, origin))


def _speeds(folder: Path, zero: float) -> dict[str, pd.DataFrame]:
    """Return the table of the receiver's speeds by GPS alone."""
    (path,) = existing_files(folder, ("BESTGPSVEL.mat",), "the folder 2008-06-23_Downtown_Kingston")
    velocity = scipy.io.loadmat(path, squeeze_me=True)
    return tables.gnss_speeds(velocity["BGV_second"] - zero, velocity["BGV_hor_spd"])


def _reference(ins: dict[str, Any], zero: float, origin: Array) -> pd.DataFrame:
    """Return INSPVA in the trajectory columns: the unit's position, its attitude against the local level.

    SPAN gives roll right-handed about forward (left side up positive, as here), pitch right-handed about right (nose up
    positive: the opposite of here) and azimuth clockwise from the local north, which yaw here is not: the level frame
    does not turn about the vertical, so the meridians' convergence since ``origin`` comes in.
    """
    geodetic = _columns(ins, "INS_Lat", "INS_Long", "INS_Alt")
    roll, pitch, azimuth = np.radians(_columns(ins, "INS_Roll", "INS_Pitch", "INS_Azi")).T
    convergence = np.radians(geodetic[:, 1] - origin[1]) * np.sin(np.radians(geodetic[:, 0]))
    speed = np.linalg.norm(_columns(ins, "INS_ve", "INS_vn", "INS_vu"), axis=1)
    rpy = np.column_stack([roll, -pitch, np.pi / 2 - azimuth + convergence])
    return tables.trajectory_table(ins["INS_second"] - zero, geodesy.geodetic_to_enu(geodetic, origin), speed, rpy)


def _flu(triad: Any) -> Array:
    """Return right-forward-up fields x, y, z of a MATLAB struct as rows (forward, left, up)."""
    right, forward, up = (np.asarray(triad[axis].item(), dtype=np.float64) for axis in ("x", "y", "z"))
    return np.column_stack([forward, -right, up])


def _columns(table: dict[str, Any], *names: str) -> Array:
    return np.column_stack([np.asarray(table[name], dtype=np.float64) for name in names])

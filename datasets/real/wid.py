"""Drives of the Wheel Inertial Dataset: a car with low-cost inertial sensors on body and wheels, and GNSS; 90-170 s.

See docs/datasets.md for the source, and for what is known of clocks and wheels.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

from trackfg.datasets import tables
from trackfg.datasets.real.real_run import RealRun, existing_files
from trackfg.errors import BadInputError
from trackfg.numerics import geodesy, rotations
from trackfg.numerics.arrays import Array
from trackfg.recording.description import ImuNoise, RecordingDescription, Tach, Track
from trackfg.recording.model import Recording

WHEEL_RADIUS_M = 0.2929
"""Of the rear wheels: the length of five drives by GNSS over the turns of the sensors on them, 0.2915 to 0.2941."""

_FILES = ("CAR.csv", "IMU2.csv", "IMU4.csv", "GNSS.csv")
_CLOCK_TICKS = 2**32
_TICK_S = 1e-6
_LARGEST_DPS, _LARGEST_MPS2 = 2000.0, 160.0
"""The sensor's ranges: rows with more, or with none, were garbled when they were sent."""
_WHEEL_STEP_S = 0.02
_LATEST_S = 2.0
"""The sensors begin within this of each other."""
_GNSS_ROW_S = 0.01
"""Between two rows of positions. Their stamps count up by ten times as much."""


class _Samples(NamedTuple):
    """Times since the first sample (n,), s; specific force, m/s^2, and angular rate, rad/s, in the sensor's axes
    (n, 3).
    """

    t: Array
    accel: Array
    gyro: Array


def load(folder: Path | str) -> RealRun:
    """Return the drive in ``folder``, one of the dataset's trials with both rear wheels, as a recording without GNSS.

    The speed is the mean of the rear wheels, on the clock of one of them, which begins within 2 s of the body's. The
    reference are the positions, on the receiver's clock since its first row.

    Raises :class:`~trackfg.errors.BadInputError` where a file is missing or is none of the dataset's.
    """
    body_file, *wheel_files, gnss_file = existing_files(folder, _FILES, "a trial of the Wheel Inertial Dataset")
    body, wheels = _samples(body_file), [_samples(path) for path in wheel_files]
    to_vehicle = rotations.axes_matrix("RFU")
    t, speed = _speed(*wheels)
    recording = Recording(
        description=RecordingDescription(
            id=f"wid-{Path(folder).name}",
            track=Track(),
            imu=tables.imu_description(ImuNoise(), rigid=False),
            tach=Tach(file="tach.parquet", time="t_s", column="speed_mps", kind="speed", unit="m/s"),
        ),
        imu=tables.imu_table(body.t, body.gyro @ to_vehicle.T, body.accel @ to_vehicle.T),
        tach=tables.tach_table(t, tables.integrated_speed(t, speed)),
    )
    return RealRun(recording, _reference(gnss_file))


def _samples(path: Path) -> _Samples:
    """Read the file of a sensor, whose first line names the separator, and leave out rows that were garbled."""
    names = ["SampleTimeFine", *(f"{kind}_{axis}" for kind in ("Acc", "Gyr") for axis in "XYZ")]
    try:
        table = pd.read_csv(path, skiprows=1, skipinitialspace=True, usecols=names)
    except ValueError as error:
        raise BadInputError(f"{path.name}: expected the columns {', '.join(names)} below a line with sep=,") from error
    table = table.apply(pd.to_numeric, errors="coerce")
    ticks, force, rate = table["SampleTimeFine"], table[names[1:4]].to_numpy(), table[names[4:]].to_numpy()
    whole = (np.abs(force) < _LARGEST_MPS2).all(axis=1) & (np.abs(rate) < _LARGEST_DPS).all(axis=1)
    whole &= force.any(axis=1)  # the first row is all zeros
    t = _TICK_S * np.concatenate([[0.0], np.cumsum(np.diff(ticks) % _CLOCK_TICKS)])
    return _Samples(t[whole], force[whole], np.radians(rate[whole]))


def _speed(one: _Samples, other: _Samples) -> tuple[Array, Array]:
    """Return times and the mean speed of the rear wheels, on the clock of one, which the other agrees with best."""
    t = np.arange(0.0, min(one.t[-1], other.t[-1]), _WHEEL_STEP_S)
    turning = np.interp(t, one.t, np.abs(one.gyro[:, 2]))

    def shifted(shift_s: float) -> Array:
        return np.interp(t + shift_s, other.t, np.abs(other.gyro[:, 2]))

    shifts = np.arange(-_LATEST_S, _LATEST_S, _WHEEL_STEP_S).tolist()
    best = min(shifts, key=lambda shift_s: float(np.mean((shifted(shift_s) - turning) ** 2)))
    return t, 0.5 * WHEEL_RADIUS_M * (turning + shifted(best))


def _reference(path: Path) -> pd.DataFrame:
    """Return the positions that differ from the ones before, east, north and up of the first."""
    table = pd.read_csv(path, usecols=["Lat_GNSS", "Long_GNSS", "Height_GNSS"])
    places = table.to_numpy()
    fresh = np.concatenate([[True], (np.diff(places[:, :2], axis=0) != 0.0).any(axis=1)])
    enu = geodesy.geodetic_to_enu(places[fresh], places[0])
    t = _GNSS_ROW_S * np.flatnonzero(fresh)
    return pd.DataFrame({"t_s": t, "east_m": enu[:, 0], "north_m": enu[:, 1], "up_m": enu[:, 2]})

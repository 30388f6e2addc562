"""The feedback extended Kalman filter of python-ins (``pyins``) is run as a baseline.

It has the errors of position, velocity, attitude and biases as states (Groves, "Principles of GNSS, inertial, and
multisensor integrated navigation systems", 2nd edition, as the package cites it).

It is fed with

- every IMU sample as increments, with the declared noise densities and sigmas of the biases;
- the tachometer's speed twice a second (the mean over 0.5 s, the wheel nominal) as a velocity along the vehicle's x
  axis, and none across it, seen from the sensor;
- GNSS positions, if there are any, with the median of their sigmas: python-ins takes one for all. The wheel's scale is
  no state of it, so the forward speed then has the sigma of that scale too;
- where it starts: heading by GNSS (:func:`trackfg.sensors.dead_reckoning.initial_path`), as declared, or yaw 0 where
  nothing determines it. From a standstill at the start come the tilt and, less the Earth's rate in that attitude, the
  gyro's bias; where there is none, tilt is the initial path's.

Signs are converted here: FLU and ENU to FRD and NED, so y, z, pitch and the heading change theirs.

**The Earth turns** in python-ins, always, so it needs a latitude: that of GNSS, else the recording's, else
:data:`DEFAULT_LATITUDE_DEG`, where gravity is the standard one; docs/baselines/peers.md says what a wrong one costs.
Chainage is the tachometer's.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from trackfg.baselines.attitude import Attitude, SampledMotion, motion_of, tables
from trackfg.geometry.cross_level import cross_level
from trackfg.numerics.blas_threads import one_thread
from trackfg.numerics.geodesy import earth_rate_enu, geodetic_to_enu
from trackfg.numerics.rotations import matrix_from_rpy
from trackfg.peers.installed import require
from trackfg.sensors.dead_reckoning import initial_path
from trackfg.sensors.imu_intervals import interpolate_columns, intervals, means_around
from trackfg.sensors.standstills import find_standstills
from trackfg.sensors.tach import read_wheel
from trackfg.sensors.tilt import force_tilt

if TYPE_CHECKING:
    from pyins.measurements import Measurement

    from trackfg.baselines.result import BaselineResult
    from trackfg.numerics.arrays import Array
    from trackfg.recording.model import Recording

NAME = "python-ins"
DEFAULT_LATITUDE_DEG = 45.0
"""Latitude where the recording has none, deg: gravity is the standard one there."""
VELOCITY_HZ = 2.0
"""Body velocities per second. More of them cost the filter more, not the smoother."""

_SPEED_OVER_S = 0.5
"""Time over which a body velocity is averaged, s: one interval of them."""
_VELOCITY_SD_MPS = 0.03
"""1-sigma of a body velocity, each axis, m/s. Chosen here."""
_TIME_STEP_S = 0.5
"""Longest step of the filter's covariance, s: one interval of the velocities."""
_MAX_TACH_GAP_S = 2.0
"""A longer silence of the tachometer while moving is a gap, s. Chosen here."""
_TILT_SD_RAD = np.radians(0.3)
"""1-sigma of roll and pitch at the start, rad. Chosen here."""
_HEADING_SD_RAD = np.radians(1.0)
"""1-sigma of the yaw at the start where GNSS or the recording gives it, rad. Chosen here."""
_NO_HEADING_SD_RAD = np.radians(0.1)  # yaw is then counted from the start
_START_SPEED_SD_MPS = 0.05
"""1-sigma of the velocity at the start, each axis, m/s. Chosen here."""
_START_PLACE_SD_M = 1e-3
"""1-sigma of the place at the start without GNSS, m: it defines the frame."""
_STEPS_TO_GEODETIC = 5  # each leaves the angle between the meridians, so a hundredth over 100 km
_FRD = np.array([1.0, -1.0, -1.0])


@dataclass(frozen=True)
class Start:
    """The sensor's start: ``geodetic`` (latitude deg, longitude deg, height m); ``rpy`` (3,), rad; sigmas."""

    geodetic: Array
    rpy: Array
    place_sd_m: float
    tilt_sd_rad: float
    yaw_sd_rad: float


@dataclass(frozen=True)
class Filtered:
    """Place and attitude of the sensor at times ``t`` (n,); ``rpy`` rad, its yaw unwrapped and from the local east."""

    t: Array
    geodetic: Array
    rpy: Array
    rpy_sd: Array
    enu_sd: Array


def run(recording: Recording) -> BaselineResult:
    """Estimate attitude and position with their sigmas, cross-level and twist of a recording.

    Raises :class:`~trackfg.errors.MissingLibraryError` without the package, ``BadInputError`` without a
    tachometer.
    """
    require("python-ins")
    motion = motion_of(recording, remove_static_bias=True)
    start = _start(recording, motion)
    noise, rest_s = recording.description.imu.noise, motion.standstill_s
    bias_sd = noise.gyro_bias_sd
    if rest_s > 0.0:
        seen_at_rest = matrix_from_rpy(*start.rpy).T @ earth_rate_enu(float(start.geodetic[0]))
        motion = replace(motion, gyro=motion.gyro + seen_at_rest)
        bias_sd = float(np.hypot(noise.gyro_white / np.sqrt(rest_s), noise.gyro_bias_walk * np.sqrt(rest_s)))
    filtered = feedback_filter(recording, motion, start, gyro_bias_sd=bias_sd, time_step_s=_TIME_STEP_S)

    rpy, rpy_sd = (interpolate_columns(motion.t, filtered.t, of) for of in (filtered.rpy, filtered.rpy_sd))
    attitude = Attitude(
        roll=rpy[:, 0],
        cross_level=cross_level(rpy[:, 0], recording.description.track.cross_level_base_m),
        pitch=rpy[:, 1],
        roll_sd=rpy_sd[:, 0],
        pitch_sd=rpy_sd[:, 1],
    )
    parameters: dict[str, float | str | bool] = {
        "latitude_deg": float(start.geodetic[0]),
        "gyro_bias_sd_radps": bias_sd,
        "velocity_hz": VELOCITY_HZ,
        "velocity_sd_mps": _VELOCITY_SD_MPS,
        "with_gnss": recording.gnss is not None,
    }
    result = tables(NAME, recording, motion, attitude, parameters)
    return replace(result, trajectory=_with_place(result.trajectory, recording, filtered))


def feedback_filter(
    recording: Recording,
    motion: SampledMotion,
    start: Start,
    *,
    gyro_bias_sd: float,
    wheel_scale: float = 1.0,
    time_step_s: float = 0.1,
) -> Filtered:
    """Run python-ins' filter, which must be installed, over the samples of ``motion``.

    ``wheel_scale`` multiplies the nominal speed; the filter's covariance moves on by at most ``time_step_s``.
    """
    from pyins import filters, strapdown
    from pyins.inertial_sensor import EstimationModel

    noise = recording.description.imu.noise
    dt = motion.dt[:, None]
    imu = pd.DataFrame(
        np.hstack([motion.gyro * dt * _FRD, motion.accel * dt * _FRD]),
        index=motion.t + 0.5 * motion.dt,
        columns=[f"{sensor}_{axis}" for sensor in ("gyro", "accel") for axis in "xyz"],
    )
    R = matrix_from_rpy(*start.rpy)
    east, north, up = wheel_scale * motion.speed[0] * R[:, 0]
    roll, pitch, yaw = np.degrees(start.rpy)
    initial = pd.Series(
        [*start.geodetic, north, east, -up, roll, -pitch, 90.0 - yaw],
        index=["lat", "lon", "alt", "VN", "VE", "VD", "roll", "pitch", "heading"],
        name=imu.index[0],
    )
    # python-ins looks up columns by name ten thousand times a minute: in Arrow's strings that takes as long again.
    with one_thread(), pd.option_context("mode.string_storage", "python"), warnings.catch_warnings():
        # What pandas means to drop is for python-ins to heed.
        warnings.simplefilter("ignore", DeprecationWarning)
        result = filters.run_feedback_filter(
            initial,
            position_sd=start.place_sd_m,
            velocity_sd=_START_SPEED_SD_MPS,
            level_sd=np.degrees(start.tilt_sd_rad),
            azimuth_sd=np.degrees(start.yaw_sd_rad),
            increments=strapdown.compute_increments_from_imu(imu, "increment"),
            gyro_model=EstimationModel(gyro_bias_sd, noise.gyro_white, noise.gyro_bias_walk),
            accel_model=EstimationModel(noise.accel_bias_sd, noise.accel_white, noise.accel_bias_walk),
            measurements=_measurements(recording, motion, wheel_scale),
            time_step=time_step_s,
        )
    path, sd = result.trajectory, result.trajectory_sd
    t = path.index.to_numpy()
    ned_sd, frd_sd = (
        interpolate_columns(t, sd.index.to_numpy(), sd[names].to_numpy())
        for names in (["east", "north", "down"], ["roll", "pitch", "heading"])
    )
    roll, pitch, heading = np.radians(path[["roll", "pitch", "heading"]].to_numpy()).T
    return Filtered(
        t=t,
        geodetic=path[["lat", "lon", "alt"]].to_numpy(),
        rpy=np.column_stack([roll, -pitch, np.unwrap(0.5 * np.pi - heading)]),
        rpy_sd=np.radians(frd_sd),
        enu_sd=ned_sd,
    )


def _measurements(recording: Recording, motion: SampledMotion, wheel_scale: float) -> list[Measurement]:
    from pyins.measurements import BodyVelocity, Position

    description, gnss = recording.description, recording.gnss
    lever_arm = np.array(description.imu.lever_arm_m)
    half = 0.5 * _SPEED_OVER_S
    clock = np.arange(np.ceil(motion.t[0] + half), motion.t[-1] - half, 1.0 / VELOCITY_HZ)
    edges = np.append(motion.t[0] - 0.5 * motion.dt[0], motion.t + 0.5 * motion.dt)
    velocity = np.cross(means_around(clock, _SPEED_OVER_S, edges, motion.gyro), lever_arm)
    velocity[:, 0] += wheel_scale * np.interp(clock, motion.t, motion.speed)
    sd = np.full(3, _VELOCITY_SD_MPS)
    measurements = []
    if gnss is not None:
        # The classes multiply the square of a sigma by a unit matrix, so that one per axis does as well.
        if description.tach is not None:
            sd[0] = np.hypot(sd[0], description.tach.scale_sd * np.sqrt(np.mean(velocity[:, 0] ** 2)))
        places = geodetic_of(gnss[["east_m", "north_m", "up_m"]].to_numpy(), _origin(recording))
        measurements.append(
            Position(
                pd.DataFrame(places, index=gnss["t_s"].to_numpy(), columns=["lat", "lon", "alt"]),
                gnss[["north_sd_m", "east_sd_m", "up_sd_m"]].median().to_numpy(),
                (np.array(description.gnss.lever_arm_m if description.gnss else lever_arm) - lever_arm) * _FRD,
            )
        )
    return [BodyVelocity(pd.DataFrame(velocity * _FRD, index=clock, columns=["VX", "VY", "VZ"]), sd), *measurements]


def geodetic_of(enu: Array, origin: Array) -> Array:
    """Return latitude, longitude, deg, and height, m (n, 3), of places in the level frame at ``origin``."""
    from pyins.transform import perturb_lla

    geodetic = np.tile(origin, (len(enu), 1))
    for _ in range(_STEPS_TO_GEODETIC):
        east, north, up = (enu - geodetic_to_enu(geodetic, origin)).T
        geodetic = perturb_lla(geodetic, np.column_stack([north, east, -up]))
    return geodetic


def _origin(recording: Recording) -> Array:
    """Return where the level frame of the tables touches the Earth, (latitude deg, longitude deg, height m)."""
    if recording.gnss_origin is not None:
        return recording.gnss_origin
    latitude = recording.description.track.latitude_deg
    return np.array([DEFAULT_LATITUDE_DEG if latitude is None else latitude, 0.0, 0.0])


def _convergence(place: Array, origin: Array) -> Array:
    """Return how far north at a ``place`` (..., 2), deg, is turned to the left of that at the origin, rad."""
    middle = 0.5 * (place[..., 0] + origin[0])
    return np.asarray(np.radians(place[..., 1] - origin[1]) * np.sin(np.radians(middle)))


def _start(recording: Recording, motion: SampledMotion) -> Start:
    """Return tilt, heading and place at the first sample, as far as they can be had."""
    track, gnss, lever_arm = recording.description.track, recording.gnss, recording.description.imu.lever_arm_m
    yaw = 0.0 if track.heading_deg is None else np.radians(90.0 - track.heading_deg)
    wheel = read_wheel(recording, _MAX_TACH_GAP_S)
    path = initial_path(recording, intervals(recording), wheel, find_standstills(recording), np.zeros(3), yaw)
    rpy = path.rpy[0].copy()
    if motion.standstill_s > 0.0:
        rpy[:2] = force_tilt(motion.accel[motion.start].mean(axis=0, keepdims=True))[0]
    headed = gnss is not None or track.heading_deg is not None
    place = path.p[0] + matrix_from_rpy(*rpy) @ np.array(lever_arm)
    origin = _origin(recording)
    geodetic = geodetic_of(place[None], origin)[0]
    rpy[2] -= _convergence(geodetic[:2], origin[:2])
    gnss_sd = 0.0 if gnss is None else float(gnss[["east_sd_m", "north_sd_m", "up_sd_m"]].median().max())
    return Start(
        geodetic=geodetic,
        rpy=rpy,
        place_sd_m=_START_PLACE_SD_M + 3.0 * gnss_sd,
        tilt_sd_rad=_TILT_SD_RAD,
        yaw_sd_rad=_HEADING_SD_RAD if headed else _NO_HEADING_SD_RAD,
    )


def _with_place(trajectory: pd.DataFrame, recording: Recording, filtered: Filtered) -> pd.DataFrame:
    """Return the trajectory with yaw and reference point in the level frame at the origin, and their sigmas."""
    origin, lever_arm = _origin(recording), np.array(recording.description.imu.lever_arm_m)
    rpy = filtered.rpy.copy()
    rpy[:, 2] += _convergence(filtered.geodetic[:, :2], origin[:2])
    place = geodetic_to_enu(filtered.geodetic, origin) - matrix_from_rpy(*rpy.T) @ lever_arm
    columns = np.column_stack([place, rpy[:, 2], filtered.enu_sd, filtered.rpy_sd[:, 2]])
    names = ["east_m", "north_m", "up_m", "yaw_rad"]
    at = interpolate_columns(trajectory["t_s"].to_numpy(), filtered.t, columns)
    place_columns = dict(zip([*names, *(f"{name}_sd" for name in names)], at.T, strict=True))
    place_columns["yaw_rad"] = np.pi - (np.pi - place_columns["yaw_rad"]) % (2.0 * np.pi)  # (-pi, pi]
    return trajectory.assign(**place_columns)

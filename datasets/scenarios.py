"""Scenarios by name, and what makes one into a recording and its truth."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import pandas as pd

from trackfg.datasets import imu_errors, inertial_sensor, lasers, odometer, positioning, tables
from trackfg.datasets.adhesion import draw_slip
from trackfg.datasets.catalogue import Scenario, scenario, scenarios
from trackfg.datasets.imu_errors import ImuErrors
from trackfg.datasets.irregularities import Irregularities, draw_irregularities
from trackfg.datasets.line_design import random_line
from trackfg.datasets.ride import Ride
from trackfg.datasets.track import Track
from trackfg.datasets.truth_geometry import truth_geometry
from trackfg.description import RecordingDescription, Vector3
from trackfg.description import Track as TrackDescription
from trackfg.errors import BadInputError
from trackfg.frames import Array
from trackfg.recording import Recording
from trackfg.recording_io import write_recording

__all__ = ["Scenario", "Simulation", "scenario", "scenarios", "simulate", "truth_table"]

SHORTEST_S = 1.0
_BEYOND_S = 0.25

LONGITUDE_DEG = 139.0
"""Where a scenario with a latitude has its origin, on the ellipsoid (gravity is that of height 0)."""


@dataclass(frozen=True)
class Simulation:
    """A simulated run.

    ``truth`` has one row per ``1/truth_rate_hz`` from t = 0, the start of the IMU's first sample: ``t_s, chainage_m,
    east_m, north_m, up_m, speed_mps`` (along the x axis, negative backwards), ``roll_rad, pitch_rad, yaw_rad`` (not
    wrapped), ``wheel_scale`` (true over nominal distance), ``gyro_bias_{x,y,z}_radps, accel_bias_{x,y,z}_mps2``.
    ``truth_geometry`` is the track's geometry where the run went (:mod:`trackfg.datasets.truth_geometry`). Constants of
    the run are fields; ``ride`` gives everything about the vehicle at any time, ``track`` about the track at any place.
    """

    recording: Recording
    truth: pd.DataFrame
    truth_geometry: pd.DataFrame
    track: Track
    ride: Ride
    wheel_scale: float
    tach_time_offset_s: float
    mount_rpy_rad: Vector3
    slips: pd.DataFrame | None = None
    """The truth of slips and slides (:func:`trackfg.datasets.odometer.slip_table`), where adhesion was simulated."""

    def write(self, folder: Path | str, table_format: Literal["parquet", "csv"] = "parquet") -> None:
        """Write recording and truth as a recording folder."""
        write_recording(
            self.recording,
            Path(folder),
            table_format=table_format,
            truth=self.truth,
            truth_geometry=self.truth_geometry,
        )


def simulate(
    scenario_name: str | Scenario,
    *,
    seed: int = 0,
    run: int = 0,
    duration_s: float | None = None,
    noise: bool = True,
    truth_rate_hz: float = 20.0,
) -> Simulation:
    """Simulate a scenario, by name or one of your own.

    ``seed`` settles the track and ``run`` the driving and the sensors on it: runs of one seed are over one track. One
    seed and run repeat to the bit, and track and driving are the same whether or not there is ``noise``. Without
    noise the sensors are perfect: no white noise, no bias, wheel scale 1, distance instead of pulses. A run starts at
    the origin of ENU, and with yaw 0 where neither GNSS nor a latitude give a heading a meaning. Raises
    :class:`~trackfg.errors.BadInputError` for an unknown name, a negative run or a duration below :data:`SHORTEST_S`.
    """
    plan = scenario(scenario_name) if isinstance(scenario_name, str) else scenario_name
    duration = plan.duration_s if duration_s is None else duration_s
    if not (np.isfinite(duration) and duration >= SHORTEST_S):
        raise BadInputError(f"duration_s {duration}: expected {SHORTEST_S} s or more")
    if run < 0:
        raise BadInputError(f"run {run}: expected 0 or more")
    line_rng, irregularity_rng = _streams(seed, (), 2)
    drive_rng, imu_rng, tach_rng, balise_rng, gnss_rng, laser_rng = _streams(seed, (run,), 6)
    sensor_rng = (imu_rng, tach_rng, balise_rng, gnss_rng, laser_rng) if noise else None

    track, origin_m, direction = (
        _track(plan, duration, line_rng, irregularity_rng),
        plan.chainage_origin_m,
        plan.direction,
    )
    if plan.both_ways and run % 2 == 1:
        origin_m, direction, track = origin_m + direction * track.line.length_m, -direction, track.reversed()
    motion = plan.driver.drive(track.line, duration, drive_rng)
    edges = tables.clock(duration, plan.imu.rate_hz)
    # The body's spline goes on beyond the recording, so that a longer run begins as a shorter one does.
    beyond = np.arange(len(edges) + round(_BEYOND_S * plan.imu.rate_hz)) / plan.imu.rate_hz
    ride = Ride(track.line, motion, origin_m, direction, plan.vehicle.body_motion(track, motion, beyond))
    return _measured(plan, track, ride, duration, edges, f"{plan.name}-seed{seed}-run{run}", sensor_rng, truth_rate_hz)


def _streams(seed: int, key: tuple[int, ...], count: int) -> list[np.random.Generator]:
    return [np.random.default_rng(stream) for stream in np.random.SeedSequence(seed, spawn_key=key).spawn(count)]


def _track(
    plan: Scenario, duration_s: float, line_rng: np.random.Generator, irregularity_rng: np.random.Generator
) -> Track:
    heading = line_rng.uniform(-np.pi, np.pi)
    length = plan.driver.furthest_m(duration_s) if plan.length_m is None else plan.length_m
    line = random_line(plan.line, length, line_rng, start_yaw_rad=heading if plan.georeferenced else 0.0)
    irregularities = (
        Irregularities.none(line.length_m)
        if plan.irregularities is None
        else draw_irregularities(plan.irregularities, line.length_m, irregularity_rng, plan.defects)
    )
    return Track(line, irregularities, plan.line.gauge_m)


def _measured(
    plan: Scenario,
    track: Track,
    ride: Ride,
    duration_s: float,
    edges: Array,
    name: str,
    streams: tuple[np.random.Generator, ...] | None,
    truth_rate_hz: float,
) -> Simulation:
    """What the sensors make of the ride; perfect ones without ``streams``."""
    imu_rng, tach_rng, balise_rng, gnss_rng, laser_rng = streams or (None,) * 5
    gyro, accel = inertial_sensor.ideal_samples(ride, edges, plan.latitude_deg, plan.imu.lever_arm_m)
    errors = None if imu_rng is None else imu_errors.draw_errors(plan.imu, edges, imu_rng)
    if errors is not None:
        gyro, accel = imu_errors.apply_errors(gyro, accel, errors)
    wheel_scale, slips = 1.0, None
    if tach_rng is None:
        tach, tach_description = (
            odometer.ideal_table(ride, plan.tach, duration_s),
            odometer.ideal_description(plan.tach),
        )
    else:
        scale_rng, slip_rng, pulse_rng = tach_rng.spawn(3)
        wheel_scale = odometer.draw_scale(plan.tach, scale_rng)
        slip = None if plan.adhesion is None else draw_slip(ride, plan.adhesion, duration_s, slip_rng)
        slips = None if slip is None else odometer.slip_table(ride, plan.tach, slip)
        tach = odometer.pulse_table(ride, plan.tach, wheel_scale, duration_s, pulse_rng, slip)
        tach_description = odometer.pulse_description(plan.tach)
    fixes = None if plan.balises is None else positioning.balise_table(ride, plan.balises, duration_s, balise_rng)
    gnss = None if plan.gnss is None else positioning.gnss_table(ride, plan.gnss, duration_s, gnss_rng)
    on_earth = gnss is not None and plan.latitude_deg is not None
    origin = np.array([plan.latitude_deg, LONGITUDE_DEG, 0.0]) if on_earth else None
    recording = Recording(
        description=RecordingDescription(
            id=name + ("" if streams else "-noise-free"),
            track=_track_description(plan, ride),
            imu=tables.imu_description(plan.imu.noise, plan.imu.lever_arm_m, rigid=plan.vehicle.rigid),
            tach=tach_description,
            fixes=None if fixes is None or fixes.empty else tables.fixes_description(),
            gnss=None if plan.gnss is None else tables.gnss_description(origin, plan.gnss.antenna_m),
            laser=tuple(lasers.laser_description(model) for model in plan.lasers),
        ),
        imu=tables.imu_table(0.5 * (edges[1:] + edges[:-1]), gyro, accel),
        tach=tach,
        fixes=None if fixes is None or fixes.empty else fixes,
        gnss=gnss,
        lasers=lasers.laser_tables(ride, track, plan.lasers, duration_s, laser_rng),
        gnss_origin=origin,
    )
    t = tables.clock(duration_s, truth_rate_hz)
    s = ride.motion.distance(ride.motion.breaks_s.clip(0.0, duration_s))
    return Simulation(
        recording=recording,
        truth=truth_table(ride, t, odometer.worn_scale(ride, plan.tach, wheel_scale, t), edges, errors),
        truth_geometry=truth_geometry(
            track,
            chainage_origin_m=ride.chainage_origin_m,
            direction=ride.direction,
            s_from=float(s.min()),
            s_to=float(s.max()),
        ),
        track=track,
        ride=ride,
        wheel_scale=wheel_scale,
        tach_time_offset_s=0.0 if streams is None else plan.tach.clock_offset_s,
        mount_rpy_rad=(0.0, 0.0, 0.0) if errors is None else errors.mount_rpy_rad,
        slips=slips,
    )


def truth_table(ride: Ride, t: Array, wheel_scale: Array, edges: Array, errors: ImuErrors | None) -> pd.DataFrame:
    """The truth at times ``t`` (n,), biases interpolated between the centres of the IMU's samples."""
    speed = np.where(ride.motion.speed(t) == 0.0, 0.0, ride.speed_along_body(t))  # at rest is exactly at rest
    trajectory = tables.trajectory_table(t, ride.position(t), speed, ride.rpy(t))
    trajectory.insert(1, "chainage_m", ride.chainage(ride.motion.distance(t)))
    trajectory["wheel_scale"] = wheel_scale
    centres = 0.5 * (edges[1:] + edges[:-1])
    for sensor, unit in (("gyro", "radps"), ("accel", "mps2")):
        for i, axis in enumerate("xyz"):
            bias = 0.0 if errors is None else np.interp(t, centres, getattr(errors, f"{sensor}_bias")[:, i])
            trajectory[f"{sensor}_bias_{axis}_{unit}"] = bias
    return trajectory


def _track_description(plan: Scenario, ride: Ride) -> TrackDescription:
    yaw = float(ride.rpy(np.zeros(1))[0, 2])
    return TrackDescription(
        gauge_m=plan.line.gauge_m,
        cross_level_base_m=plan.line.cross_level_base_m,
        direction=ride.direction,
        latitude_deg=plan.latitude_deg,
        heading_deg=None if plan.latitude_deg is None else (90.0 - np.degrees(yaw)) % 360.0,
    )

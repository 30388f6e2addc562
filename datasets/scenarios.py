"""Scenarios by name, and what makes one into a recording and its truth."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import pandas as pd

from trackfg.datasets import imu_errors, inertial_sensor, odometer, positioning, tables
from trackfg.datasets.catalogue import Scenario, scenario, scenarios
from trackfg.datasets.imu_errors import ImuErrors
from trackfg.datasets.line_design import random_line
from trackfg.datasets.ride import Ride
from trackfg.description import RecordingDescription, Track, Vector3
from trackfg.errors import BadInputError
from trackfg.frames import Array
from trackfg.recording import Recording
from trackfg.recording_io import write_recording

__all__ = ["Scenario", "Simulation", "scenario", "scenarios", "simulate", "truth_table"]

SHORTEST_S = 1.0

LONGITUDE_DEG = 139.0
"""Where a scenario with a latitude has its origin, on the ellipsoid (gravity is that of height 0)."""


@dataclass(frozen=True)
class Simulation:
    """A simulated run.

    ``truth`` has one row per ``1/truth_rate_hz`` from t = 0, the start of the IMU's first sample: ``t_s, chainage_m,
    east_m, north_m, up_m, speed_mps`` (along the x axis, negative backwards), ``roll_rad, pitch_rad, yaw_rad`` (not
    wrapped), ``wheel_scale`` (true over nominal distance), ``gyro_bias_{x,y,z}_radps, accel_bias_{x,y,z}_mps2``.
    Constants of the run are fields; ``ride`` gives everything at any time.
    """

    recording: Recording
    truth: pd.DataFrame
    ride: Ride
    wheel_scale: float
    tach_time_offset_s: float
    mount_rpy_rad: Vector3

    def write(self, folder: Path | str, table_format: Literal["parquet", "csv"] = "parquet") -> None:
        """Write recording and truth as a recording folder."""
        write_recording(self.recording, Path(folder), table_format=table_format, truth=self.truth)


def simulate(
    scenario_name: str | Scenario,
    *,
    seed: int = 0,
    duration_s: float | None = None,
    noise: bool = True,
    truth_rate_hz: float = 20.0,
) -> Simulation:
    """Simulate a scenario, by name or one of your own.

    One seed repeats to the bit, and settles line and driving whether or not there is ``noise``. Without noise the
    sensors are perfect: no white noise, no bias, wheel scale 1, distance instead of pulses. A run starts at the origin
    of ENU, and with yaw 0 where neither GNSS nor a latitude give a heading a meaning. Raises
    :class:`~trackfg.errors.BadInputError` for an unknown name or a duration below :data:`SHORTEST_S`.
    """
    plan = scenario(scenario_name) if isinstance(scenario_name, str) else scenario_name
    duration = plan.duration_s if duration_s is None else duration_s
    if not (np.isfinite(duration) and duration >= SHORTEST_S):
        raise BadInputError(f"duration_s {duration}: expected {SHORTEST_S} s or more")
    line_rng, drive_rng, imu_rng, scale_rng, tach_rng, balise_rng, gnss_rng = (
        np.random.default_rng(stream) for stream in np.random.SeedSequence(seed).spawn(7)
    )

    heading = line_rng.uniform(-np.pi, np.pi)
    georeferenced = plan.gnss is not None or plan.latitude_deg is not None
    line = random_line(
        plan.line, plan.driver.furthest_m(duration), line_rng, start_yaw_rad=heading if georeferenced else 0.0
    )
    ride = Ride(line, plan.driver.drive(line, duration, drive_rng), plan.chainage_origin_m, plan.direction)

    edges = tables.clock(duration, plan.imu.rate_hz)
    gyro, accel = inertial_sensor.ideal_samples(ride, edges, plan.latitude_deg, plan.imu.lever_arm_m)
    errors = imu_errors.draw_errors(plan.imu, edges, imu_rng) if noise else None
    if errors is not None:
        gyro, accel = imu_errors.apply_errors(gyro, accel, errors)

    wheel_scale = odometer.draw_scale(plan.tach, scale_rng) if noise else 1.0
    tach = (
        odometer.pulse_table(ride, plan.tach, wheel_scale, duration, tach_rng)
        if noise
        else odometer.ideal_table(ride, plan.tach, duration)
    )
    fixes = _balises(plan, ride, duration, balise_rng if noise else None)
    gnss = None if plan.gnss is None else positioning.gnss_table(ride, plan.gnss, duration, gnss_rng if noise else None)
    on_earth = gnss is not None and plan.latitude_deg is not None
    origin = np.array([plan.latitude_deg, LONGITUDE_DEG, 0.0]) if on_earth else None
    recording = Recording(
        description=RecordingDescription(
            id=f"{plan.name}-seed{seed}" + ("" if noise else "-noise-free"),
            track=_track(plan, ride),
            imu=tables.imu_description(plan.imu.noise, plan.imu.lever_arm_m),
            tach=odometer.pulse_description(plan.tach) if noise else odometer.ideal_description(plan.tach),
            fixes=None if fixes is None else tables.fixes_description(),
            gnss=None if plan.gnss is None else tables.gnss_description(origin, plan.gnss.antenna_m),
        ),
        imu=tables.imu_table(0.5 * (edges[1:] + edges[:-1]), gyro, accel),
        tach=tach,
        fixes=fixes,
        gnss=gnss,
        gnss_origin=origin,
    )
    return Simulation(
        recording=recording,
        truth=truth_table(ride, tables.clock(duration, truth_rate_hz), wheel_scale, edges, errors),
        ride=ride,
        wheel_scale=wheel_scale,
        tach_time_offset_s=plan.tach.clock_offset_s if noise else 0.0,
        mount_rpy_rad=(0.0, 0.0, 0.0) if errors is None else errors.mount_rpy_rad,
    )


def truth_table(ride: Ride, t: Array, wheel_scale: float, edges: Array, errors: ImuErrors | None) -> pd.DataFrame:
    """The truth at times ``t`` (n,), biases interpolated between the centres of the IMU's samples."""
    s = ride.motion.distance(t)
    trajectory = tables.trajectory_table(t, ride.position(t), ride.motion.speed(t), ride.line.rpy(s))
    trajectory.insert(1, "chainage_m", ride.chainage(s))
    trajectory["wheel_scale"] = wheel_scale
    centres = 0.5 * (edges[1:] + edges[:-1])
    for sensor, unit in (("gyro", "radps"), ("accel", "mps2")):
        for i, axis in enumerate("xyz"):
            bias = 0.0 if errors is None else np.interp(t, centres, getattr(errors, f"{sensor}_bias")[:, i])
            trajectory[f"{sensor}_bias_{axis}_{unit}"] = bias
    return trajectory


def _balises(plan: Scenario, ride: Ride, duration_s: float, rng: np.random.Generator | None) -> pd.DataFrame | None:
    """The fixes, or None where the run passes no balise."""
    if plan.balises is None:
        return None
    table = positioning.balise_table(ride, plan.balises, duration_s, rng)
    return None if table.empty else table


def _track(plan: Scenario, ride: Ride) -> Track:
    yaw = float(ride.rpy(np.zeros(1))[0, 2])
    return Track(
        gauge_m=plan.line.gauge_m,
        cross_level_base_m=plan.line.cross_level_base_m,
        direction=ride.direction,
        latitude_deg=plan.latitude_deg,
        heading_deg=None if plan.latitude_deg is None else (90.0 - np.degrees(yaw)) % 360.0,
    )

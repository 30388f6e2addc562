"""A ride is measured by a scenario's sensors and recorders."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Literal, NamedTuple, get_args

import numpy as np
import pandas as pd

from trackfg.datasets import tables
from trackfg.datasets.line.line import GivenLine
from trackfg.datasets.line.track import SimulatedTrack
from trackfg.datasets.scenario import Scenario, TableName
from trackfg.datasets.sensors import imu_errors, inertial_sensor, lasers, odometer, positioning
from trackfg.datasets.sensors.clocks import dropped, stamped
from trackfg.datasets.sensors.further_sensor import Measured
from trackfg.datasets.sensors.imu_errors import ImuErrors
from trackfg.datasets.vehicle.ride import Ride
from trackfg.io.formats.registry import format_of
from trackfg.numerics.arrays import Array
from trackfg.recording.description import RecordingDescription
from trackfg.recording.description import Track as TrackDescription
from trackfg.recording.model import Recording

Sensor = Literal["imu", "tach", "balises", "gnss", "lasers", "recorders", "further"]
Kept = Literal["imu", "tach"]

LONGITUDE_DEG = 139.0
"""Where a scenario with a latitude has its origin, on the ellipsoid (gravity is that of height 0)."""


@dataclass(frozen=True)
class Streams:
    """Streams of random numbers: those of a run's sensors, and those of what a vehicle keeps from run to run.

    ``kept`` is empty where every run is of another vehicle: what would be kept is then drawn from the run's streams.
    """

    run: Mapping[Sensor, np.random.Generator]
    kept: Mapping[Kept, np.random.Generator] = field(default_factory=dict)


@dataclass(frozen=True)
class Measurement:
    """A recording and what was drawn for it; ``errors`` and ``slips`` are None where there are none."""

    recording: Recording
    errors: ImuErrors | None
    wheel_scale: float
    slips: pd.DataFrame | None
    further_scales: Mapping[str, float] = field(default_factory=dict)


def measure(
    plan: Scenario,
    track: SimulatedTrack,
    ride: Ride,
    edges: Array,
    name: str,
    sensor_id: str | None,
    streams: Streams | None,
) -> Measurement:
    """Return the recording of a ride over ``track``, perfect without ``streams``, from t = 0 to the last of ``edges``.

    ``edges`` (n + 1,) are those of the IMU's intervals. ``name`` is the recording's, ``sensor_id`` the IMU's in its
    mounting.
    """
    rows = _SensorRows.of(plan, track, ride, edges, streams)
    further = rows.further_by_table
    recording = Recording(
        description=_description(plan, track, ride, rows, name if streams else f"{name}-noise-free", sensor_id),
        imu=rows.imu,
        tach=rows.wheel.table,
        fixes=rows.fixes,
        gnss=rows.gnss,
        lasers=rows.lasers,
        gnss_origin=rows.gnss_origin,
        others={table: sensor.table for table, sensor in further.items()},
    )
    if streams is not None:
        recording = _recorded(plan, recording, streams.run["recorders"])
    scales = {table: sensor.scale for table, sensor in further.items()}
    return Measurement(recording, rows.errors, rows.wheel.scale, rows.wheel.slips, scales)


class _SensorRows(NamedTuple):
    """The rows of all sensors before recorders stamp them, with the errors of the inertial ones.

    ``further`` are those of the further sensors, by the key of their kind in a description.
    """

    imu: pd.DataFrame
    errors: ImuErrors | None
    wheel: odometer.MeasuredWheel
    fixes: pd.DataFrame | None
    gnss: pd.DataFrame | None
    gnss_origin: Array | None
    lasers: dict[str, pd.DataFrame]
    further: dict[str, list[Measured]]

    @classmethod
    def of(
        cls, plan: Scenario, track: SimulatedTrack, ride: Ride, edges: Array, streams: Streams | None
    ) -> _SensorRows:
        """Measure a ride; ``edges`` (n + 1,), s, are those of the IMU's intervals."""
        duration_s = float(edges[-1])
        imu, errors = _inertial(plan, ride, edges, streams)
        wheel_rngs = (None, None) if streams is None else (streams.run["tach"], streams.kept.get("tach"))
        laser_rng = None if streams is None else streams.run["lasers"]
        fixes, gnss = _positions(plan, ride, duration_s, streams)
        on_earth = gnss is not None and plan.latitude_deg is not None
        return cls(
            imu=imu,
            errors=errors,
            wheel=odometer.measured_wheel(ride, plan.tach, plan.adhesion, duration_s, *wheel_rngs),
            fixes=fixes,
            gnss=gnss,
            gnss_origin=np.array([plan.latitude_deg, LONGITUDE_DEG, 0.0]) if on_earth else None,
            lasers=lasers.laser_tables(ride, track, plan.lasers, duration_s, laser_rng),
            further=_further(plan, ride, duration_s, streams),
        )

    @property
    def further_by_table(self) -> dict[str, Measured]:
        """The further sensors by the names of their tables."""
        return {
            format_of(sensor.part).table_name(sensor.part, number): sensor
            for group in self.further.values()
            for number, sensor in enumerate(group, start=1)
        }

    @property
    def further_parts(self) -> dict[str, object]:
        """The parts of a description that are the further sensors'."""
        return {
            key: tuple(sensor.part for sensor in group) if format_of(group[0].part).several else group[0].part
            for key, group in self.further.items()
        }


def _inertial(
    plan: Scenario, ride: Ride, edges: Array, streams: Streams | None
) -> tuple[pd.DataFrame, ImuErrors | None]:
    """Return the IMU's table and its errors, None without any."""
    gyro, accel = inertial_sensor.ideal_samples(ride, edges, plan.latitude_deg, plan.imu.lever_arm_m)
    errors = None
    if streams is not None:
        errors = imu_errors.draw_errors(plan.imu, edges, streams.run["imu"], streams.kept.get("imu"))
        gyro, accel = imu_errors.apply_errors(gyro, accel, errors)
    return tables.imu_table(0.5 * (edges[1:] + edges[:-1]), gyro, accel), errors


def _description(
    plan: Scenario, track: SimulatedTrack, ride: Ride, rows: _SensorRows, name: str, sensor_id: str | None
) -> RecordingDescription:
    """Return the recording's description: what its maker would know of it."""
    description = RecordingDescription(
        id=name,
        track=_track_description(plan, track, ride),
        kilometrage=plan.line.kilometrage if isinstance(plan.line, GivenLine) else None,
        imu=tables.imu_description(
            plan.imu.declared_noise,
            plan.imu.lever_arm_m,
            rigid=plan.vehicle.rigid,
            mount_roll_sd_rad=plan.imu.mount_roll_sd_rad,
            sensor_id=sensor_id,
        ),
        tach=rows.wheel.description,
        fixes=None if rows.fixes is None else tables.fixes_description(),
        gnss=None if plan.gnss is None else tables.gnss_description(rows.gnss_origin, plan.gnss.antenna_m),
        laser=tuple(lasers.laser_description(model) for model in plan.lasers),
    )
    return description.model_copy(update=rows.further_parts)


def _positions(
    plan: Scenario, ride: Ride, duration_s: float, streams: Streams | None
) -> tuple[pd.DataFrame | None, pd.DataFrame | None]:
    """Return the tables of balises and of GNSS; a run that passes no balise has no table of them."""
    balise_rng, gnss_rng = (None, None) if streams is None else (streams.run["balises"], streams.run["gnss"])
    fixes = None if plan.balises is None else positioning.balise_table(ride, plan.balises, duration_s, balise_rng)
    gnss = None if plan.gnss is None else positioning.gnss_table(ride, plan.gnss, duration_s, gnss_rng)
    return None if fixes is None or fixes.empty else fixes, gnss


def _further(plan: Scenario, ride: Ride, duration_s: float, streams: Streams | None) -> dict[str, list[Measured]]:
    """Return what the further sensors measure, by their key."""
    sensors = plan.further_sensors
    rngs = [None] * len(sensors) if streams is None else streams.run["further"].spawn(len(sensors))
    measured: dict[str, list[Measured]] = {}
    for sensor, rng in zip(sensors, rngs, strict=True):
        measured.setdefault(sensor.key, []).append(sensor.measured(ride, duration_s, rng))
    return measured


def _recorded(plan: Scenario, recording: Recording, rng: np.random.Generator) -> Recording:
    """Return the recording as its recorders stamp and keep the rows."""
    seeds: dict[TableName, int] = dict(
        zip(get_args(TableName), rng.integers(2**63, size=len(get_args(TableName))).tolist(), strict=True)
    )

    def kept(name: TableName, table: pd.DataFrame) -> pd.DataFrame:
        recorder = plan.recorders.get(name)
        if recorder is None:
            return table
        # From the same seed each time: lasers that share their times go on sharing them.
        clock_rng, drop_rng = np.random.default_rng(seeds[name]).spawn(2)
        return dropped(stamped(table, recorder.clock, clock_rng), recorder.drops, drop_rng)

    return replace(
        recording,
        imu=kept("imu", recording.imu),
        tach=None if recording.tach is None else kept("tach", recording.tach),
        fixes=None if recording.fixes is None else kept("fixes", recording.fixes),
        gnss=None if recording.gnss is None else kept("gnss", recording.gnss),
        lasers={name: kept("lasers", table) for name, table in recording.lasers.items()},
        others={name: kept("further", table) for name, table in recording.others.items()},
    )


def _track_description(plan: Scenario, track: SimulatedTrack, ride: Ride) -> TrackDescription:
    yaw = float(ride.rpy(np.zeros(1))[0, 2])
    return TrackDescription(
        gauge_m=track.gauge_m,
        cross_level_base_m=track.line.cross_level_base_m,
        direction=ride.direction,
        latitude_deg=plan.latitude_deg,
        heading_deg=None if plan.latitude_deg is None else (90.0 - np.degrees(yaw)) % 360.0,
    )

"""Make a recording and its truth from a scenario."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from numbers import Integral, Real
from pathlib import Path
from typing import Literal, NamedTuple, get_args
from weakref import WeakValueDictionary

import numpy as np
import pandas as pd

from trackfg.datasets import tables
from trackfg.datasets.catalogue import scenario, scenarios
from trackfg.datasets.line.irregularities import Irregularities, draw_irregularities
from trackfg.datasets.line.line import GivenLine
from trackfg.datasets.line.line_design import random_line
from trackfg.datasets.line.track import SimulatedTrack
from trackfg.datasets.line.truth_geometry import truth_geometry
from trackfg.datasets.measuring import Kept, Sensor, Streams, measure
from trackfg.datasets.scenario import Scenario
from trackfg.datasets.sensors import odometer
from trackfg.datasets.sensors.imu_errors import ImuErrors
from trackfg.datasets.sensors.positioning import BaliseModel
from trackfg.datasets.vehicle.body_motion import BodyMotion
from trackfg.datasets.vehicle.flange import Flanging
from trackfg.datasets.vehicle.motion import DrivenMotion
from trackfg.datasets.vehicle.ride import Ride
from trackfg.errors import BadInputError
from trackfg.io.reader import write_recording
from trackfg.numerics.arrays import Array
from trackfg.numerics.key_figures import Outlined
from trackfg.recording.description import Vector3
from trackfg.recording.model import Recording

__all__ = ["Scenario", "Simulation", "scenario", "scenarios", "simulate"]

SHORTEST_S = 1.0
"""Shortest run that is simulated, s."""
LONGEST_S = 1e6
"""Longest one, s: eleven days, which already take more memory than most machines have."""
_BEYOND_S = 0.25
"""How much longer than the recording the body's motion is computed, s; the comment below says why."""
_DRAWN: WeakValueDictionary[tuple[object, ...], Irregularities] = WeakValueDictionary()
"""Irregularities of all runs in memory, by what they are drawn from: a further run over the same track takes these."""
_BEGINS = {"track": 0.0, "vehicle": 0.2, "sensors": 0.35, "truth": 0.85, "writing": 0.9}
"""Share of the time after which a stage begins, of 20 minutes of measuring-car and mainline with their writing."""


@dataclass(frozen=True, repr=False)
class Simulation(Outlined):
    """A simulated run.

    ``truth`` has one row per ``1/truth_rate_hz`` from t = 0, the start of the IMU's first sample: ``t_s, chainage_m,
    east_m, north_m, up_m, speed_mps`` (along the x axis, negative backwards), ``roll_rad, pitch_rad, yaw_rad`` (not
    wrapped), ``wheel_scale`` (true over nominal distance), ``gyro_bias_{x,y,z}_radps, accel_bias_{x,y,z}_mps2``.
    Constants of the run are fields; ``ride`` gives everything about the vehicle at any time, ``track`` about the track
    at any place.

    Examples
    --------
    >>> from trackfg.datasets import simulate
    >>> run = simulate("mainline", seed=1, duration_s=30.0)
    >>> run.recording
    <Recording mainline-seed1-run0: 30.0 s, imu 6000 rows at 200 Hz, tach 1501 rows>
    >>> round(run.wheel_scale, 4)  # the wheel's true distance over its nominal one
    1.0045
    """

    recording: Recording
    truth: pd.DataFrame
    track: SimulatedTrack
    ride: Ride
    stretch_m: tuple[float, float]
    """From where to where the run went: ``s`` along the track's line."""
    wheel_scale: float
    tach_time_offset_s: float
    mount_rpy_rad: Vector3
    slips: pd.DataFrame | None = None
    """The truth of slips and slides (:func:`trackfg.datasets.sensors.odometer.slip_table`), where adhesion was
    simulated.
    """
    further_scales: Mapping[str, float] = field(default_factory=dict)
    """Of further sensors by the names of their tables: true distance or speed over the measured one."""

    @cached_property
    def truth_geometry(self) -> pd.DataFrame:
        """Return the track's geometry where the run went (:mod:`trackfg.datasets.line.truth_geometry`)."""
        return truth_geometry(
            self.track,
            chainage_origin_m=self.ride.chainage_origin_m,
            direction=self.ride.direction,
            s_from=self.stretch_m[0],
            s_to=self.stretch_m[1],
        )

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
    progress: Callable[[str, float], None] | None = None,
) -> Simulation:
    """Simulate a scenario, by name or one of your own.

    One seed and run repeat to the bit, and track and driving are the same whether or not there is ``noise``. A run
    starts at the origin of ENU, and with yaw 0 where neither GNSS nor a latitude give the heading a meaning.

    Parameters
    ----------
    scenario_name
        One of :func:`scenarios`, or a scenario.
    seed
        Settles the track and, with ``run``, the driving and the sensors on it: runs of one seed are over one track, and
        the runs of one vehicle share its wheel and its IMU as it is mounted.
    run
        Which of the runs on the track.
    duration_s
        Length of the run, s, instead of the scenario's own.
    noise
        Without it sensors and recorders are perfect: no white noise, no bias, wheel scale 1, distance instead of
        pulses, and no effect on the recording.
    truth_rate_hz
        Rate of the rows of the truth, Hz.
    progress
        Called as ``progress(stage, fraction)`` as the stages "track", "vehicle", "sensors", "truth" and "writing"
        begin.

    Returns
    -------
    Simulation
        The recording and its truth.

    Raises
    ------
    BadInputError
        For an unknown name, a seed or run that is no whole number of 0 or more, a duration that is no number from
        :data:`SHORTEST_S` to :data:`LONGEST_S`, a rate of the truth that is no number above 0, and a line too short for
        the driver.

    Examples
    --------
    >>> from trackfg.datasets import simulate
    >>> simulate("mainline", seed=1, duration_s=30.0).recording
    <Recording mainline-seed1-run0: 30.0 s, imu 6000 rows at 200 Hz, tach 1501 rows>
    """
    plan = (scenario_name if isinstance(scenario_name, Scenario) else scenario(scenario_name)).planned()
    duration = plan.duration_s if duration_s is None else duration_s
    _refuse_impossible(duration, truth_rate_hz, {"seed": seed, "run": run})
    vehicle = run // plan.runs_per_vehicle
    draws = _Draws.of(seed, run, vehicle, keeps=plan.runs_per_vehicle > 1)

    def begin(stage: str) -> None:
        if progress is not None:
            progress(stage, _BEGINS[stage])

    begin("track")
    track = _track(plan, duration, draws.line, draws.irregularities, seed)
    if plan.flange_knocks:
        plan = replace(plan, vehicle=Flanging(plan.vehicle, seed=int(draws.flange.integers(2**63))))
    if plan.both_ways and run % 2 == 1:
        plan, track = _from_the_other_end(plan, track)
    begin("vehicle")
    edges = tables.clock(duration, plan.imu.rate_hz)
    track, ride = _ridden(plan, track, duration, edges, draws.driver)
    mounted_at_random = noise and (plan.imu.mount_sd_rad > 0.0 or plan.imu.mount_roll_sd_rad > 0.0)
    begin("sensors")
    measured = measure(
        plan,
        track,
        ride,
        edges,
        name=f"{plan.name}-seed{seed}-run{run}",
        sensor_id=f"seed{seed}-vehicle{vehicle}" if mounted_at_random else None,
        streams=draws.sensors if noise else None,
    )
    recording = measured.recording
    if noise:
        recording = _with_effects(plan, recording, ride, _streams(seed, (3, run), len(plan.effects)))
    begin("truth")
    t = tables.clock(duration, truth_rate_hz)
    simulation = Simulation(
        recording=recording,
        truth=_truth(ride, t, odometer.worn_scale(ride, plan.tach, measured.wheel_scale, t), edges, measured.errors),
        track=track,
        ride=ride,
        stretch_m=_stretch_m(ride.motion, duration),
        wheel_scale=measured.wheel_scale,
        tach_time_offset_s=_tach_time_offset_s(plan) if noise else 0.0,
        mount_rpy_rad=(0.0, 0.0, 0.0) if measured.errors is None else measured.errors.mount_rpy_rad,
        slips=measured.slips,
        further_scales=measured.further_scales,
    )
    begin("writing")
    return simulation


class _Draws(NamedTuple):
    """The random generators of a run: those of its track, of its driver, and of its sensors."""

    line: np.random.Generator
    irregularities: np.random.Generator
    flange: np.random.Generator
    driver: np.random.Generator
    sensors: Streams

    @classmethod
    def of(cls, seed: int, run: int, vehicle: int, *, keeps: bool) -> _Draws:
        """Return those of a ``run`` by a ``vehicle``, which ``keeps`` some of its sensors' errors for several runs."""
        line, irregularities, flange = _streams(seed, (0,), 3)
        driver, *sensors = _streams(seed, (1, run), 1 + len(get_args(Sensor)))
        streams = Streams(dict(zip(get_args(Sensor), sensors, strict=True)))
        if keeps:
            kept = _streams(seed, (2, vehicle), len(get_args(Kept)))
            streams = replace(streams, kept=dict(zip(get_args(Kept), kept, strict=True)))
        return cls(line, irregularities, flange, driver, streams)


def _refuse_impossible(duration_s: float, truth_rate_hz: float, counted: Mapping[str, int]) -> None:
    if not (isinstance(duration_s, Real) and SHORTEST_S <= duration_s <= LONGEST_S):
        raise BadInputError(f"duration_s {duration_s!r}: expected a number of {SHORTEST_S:g} to {LONGEST_S:g} s")
    if not (isinstance(truth_rate_hz, Real) and 0.0 < truth_rate_hz < float("inf")):
        raise BadInputError(f"truth_rate_hz {truth_rate_hz!r}: expected a number above 0")
    for name, value in counted.items():
        if not isinstance(value, Integral) or value < 0:
            raise BadInputError(f"{name} {value!r}: expected a whole number of 0 or more")


def _with_effects(
    plan: Scenario, recording: Recording, ride: Ride, streams: Sequence[np.random.Generator]
) -> Recording:
    for effect, rng in zip(plan.effects, streams, strict=True):
        recording = effect.recorded(recording, ride, rng)
    return recording


def _stretch_m(motion: DrivenMotion, duration_s: float) -> tuple[float, float]:
    """Return from where to where a run of that duration goes, m: it turns round at breaks of its motion alone."""
    s = motion.distance(np.append(motion.breaks_s[motion.breaks_s < duration_s], duration_s))
    return float(s.min()), float(s.max())


def _ridden(
    plan: Scenario, track: SimulatedTrack, duration_s: float, edges: Array, rng: np.random.Generator
) -> tuple[SimulatedTrack, Ride]:
    """Return the track in the frame of the run, and the ride over it; ``edges`` (n + 1,), s, are the IMU's."""
    motion = plan.driver.drive(track.line, duration_s, rng)
    # The body's spline is fitted to more than the recording, so that a longer run has the same beginning.
    beyond = np.arange(len(edges) + round(_BEYOND_S * plan.imu.rate_hz)) / plan.imu.rate_hz
    body = plan.vehicle.body_motion(track, motion, beyond)
    if not plan.georeferenced:
        track = _facing_east(track, motion, body)
    return track, Ride(track.line, motion, plan.chainage_origin_m, plan.direction, body)


def _streams(seed: int, key: tuple[int, ...], count: int) -> list[np.random.Generator]:
    """Return independent streams. No key may begin another: streams spawn further ones, and those would be the same."""
    return [np.random.default_rng(stream) for stream in np.random.SeedSequence(seed, spawn_key=key).spawn(count)]


def _track(
    plan: Scenario, duration_s: float, line_rng: np.random.Generator, irregularity_rng: np.random.Generator, seed: int
) -> SimulatedTrack:
    if isinstance(plan.line, GivenLine):
        line = plan.line.line
    else:
        heading = line_rng.uniform(-np.pi, np.pi)
        length = plan.driver.furthest_m(duration_s) if plan.length_m is None else plan.length_m
        length = max([length, *(defect.extent_m[1] for defect in plan.defects)])
        line = random_line(plan.line, length, line_rng, start_yaw_rad=heading)
    if plan.irregularities is None:
        return SimulatedTrack(line, Irregularities.none(line.length_m), plan.line.gauge_m)
    key = (seed, plan.irregularities, line.length_m, tuple(plan.defects))
    irregularities = _DRAWN.get(key)
    if irregularities is None:
        irregularities = draw_irregularities(plan.irregularities, line.length_m, irregularity_rng, plan.defects)
        _DRAWN[key] = irregularities
    return SimulatedTrack(line, irregularities, plan.line.gauge_m)


def _facing_east(track: SimulatedTrack, motion: DrivenMotion, body: BodyMotion) -> SimulatedTrack:
    """Return the track turned as a whole so that the body starts with yaw 0. It sits askew on rough rails by some 1e-4
    rad.
    """
    yaw = float(Ride(track.line, motion, body=body).rpy(np.zeros(()))[2])
    return replace(track, line=replace(track.line, start_yaw_rad=track.line.start_yaw_rad - yaw))


def _from_the_other_end(plan: Scenario, track: SimulatedTrack) -> tuple[Scenario, SimulatedTrack]:
    """Return the same track, its chainage and its balises to who starts at its end."""
    length = track.line.length_m
    turned = replace(
        plan,
        chainage_origin_m=plan.chainage_origin_m + plan.direction * length,
        direction=-1 if plan.direction == 1 else 1,
        balises=None if plan.balises is None else _mirrored(plan.balises, length),
    )
    return turned, track.reversed()


def _mirrored(balises: BaliseModel, length_m: float) -> BaliseModel:
    places = np.array(balises.places_m) if balises.places_m else np.arange(0.0, length_m, balises.spacing_m)
    return replace(balises, places_m=tuple((length_m - places[::-1]).tolist()))


def _tach_time_offset_s(plan: Scenario) -> float:
    recorder = plan.recorders.get("tach")
    return plan.tach.clock_offset_s + (recorder.clock.offset_s if recorder else 0.0)


def _truth(ride: Ride, t: Array, wheel_scale: Array, edges: Array, errors: ImuErrors | None) -> pd.DataFrame:
    """Return the truth at times ``t`` (n,), biases interpolated between the centres of the IMU's samples."""
    # A body that still rocks on its springs after a stop has no speed: the vehicle is at rest, exactly.
    speed = np.where(ride.motion.speed(t) == 0.0, 0.0, ride.speed_along_body(t))
    trajectory = tables.trajectory_table(t, ride.position(t), speed, ride.rpy(t))
    trajectory.insert(1, "chainage_m", ride.chainage(ride.motion.distance(t)))
    trajectory["wheel_scale"] = wheel_scale
    centres = 0.5 * (edges[1:] + edges[:-1])
    for sensor, unit in (("gyro", "radps"), ("accel", "mps2")):
        for i, axis in enumerate("xyz"):
            bias = 0.0 if errors is None else np.interp(t, centres, getattr(errors, f"{sensor}_bias")[:, i])
            trajectory[f"{sensor}_bias_{axis}_{unit}"] = bias
    return trajectory

"""The factors of further sensors of distance and speed: what a recording has besides its first tach and positions.

Each sensor has one ``SENSOR`` variable, in the order of the description. So has an antenna whose place is declared in
a vehicle in which that of the inertial sensor is not: how much further ahead and to the left it is, m. What a sensor of
the speed over ground measured between two keyframes is integrated (trapezoid rule); with white noise of sigma s in rows
dt apart it is known to

    s sqrt(dt T)

over a time T. An interval in which it was silent has no factor. A sensor that is wrong for some time (an echo from
snow, a wheel that slips) is given up there by the same loss as the tach
(:class:`trackfg.factors.loss.SwitchChain`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pandas as pd

from trackfg.config import SmoothConfig
from trackfg.factors.family import Family
from trackfg.factors.further_sensors import speed_distance, tach_increment
from trackfg.factors.loss import SwitchChain
from trackfg.factors.prior import prior
from trackfg.factors.states import Kind
from trackfg.graph.gnss_speeds import OFFSET_SD_MPS, gnss_speeds
from trackfg.graph.inputs import GraphInputs
from trackfg.graph.miscount import with_miscount
from trackfg.graph.odometry import creep_variance, response_of_wheels
from trackfg.graph.wheel_slip import rolling
from trackfg.numerics.arrays import Array
from trackfg.numerics.integrals import trapezoid_integral
from trackfg.numerics.spans import median_interval
from trackfg.recording.canonical import pulse_m
from trackfg.recording.description import (
    FurtherTach,
    GnssSpeed,
    RecordingDescription,
    Speed,
    Table,
    Tach,
    UnplacedAntenna,
)
from trackfg.recording.model import GNSS_SPEED_TABLE, TACH_COLUMNS, Recording
from trackfg.sensors.tach import LEAST_ROUNDING_M, Wheel, longest_silence_s, read_resolution

BEFORE_S = 1.0
"""Rows this much older than an interval (s) determine how far apart rows usually are."""

_SWAY_SD_M = 2e-3
"""How far the sensor's place moves along the track besides the reference point, between two keyframes: the body pitches
by some 1e-3 rad on its springs, under a sensor 2 m below or above. Assumed.
"""

_READ_S = 0.25
"""A tach is read off at a keyframe from as much before and after (s), as its rate is in :mod:`trackfg.sensors.tach`."""
_READINGS = 26
"""As many readings are taken within that: one each 20 ms."""
_NO_ROWS = np.array([[-1e12, 1.0 - 1e12], [0.0, 0.0]])
"""Times (s, before any run) and values of a table that covers nothing."""
_GRID_S = 0.1
"""Step of the first guess (s)."""
_STOP_S = 2.0
"""A stop is longer (s): a shorter silence is a lost echo."""
_SLOW_MPS = 2.0
"""A stop begins and ends slower (m/s): radars fall silent at some 0.2 to 1.5 m/s."""


Part = Table | UnplacedAntenna
"""What a description says of a sensor that has a variable."""


class FurtherSensor(NamedTuple):
    """A sensor has a table's ``name``, a ``part`` of the description, a ``variable``, by its index, and a ``kind``."""

    name: str
    part: Part
    variable: int
    kind: SensorKind


def further_sensors(description: RecordingDescription) -> list[FurtherSensor]:
    """Return the further sensors in the order of their variables."""
    named = [(name, part, kind) for kind in KINDS for name, part in kind.described(description)]
    return [FurtherSensor(name, part, index, kind) for index, (name, part, kind) in enumerate(named)]


def sensor_priors(description: RecordingDescription, config: SmoothConfig) -> Iterator[Family]:
    """Yield what is known of each further sensor beforehand."""
    for sensor in further_sensors(description):
        sigma = np.array([sensor.kind.prior_sd(sensor.part, config)])
        yield prior(Kind.SENSOR, np.array([sensor.variable]), np.zeros((1, Kind.SENSOR.dim)), sigma)


def measures_speed(recording: Recording) -> bool:
    """Return whether a sensor of the speed over ground, or the receiver, has speeds."""
    speeds = [sensor for sensor in further_sensors(recording.description) if isinstance(sensor.part, Speed | GnssSpeed)]
    return any(len(recording.others.get(sensor.name, ())) > 1 for sensor in speeds)


def with_distance_by_speed(recording: Recording) -> Recording:
    """Return the recording with the distance by its first sensor of the speed as that of a tach, for a first guess.

    A silence that begins and ends slowly is a stop.
    """
    tables = [recording.others.get(sensor.name) for sensor in further_sensors(recording.description)]
    t, speed = (
        next(table for table in tables if table is not None and len(table) > 1)[["t_s", "speed_mps"]].to_numpy().T
    )
    silent = np.flatnonzero((np.diff(t) > _STOP_S) & (np.maximum(np.abs(speed[1:]), np.abs(speed[:-1])) < _SLOW_MPS))
    ends = np.concatenate([t[silent] + _GRID_S, t[silent + 1] - _GRID_S])
    grid = np.arange(t[0], t[-1], _GRID_S)
    times, speeds = np.concatenate([t, ends]), np.concatenate([speed, np.zeros(ends.size)])
    order = np.argsort(times, kind="stable")
    speed = np.interp(grid, times[order], speeds[order])
    distance = trapezoid_integral(grid, speed)
    tach = Tach(file="-", column="-", kind="speed", unit="m/s", signed=True)
    description = recording.description.model_copy(update={"tach": tach})
    table = pd.DataFrame(dict(zip(TACH_COLUMNS, (grid, distance), strict=True)))
    return replace(recording, description=description, tach=table)


def further_distances(inputs: GraphInputs) -> list[Family]:
    """Return the families of the further sensors, one per sensor, those without rows empty."""
    sensors = further_sensors(inputs.recording.description)
    return [sensor.kind.family(inputs, sensor) for sensor in sensors if sensor.kind.family is not None]


def antenna_variable(description: RecordingDescription) -> int | None:
    """Return the index of the variable that says where the antenna is; None where its place is known."""
    if description.unplaced_antenna is None:
        return None
    sensors = further_sensors(description)
    return next(sensor.variable for sensor in sensors if isinstance(sensor.part, UnplacedAntenna))


def _tach(inputs: GraphInputs, sensor: FurtherSensor) -> Family:
    """The wheel of a further axle. Its count is read at every keyframe, so two readings are in each interval."""
    config, at, part = inputs.config, inputs.t, sensor.part
    assert isinstance(part, FurtherTach)
    table = inputs.recording.others.get(sensor.name)
    t, distance = _NO_ROWS if table is None or len(table) < 2 else table[["t_s", "distance_m"]].to_numpy().T
    longest_s = longest_silence_s(t, config.tach.max_gap_s)
    k = np.flatnonzero(_covered(t, at - _READ_S, longest_s) & _covered(t, at + _READ_S, longest_s))
    way = 1.0 if part.signed else np.where(inputs.distance[k] < 0.0, -1.0, 1.0)
    wheel = Wheel(t, distance, _rounding_sd(part, t, distance), 0.0, part.integrates_speed, np.zeros((0, 2)))
    count, rate, reading_sd = _readings(wheel, at)
    measured = {
        "counted": way * np.diff(count)[k],
        "faster": way * np.diff(rate)[k],
        "response": response_of_wheels(inputs)[k],
    }
    whole = not inputs.recording.imu.empty and k.size > 0  # else one interval of a stream
    if whole and not part.integrates_speed:
        wheel = with_miscount(wheel, inputs.data, inputs.world.gravity, config)
    variance = creep_variance(inputs) + (reading_sd[1:] ** 2 + reading_sd[:-1] ** 2)
    variance = (variance + wheel.variance_gained(at, config.tach.speed_noise_mps))[k]
    sigma = np.sqrt(variance)[:, None] * config.noise.tach
    loss = SwitchChain(config.tach.robust_width, config.keyframes.interval_s)
    family = tach_increment(k, sensor.variable, measured, sigma, loss, sensor.name)
    if not whole:  # the window of a stream doubts the wheel by itself
        return family
    wheel_rolling = rolling(wheel, inputs.data, inputs.floor, inputs.path, inputs.rests, inputs.world.gravity, config)
    return replace(family, doubtful=wheel_rolling.slips_within(at)[k])


def _readings(wheel: Wheel, at: Array) -> tuple[Array, Array, Array]:
    """Return a tach's distance (m) at times ``at`` (m,), s, its rate (m/s) and the sigma of the distance (m), all (m,).

    A parabola is fitted to what is shown shortly before and after. Of n readings with independent roundings its value
    in the middle has sqrt(9 / (4 n)) of the sigma of one (Savitzky and Golay, "Smoothing and differentiation of data by
    simplified least squares procedures", Anal. Chem. 36 (1964)); there are no more of them than rows, or than pulses.
    """
    offset = np.linspace(-_READ_S, _READ_S, _READINGS)
    value, slope, _ = np.linalg.pinv(np.vander(offset, 3, increasing=True))
    shown = np.interp(at[:, None] + offset, wheel.t, wheel.distance)
    pulses = np.ptp(shown, axis=1) / (np.sqrt(12.0) * wheel.rounding_sd)
    independent = np.minimum(pulses, 2.0 * _READ_S / median_interval(wheel.t))
    reading_sd = wheel.rounding_sd * np.minimum(1.0, 1.5 / np.sqrt(np.maximum(independent, 1.0)))
    return shown @ value, shown @ slope, reading_sd


def _rounding_sd(part: FurtherTach, t: Array, distance: Array) -> float:
    """Return the rounding error of one reading, 1-sigma in m."""
    if part.integrates_speed:
        return LEAST_ROUNDING_M
    if part.kind == "pulses":
        return pulse_m(part) / float(np.sqrt(12.0))
    return read_resolution(t, distance)[1] if t.size > 2 else LEAST_ROUNDING_M


def _speed(inputs: GraphInputs, sensor: FurtherSensor) -> Family:
    config, part = inputs.config, sensor.part
    assert isinstance(part, Speed)
    table = inputs.recording.others.get(sensor.name)
    t, speed = np.zeros((2, 0)) if table is None else table[["t_s", "speed_mps"]].to_numpy().T
    known, integral, interval_s = integrated(t, speed, inputs.t, config.tach.max_gap_s)
    k = np.flatnonzero(known)
    way = 1.0 if part.signed else np.where(inputs.distance[k] < 0.0, -1.0, 1.0)
    swing = np.cross(inputs.mean_rate[k] * inputs.durations[k, None], part.lever_arm_m)
    measured = {"distance": way * integral[k], "swing": swing[:, 0], "across": swing[:, 1]}
    sigma = np.hypot(part.sd_mps * np.sqrt(interval_s * inputs.durations[k]), _SWAY_SD_M)[:, None]
    loss = SwitchChain(config.tach.robust_width, config.keyframes.interval_s)
    return speed_distance(k, sensor.variable, measured, sigma, loss, sensor.name)


def integrated(t: Array, speed: Array, at: Array, max_gap_s: float) -> tuple[np.ndarray, Array, float]:
    """Integrate a speed at times ``t`` (n,), s, between neighbouring times ``at`` (m,), s.

    Returns whether each interval (m - 1,) is known, with no silence in it longer than ``max_gap_s`` (s) or some usual
    intervals, the integrals (m - 1,), m, and the usual interval between rows, s. Half a silence is bridged at either
    end.
    """
    if t.size < 2:
        return np.zeros(at.size - 1, dtype=bool), np.zeros(at.size - 1), 0.0
    longest_s = longest_silence_s(t, max_gap_s)
    interval_s, reach = median_interval(t), 0.5 * longest_s
    t = np.concatenate([[t[0] - reach], t, [t[-1] + reach]])
    speed = np.concatenate([speed[:1], speed, speed[-1:]])
    total = trapezoid_integral(t, speed)
    row = np.clip(np.searchsorted(t, at, side="right") - 1, 0, t.size - 2)
    within = total[row] + 0.5 * (at - t[row]) * (speed[row] + np.interp(at, t, speed))
    return _covered(t, at, longest_s), np.diff(within), interval_s


def _covered(t: Array, at: Array, longest_s: float) -> np.ndarray:
    """Return whether rows at ``t`` (n,), s, cover each interval between times ``at`` (m,) without a longer silence."""
    silences = np.concatenate([[0], np.cumsum(np.diff(t) > longest_s)])
    row = np.clip(np.searchsorted(t, at, side="right"), 1, t.size - 1)
    inside = (at >= t[0]) & (at <= t[-1])
    covered: np.ndarray = inside[:-1] & inside[1:] & (silences[row[1:]] == silences[row[:-1] - 1])
    return covered


def _receiver(inputs: GraphInputs, sensor: FurtherSensor) -> Family:
    return gnss_speeds(inputs, sensor.variable)


def _tach_prior_sd(part: Part, config: SmoothConfig) -> tuple[float, float]:
    """Scale, and the clock's offset, s."""
    assert isinstance(part, FurtherTach)
    return part.scale_sd, config.tach.clock_offset_sd_s


def _speed_prior_sd(part: Part, config: SmoothConfig) -> tuple[float, float]:
    """Scale, and the tangent of the mounting's yaw."""
    assert isinstance(part, Speed)
    return part.scale_sd, float(np.radians(part.yaw_sd_deg))


def _receiver_prior_sd(part: Part, config: SmoothConfig) -> tuple[float, float]:
    """Offset of the speeds, m/s, and of their stamps, s."""
    return OFFSET_SD_MPS, config.position.gnss_clock_offset_sd_s


def _antenna_prior_sd(part: Part, config: SmoothConfig) -> tuple[float, float]:
    """Return the sigma of how much further ahead and to the left it is, m."""
    assert isinstance(part, UnplacedAntenna)
    return part.sd_m


class SensorKind(NamedTuple):
    """A kind of further sensor.

    ``key`` is where the description has it, alone or in a list; tables of a list are called ``table``, a slash, and a
    number from ``first``. ``prior_sd`` gives the sigmas of its variable, ``family`` its factors, if it has its own.
    """

    key: str
    table: str
    first: int
    prior_sd: Callable[[Part, SmoothConfig], tuple[float, float]]
    family: Callable[[GraphInputs, FurtherSensor], Family] | None

    def described(self, description: RecordingDescription) -> list[tuple[str, Part]]:
        """Return the name of each such sensor's table, and its part of the description."""
        parts = getattr(description, self.key)
        if isinstance(parts, tuple):
            return [(f"{self.table}/{number}", part) for number, part in enumerate(parts, start=self.first)]
        return [] if parts is None else [(self.table, parts)]


KINDS = (
    SensorKind("speed", "speed", 1, _speed_prior_sd, _speed),
    SensorKind("further_tach", "tach", 2, _tach_prior_sd, _tach),
    SensorKind(GNSS_SPEED_TABLE, GNSS_SPEED_TABLE, 1, _receiver_prior_sd, _receiver),
    SensorKind("unplaced_antenna", "antenna", 1, _antenna_prior_sd, None),
)
"""All kinds, in the order of their variables."""

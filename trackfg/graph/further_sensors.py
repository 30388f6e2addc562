"""The factors of further sensors of distance and speed: what a recording has besides its first tach.

Each sensor has one ``SENSOR`` variable, in the order of the description. What a sensor of the speed over ground
measured between two keyframes is integrated (trapezoid rule); with white noise of sigma s in rows dt apart it is known
to

    s sqrt(dt T)

over a time T. An interval in which it was silent has no factor. A sensor that is wrong for some time (an echo from
snow, a wheel that slips) is given up there by the same loss as the tach
(:class:`trackfg.factors.loss.SwitchChain`).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pandas as pd

from trackfg.factors.family import Family
from trackfg.factors.further_sensors import speed_distance
from trackfg.factors.loss import SwitchChain
from trackfg.factors.prior import prior
from trackfg.factors.states import Kind
from trackfg.graph.inputs import GraphInputs
from trackfg.numerics.arrays import Array
from trackfg.numerics.spans import median_interval
from trackfg.recording.description import RecordingDescription, Speed, Tach
from trackfg.recording.model import TACH_COLUMNS, Recording

BEFORE_S = 1.0
"""Rows this much older than an interval (s) tell how far apart rows usually are."""

_USUAL_INTERVALS = 3.5
"""A longer time without a row, in usual intervals, is a silence; as for the tach (:mod:`trackfg.sensors.tach`)."""
_SWAY_SD_M = 2e-3
"""How far the sensor's place moves along the track besides the reference point, between two keyframes: the body pitches
by some 1e-3 rad on its springs, under a sensor 2 m below or above. Assumed.
"""

_GRID_S = 0.1
"""Step of the first guess (s)."""
_STOP_S = 2.0
"""A stop is longer (s): a shorter silence is a lost echo."""
_SLOW_MPS = 2.0
"""A stop begins and ends slower (m/s): radars fall silent at some 0.2 to 1.5 m/s."""


class FurtherSensor(NamedTuple):
    """A sensor with the ``name`` of its table, its ``part`` of the description, and the index of its ``variable``."""

    name: str
    part: Speed
    variable: int


def further_sensors(description: RecordingDescription) -> list[FurtherSensor]:
    """Return the further sensors in the order of their variables."""
    named = [(f"speed/{number}", part) for number, part in enumerate(description.speed, start=1)]
    return [FurtherSensor(name, part, index) for index, (name, part) in enumerate(named)]


def sensor_priors(description: RecordingDescription) -> Iterator[Family]:
    """Yield what is declared of each further sensor: scale, and yaw of its mounting."""
    for sensor in further_sensors(description):
        sigma = np.array([[sensor.part.scale_sd, np.radians(sensor.part.yaw_sd_deg)]])
        yield prior(Kind.SENSOR, np.array([sensor.variable]), np.zeros((1, Kind.SENSOR.dim)), sigma)


def measures_speed(recording: Recording) -> bool:
    """Return whether a further sensor has rows."""
    return any(len(recording.others.get(sensor.name, ())) > 1 for sensor in further_sensors(recording.description))


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
    speed = np.interp(grid, *_sorted(np.concatenate([t, ends]), np.concatenate([speed, np.zeros(ends.size)])))
    distance = np.concatenate([[0.0], np.cumsum(0.5 * np.diff(grid) * (speed[1:] + speed[:-1]))])
    tach = Tach(file="-", column="-", kind="speed", unit="m/s", signed=True)
    description = recording.description.model_copy(update={"tach": tach})
    table = pd.DataFrame(dict(zip(TACH_COLUMNS, (grid, distance), strict=True)))
    return replace(recording, description=description, tach=table)


def _sorted(t: Array, values: Array) -> tuple[Array, Array]:
    order = np.argsort(t, kind="stable")
    return t[order], values[order]


def further_distances(inputs: GraphInputs) -> list[Family]:
    """Return the families of the further sensors, one per sensor, those without rows empty."""
    return [_speed(inputs, sensor) for sensor in further_sensors(inputs.recording.description)]


def _speed(inputs: GraphInputs, sensor: FurtherSensor) -> Family:
    config, part = inputs.config, sensor.part
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
    interval_s = median_interval(t)
    longest = max(max_gap_s, _USUAL_INTERVALS * interval_s)
    reach = 0.5 * longest
    t = np.concatenate([[t[0] - reach], t, [t[-1] + reach]])
    speed = np.concatenate([speed[:1], speed, speed[-1:]])
    total = np.concatenate([[0.0], np.cumsum(0.5 * np.diff(t) * (speed[1:] + speed[:-1]))])
    silent = np.concatenate([[0], np.cumsum(np.diff(t) > longest)])
    row = np.clip(np.searchsorted(t, at, side="right") - 1, 0, t.size - 2)
    within = total[row] + 0.5 * (at - t[row]) * (speed[row] + np.interp(at, t, speed))
    inside = (at >= t[0]) & (at <= t[-1])
    known = inside[:-1] & inside[1:] & (silent[np.minimum(row[1:] + 1, t.size - 1)] == silent[row[:-1]])
    return known, np.diff(within), interval_s

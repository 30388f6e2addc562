"""The next interval of a stream: where its keyframe is, and its factors, by the functions that the batch smoother uses.

The motion over the interval is predicted by the inertial sensor from the newest keyframe: the wheel may slip. Rows a
little after the keyframe are needed for its own rates: the wheel's more than the inertial sensor's, so that most of the
interval is ready when the last of them come.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from trackfg.factors.factor_type import FactorType
from trackfg.factors.family import Family, changed
from trackfg.factors.imu import Preintegration, PreintegrationNoise
from trackfg.factors.odometry import tach_excess
from trackfg.factors.states import Nav, Odo, States
from trackfg.graph.further_sensors import further_distances
from trackfg.graph.inertial import preintegrated
from trackfg.graph.inputs import GraphInputs
from trackfg.graph.motion import along_track
from trackfg.graph.odometry import path_length_factors, tach_factors
from trackfg.graph.positions import positions
from trackfg.graph.wheel_slip import Rolling
from trackfg.numerics.arrays import Array
from trackfg.numerics.rotations import rpy_from_matrix
from trackfg.recording.model import Recording
from trackfg.sensors.dead_reckoning import InitialPath
from trackfg.sensors.imu_intervals import Intervals
from trackfg.sensors.tach import Wheel
from trackfg.streaming.rows import NO_SAMPLES
from trackfg.streaming.window.stream_context import Setting
from trackfg.streaming.window.window import Interval, Window

_NO_RESTS = np.zeros((0, 2))
OFF_S = 60.0
"""A device that was off was so for about as long."""
_BELIEVED_SIGMAS = 4.0
_OF_THE_INTERVAL = (FactorType.ABSOLUTE_FIX, FactorType.GNSS_POSITION)
"""Families that may touch the older keyframe alone, and are new all the same."""
OTHER_ROWS = (
    FactorType.TACH_DISTANCE,
    FactorType.TACH_READING,
    *_OF_THE_INTERVAL,
    FactorType.WITHHELD_FIX,
    FactorType.TACH_INCREMENT,
    FactorType.SPEED_DISTANCE,
)
"""Families of other rows than the inertial sensor's."""


class Ahead(NamedTuple):
    """What the inertial sensor says of the next interval: all of it but what other rows add (:func:`completed`)."""

    inputs: GraphInputs
    interval: Interval


def ahead(setting: Setting, window: Window, data: Intervals, edges: np.ndarray, *, broken: bool = False) -> Ahead:
    """From the newest keyframe to the next one, at ``edges`` (2,) of the inertial ``data``, which goes a little on.

    ``broken``: the sensor was off for an unknown time that is not on the clock.
    """
    k = len(window) - 1
    here = window.states.take(slice(k, k + 1))
    t = data.edges[edges]
    standing = _path(data.edges[[0, -1]], here, np.zeros(2))
    nothing = Recording(setting.description, NO_SAMPLES)
    inputs = GraphInputs(
        nothing, setting.config, setting.world, data, None, _NO_RESTS, standing, None, edges, t, setting.clock_origin
    )
    response = inputs.response[0]
    here = replace(here, bias=here.bias + response @ here.imu[0])
    measured = preintegrated(inputs, here.joined(here), speedless=False)[0]
    nav = measured.predicted(here.nav, here.bias[0])
    distance = _distance(here.nav, nav, setting.lever_arm)
    inputs = _with_motion(inputs, here, nav, distance)
    odo = Odo.of(here.odo.distance + distance, here.odo.scale, here.odo.count + distance, np.array([distance]))
    there = replace(here, nav=nav, bias=window.states.bias[k:], odo=odo)
    families = _new([*path_length_factors(inputs), *along_track(inputs)])
    if broken:
        measured, families = _across_break(inputs, here, measured, families)
    return Ahead(inputs, Interval(float(t[1]), here.bias[0], there, measured, response, families))


def completed(begun: Ahead, recording: Recording, wheel: Wheel | None, speed_sd: float) -> Interval:
    """With what the other rows say; ``wheel`` covers the interval and a little more. ``speed_sd``, m/s, is that of the
    newest keyframe.

    A wheel that rolled as far as the vehicle may have moved is believed: the next keyframe is where it says. Else it
    would be doubted where the inertial sensor is, for as long as that drifts on without it.
    """
    inputs, interval = begun.inputs.with_rows(recording, wheel), begun.interval
    there = interval.ahead
    if wheel is not None:
        counted, span = np.diff(wheel.at(inputs.t)), float(inputs.t[1] - inputs.t[0])
        more = float((counted - there.odo.step)[0])
        further = float(tach_excess(there.odo.scale, counted, there.odo.step)[0])
        moved_sd = span * np.hypot(speed_sd, interval.measured.noise.accel * np.sqrt(span / 3.0))
        distance_sd = np.hypot(moved_sd, np.sqrt(2.0) * wheel.rounding_sd)
        if abs(further) < _BELIEVED_SIGMAS * distance_sd:
            nav, forward = there.nav, there.nav.R[:, :, 0]
            there = replace(there, nav=Nav(nav.R, nav.p + further * forward, nav.v + further / span * forward))
        else:
            further = 0.0
        there = replace(there, odo=Odo(there.odo.array + np.array([further, 0.0, more, further])))
    families = (*interval.families, *_new([*tach_factors(inputs), *positions(inputs), *further_distances(inputs)]))
    return interval._replace(ahead=there, families=families)


def _across_break(
    inputs: GraphInputs, here: States, measured: Preintegration, families: tuple[Family, ...]
) -> tuple[Preintegration, tuple[Family, ...]]:
    """No more than a hole of :data:`OFF_S` would leave: the vehicle went on for as long, or turned, or stood."""
    config, lasting = inputs.config.imu, float(inputs.t[1] - inputs.t[0])
    gone = float(np.hypot(np.linalg.norm(here.nav.v[0]) * OFF_S, config.bridge_accel_white * OFF_S**1.5 / np.sqrt(3.0)))
    longer = np.sqrt(OFF_S / lasting)
    noise = PreintegrationNoise(
        config.bridge_gyro_white * longer, config.bridge_accel_white * longer, gone / float(np.sqrt(lasting))
    )
    loose = changed(
        (family for family in families if family.type is not FactorType.PATH),
        FactorType.ARC_LENGTH,
        lambda family: replace(family, sigma=np.full_like(family.sigma, gone)),
    )
    return replace(measured, noise=noise), loose


def _new(families: list[Family]) -> tuple[Family, ...]:
    """Without what the interval before has said already: factors of the older keyframe alone."""
    new = (family if family.type in _OF_THE_INTERVAL else _of_the_later(family) for family in families)
    return tuple(family for family in new if len(family))


def _of_the_later(family: Family) -> Family:
    own = family.last_keyframe == 1
    return family if own.all() else family.take(own)


def _distance(here: Nav, ahead: Nav, lever_arm: Array) -> float:
    """Along the track, backwards negative."""
    chord = (ahead.p - ahead.R @ lever_arm) - (here.p - here.R @ lever_arm)
    forward = 0.5 * (here.R[0, :, 0] + ahead.R[0, :, 0])
    return float(np.copysign(np.linalg.norm(chord), chord[0] @ forward))


def _path(t: Array, here: States, speed: Array) -> InitialPath:
    """A first guess of the motion about the interval, as factors need it: attitude and bias as they are."""
    n = len(t)
    rpy = np.repeat(rpy_from_matrix(here.nav.R), n, axis=0)
    p = np.zeros((n, 3))
    p[1:, 0] = np.cumsum(0.5 * (speed[1:] + speed[:-1]) * np.diff(t))
    return InitialPath(t, rpy, p, np.zeros((n, 3)), speed, np.repeat(here.bias[:, 3:], n, axis=0))


def _with_motion(inputs: GraphInputs, here: States, ahead: Nav, distance: float) -> GraphInputs:
    """With speeds that change evenly over the interval and cover its distance."""
    edges, (begin, end) = inputs.data.edges, inputs.t
    slow, fast = (float(nav.v[0] @ nav.R[0, :, 0]) for nav in (here.nav, ahead))
    speed = slow + (fast - slow) * (edges - begin) / (end - begin)
    speed += distance / (end - begin) - 0.5 * (slow + fast)
    path = _path(edges, here, speed)
    travelled = Wheel(edges, path.p[:, 0], 1e-4, 0.0, False, _NO_RESTS)
    rolling = Rolling(edges, speed, np.ones(len(edges) - 1, dtype=bool), travelled)
    return inputs.with_motion(path, rolling)

"""The factors of motion hold the vehicle on the track, or at rest."""

from __future__ import annotations

import numpy as np

from trackfg.config import MotionConfig
from trackfg.factors.family import Family
from trackfg.factors.loss import Huber, Loss
from trackfg.factors.motion import at_rest, non_holonomic, stays
from trackfg.factors.path import follows_path
from trackfg.graph.inputs import GraphInputs, still_between
from trackfg.numerics.arrays import Array
from trackfg.numerics.spans import within
from trackfg.sensors.imu_intervals import Turning, turning

_COARSE_M = 0.02
"""Rounding of a count, m, from which on it shows in a path: in a curve in which an interval of 50 rows turns by 0.05
rad, 0.02 m 0.05 / sqrt(50) = 0.14 mm, where the initial speed, smoothed, errs by no more.
"""


def motion(inputs: GraphInputs) -> list[Family]:
    """Return the factors of motion along the track, and of no motion at rest."""
    rigid = inputs.recording.description.imu.rigid
    return [*along_track(inputs, turned(inputs)), *resting(inputs.t, inputs.rests, inputs.config.motion, rigid=rigid)]


def along_track(inputs: GraphInputs, turned: Turning) -> list[Family]:
    """Return no sideways velocity, and, of a sensor that follows the track, motion where it points all the way.

    ``turned`` is that of the function of this name.
    """
    config, k = inputs.config.motion, np.arange(len(inputs.t))
    speed = np.abs(np.interp(inputs.t, inputs.path.t, inputs.path.speed))
    sigma = np.array([config.lateral_sd_mps, config.vertical_sd_mps]) + config.sd_per_speed * speed[:, None]
    growth = config.sd_per_speed / sigma
    sigma = sigma * inputs.config.noise.motion
    huber = Huber(config.robust_width)
    return [
        _path(inputs, turned, huber),
        non_holonomic(k, inputs.body_rate, inputs.lever_arm, speed, growth, sigma, huber),
    ]


def resting(t: Array, rests: Array, config: MotionConfig, *, rigid: bool) -> list[Family]:
    """Return no velocity at keyframes ``t`` (n,), s, in ``rests`` (r, 2), and no motion between two in one."""
    still = (config.rest_speed_sd_mps, config.rest_turn_sd_rad, config.rest_shift_sd_m)
    if rigid:
        still = (config.rigid_rest_speed_sd_mps, config.rigid_rest_turn_sd_rad, config.rigid_rest_shift_sd_m)
    huber = Huber(config.robust_width)
    return [
        at_rest(np.flatnonzero(within(t, rests)), still[0], huber),
        stays(np.flatnonzero(still_between(t, rests)), *still[1:], huber),
    ]


def turned(inputs: GraphInputs) -> Turning:
    """Return how the gyro, less the initial bias, turns between keyframes."""
    return turning(
        inputs.data, inputs.edges, inputs.path.bias(inputs.t).mean(axis=0), _rolled(inputs, inputs.data.edges)
    )


def _path(inputs: GraphInputs, turned: Turning, loss: Loss) -> Family:
    """Return path factors of a sensor that follows the track, where it moves and its record has no hole."""
    config, distance = inputs.config.motion, np.abs(inputs.distance)
    bridged = np.concatenate([[0], np.cumsum(inputs.data.bridged)])
    whole = np.diff(bridged[inputs.edges]) == 0
    k = np.flatnonzero(whole & ~inputs.still & inputs.recording.description.imu.rigid)
    about = inputs.noise.gyro[:, [2, 1]]  # the axes about which the path turns sideways and upward
    bridge = about * (distance * np.sqrt(inputs.durations / 12.0))[:, None]
    model = (config.path_sd_m + config.path_sd_relative * distance) * inputs.config.noise.path
    sigma = np.hypot(model[:, None], bridge)[k]
    return follows_path(k, turned.turn[k], turned.mean[k], turned.mean_by_time[k], inputs.lever_arm, sigma, loss)


def _rolled(inputs: GraphInputs, t: Array) -> Array:
    """Return the distance at ``t`` (m,), m.

    Steps of a coarse tach and noise of a speed signal are none of the vehicle's, and smoothed.
    """
    wheel = inputs.wheel
    if wheel is not None and (wheel.coarse or wheel.grown is not None or wheel.rounding_sd > _COARSE_M):
        return inputs.path.rolled(t)
    return inputs.distance_at(t)

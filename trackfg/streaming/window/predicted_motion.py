"""The motion over the next interval of a stream, as its inertial samples measure and predict it.

Where compiled kernels are in use, ``kernels/prediction.cpp`` computes all of it at once; the batch smoother's
functions, one after the other, are its reference.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np

from trackfg.factors.bias import response_terms
from trackfg.factors.family import Family
from trackfg.factors.imu import Preintegration, PreintegrationNoise
from trackfg.factors.path import LEAST_TURN
from trackfg.factors.states import Kind, Nav, States
from trackfg.graph.inertial import increment_s, preintegrated
from trackfg.graph.inputs import RATE_WINDOW_S, GraphInputs, declared_noise, hole_noise
from trackfg.graph.motion import along_track, turned
from trackfg.graph.odometry import (
    ARC_SD_M,
    ARC_SD_RELATIVE,
    DISTANCE_SD_M,
    ROLLED_AT_REST_M,
    path_length_factors,
)
from trackfg.graph.wheel_slip import Rolling
from trackfg.numerics.arrays import Array
from trackfg.numerics.geodesy import EARTH_RADIUS
from trackfg.numerics.kernels import compiled_kernels, kernel_argument
from trackfg.numerics.rotations import rpy_from_matrix
from trackfg.recording.model import Recording
from trackfg.sensors.dead_reckoning import InitialPath
from trackfg.sensors.imu_intervals import AT_REST_M, Intervals, Turning, samples_per_increment
from trackfg.sensors.imu_noise.noise_at_rest import NoiseAtRest
from trackfg.sensors.imu_noise.noise_floor import CLEARLY, NoiseFloor
from trackfg.sensors.imu_noise.sample_blocks import NOISE_LIMITS, block_length
from trackfg.sensors.imu_noise.vibration_power import vibration_widths
from trackfg.sensors.imu_noise.white_noise import WhiteNoise
from trackfg.sensors.tach import Wheel
from trackfg.streaming.rows import NO_SAMPLES
from trackfg.streaming.window.interval_factors import new_factors
from trackfg.streaming.window.stream_context import StreamContext

_NO_RESTS = np.zeros((0, 2))


@dataclass(frozen=True)
class PredictedMotion:
    """The keyframe that the motion begins at, with the interval's bias (``start``), and that bias' ``response`` to the
    calibration (6, IMU); what was ``measured`` between the times ``t`` (2,), s; the state at the end (``nav``) and the
    ``distance`` along the track, m, backwards negative; the ``families`` of the motion along the track; and what a
    wheel's rolling depends on, ``rolling`` (4,): how far the vehicle moved, m, and turned, rad, the mean forward force,
    g, and the speed at the end, m/s.
    """

    context: StreamContext
    make_inputs: Callable[[], GraphInputs]
    t: Array
    start: States
    response: Array
    measured: Preintegration
    nav: Nav
    distance: float
    families: tuple[Family, ...]
    rolling: Array

    @cached_property
    def inputs(self) -> GraphInputs:
        """The inputs of the factors of other rows, with the first guess of the motion."""
        return self.make_inputs()

    @classmethod
    def of(
        cls, context: StreamContext, newest: States, data: Intervals, edges: np.ndarray, at_rest: NoiseAtRest
    ) -> PredictedMotion:
        """Predict from the ``newest`` keyframe to the next one, as :func:`next_interval.predict_interval` says."""
        predicted = _by_kernel if compiled_kernels() and len(data.stretches) == 1 else _by_arrays
        return predicted(context, newest, data, edges, at_rest)


def _by_arrays(
    context: StreamContext, newest: States, data: Intervals, edges: np.ndarray, at_rest: NoiseAtRest
) -> PredictedMotion:
    standing = _path(data, rpy_from_matrix(newest.nav.R), newest.bias, np.zeros(2))
    inputs = _inputs(context, data, edges, replace(NoiseFloor.of(data), at_rest=at_rest), standing, None)
    response = _response(inputs, newest)
    start = newest.with_bias(newest.bias + response @ newest.imu[0])
    measured = preintegrated(inputs, start.joined(start), speedless=False)[0]
    nav = measured.predicted(start.nav, start.bias[0])
    distance = _distance(start.nav, nav, context.lever_arm)
    begin, end = inputs.t
    slow, fast = (float(state.v[0] @ state.R[0, :, 0]) for state in (start.nav, nav))
    speed = slow + (fast - slow) * (standing.t - begin) / (end - begin)
    speed += distance / (end - begin) - 0.5 * (slow + fast)
    path = _path(data, standing.rpy[:1], start.bias, speed)
    inputs = inputs.with_motion(path, _rolling(path, data.edges, path.rolled(data.edges)))
    families = new_factors([*path_length_factors(inputs), *along_track(inputs, turned(inputs))])
    turn, force = inputs.mean_rate[0, 2] * (end - begin), inputs.mean_accel[0, 0] / context.world.gravity
    rolling = np.array([inputs.distance[0], turn, force, np.interp(end, path.t, path.speed)])
    return PredictedMotion(
        context, lambda: inputs, inputs.t, start, response, measured, nav, distance, families, rolling
    )


def _response(inputs: GraphInputs, newest: States) -> Array:
    """Return the derivative of the bias by the calibration (6, IMU), at the velocity in the middle of the interval."""
    force = newest.nav.R @ (inputs.mean_accel - newest.bias[:, :3])[..., None]
    gained = inputs.durations[:, None] * (force[..., 0] - [0.0, 0.0, inputs.world.gravity])
    velocity = newest.nav.v + 0.5 * gained
    terms = response_terms(inputs.mean_accel, inputs.mean_rate, inputs.vibration, newest.nav.R, velocity)
    return np.asarray(terms[0])


def _by_kernel(
    context: StreamContext, newest: States, data: Intervals, edges: np.ndarray, at_rest: NoiseAtRest
) -> PredictedMotion:
    from trackfg.numerics import compiled

    t, gyro, accel = map(kernel_argument, (data.edges, data.gyro, data.accel))
    begin, end = edges.tolist()
    group = int(samples_per_increment(data.usual_duration, increment_s(newest.nav.v))[0])
    count = -(-(end - begin) // group)
    means, response, noise = np.empty((3, 3)), np.empty((6, Kind.IMU.dim)), np.empty((2, 6))
    increments, frame, delta, state = np.empty(7 * count), np.empty(4), np.empty(compiled.DELTA_SIZE), np.empty(15)
    motion, rolled, turns, rates = np.empty(7), np.empty(len(data.edges)), np.empty((3, 1, 3, 3)), np.empty((2, 3))
    ahead, sigmas = np.empty((1, 3)), np.empty((1, 10))
    results = (means, response, noise, increments, frame, delta, state, motion, rolled, turns, rates, ahead, sigmas)
    compiled.predict_interval(
        *(t, gyro, accel, np.ascontiguousarray(data.bridged)),
        (begin, end, block_length(data), *vibration_widths(data), group),
        data.usual_duration,
        _setting(context, at_rest),
        NOISE_LIMITS,
        newest.arrays,
        results,
    )
    bias, density = noise[:1], noise[1:]
    white = WhiteNoise(density[:, :3], density[:, 3:])
    white = white.over_holes(data.bridged[begin : begin + 1], *hole_noise(context.config))
    start = newest.with_bias(bias)
    measured = Preintegration(
        PreintegrationNoise(white.gyro[0], white.accel[0]),
        float(frame[0]),
        frame[1:],
        bias[0],
        increments[:count],
        increments[count : 4 * count].reshape(count, 3),
        increments[4 * count :].reshape(count, 3),
    )
    vars(measured)["delta"] = delta
    nav = Nav(state[None, :9].reshape(1, 3, 3), state[None, 9:12], state[None, 12:])

    def inputs() -> GraphInputs:
        path = _path(data, rpy_from_matrix(newest.nav.R), bias, motion[1:3])
        rolling = _rolling(path, data.edges, rolled)
        return _inputs(context, data, edges, NoiseFloor.unknown(data), path, rolling).knowing(
            mean_accel=means[:1],
            mean_gyro=means[1:2],
            vibration=means[2:],
            noise=white,
            distance=motion[3:4],
            body_rate=rates,
        )

    follows_path = context.description.imu.rigid and not data.bridged[begin:end].any()
    families = context.motion_factors.measured(sigmas, Turning(*turns), ahead, rates[1:], follows_path=follows_path)
    return PredictedMotion(
        context, inputs, data.edges[edges], start, response, measured, nav, float(motion[0]), families, motion[3:]
    )


@lru_cache(maxsize=4)
def _setting(context: StreamContext, at_rest: NoiseAtRest) -> Array:
    """Return the numbers that ``Setting`` in ``kernels/prediction.cpp`` names; they last until the next rest."""
    world, hole, position = context.world, np.repeat(hole_noise(context.config), 3), PreintegrationNoise.position
    motion, tach, level = context.config.motion, context.config.tach, context.config.noise
    assumed = at_rest.assumed(*declared_noise(context.description, context.config))
    return np.array([
        *(CLEARLY, world.gravity, *world.earth_rate.tolist(), EARTH_RADIUS, RATE_WINDOW_S, AT_REST_M, position),
        *(*context.description.imu.lever_arm_m, *assumed.tolist(), *at_rest.excess.tolist()),
        *hole.tolist(),
        *(DISTANCE_SD_M, tach.scale_walk_per_sqrt_m, ROLLED_AT_REST_M, ARC_SD_M, ARC_SD_RELATIVE),
        *(motion.lateral_sd_mps, motion.vertical_sd_mps, motion.sd_per_speed, level.motion),
        *(motion.path_sd_m, motion.path_sd_relative, level.path, LEAST_TURN),
    ])  # fmt: skip


def _inputs(
    context: StreamContext,
    data: Intervals,
    edges: np.ndarray,
    floor: NoiseFloor,
    path: InitialPath,
    rolling: Rolling | None,
) -> GraphInputs:
    return GraphInputs(
        recording=Recording(context.description, NO_SAMPLES),
        config=context.config,
        world=context.world,
        data=data,
        floor=floor,
        wheel=None,
        rests=_NO_RESTS,
        path=path,
        rolling=rolling,
        edges=edges,
        t=data.edges[edges],
        clock_origin=context.clock_origin,
    )


def _path(data: Intervals, rpy: Array, bias: Array, speed: Array) -> InitialPath:
    """Return a first guess of the motion over ``data``, as factors need it: one attitude (1, 3), rad, one bias (1, 6),
    and the ``speed`` (2,) at begin and end, m/s.
    """
    nowhere = np.zeros((2, 3))
    return InitialPath(
        data.edges[[0, -1]], rpy.repeat(2, axis=0), nowhere, nowhere, speed, bias[:, 3:].repeat(2, axis=0)
    )


def _rolling(path: InitialPath, edges: Array, rolled: Array) -> Rolling:
    return Rolling(path.t, path.speed, np.ones(1, dtype=bool), Wheel(edges, rolled, 1e-4, 0.0, False, _NO_RESTS))


def _distance(newest: Nav, predicted: Nav, lever_arm: Array) -> float:
    """Return the distance along the track, m, backwards negative."""
    chord = (predicted.p - predicted.R @ lever_arm) - (newest.p - newest.R @ lever_arm)
    forward = 0.5 * (newest.R[0, :, 0] + predicted.R[0, :, 0])
    return float(np.copysign(np.linalg.norm(chord), chord[0] @ forward))

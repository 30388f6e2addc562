"""Inertial samples become inertial factors, a walk of the biases, and gravity tilt where nothing measures speed."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from trackfg.factors.bias import RECTIFICATION, bias_walk, response_terms
from trackfg.factors.family import Family, row_norms
from trackfg.factors.gravity import gravity_tilt
from trackfg.factors.imu import Preintegration, PreintegrationNoise
from trackfg.factors.states import Nav, States
from trackfg.graph.inputs import GraphInputs
from trackfg.numerics.arrays import Array
from trackfg.numerics.geodesy import EARTH_RADIUS, transport_rate
from trackfg.numerics.integrals import means_around
from trackfg.numerics.rotations import so3_exp, so3_log
from trackfg.recording.description import ImuNoise
from trackfg.sensors.imu_intervals import compress, increment_starts

_INCREMENT_S, _INCREMENT_M = 0.02, 0.4
"""What GTSAM preintegrates at a time, s, and at speed m: finer samples are compressed first, exactly but for the way
within an increment, where the force counts as constant. Of the way of a wave this leaves out
``(2 pi increment / wave)^2 / 12``: 6 % of the shortest one of the track's level and alignment, 3 m, and 2 % of 5 m. At
80 m/s, increments of 20 ms passed for 4 % of a gyro's scale.
"""

_AT_A_TIME = 400
"""Intervals whose samples are compressed together: what is needed on the way stays small."""

_SPRINGS_S = 10.0
"""Over so long a body's motion on its springs averages out, s: bodies of railway vehicles sway, roll, bounce and pitch
at 0.5 to 2 Hz, those of cars at 1 to 2, of which a mean over 10 s leaves 6 % at most."""

_UNKNOWN_ACCELERATION = 0.3
"""m/s^2, with a correlation time of 10 s: the accelerations that the tilt of a run without speed has to allow for."""


def preintegrated(inputs: GraphInputs, states: States, speedless: bool) -> tuple[Preintegration, ...]:
    """Return what the inertial sensor measured in each interval, about the biases of ``states``.

    The accelerometer has no weight where nothing measures speed.
    """
    gyro, accel = inputs.noise.gyro, np.full_like(inputs.noise.accel, 1e3) if speedless else inputs.noise.accel
    gyro_bias = states.bias[:, 3:].mean(axis=0)
    gravity, earth = inputs.world.gravity, inputs.world.earth_rate
    # The level frame turns with the Earth and, with the vehicle, over its curvature. GTSAM's Coriolis term counts
    # the second twice: v^2 / radius upwards, taken back through gravity.
    velocity = 0.5 * (states.nav.v[1:] + states.nav.v[:-1])
    turning = earth + transport_rate(velocity)
    weight = gravity + np.sum(velocity[:, :2] ** 2, axis=1) / EARTH_RADIUS

    starts, first = increment_starts(inputs.data, inputs.edges, increment_s(states.nav.v[:-1]))
    count = len(starts) - 1
    duration, rotation, velocity = np.empty(count), np.empty((count, 3)), np.empty((count, 3))
    for begin in range(0, len(first) - 1, _AT_A_TIME):
        rows = slice(first[begin], first[min(begin + _AT_A_TIME, len(first) - 1)])
        increments = compress(inputs.data, starts[rows.start : rows.stop + 1], gyro_bias)
        duration[rows], rotation[rows], velocity[rows] = increments.duration, increments.rotation, increments.velocity
    return tuple(
        Preintegration(
            PreintegrationNoise(gyro[k], accel[k]),
            float(weight[k]),
            turning[k],
            states.bias[k],
            duration[a:b],
            rotation[a:b],
            velocity[a:b],
        )
        for k, (a, b) in enumerate(pairwise(first.tolist()))
    )


def increment_s(velocity: Array) -> Array:
    """Return the longest duration of an increment at velocities (n, 3), m/s. Shape (n,), s."""
    speed = row_norms(velocity)
    return np.asarray(np.minimum(_INCREMENT_S, _INCREMENT_M / np.maximum(speed, 1e-9)))


def own_bias_walk(inputs: GraphInputs) -> Family:
    """Return the walk of the sensor's own biases, with the declared densities."""
    return walk_of(inputs.t, inputs.response, inputs.recording.description.imu.noise)


def walk_of(t: Array, response: Array, noise: ImuNoise) -> Family:
    """Return the walk between keyframes at ``t`` (n,) with their responses to the calibration (n, 6, dim)."""
    return bias_walk(np.arange(len(t) - 1), np.diff(response, axis=0), walk_sigma(t, noise))


def walk_sigma(t: Array, noise: ImuNoise) -> Array:
    """Return by how much the biases walk between neighbouring times ``t`` (n,), s, shape (n - 1, 6)."""
    density = np.array([noise.accel_bias_walk] * 3 + [noise.gyro_bias_walk] * 3)
    return np.asarray(np.sqrt(t[1:] - t[:-1])[:, None] * density)


def response_of_motion(nav: Nav, t: Array, gravity: float, response: Array, *, on_springs: bool) -> Array:
    """Return the response to the calibration, as ``response`` (n, 6, dim), but at mean forces and rates of the motion.

    A measured mean has the noise of the very increment whose residual it multiplies: with noise n beside a force f, the
    error in variables pulls a scale factor by ``-n^2 / (f^2 + n^2)`` (Fuller, *Measurement Error Models* (1987), 1.1).
    The means of the motion of keyframes (n,) at ``t``, s, have no noise but what the states took from it.

    What a body does ``on_springs`` is measured well, but the graph takes it for noise of the motion along the axis, of
    which a scale of -100 % leaves none. Forces sideways and upwards, roll and pitch are means over :data:`_SPRINGS_S`.
    """
    dt = np.diff(t)[:, None]
    turn = so3_log(np.swapaxes(nav.R[:-1], 1, 2) @ nav.R[1:])
    middle = nav.R[:-1] @ so3_exp(0.5 * turn)
    force = np.einsum("mji,mj->mi", middle, np.diff(nav.v, axis=0) / dt + [0.0, 0.0, gravity])
    rate = turn / dt
    if on_springs:
        moved = np.hstack([force[:, 1:], rate[:, :2]])
        integral = np.vstack([np.zeros(4), np.cumsum(moved * dt, axis=0)])
        means = means_around(0.5 * (t[1:] + t[:-1]), t, integral, _SPRINGS_S)
        force[:, 1:], rate[:, :2] = means[:, :2], means[:, 2:]
    power = np.diagonal(response[:-1, :3, RECTIFICATION], axis1=1, axis2=2)
    terms = response_terms(force, rate, power, middle, 0.5 * (nav.v[1:] + nav.v[:-1]))
    return np.concatenate([terms, np.zeros((1, *terms.shape[1:]))])


def tilt(inputs: GraphInputs) -> Family:
    """Return the gravity tilt of the mean specific force around each keyframe, each sample in one mean."""
    middle = np.concatenate([[inputs.edges[0]], (inputs.edges[1:] + inputs.edges[:-1]) // 2, [inputs.edges[-1]]])
    dt = inputs.data.durations[:, None]
    integral = np.vstack([np.zeros(3), np.cumsum(inputs.data.accel * dt, axis=0)])
    duration = np.diff(inputs.data.edges[middle])[:, None]
    force = np.diff(integral[middle], axis=0) / duration
    white = inputs.noise.accel[np.minimum(np.arange(len(inputs.t)), len(inputs.noise) - 1)]
    sigma = np.sqrt(white**2 / duration + 2.0 * _UNKNOWN_ACCELERATION**2 * 10.0 / duration)
    return gravity_tilt(np.arange(len(inputs.t)), force, inputs.world.gravity, sigma)

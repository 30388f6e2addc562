"""The odometer's factors tie distance, wheel and arc length.

A wheel that drives or brakes creeps: on the stable side of its creep curve by a share of the distance that is about
proportional to the force that it transmits, some 1 % at the top of the curve. The force per mass, in g, is what the
accelerometer shows forwards (acceleration and gradient together), so that over a distance d with the mean force f

    variance = (creep sqrt(d))^2 + (creep_per_traction |f| / g  d)^2 (1 s / T)

in a time T: what the force leaves open is another one in every second, so that the sum over a stretch does not depend
on how many keyframes are in it.

What is left beyond is slip, and the loss switches the wheel off there.
"""

from __future__ import annotations

import numpy as np

from trackfg.config import TachConfig
from trackfg.factors.family import Family
from trackfg.factors.loss import SwitchChain
from trackfg.factors.odometry import (
    ANY_DISTANCE_SD_M,
    arc_length,
    creep_sd,
    distance_chain,
    tach_distance,
    tach_reading,
    wheel_response,
)
from trackfg.factors.states import Kind
from trackfg.graph.inputs import GraphInputs
from trackfg.numerics.arrays import Array
from trackfg.numerics.spans import within

DISTANCE_SD_M = 1e-5
"""Distances of an interval and of the chain are one quantity: far below what any sensor resolves, m."""

ARC_SD_M = 2e-4
"""Sigma of the length of the path over an interval, m: what the chord-to-arc correction leaves out."""

ARC_SD_RELATIVE = 1e-5
"""The same, in proportion to the distance."""

ROLLED_AT_REST_M = 0.01
"""Distance that is added to that of every interval, m, so that no sigma that grows with it is 0 at rest."""


def odometer(inputs: GraphInputs) -> list[Family]:
    """Return the factors of distance: it adds up, is the length of the path, and what the wheel rolls."""
    return [*path_length_factors(inputs), *tach_factors(inputs)]


def path_length_factors(inputs: GraphInputs) -> list[Family]:
    """Return the factors that need no wheel: distance adds up, and is the length of the path."""
    config, k = inputs.config.tach, np.arange(len(inputs.t) - 1)
    distance = np.abs(inputs.distance)
    chain_sd = np.stack(
        [np.full(k.size, DISTANCE_SD_M), config.scale_walk_per_sqrt_m * np.sqrt(distance + ROLLED_AT_REST_M)], 1
    )
    return [
        distance_chain(k, chain_sd),
        arc_length(k, inputs.lever_arm, (ARC_SD_M + ARC_SD_RELATIVE * distance)[:, None]),
    ]


def tach_factors(inputs: GraphInputs) -> list[Family]:
    """Return the factors of the wheel: distance is what it rolls, where there is one."""
    config, k = inputs.config.tach, np.arange(len(inputs.t) - 1)
    loss = None
    if inputs.recording.description.tach is not None:  # also where it is silent: it may start within the same window
        loss = SwitchChain(config.robust_width, inputs.config.keyframes.interval_s)
    if inputs.wheel is None:
        nothing = np.zeros((k.size, Kind.WHEEL.dim))
        return [tach_distance(k, nothing, np.full((k.size, 1), ANY_DISTANCE_SD_M), loss)]
    gained = inputs.wheel.variance_gained(inputs.t, config.speed_noise_mps) * _moving(inputs)
    variance = creep_variance(inputs) + gained
    silent = ~(inputs.wheel.covers(inputs.t[:-1]) & inputs.wheel.covers(inputs.t[1:]))
    unknown = ~inputs.wheel.counts(inputs.t) | (silent & inputs.wheel.integrates_speed)
    variance = np.where(unknown, ANY_DISTANCE_SD_M**2, variance)
    sigma = np.sqrt(variance)[:, None] * inputs.config.noise.tach
    response = response_of_wheels(inputs, offset=inputs.wheel.integrates_speed)
    assert inputs.rolling is not None
    wheel = tach_distance(k, response, sigma, loss, inputs.rolling.slips_within(inputs.t))
    read = _readable(inputs)
    at = inputs.t[read]
    # The rate of the count itself has the noise of its rounding, by which each reading would contradict any offset.
    count, rate, since = inputs.wheel.at(at), inputs.rolling.speed_at(at), at - inputs.clock_origin
    return [wheel, tach_reading(read, count, rate, since, inputs.wheel.reading_sd(at)[:, None])]


def creep_variance(inputs: GraphInputs) -> Array:
    """Return the variance of the distance that a wheel rolls in each interval, m^2, shape (n - 1,)."""
    force = inputs.mean_accel[:, 0] / inputs.world.gravity
    return creep_variance_over(np.abs(inputs.distance), force, inputs.durations, inputs.config.tach)


def creep_variance_over(distance: Array, force: Array, duration: Array | float, config: TachConfig) -> Array:
    """Return the same over distances (m,), m, with mean forward forces (m,), g, that take ``duration``, s."""
    return np.asarray(
        config.creep_m_per_sqrt_m**2 * (distance + ROLLED_AT_REST_M)
        + creep_sd(config.creep_per_traction, distance * force) ** 2 / duration
    )


def response_of_wheels(inputs: GraphInputs, *, offset: bool = False) -> Array:
    """Return what ``WHEEL`` adds to the distance that a wheel rolls in each interval, shape (n - 1, 5).

    ``offset``: whether the distance is that of a speed signal, which may be off by a constant in motion.
    """
    force = inputs.mean_accel[:, 0] / inputs.world.gravity
    moving_s = inputs.durations * _moving(inputs) * offset
    return wheel_response(inputs.distance, inputs.mean_rate[:, 2] * inputs.durations, force, moving_s)


def _moving(inputs: GraphInputs) -> np.ndarray:
    """Return whether the vehicle moves in each interval, shape (n - 1,)."""
    moving: np.ndarray = ~within(0.5 * (inputs.t[1:] + inputs.t[:-1]), inputs.rests)
    return moving


def _readable(inputs: GraphInputs) -> np.ndarray:
    """Return the keyframes with a tach reading of their own.

    A count that has not moved since the last reading adds nothing: its rounding error is the same one.
    """
    assert inputs.wheel is not None
    covered = np.flatnonzero(inputs.wheel.covers(inputs.t))
    count = inputs.wheel.at(inputs.t[covered])
    if covered.size == 0:
        return covered
    grid = np.floor(count / max(inputs.wheel.quantum, 1e-9) + 0.5)
    fresh = np.concatenate([[True], grid[1:] != grid[:-1]])
    readable: np.ndarray = covered[fresh]
    return readable

"""The odometer's factors of a graph: distance, wheel, arc length.

A wheel that drives or brakes creeps: on the stable side of its creep curve by a share of the distance that is about
proportional to the force that it transmits, some 1 % at the top of the curve. The force per mass, in g, is what the
accelerometer shows forwards (acceleration and gradient together), so that over a distance d with the mean force f

    variance = (creep sqrt(d))^2 + (creep_per_traction |f| / g  d)^2 (1 s / T)

in a time T: what the force leaves open is another one in every second, so that the sum over a stretch does not depend
on how many keyframes are in it.

What is left beyond is slip, and the loss switches the wheel off there.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from trackfg.factors.family import Family
from trackfg.factors.loss import SwitchChain
from trackfg.factors.odometry import arc_length, distance_chain, tach_distance, tach_reading, wheel_response
from trackfg.factors.states import Kind
from trackfg.graph.inputs import Layout
from trackfg.numerics.spans import within

_DISTANCE_SD_M = 1e-5
_ARC_SD_M = 2e-4
_ARC_SD_RELATIVE = 1e-5
_MOVED_SD_M = 1e4
"""For an interval in which the wheel says nothing: any distance."""


def odometer(layout: Layout) -> list[Family]:
    """Distance adds up, is the length of the path, and is what the wheel rolls, where there is one."""
    return [*travelled(layout), *rolled(layout)]


def travelled(layout: Layout) -> list[Family]:
    """What needs no wheel: distance adds up, and is the length of the path."""
    config, k = layout.config.tach, np.arange(len(layout.t) - 1)
    distance = np.abs(layout.distance)
    chain_sd = np.stack([np.full(k.size, _DISTANCE_SD_M), config.scale_walk_per_sqrt_m * np.sqrt(distance + 0.01)], 1)
    return [
        distance_chain(k, chain_sd),
        arc_length(k, layout.lever_arm, (_ARC_SD_M + _ARC_SD_RELATIVE * distance)[:, None]),
    ]


def rolled(layout: Layout) -> list[Family]:
    """Distance is what the wheel rolls, where there is one."""
    config, k = layout.config.tach, np.arange(len(layout.t) - 1)
    distance = np.abs(layout.distance)
    loss = None
    if layout.recording.description.tach is not None:  # also where it is silent: it may start within the same window
        loss = SwitchChain(config.robust_width, layout.config.keyframes.interval_s)
    if layout.wheel is None:
        nothing = np.zeros((k.size, Kind.WHEEL.dim))
        return [tach_distance(k, nothing, np.full((k.size, 1), _MOVED_SD_M), loss)]
    force = layout.mean_accel[:, 0] / layout.world.gravity
    variance = (
        config.creep_m_per_sqrt_m**2 * (distance + 0.01)
        + (config.creep_per_traction * np.abs(force) * distance) ** 2 / layout.durations
    )
    if layout.wheel.integrates_speed:
        moving = ~within(0.5 * (layout.t[1:] + layout.t[:-1]), layout.rests)
        variance = variance + config.speed_noise_mps**2 * layout.durations * moving
    silent = ~(layout.wheel.covers(layout.t[:-1]) & layout.wheel.covers(layout.t[1:]))
    unknown = ~layout.wheel.counts(layout.t) | (silent & layout.wheel.integrates_speed)
    variance = np.where(unknown, _MOVED_SD_M**2, variance)
    sigma = np.sqrt(variance)[:, None] * layout.config.noise.tach
    response = wheel_response(layout.distance, layout.mean_rate[:, 2] * layout.durations, force)
    assert layout.rolling is not None
    wheel = tach_distance(k, response, sigma, loss)
    wheel = replace(wheel, doubtful=layout.rolling.slips_within(layout.t))
    read = _readable(layout)
    count, rate = layout.wheel.at(layout.t[read]), layout.wheel.rate(layout.t[read])
    since = layout.t[read] - layout.clock_origin
    return [wheel, tach_reading(read, count, rate, since, np.full((read.size, 1), layout.wheel.rounding_sd))]


def _readable(layout: Layout) -> np.ndarray:
    """Keyframes with a tach reading of their own: a count that has not moved since the last reading says nothing
    new, its rounding error is the same one."""
    assert layout.wheel is not None
    covered = np.flatnonzero(layout.wheel.covers(layout.t))
    count = layout.wheel.at(layout.t[covered])
    if covered.size == 0:
        return covered
    grid = np.floor(count / max(layout.wheel.quantum, 1e-9))
    fresh = np.concatenate([[True], grid[1:] != grid[:-1]])
    readable: np.ndarray = covered[fresh]
    return readable

"""A wheel that creeps further than another one counts less: the one that creeps least is nearest to the distance.

Below the top of its creep curve a wheel creeps the way of the force, ahead in traction and behind under the brake
(:func:`trackfg.factors.odometry.wheel_response`), never the other way. Where rails are slippery under one axle only,
its wheel parts from the others, and the sign shows which of them is wrong. A first solution knows the wheels' scales
and clocks, and leaves the residual e (m) of each wheel's distance. With s the sign of the force, wheel i creeps by

    c_i = (C_i(t + T/2) - C_i(t - T/2)) / T,   C_i the sum of s e_i,

as a mean over T, since creep lasts as long as its force, and leads by ``l_i = c_i - min_j c_j``. Of l_i^2 the variance
n that noise would give it in that time is taken off. An error of that rate which lasts for T adds up to l_i T; as an
independent error of each interval, of duration dt, it has

    variance = max(l_i^2 - n, 0) T dt.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from trackfg.config import SmoothConfig
from trackfg.factors.factor_type import FactorType
from trackfg.factors.family import Family
from trackfg.factors.odometry import MOST_CREEP, creep_sd, force_on_distances
from trackfg.factors.states import States
from trackfg.graph.build import Problem
from trackfg.numerics.arrays import Array

_LASTS_S = 5.0
"""The time T, s: a train drives or brakes for longer at a time, 10 s and more from a stop to the speed of a line."""

_ROLLS = 0.5
"""Weight of a wheel in an interval from which on it rolls: it may be the one that creeps least."""


class _Creep(NamedTuple):
    """The creep of a wheel in each interval is a rate, m/s, with the variance of its noise, m^2/s^2, where it rolls."""

    rate: Array
    variance: Array
    rolls: np.ndarray


def with_creeping_wheels(problem: Problem, states: States, config: SmoothConfig) -> Problem:
    """Return the problem with larger sigmas where a wheel creeps further than another one, by a solution's ``states``.

    A problem with one wheel stays as it is.
    """
    wheels = [part for part in problem.families if part.type in (FactorType.TACH_DISTANCE, FactorType.TACH_INCREMENT)]
    if len(wheels) < 2:
        return problem
    creeps = [_creep(wheel, states, problem.t, config) for wheel in wheels]
    rate, variance, rolls = (np.stack(rows) for rows in zip(*creeps, strict=True))
    duration = np.diff(problem.t)
    fastest = MOST_CREEP * np.abs(states.odo.step[1:]) / duration  # beyond it a wheel slips, which its loss deals with
    least, k = np.argmin(np.where(rolls, rate, np.inf), axis=0), np.arange(len(duration))
    lead = np.clip(rate - rate[least, k], 0.0, fastest) * rolls[least, k]
    added = np.maximum(lead**2 - variance - variance[least, k], 0.0) * _LASTS_S * duration
    wider = {
        id(wheel): wheel.with_sigma(np.sqrt(wheel.sigma**2 + more[wheel.first_keyframe, None]))
        for wheel, more in zip(wheels, added, strict=True)
    }
    return replace(problem, families=tuple(wider.get(id(family), family) for family in problem.families))


def _creep(wheel: Family, states: States, t: Array, config: SmoothConfig) -> _Creep:
    k, duration = wheel.first_keyframe, np.diff(t)
    pushed = force_on_distances(wheel.data["response"])
    by_force = config.noise.tach * creep_sd(config.tach.creep_per_traction, pushed) / np.sqrt(duration[k])
    ahead, variance, rolls = np.zeros_like(duration), np.zeros_like(duration), np.zeros(len(duration), dtype=bool)
    ahead[k] = np.sign(pushed) * wheel.residual(states)[:, 0]
    variance[k] = np.maximum(wheel.sigma[:, 0] ** 2 - by_force**2, 0.0)
    rolls[k] = wheel.weights(states) > _ROLLS
    middle = 0.5 * (t[1:] + t[:-1])
    begin, end = np.maximum(middle - 0.5 * _LASTS_S, t[0]), np.minimum(middle + 0.5 * _LASTS_S, t[-1])

    def within(values: Array) -> Array:
        """Return the sum of what intervals have, from ``begin`` to ``end``."""
        total = np.concatenate([[0.0], np.cumsum(values)])
        return np.asarray(np.interp(end, t, total) - np.interp(begin, t, total))

    return _Creep(within(ahead) / (end - begin), within(variance) / (end - begin) ** 2, rolls)

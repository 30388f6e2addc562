"""Slip is found before there is a graph: the wheel's speed is held against the accelerometer's.

On a grid of times the vehicle's speed v and the error b of the forward acceleration a, which wanders slowly, satisfy

    v_k+1 - v_k + b_k dt = a_k dt,   b_k+1 = b_k,   (v_k + v_k+1) dt / 2 = d_k,   v = 0 at rest,

each to its sigma; d is the distance that the wheel rolls. The forward acceleration is the specific force less gravity's
part, for which the pitch is the gyro's alone: a slipping wheel cannot spoil that. The equation of d holds while the
wheel rolls.

1. A Kalman filter goes through time and passes over each rolled distance, and each rest, that it does not find
   credible; another one goes back. Neither follows the wheel into a slip, however long and violent, since both know the
   speed before it; each may pass over too much after one. A reading is credible where either filter keeps it.
2. From there, least squares and the probability of rolling by :mod:`trackfg.factors.switching` in turns.

A wheel scale that is off by some per cent is in b as well, which changes when the acceleration does. Where a wheel
would slip for most of the time that it turns, the force is not what this model takes it for, and nothing is found.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.linalg import solveh_banded

from trackfg.config import SmoothConfig
from trackfg.factors.odometry import creep_sd
from trackfg.factors.switching import Chain, first_state_probability
from trackfg.graph.forward_force import ForwardForce, forward_force
from trackfg.numerics.arrays import Array
from trackfg.numerics.spans import within
from trackfg.sensors.dead_reckoning import InitialPath
from trackfg.sensors.imu_intervals import Intervals
from trackfg.sensors.imu_noise.noise_floor import NoiseFloor
from trackfg.sensors.tach import Wheel

_STEP_S = 0.5
"""Step of the grid, s: slips last longer, and a minute of slip is 120 steps."""

_ERROR_WALK = 1e-3
"""m/s^2 in 1 s: pitch from the gyro."""
_SCALE_SD = 0.01
"""Relative sigma of the wheel's scale: diameters are described to about 1 %, as ``tach.scale_sd`` has it."""

_CREEP = 2e-3
"""Of the distance, besides that which goes with the force."""
_REST_SD_MPS = 0.01
"""Sigma of the speed at rest, m/s."""

_SILENT_SD_M = 1e6
"""Sigma of a distance that the wheel does not measure, m: any."""

_FEWEST = 5
"""Times: a shorter run is not searched."""

_GATE_SIGMAS = 4.0
"""A filter passes over a distance that is further off, in sigmas: 6e-5 of good ones are."""

_LONE_SIGMAS = 3.5
"""Where a lone error is as likely a slip."""
_LEAST_WEIGHT = 1e-6
"""Weights are at least this, so that the banded system stays positive definite."""

_BREAKDOWN = 0.5
"""Share of a turning wheel's distances that may be wrong: with more no estimator can say which are right (Rousseeuw &
Leroy, Robust Regression and Outlier Detection, 1.2), and a force that is wrong looks like a slip without end."""

_ROUNDS = 8
"""Rounds of least squares and probabilities at most; :data:`_SETTLED` ends them earlier."""

_SETTLED = 0.01
"""No weight changes by more."""


@dataclass(frozen=True)
class Rolling:
    """The search for slip gives the vehicle's ``speed`` (n,), m/s, at times ``t`` (n,), s, and where the wheel rolls.

    ``rolls`` (n - 1,): whether it rolls in between; ``wheel``: as if it had rolled all the time.
    """

    t: Array
    speed: Array
    rolls: np.ndarray
    wheel: Wheel

    def speed_at(self, t: Array) -> Array:
        """Return the vehicle's speed at times ``t`` (m,), s, in m/s, shape (m,).

        The accelerometer has its part in it: there is neither the rounding of a count in it nor wrong pulses.
        """
        return np.interp(t, self.t, self.speed)

    def slips_within(self, t: Array) -> np.ndarray:
        """Return whether the wheel slips somewhere between neighbouring times (m,), shape (m - 1,)."""
        if self.rolls.all():
            return np.zeros(len(t) - 1, dtype=bool)
        edges = np.clip(np.searchsorted(self.t, t), 0, len(self.rolls))
        slipping = np.concatenate([[0], np.cumsum(~self.rolls)])
        found: np.ndarray = slipping[edges[1:]] > slipping[np.maximum(edges[:-1] - 1, 0)]
        return found


class _Evidence(NamedTuple):
    """The evidence of each step is a forward acceleration (m/s^2) and a rolled distance with its sigma (m).

    ``noise`` is the acceleration's (m/s in 1 s), ``walk`` the sigma of the change of b (m/s^2); the last two say
    whether the vehicle rests at the step's start and end.
    """

    acceleration: Array
    noise: Array
    rolled: Array
    sigma: Array
    walk: Array
    rests_before: np.ndarray
    rests_after: np.ndarray

    def reversed(self) -> _Evidence:
        """Return the evidence in reversed time, with the speeds as they are."""
        a, noise, rolled, sigma, walk, rest_at_begin, rest_at_end = (part[::-1] for part in self)
        return _Evidence(-a, noise, rolled, sigma, walk, rest_at_end, rest_at_begin)


def rolling(
    wheel: Wheel,
    data: Intervals,
    floor: NoiseFloor,
    path: InitialPath,
    rests: Array,
    gravity: float,
    config: SmoothConfig,
) -> Rolling:
    """Find where the wheel rolls.

    ``floor`` is the noise of the samples in ``data``; ``path`` gives roll and gyro bias; ``rests`` (r, 2) s;
    ``gravity`` m/s^2.
    """
    t = np.arange(data.edges[0], data.edges[-1], _STEP_S)
    if len(t) < _FEWEST:
        return Rolling(t, wheel.rate(t), np.ones(len(t) - 1, dtype=bool), wheel)
    forward = forward_force(t, wheel, data, floor, path, gravity, config)
    evidence = _evidence(t, wheel, forward, rests, gravity, config)
    credible = _passed(evidence) | _passed(evidence.reversed())[::-1]
    weight = np.where(credible, 1.0, _LEAST_WEIGHT)
    resting = np.append(evidence.rests_before[0], evidence.rests_after & credible)
    for _ in range(_ROUNDS):
        speed = _speeds(evidence, weight, resting)
        z = (evidence.rolled - 0.5 * _STEP_S * (speed[1:] + speed[:-1])) / evidence.sigma
        previous, weight = weight, np.maximum(first_state_probability(z, Chain(_LONE_SIGMAS)), _LEAST_WEIGHT)
        if np.abs(weight - previous).max() < _SETTLED:
            break
    rolls = weight > 0.5
    turning = (evidence.sigma < _SILENT_SD_M) & (evidence.rolled != 0.0)
    if np.count_nonzero(rolls & turning) < _BREAKDOWN * np.count_nonzero(turning):
        rolls, speed = np.ones_like(rolls), wheel.rate(t)
    return Rolling(t, speed, rolls, wheel.with_speed(t, speed, rolls & ~wheel.coarse))


def _evidence(
    t: Array, wheel: Wheel, forward: ForwardForce, rests: Array, gravity: float, config: SmoothConfig
) -> _Evidence:
    rolled = np.diff(wheel.at(t))
    creep = np.hypot(_CREEP * rolled, creep_sd(config.tach.creep_per_traction, rolled * forward.force / gravity))
    noise = wheel.variance_gained(t, config.tach.speed_noise_mps)
    if not wheel.integrates_speed:
        rounding = wheel.reading_sd(t)
        noise = noise + (rounding[1:] ** 2 + rounding[:-1] ** 2)
    late = config.tach.clock_offset_sd_s * forward.acceleration * _STEP_S
    sigma = np.sqrt(creep**2 + noise + late**2) * config.noise.tach
    sigma[~(wheel.covers(t[1:]) & wheel.covers(t[:-1]))] = _SILENT_SD_M
    change = np.diff(forward.acceleration, append=forward.acceleration[-1])
    walk = np.hypot(_ERROR_WALK * np.sqrt(_STEP_S), _SCALE_SD * change)
    resting = within(t, rests)
    return _Evidence(forward.acceleration, forward.noise, rolled, sigma, walk, resting[:-1], resting[1:])


def _passed(evidence: _Evidence) -> np.ndarray:
    """Return which rolled distances and rests a Kalman filter of (v, b) finds credible on its way, (n,) of bool.

    Plain numbers: this is the one loop over time, and arrays of two would cost ten times as much.
    """
    dt, middle = _STEP_S, 0.5 * _STEP_S
    v, b = float(evidence.rolled[0]) / dt, 0.0
    vv, vb, bb = 1.0, 0.0, 1.0
    credible = []
    for a, noise, rolled, sigma, walk, _, resting in zip(*(part.tolist() for part in evidence), strict=True):
        v += (a - b) * dt
        vv += dt * (dt * bb - 2.0 * vb) + noise * noise * dt
        vb -= dt * bb
        bb += walk * walk
        # At rest v itself is measured, else the mean speed v + (b - a) dt / 2.
        measured, variance, by_b = (
            (0.0, _REST_SD_MPS**2, 0.0) if resting else (rolled / dt + a * middle, (sigma / dt) ** 2, middle)
        )
        with_v, with_b = vv + by_b * vb, vb + by_b * bb
        variance += with_v + by_b * with_b
        innovation = measured - v - by_b * b
        credible.append(innovation**2 < _GATE_SIGMAS**2 * variance)
        if credible[-1]:
            v += with_v / variance * innovation
            b += with_b / variance * innovation
            vv -= with_v * with_v / variance
            vb -= with_v * with_b / variance
            bb -= with_b * with_b / variance
    return np.array(credible)


def _speeds(evidence: _Evidence, weight: Array, resting: np.ndarray) -> Array:
    """Return the least-squares speeds (n + 1,) from banded normal equations of (v_0, b_0, v_1, b_1, ...).

    ``resting`` is of shape (n + 1,).
    """
    n, dt = len(weight), _STEP_S
    band, right = np.zeros((4, 2 * n + 2)), np.zeros(2 * n + 2)

    def add(offsets: tuple[int, ...], factors: tuple[float, ...], measured: Array, information: Array) -> None:
        """Add rows ``sum of factors times x at 2 k + offsets = measured_k``."""
        first = 2 * np.arange(len(measured))
        for p, f in zip(offsets, factors, strict=True):
            right[first + p] += f * measured * information
            for q, h in zip(offsets, factors, strict=True):
                if q >= p:
                    band[3 - (q - p), first + q] += f * h * information

    nothing, ends = np.zeros(n), np.zeros(n + 1)
    add((0, 1, 2), (-1.0, dt, 1.0), evidence.acceleration * dt, 1.0 / (evidence.noise**2 * dt))
    add((1, 3), (-1.0, 1.0), nothing, evidence.walk**-2)
    add((0, 2), (0.5 * dt, 0.5 * dt), evidence.rolled, weight / evidence.sigma**2)
    add((0,), (1.0,), ends, np.where(resting, _REST_SD_MPS**-2, _LEAST_WEIGHT))
    add((1,), (1.0,), ends, np.full(n + 1, _LEAST_WEIGHT))
    return np.asarray(solveh_banded(band, right)[::2])

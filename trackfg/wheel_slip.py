"""Where the wheel does not roll, found before there is a graph: the wheel's speed against the accelerometer's.

On a grid of times the vehicle's speed v and the error b of the forward acceleration a, which wanders slowly, satisfy

    v_i+1 - v_i + b_i dt = a_i dt,   b_i+1 = b_i,   (v_i + v_i+1) / 2 dt = the distance that the wheel rolls,   v = 0 at rest,

each to its sigma. The forward acceleration is the specific force less gravity's part, for which the pitch comes from the
gyro alone: that a slipping wheel cannot spoil. The wheel's equations hold while it rolls; which of them do is the hidden
state of :mod:`trackfg.factors.switching`, found by graduated non-convexity: at first all errors are taken to be small
against sigma, which shrinks from iteration to iteration to what it is (Blake and Zisserman, "Visual Reconstruction",
1987; Yang et al., "Graduated non-convexity for robust spatial perception", IEEE Robotics and Automation Letters, 2020).
Neither a scale of 1 % nor a gradient matters here: to b they are slow.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import solveh_banded

from trackfg.factors.switching import first_state_probability
from trackfg.frames import Array
from trackfg.inertial import Intervals, means_around
from trackfg.initial import InitialPath
from trackfg.spans import within
from trackfg.units import STANDARD_GRAVITY
from trackfg.wheel import Wheel

_STEP_S = 0.5
_ACCELERATION_SD = 0.02
"""m/s in 1 s: noise and vibration, springs."""
_ERROR_WALK = 1e-3
_SCALE_SD = 0.01
"""m/s^2 in 1 s: pitch from the gyro, the wheel's scale."""
_CREEP = 2e-3
_CREEP_PER_TRACTION = 0.05
_REST_SD_MPS = 0.01
_WIDTH = 3.5
_GATE = 4.0
_LEAST_WEIGHT = 1e-6
_SETTLING = 8


@dataclass(frozen=True)
class Rolling:
    """The vehicle's ``speed`` (n,), m/s, at times ``t`` (n,), s; whether the wheel rolls in between (n - 1,); and the
    ``wheel`` as if it had rolled all the time.
    """

    t: Array
    speed: Array
    rolls: np.ndarray
    wheel: Wheel

    def slips_within(self, t: Array) -> np.ndarray:
        """Whether it does not roll somewhere between neighbouring times (m,), shape (m - 1,)."""
        edges = np.clip(np.searchsorted(self.t, t), 0, len(self.rolls))
        slipping = np.concatenate([[0], np.cumsum(~self.rolls)])
        first, after = np.maximum(edges[:-1] - 1, 0), edges[1:]
        found: np.ndarray = slipping[after] > slipping[first]
        return found


def rolling(wheel: Wheel, data: Intervals, path: InitialPath, rests: Array) -> Rolling:
    """Find where the wheel rolls. ``path`` gives roll and gyro bias; ``rests`` (r, 2) s."""
    t = np.arange(data.edges[0], data.edges[-1], _STEP_S)
    middle = 0.5 * (t[1:] + t[:-1])
    accel, gyro = (means_around(middle, _STEP_S, data.edges, samples) for samples in (data.accel, data.gyro))
    force = accel[:, 0] + STANDARD_GRAVITY * np.sin(_pitch(middle, gyro, path))
    rolled = np.diff(wheel.at(t))
    distance = np.abs(rolled)
    sigma = np.sqrt(
        2.0 * wheel.rounding_sd**2
        + (_CREEP * distance) ** 2
        + (_CREEP_PER_TRACTION * np.abs(accel[:, 0]) / STANDARD_GRAVITY * distance) ** 2
    )
    sigma[~(wheel.covers(t[1:]) & wheel.covers(t[:-1]))] = 1e6
    at_rest = within(t, rests)
    walk = np.sqrt(_ERROR_WALK**2 * _STEP_S + (_SCALE_SD * np.diff(force, append=force[-1])) ** 2)
    onward = _gated(force, rolled, sigma, walk, at_rest)
    back = _gated(-force[::-1], rolled[::-1], sigma[::-1], walk[::-1], at_rest[::-1])[::-1]
    weight = np.where(onward | back, 1.0, _LEAST_WEIGHT)
    for _ in range(_SETTLING):
        speed = _speeds(force, rolled, sigma / np.sqrt(weight), walk, at_rest)
        z = (rolled - 0.5 * _STEP_S * (speed[1:] + speed[:-1])) / sigma
        before, weight = weight, np.maximum(first_state_probability(z, _WIDTH), _LEAST_WEIGHT)
        if np.abs(weight - before).max() < 0.01:
            break
    rolls = weight > 0.5
    return Rolling(t, speed, rolls, wheel.with_speed(t, speed, rolls))


def _gated(force: Array, rolled: Array, sigma: Array, walk: Array, at_rest: np.ndarray) -> np.ndarray:
    """Which rolled distances a filter that goes forward through time finds credible, shape (n,) of bool."""
    dt = _STEP_S
    v, b = float(rolled[0] / dt), 0.0
    Pvv, Pvb, Pbb = 1.0, 0.0, 1.0
    qv = _ACCELERATION_SD**2 * dt
    credible = []
    for f, d, s, w, rest in zip(*(x.tolist() for x in (force, rolled, sigma, walk, at_rest[1:])), strict=True):
        v += (f - b) * dt
        Pvv += dt * (dt * Pbb - 2.0 * Pvb) + qv
        Pvb -= dt * Pbb
        Pbb += w * w
        h = 0.5 * dt
        y, R, o = (0.0, _REST_SD_MPS**2, 0.0) if rest else (d / dt + f * h, (s / dt) ** 2, h)
        Hv, Hb = Pvv + o * Pvb, Pvb + o * Pbb
        S = Hv + o * Hb + R
        e = y - v - o * b
        ok = rest or e * e < _GATE**2 * S
        credible.append(ok)
        if ok:
            v += Hv / S * e
            b += Hb / S * e
            Pvv, Pvb, Pbb = Pvv - Hv * Hv / S, Pvb - Hv * Hb / S, Pbb - Hb * Hb / S
    return np.array(credible)


def _pitch(t: Array, gyro: Array, path: InitialPath) -> Array:
    """Pitch by the gyro alone, up to a constant. Track climbs and falls alike: the rate's median is bias."""
    w = gyro - path.bias(t)
    roll = np.interp(t, path.t, path.rpy[:, 0])
    rate = w[:, 1] * np.cos(roll) - w[:, 2] * np.sin(roll)
    return np.asarray(np.cumsum(rate - np.median(rate)) * _STEP_S)


def _speeds(force: Array, rolled: Array, sigma: Array, walk: Array, at_rest: np.ndarray) -> Array:
    """Least squares: normal equations of (v_0, b_0, v_1, b_1, ...), banded."""
    n, dt = len(force) + 1, _STEP_S
    band, right = np.zeros((4, 2 * n)), np.zeros(2 * n)

    def add(offsets: tuple[int, ...], factors: tuple[float, ...], b: Array, information: Array) -> None:
        """Rows ``sum factors x[2 i + offsets] = b_i``."""
        first = 2 * np.arange(len(b))
        for p, f in zip(offsets, factors, strict=True):
            np.add.at(right, first + p, f * b * information)
            for q, h in zip(offsets, factors, strict=True):
                if q >= p:
                    np.add.at(band, (3 - (q - p), first + q), f * h * information)

    each = np.ones(n - 1)
    add((0, 1, 2), (-1.0, dt, 1.0), force * dt, each / (_ACCELERATION_SD**2 * dt))
    add((1, 3), (-1.0, 1.0), 0.0 * each, walk**-2)
    add((0, 2), (0.5 * dt, 0.5 * dt), rolled, sigma**-2)
    add((0,), (1.0,), np.zeros(n), np.where(at_rest, _REST_SD_MPS**-2, 1e-6))
    add((1,), (1.0,), np.zeros(n), np.full(n, 1e-6))
    return np.asarray(solveh_banded(band, right)[::2])

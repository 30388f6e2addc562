"""A car's J-turn over a road that becomes slippery: the simulation of Miyata and Tsunashima, and its truth.

The car runs at 80 km/h. The steer of the front wheels goes to 3 deg by a smooth step, ``3 u^2 - 2 u^3`` over the first
second (the paper says "smooth" only), and stays. Friction is 0.8, 0.55 and 0.3 for 6 s each. With the paper's symbols
and table 1 the sides of the road push on each tyre, of which an axle has two,

    F_i = -C_i (mu/K_i) atan(K_i b_i / mu) + q_i,   b_f = beta + l_f gamma/V - delta,   b_r = beta - l_r gamma/V,

``K_i = pi C_i / (2 W_i)`` with W_i the tyre's load, so that the force tends to ``mu W_i`` (the paper gives no K), and

    m V (d beta/dt + gamma) = 2 F_f + 2 F_r,   I d gamma/dt = 2 l_f F_f - 2 l_r F_r                       (1, 2)

is stepped as the paper does it, by Euler's rule over dt = 0.03 s, q and mu constant in a step. Measured is the lateral
acceleration ``V (d beta/dt + gamma)`` of the centre of gravity plus ``l_f d gamma/dt`` above the front axle, less ``l_r
d gamma/dt`` above the rear one. Both noises are white: q has 20 N, the measurement 0.5 m/s^2 (1 sigma).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd

from trackfg.numerics.arrays import Array
from trackfg.numerics.units import KMH, STANDARD_GRAVITY

STEP_S = 0.03
"""Step of the simulation and of its tables, s (the paper's)."""
STRETCHES_S = ((0.0, 6.0), (6.0, 12.0), (12.0, 18.0))
"""Start and end of each stretch of road, s (the paper's)."""
FRICTION = (0.8, 0.55, 0.3)
"""Of each stretch: dry asphalt, wet asphalt, a film of water."""

_DURATION_S = STRETCHES_S[-1][1]
_SPEED_MPS = 80.0 * KMH
"""Speed of the car, m/s (the paper's 80 km/h)."""
_MASS_KG, _INERTIA_KGM2 = 1562.0, 2630.0
"""Mass and moment of inertia about the vertical (table 1)."""
_FRONT_M, _REAR_M = 1.104, 1.42
"""Distances of the axles from the centre of gravity (table 1)."""
_CORNERING_N = np.array([42000.0, 64000.0])
"""Cornering powers of a front and a rear tyre, N/rad (table 1)."""
_LOAD_N = 0.5 * _MASS_KG * STANDARD_GRAVITY * np.array([_REAR_M, _FRONT_M]) / (_FRONT_M + _REAR_M)
"""Load of a front and a rear tyre at rest, N."""
_STEER_RAD, _STEER_RISE_S = float(np.radians(3.0)), 1.0
"""Steer of the front wheels at the end, and its rise time: 3 deg (the paper's), 1 s (assumed)."""
_FORCE_SD_N, _ACCELERATION_SD_MPS2 = 20.0, 0.5
"""1-sigma of the noise of the forces and of the measurement (the paper's)."""


@dataclass(frozen=True)
class JTurn:
    """``measured``: ``t_s, steer_rad, front_mps2, rear_mps2``; ``truth``: ``t_s, slip_angle_rad, yaw_rate_radps,
    friction, front_mps2, rear_mps2``. One row per step in both, from t = 0.
    """

    measured: pd.DataFrame
    truth: pd.DataFrame

    @property
    def distance_m(self) -> float:
        """Return the way that the car goes."""
        return _SPEED_MPS * _DURATION_S


def j_turn(seed: int, *, noise: bool = True) -> JTurn:
    """Simulate the J-turn. One seed repeats to the bit; without ``noise`` neither plant nor sensors have any."""
    plant_rng, sensor_rng = np.random.default_rng(seed).spawn(2)
    steps = round(_DURATION_S / STEP_S)
    t = STEP_S * np.arange(steps)
    u = np.clip(t / _STEER_RISE_S, 0.0, 1.0)
    steer = _STEER_RAD * u * u * (3.0 - 2.0 * u)
    # Half a step before its time, so that rounding cannot move a jump by a step.
    starts = np.array([start for start, _ in STRETCHES_S]) - 0.5 * STEP_S
    friction = np.array(FRICTION)[np.searchsorted(starts, t) - 1]
    push = noise * _FORCE_SD_N * plant_rng.standard_normal((steps, 2))
    state = np.zeros((steps, 2))
    acceleration = np.zeros((steps, 2))
    for k in range(steps):
        slip_rate, yaw_acceleration = _rates(state[k], steer[k], friction[k], push[k])
        centre = _SPEED_MPS * (slip_rate + state[k, 1])
        acceleration[k] = centre + _FRONT_M * yaw_acceleration, centre - _REAR_M * yaw_acceleration
        if k + 1 < steps:
            state[k + 1] = state[k] + STEP_S * np.array([slip_rate, yaw_acceleration])
    reading = acceleration + noise * _ACCELERATION_SD_MPS2 * sensor_rng.standard_normal((steps, 2))
    measured = {"t_s": t, "steer_rad": steer, "front_mps2": reading[:, 0], "rear_mps2": reading[:, 1]}
    truth = {"t_s": t, "slip_angle_rad": state[:, 0], "yaw_rate_radps": state[:, 1], "friction": friction}
    truth |= {"front_mps2": acceleration[:, 0], "rear_mps2": acceleration[:, 1]}
    return JTurn(pd.DataFrame(measured), pd.DataFrame(truth))


def _rates(state: Array, steer: float, friction: float, push: Array) -> tuple[float, float]:
    """Return time derivatives of slip angle and yaw rate, eqs. 1 and 2."""
    slip_angle, yaw_rate = state
    at_wheels = np.array(
        [slip_angle + _FRONT_M * yaw_rate / _SPEED_MPS - steer, slip_angle - _REAR_M * yaw_rate / _SPEED_MPS]
    )
    most = 2.0 * friction * _LOAD_N / np.pi
    front, rear = -most * np.arctan(_CORNERING_N * at_wheels / most) + push
    slip_rate = 2.0 * (front + rear) / (_MASS_KG * _SPEED_MPS) - yaw_rate
    return float(slip_rate), float(2.0 * (_FRONT_M * front - _REAR_M * rear) / _INERTIA_KGM2)

"""A car as a bicycle with arctangent tyres: what the friction task's filter and graph share.

After Miyata and Tsunashima, "Effectiveness of state estimation using interacting multiple model approach" (Nihon
University), with their symbols. State ``x = (beta, gamma)``, slip angle of the body (rad) and yaw rate (rad/s);
``delta`` the steer of the front wheels (rad), ``mu`` the friction coefficient, ``V`` the speed:

    beta_f = beta + l_f gamma / V - delta                                    (5)
    beta_r = beta - l_r gamma / V                                            (6)
    F_i = -C_i (mu/K_i) atan(K_i beta_i / mu) + q_i,   i = f, r              (3, 4)
    beta'  = beta - gamma dt + 2 (F_f + F_r) dt / (m V)                      (9)
    gamma' = gamma + 2 (l_f F_f - l_r F_r) dt / I                            (9)
    a_f = 2 (1/m + l_f^2/I) F_f + 2 (1/m - l_f l_r/I) F_r + v_f              (10)
    a_r = 2 (1/m - l_f l_r/I) F_f + 2 (1/m + l_r^2/I) F_r + v_r              (10)

In matrices ``x' = A x + G (F + q)`` and ``y = D (F + q) + v``: the plant noise q, on the force of each tyre (N), enters
state and measurement alike. The paper does not give ``K_i``; ``K_i = pi C_i / (2 W_i)``, W_i the load of one tyre,
makes the force tend to ``mu W_i``.
"""

# ruff: noqa: N802  methods have the paper's symbols

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pandas as pd

from trackfg.errors import BadInputError
from trackfg.numerics.arrays import Array
from trackfg.numerics.units import KMH, STANDARD_GRAVITY

DRIVE_COLUMNS = ("t_s", "steer_rad", "front_mps2", "rear_mps2")
"""What is measured: lateral acceleration above either axle, at a fixed rate, and the steer, which is known."""

_STATES = ("slip_angle_rad", "yaw_rate_radps", "friction")
FRICTION_COLUMNS = ("t_s", *(name for state in _STATES for name in (state, f"{state}_sd")))
"""What is estimated, each with its sigma."""


@dataclass(frozen=True)
class Car:
    """The paper's table 1: mass (kg), yaw inertia (kg m^2), distances of the axles from the centre of gravity (m),
    cornering powers of one tyre (N/rad), speed (m/s).
    """

    m: float = 1562.0
    I: float = 2630.0  # noqa: E741  the paper's symbol
    l_f: float = 1.104
    l_r: float = 1.42
    C_f: float = 42000.0
    C_r: float = 64000.0
    V: float = 80.0 * KMH

    @property
    def C(self) -> Array:
        """Return cornering powers, front and rear."""
        return np.array([self.C_f, self.C_r])

    @property
    def K(self) -> Array:
        """Return ``pi C / (2 W)``, W the load of one tyre, front and rear."""
        load = 0.5 * self.m * STANDARD_GRAVITY * np.array([self.l_r, self.l_f]) / (self.l_f + self.l_r)
        return np.asarray(np.pi * self.C / (2.0 * load))

    @property
    def D(self) -> Array:
        """Return forces of the tyres to accelerations above the axles, eq. 10. Shape (2, 2)."""
        across = 1.0 / self.m - self.l_f * self.l_r / self.I
        front, rear = 1.0 / self.m + self.l_f**2 / self.I, 1.0 / self.m + self.l_r**2 / self.I
        return 2.0 * np.array([[front, across], [across, rear]])

    def A(self, dt: float) -> Array:
        """Return the state without forces, eq. 9. Shape (2, 2)."""
        return np.array([[1.0, -dt], [0.0, 1.0]])

    def G(self, dt: float) -> Array:
        """Return forces of the tyres to the state, eq. 9. Shape (2, 2)."""
        by_force = 2.0 * dt / (self.m * self.V)
        return np.array([[by_force, by_force], [2.0 * dt * self.l_f / self.I, -2.0 * dt * self.l_r / self.I]])


@dataclass(frozen=True)
class Noise:
    """White noise at every step: 1-sigma of the plant's forces q (N) and of the measured accelerations v (m/s^2)."""

    force_sd: tuple[float, float] = (20.0, 20.0)
    acceleration_sd: tuple[float, float] = (0.5, 0.5)

    @property
    def Q(self) -> Array:
        """Return the paper's diag(400, 400), N^2."""
        return np.diag(np.square(self.force_sd))

    @property
    def R(self) -> Array:
        """Return the paper's diag(0.25, 0.25), (m/s^2)^2."""
        return np.diag(np.square(self.acceleration_sd))


def drive_arrays(drive: pd.DataFrame) -> tuple[Array, float, Array, Array]:
    """Return times (n,), their step, steer (n,) and accelerations (n, 2) of a table with :data:`DRIVE_COLUMNS`.

    Raises :class:`~trackfg.errors.BadInputError` where a column is missing, a value not finite, the step not constant
    (to a thousandth) or a row alone.
    """
    if missing := [name for name in DRIVE_COLUMNS if name not in drive]:
        raise BadInputError(f"drive: no column {', '.join(missing)}; expected {', '.join(DRIVE_COLUMNS)}")
    values = drive[list(DRIVE_COLUMNS)].to_numpy(dtype=np.float64)
    bad = ~np.isfinite(values)
    if bad.any():
        row, column = np.argwhere(bad)[0]
        raise BadInputError(f"drive: row {row}, {DRIVE_COLUMNS[column]}: expected a finite number")
    steps = np.diff(values[:, 0])
    if len(steps) == 0 or steps[0] <= 0 or np.abs(steps - steps[0]).max() > 1e-3 * steps[0]:
        raise BadInputError("drive: expected two rows or more, at a constant rate")
    return values[:, 0], float(steps.mean()), values[:, 1], values[:, 2:]


class TyreForces(NamedTuple):
    """Forces of a front and a rear tyre, N, (..., 2); derivatives by the state (..., 2, 2) and by friction (..., 2)."""

    F: Array
    by_state: Array
    by_friction: Array


def tyre_forces(car: Car, x: Array, delta: Array | float, mu: Array | float) -> TyreForces:
    """Return equations 3 to 6 without noise. Shapes: ``x`` (..., 2), ``delta`` and ``mu`` (...)."""
    C, K = car.C, car.K
    arm = np.array([car.l_f, -car.l_r]) / car.V
    slip = x[..., :1] + arm * x[..., 1:] - np.asarray(delta)[..., None] * np.array([1.0, 0.0])
    friction = np.asarray(mu)[..., None]
    z = K * slip / friction
    angle, softened = np.arctan(z), 1.0 / (1.0 + z * z)
    by_slip = -C * softened
    return TyreForces(
        F=-C * friction / K * angle,
        by_state=np.stack([by_slip, by_slip * arm], axis=-1),
        by_friction=-C / K * (angle - z * softened),
    )

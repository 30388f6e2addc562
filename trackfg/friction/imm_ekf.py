"""Slip angle, yaw rate and friction of a car from its lateral accelerations by an IMM-EKF.

Miyata and Tsunashima, "Effectiveness of state estimation using interacting multiple model approach" (Nihon University):
an extended Kalman filter of the bicycle model (:mod:`trackfg.friction.bicycle`) per friction coefficient ``mu_j = j /
M``, tied by :mod:`trackfg.numerics.imm`. The friction estimate is ``sum_j r_j mu_j`` (27).

The plant noise q is on the tyres' forces and therefore in state and measurement. Given y_t, the noise that drives the
next step has mean ``J (y_t - D F_t)``, ``J = Q D' (D Q D' + R)^-1``, so that with ``B = G (I - J D)``

    x_t+1 = A x_t + B F_t + G J y_t + G (q - J (y - D F)),   its noise G (Q - J D Q) G',

is independent of y_t, and the EKF's usual step holds with ``S = H P H' + D Q D' + R``.

docs/baselines/imm-ekf.md lists what the paper prints otherwise. What could not have run is always corrected;
``as_printed`` keeps the transitions of 7 and 10 modes, whose first and last rows share 0.1 (M - 2)/(M - 3), not 0.2,
among the far modes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd

from trackfg.friction.bicycle import FRICTION_COLUMNS, Car, Noise, drive_arrays, tyre_forces
from trackfg.numerics.arrays import Array
from trackfg.numerics.imm import ModeSteps, interacting_multiple_models, measured

_THREE_MODES = np.array([[0.55, 0.35, 0.10], [0.25, 0.50, 0.25], [0.10, 0.35, 0.55]])
"""Eq. 28."""


@dataclass(frozen=True)
class FrictionEstimate:
    """A ``table`` of :data:`~trackfg.friction.bicycle.FRICTION_COLUMNS`, and the modes' ``probability`` (T, M)."""

    table: pd.DataFrame
    friction_modes: Array
    probability: Array


def run(
    drive: pd.DataFrame,
    *,
    modes: int = 10,
    window_s: float = 0.6,
    car: Car | None = None,
    noise: Noise | None = None,
    as_printed: bool = False,
) -> FrictionEstimate:
    """Estimate from ``drive``, a table with columns :data:`trackfg.friction.bicycle.DRIVE_COLUMNS` at a fixed rate.

    The first row gives no update: it is the start, x = 0, P = I, every mode as likely as the other. ``car`` and
    ``noise`` are the paper's by default. Raises ``ValueError`` for fewer than 3 modes, and as
    :func:`trackfg.friction.bicycle.drive_arrays` does.
    """
    car, noise = car or Car(), noise or Noise()
    t, dt, delta, y = drive_arrays(drive)
    mu = np.arange(1, modes + 1) / modes
    A, G, D, Q = car.A(dt), car.G(dt), car.D, noise.Q
    R = D @ Q @ D.T + noise.R
    J = np.linalg.solve(R, D @ Q).T
    B = G - G @ J @ D
    independent = G @ (Q - J @ D @ Q) @ G.T

    def step(k: int, x: Array, P: Array) -> ModeSteps:
        prior = tyre_forces(car, x, delta[k - 1], mu)
        F = A + B @ prior.by_state
        predicted = x @ A.T + prior.F @ B.T + G @ J @ y[k - 1]
        spread = F @ P @ F.swapaxes(1, 2) + independent
        now = tyre_forces(car, predicted, delta[k], mu)
        return measured(predicted, spread, y[k] - now.F @ D.T, D @ now.by_state, R)

    result = interacting_multiple_models(
        step,
        state=np.zeros((modes, 2)),
        covariance=np.tile(np.eye(2), (modes, 1, 1)),
        probability=np.full(modes, 1.0 / modes),
        transition=transition_matrix(modes, as_printed=as_printed),
        steps=len(t) - 1,
        window=max(1, round(window_s / dt)),
    )
    friction = result.probability @ mu
    spread = np.sqrt(np.maximum(result.probability @ mu**2 - friction**2, 0.0))
    sd = np.sqrt(np.diagonal(result.covariance, axis1=1, axis2=2))
    columns = (t, result.state[:, 0], sd[:, 0], result.state[:, 1], sd[:, 1], friction, spread)
    table = pd.DataFrame(dict(zip(FRICTION_COLUMNS, columns, strict=True)))
    return FrictionEstimate(table, mu, result.probability)


def transition_matrix(modes: int, *, as_printed: bool = False) -> Array:
    """Return ``p_ij``: eq. 28 for 3 modes, the rule below it for more. Shape (modes, modes).

    0.5 to stay, 0.2 to either neighbour (0.3 where there is one only), the rest shared by all others. Raises
    ``ValueError`` for fewer than 3 modes.
    """
    if modes < 3:
        raise ValueError(f"{modes} modes: expected 3 or more")
    if modes == 3:
        return _THREE_MODES.copy()
    p = np.full((modes, modes), 0.1 / (modes - 3))
    if not as_printed:
        p[[0, -1]] = 0.2 / (modes - 2)
    stay = np.arange(modes)
    p[stay, stay] = 0.5
    p[stay[:-1], stay[1:]] = p[stay[1:], stay[:-1]] = 0.2
    p[0, 1] = p[-1, -2] = 0.3
    return p

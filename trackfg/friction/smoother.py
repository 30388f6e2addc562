"""Slip angle, yaw rate and friction of a car from its lateral accelerations by a factor graph: the smoother's way.

The measurements and the model are those of the filter (:mod:`trackfg.friction.imm_ekf`), the bicycle of
:mod:`trackfg.friction.bicycle`; friction is a variable of each step instead of a choice among modes. One vector
variable per step holds ``z_k = (beta_k, gamma_k, mu_k)``. Factors:

* **step**: ``x_k+1 - (A x_k + G F_k)`` and ``y_k - D F_k`` are the noises ``G q`` and ``D q + v``, which share the
  forces on the tyres: one factor with four rows and their joint covariance;
* **last measurement**: ``y_n - D F_n`` alone;
* **friction**: ``mu_k+1 - mu_k`` is a random walk with jumps: Geman and McClure's loss on the increment,
  ``rho(u) = c^2 u^2 / (2 (c^2 + u^2))``, u in sigmas of the walk; a jump costs ``c^2 / 2`` however large it is;
* **start**: ``x_0`` and ``mu_0`` with the sigmas of a prior.

The cost has a minimum for every way to place the jumps. Graduated non-convexity (Blake and Zisserman; Yang, Antonante,
Tzoumas and Carlone, "Graduated non-convexity for robust spatial perception", IEEE RA-L 5 (2020)) finds a good one: the
loss starts wide, hence convex, and its width is halved, each time from the last solution, down to c.

Jacobians are computed as arrays; GTSAM holds the linear factors and eliminates them by QR along the chain. Sigmas are
the posterior's with the jumps where they were found.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import gtsam
import numpy as np
import pandas as pd

from trackfg.errors import UnsolvableError
from trackfg.friction.bicycle import FRICTION_COLUMNS, Car, Noise, TyreForces, drive_arrays, tyre_forces
from trackfg.numerics.arrays import Array

_WIDEST = 32.0
"""The loss starts this many times as wide as it ends."""
_SHORTEST = 2.0**-12
"""The shortest step of the line search, as a share of the Gauss-Newton step. Chosen here."""
_MOST_ITERATIONS = 100
"""Iterations at one width of the loss. Chosen here."""
_TOLERANCE = 1e-3
"""Of the cost: half a squared sigma."""


@dataclass(frozen=True)
class FrictionModel:
    """The prior of friction: its walk per square root of a second, the loss's width c in sigmas, mean and sigma at
    the start, and the least that it can be. ``state_sd`` (rad, rad/s) is that of slip angle and yaw rate at the start.
    """

    walk_density: float = 0.01
    jump_width: float = 1.5
    start: float = 0.5
    start_sd: float = 0.3
    least: float = 0.02
    state_sd: tuple[float, float] = (1.0, 1.0)


def smooth_friction(
    drive: pd.DataFrame, *, car: Car | None = None, noise: Noise | None = None, model: FrictionModel | None = None
) -> pd.DataFrame:
    """Return :data:`~trackfg.friction.bicycle.FRICTION_COLUMNS` of a drive.

    ``drive`` has columns :data:`~trackfg.friction.bicycle.DRIVE_COLUMNS` at a fixed rate. ``car`` and ``noise`` are the
    paper's by default. Raises :class:`~trackfg.errors.UnsolvableError` where the iteration does not end, and as
    :func:`trackfg.friction.bicycle.drive_arrays` does.
    """
    problem = _Problem.of(drive, car or Car(), noise or Noise(), model or FrictionModel())
    # A walk without jumps, ten times as fast, first brings the states near the measurements.
    z = _minimise(replace(problem, walk_sd=10.0 * problem.walk_sd), problem.start(), np.inf)
    width = _WIDEST * problem.model.jump_width
    while width >= problem.model.jump_width:
        z = _minimise(problem, z, width)
        width *= 0.5
    bayes_net = _eliminate(problem, z, _walk_weight(problem, z, problem.model.jump_width))
    columns = [drive["t_s"].to_numpy()]
    for value, sd in zip(z.T, np.sqrt(_marginal_variances(bayes_net, len(z))).T, strict=True):
        columns += [value, sd]
    return pd.DataFrame(dict(zip(FRICTION_COLUMNS, columns, strict=True)))


@dataclass(frozen=True)
class _Problem:
    """Measurements ``steer`` (n,) and ``y`` (n, 2), and whitening of a step's four rows and a measurement's two."""

    car: Car
    model: FrictionModel
    dt: float
    steer: Array
    y: Array
    whiten_step: Array
    whiten_measurement: Array
    walk_sd: float

    @classmethod
    def of(cls, drive: pd.DataFrame, car: Car, noise: Noise, model: FrictionModel) -> _Problem:
        _, dt, steer, y = drive_arrays(drive)
        from_force = np.vstack([car.G(dt), car.D])
        joint = from_force @ noise.Q @ from_force.T
        joint[2:, 2:] += noise.R
        return cls(
            car,
            model,
            dt,
            steer,
            y,
            whiten_step=np.linalg.inv(np.linalg.cholesky(joint)),
            whiten_measurement=np.linalg.inv(np.linalg.cholesky(joint[2:, 2:])),
            walk_sd=model.walk_density * float(np.sqrt(dt)),
        )

    def start(self) -> Array:
        """Return what the car would do with the prior's friction. Shape (n, 3)."""
        z = np.zeros((len(self.y), 3))
        z[:, 2] = self.model.start
        A, G = self.car.A(self.dt), self.car.G(self.dt)
        for k, delta in enumerate(self.steer[:-1]):
            z[k + 1, :2] = A @ z[k, :2] + G @ tyre_forces(self.car, z[k, :2], delta, z[k, 2]).F
        return z

    def residuals(self, z: Array) -> tuple[Array, Array, Array, TyreForces]:
        """Return the whitened residuals: start (3,), steps (n - 1, 4), last measurement (2,); and the forces."""
        forces = tyre_forces(self.car, z[:, :2], self.steer, z[:, 2])
        off = self.y - forces.F @ self.car.D.T
        moved = z[1:, :2] - z[:-1, :2] @ self.car.A(self.dt).T - forces.F[:-1] @ self.car.G(self.dt).T
        steps = np.hstack([moved, off[:-1]]) @ self.whiten_step.T
        start = (z[0] - [0.0, 0.0, self.model.start]) / self._start_sd
        return start, steps, self.whiten_measurement @ off[-1], forces

    @property
    def _start_sd(self) -> Array:
        return np.array([*self.model.state_sd, self.model.start_sd])

    def cost(self, z: Array, width: float) -> float:
        """Return half the sum of squared residuals, those of friction under the loss; infinite below the least mu."""
        if z[:, 2].min() < self.model.least:
            return float("inf")
        start, steps, last, _ = self.residuals(z)
        u2 = np.square(np.diff(z[:, 2]) / self.walk_sd)
        walk = u2 if np.isinf(width) else width**2 * u2 / (width**2 + u2)
        return float(0.5 * (start @ start + np.sum(steps**2) + last @ last + np.sum(walk)))

    def linearized(self, z: Array, walk_weight: Array) -> gtsam.GaussianFactorGraph:
        """Return the factors linearised at ``z``, friction's weighted by ``walk_weight`` (n - 1,); keys are steps."""
        n = len(z)
        start, steps, last, forces = self.residuals(z)
        A, G, D = self.car.A(self.dt), self.car.G(self.dt), self.car.D
        by_z = np.concatenate([forces.by_state, forces.by_friction[..., None]], axis=2)
        jacobian, next_jacobian = np.zeros((2, n - 1, 5, 3))
        plant = G @ by_z[:-1]
        plant[:, :, :2] += A
        jacobian[:, :4] = -self.whiten_step @ np.concatenate([plant, D @ by_z[:-1]], axis=1)
        next_jacobian[:, :4, :2] = self.whiten_step[:, :2]
        scale = np.sqrt(walk_weight) / self.walk_sd
        jacobian[:, 4, 2], next_jacobian[:, 4, 2] = -scale, scale
        residual = np.column_stack([steps, scale * np.diff(z[:, 2])])
        graph = gtsam.GaussianFactorGraph()
        graph.add(0, np.diag(1.0 / self._start_sd), -start, gtsam.noiseModel.Unit.Create(3))
        unit = gtsam.noiseModel.Unit.Create(5)
        for k in range(n - 1):
            graph.add(k, jacobian[k], k + 1, next_jacobian[k], -residual[k], unit)
        graph.add(n - 1, -self.whiten_measurement @ D @ by_z[-1], -last, gtsam.noiseModel.Unit.Create(2))
        return graph


def _eliminate(problem: _Problem, z: Array, walk_weight: Array) -> gtsam.GaussianBayesNet:
    ordering = gtsam.Ordering()
    for k in range(len(z)):
        ordering.push_back(k)
    return problem.linearized(z, walk_weight).eliminateSequential(ordering, gtsam.EliminateQR)


def _walk_weight(problem: _Problem, z: Array, width: float) -> Array:
    """Return Geman and McClure's weights of the friction increments, ``(c^2 / (c^2 + u^2))^2``. Shape (n - 1,)."""
    u = np.diff(z[:, 2]) / problem.walk_sd
    return np.asarray(1.0 / np.square(1.0 + np.square(u / width)))


def _minimise(problem: _Problem, z: Array, width: float) -> Array:
    """Minimise by reweighted Gauss-Newton steps, halved until the cost falls, until it hardly does."""
    cost = problem.cost(z, width)
    for _ in range(_MOST_ITERATIONS):
        step = _eliminate(problem, z, _walk_weight(problem, z, width)).optimize()
        full = np.array([step.at(k) for k in range(len(z))])
        length, moved, less = 1.0, z + full, problem.cost(z + full, width)
        while less >= cost and length > _SHORTEST:
            length *= 0.5
            moved = z + length * full
            less = problem.cost(moved, width)
        if less >= cost:
            return z
        fell, z, cost = cost - less, moved, less
        if fell < _TOLERANCE:
            return z
    raise UnsolvableError(f"friction: no minimum after {_MOST_ITERATIONS} iterations at width {width:g}")


def _marginal_variances(bayes_net: gtsam.GaussianBayesNet, n: int) -> Array:
    """Run backwards over the Bayes net: ``z_k = -R^-1 S z_k+1 + R^-1 e``, e of unit covariance. Shape (n, 3)."""
    variance = np.empty((n, 3))
    P = np.zeros((3, 3))
    for k in range(n - 1, -1, -1):
        conditional = bayes_net.at(k)
        inverse = np.linalg.inv(conditional.R())
        gain = inverse @ conditional.S() if k < n - 1 else np.zeros((3, 3))
        P = gain @ P @ gain.T + inverse @ inverse.T
        variance[k] = np.diag(P)
    return variance

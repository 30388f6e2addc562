"""A body on springs leaves its axis as it turns against its path, or as it bounces and slips sideways without turning.

By a turn b against its path it moves sideways by ``b v`` at the speed v, by a bounce at any speed alike. With the share
p of turns in the variance of the non-holonomic factor's residual r, the derivative of r by the logarithm of the speed
has ``p r`` in it, and pulls at the speed unless the sigma grows with it by as much (:mod:`trackfg.factors.motion`).
What the declared sigmas say of p is an assumption. A run shows how far r is the pitch or the yaw of the body, less its
mean over some seconds,

    p = sum(r d) / sum(r^2),   d = v (pitch - mean pitch) upwards, -v (yaw - mean yaw) to the left,

with the variance ``sum(r^2 d^2) / sum(r^2)^2``, most of it due to curves. Where the posterior mean of both is below
what is assumed, the growth is lowered with it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from trackfg.factors.factor_type import FactorType
from trackfg.factors.family import Family, changed
from trackfg.factors.motion import mount_matrix
from trackfg.numerics.arrays import Array
from trackfg.numerics.integrals import means_around, trapezoid_integral
from trackfg.numerics.rotations import rpy_from_matrix
from trackfg.smoothing.reassessment import Reassessment, SolvedRun

_AROUND_S = 4.0
"""Over so long a body's turns on its springs (0.5 to 2 Hz) average out, s, and a curve changes little."""

_SHARE_SD = 0.3
"""Sigma of the share that is assumed: it may be anything between 0 and 1."""

_MOVING_MPS = 2.0
"""At lower speeds turns move a body little, m/s."""

_FAR_SIGMAS = 3.0
"""Residuals beyond show something else."""

_LOWERED = 0.1
"""A share that would change by less stays: the pull changes by as small a part."""


def turning_body(run: SolvedRun) -> Reassessment:
    """Reassess how much of the sideways motion of a body on springs is its turning against its path."""
    problem = run.problem
    family, declared = (graph.family(FactorType.NON_HOLONOMIC) for graph in (problem, run.declared))
    rigid = problem.family(FactorType.PATH) is not None
    if family is None or declared is None or rigid or not run.solution.converged:
        return Reassessment(problem)
    residual, turned, speed = _moved(run, family)
    power, of_turns = np.sum(residual**2, axis=0), np.sum(residual * turned, axis=0)
    assumed = np.sum(residual**2 * declared.data["growth"] * speed, axis=0)
    if not assumed.all():
        return Reassessment(problem)
    variance = np.sum((residual * turned) ** 2, axis=0) / power**2
    weight = _SHARE_SD**2 / (_SHARE_SD**2 + variance)
    lowered = np.clip(1.0 + weight * (of_turns / assumed - 1.0), 0.0, 1.0)
    growth = lowered * declared.data["growth"]
    change = np.abs(growth - family.data["growth"]) / declared.data["growth"] * assumed / power
    if (change < _LOWERED).all():
        return Reassessment(problem)

    def grown(motion: Family) -> Family:
        return motion.with_data(growth=growth)

    families = changed(problem.families, FactorType.NON_HOLONOMIC, grown)
    return Reassessment(replace(problem, families=families), changed=True)


def _moved(run: SolvedRun, family: Family) -> tuple[Array, Array, Array]:
    """Return the residuals, to the left and upwards, (n, 2), what the body's turns move it that way, (n, 2), and its
    speed, (n, 1), all m/s; zeros where they say nothing.
    """
    states, t = run.solution.states, run.problem.t
    travel = mount_matrix(states.mount)[0]
    speed = (states.nav.own_velocity @ travel[:, 0])[:, None]
    angles = np.unwrap(rpy_from_matrix(states.nav.R @ travel)[:, [2, 1]], axis=0)
    integral = np.stack([trapezoid_integral(t, angle) for angle in angles.T], axis=1)
    turned = speed * [-1.0, 1.0] * (angles - means_around(t, t, integral, _AROUND_S))
    residual = family.residual(states)
    is_shown = (np.abs(speed) > _MOVING_MPS) & (np.abs(residual) < _FAR_SIGMAS * family.sigma)
    return np.where(is_shown, residual, 0.0), turned, np.abs(speed)

"""The likelihood of a walk of the wheel's scale, with the states integrated out.

With whitened rows A, b at the solution and the step d that solves them (Laplace; MacKay, "Bayesian interpolation",
Neural Computation 4, 1992),

    log L(q) = |R d|^2 / 2 - |b|^2 / 2 - sum of log sigma - log det R,   R' R = A' A,

one elimination for each q. The tach has its convex loss there: the switches of a wrong explanation must not speak for
it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from trackfg.factors.factor_type import FactorType
from trackfg.factors.family import Family
from trackfg.factors.imu import InertialFactors
from trackfg.factors.linear import LinearFactors
from trackfg.factors.odometry import ANY_DISTANCE_SD_M, MOST_CREEP
from trackfg.factors.states import States
from trackfg.solver.elimination import eliminate
from trackfg.solver.square_root import SquareRoot

CLEARLY = 3.0
"""A walk is likelier if its log likelihood is larger by more than this: odds of 20 to 1."""

_NOISE_SIGMAS = 3.0
"""What else than creep an interval of the wheel may be off by, in its sigmas."""


@dataclass(frozen=True)
class ScaleEvidence:
    """The whitened ``rows`` of all but the chain of distances, at the ``states``."""

    rows: Sequence[LinearFactors]
    states: States

    @classmethod
    def of(cls, inertial: InertialFactors, families: Sequence[Family], states: States) -> ScaleEvidence:
        """Linearise the ``inertial`` factors and ``families`` at the ``states``."""
        rows = [inertial.linearize(states)]
        for family in families:
            if family.type is FactorType.TACH_DISTANCE:
                rows.append(_without_slips(family, states).convex_start().linearize(states))
            elif family.type is not FactorType.DISTANCE_CHAIN:
                rows.append(family.convex_start().linearize(states))
        return cls(rows, states)

    def log_likelihood(self, chain: Family) -> float:
        """Return the log likelihood with this chain of distances, without the sigmas of the other rows."""
        linear = chain.linearize(self.states)
        root = eliminate([*self.rows, linear], len(self.states))
        at_solution = 0.5 * sum(float(np.sum(part.b**2)) for part in (*self.rows, linear))
        return 0.5 * root.length**2 - at_solution - float(np.log(chain.sigma).sum()) - _log_determinant(root)


def _without_slips(tach: Family, states: States) -> Family:
    """Return the tach without weight where the wheel is off by more than one that creeps: it slips there, and no walk
    of the scale is to explain that.
    """
    first = tach.slots[0].index
    way = np.abs(states.odo.distance[first + 1] - states.odo.distance[first])
    creeps = np.abs(tach.residual(states)[:, 0]) <= MOST_CREEP * way + _NOISE_SIGMAS * tach.sigma[:, 0]
    return tach.with_sigma(np.where(creeps[:, None], tach.sigma, ANY_DISTANCE_SD_M))


def _log_determinant(root: SquareRoot) -> float:
    each = np.diagonal(root.R, axis1=1, axis2=2)
    return float(np.log(np.abs(each)).sum() + np.log(np.abs(np.diagonal(root.R_shared))).sum())

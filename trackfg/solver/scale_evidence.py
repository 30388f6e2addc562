"""The evidence of a wheel's scale that walks or changes is what the data say with the states integrated out.

With whitened rows A, b at the solution and the step d that solves them (Laplace; MacKay, "Bayesian interpolation",
Neural Computation 4, 1992),

    log L(q) = |R d|^2 / 2 - |b|^2 / 2 - sum of log sigma - log det R,   R' R = A' A,

one elimination for each q. The joint posterior of changes at some places, less what a wide prior says of them, is what
the data say. The tach has its convex loss in both: the switches of a wrong explanation must not speak for it.
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
from trackfg.factors.states import KEYFRAME_DIM, Kind, Odo, States, offset_in_keyframe
from trackfg.numerics.arrays import Array
from trackfg.solver.covariance import Functions
from trackfg.solver.elimination import eliminate
from trackfg.solver.forward_functions import estimated
from trackfg.solver.square_root import SquareRoot

CLEARLY = 3.0
"""A walk is likelier if its log likelihood is larger by more than this: odds of 20 to 1."""

_ANY_CHANGE_SD = 0.05
"""Sigma of a change of the scale while nothing is known of it: what the data say is less what this says."""

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

    def on_changes(self, chain: Family, edges: np.ndarray) -> tuple[Array, Array]:
        """Return the information (c, c) of all rows on changes of the scale, and its product with their estimate (c,).

        They are at ``edges`` (c,), factors of the ``chain``, and in between the scale walks as the chain says.
        """
        sigma = chain.sigma.copy()
        sigma[edges, 1] = _ANY_CHANGE_SD
        keyframe, scale = chain.slots[0].index[edges], offset_in_keyframe(Kind.ODO) + Odo.SCALE
        of_next = np.zeros((len(edges), KEYFRAME_DIM))
        of_next[:, scale] = 1.0
        changes = Functions(keyframe, -of_next, of_next, np.zeros((len(edges), 0)))
        rows = [*self.rows, chain.with_sigma(sigma).linearize(self.states)]
        moved, covariance = estimated(rows, len(self.states), changes)
        precision = np.linalg.inv(covariance)
        estimate = np.diff(self.states.odo.scale)[keyframe] + moved
        return precision - np.eye(len(edges)) / _ANY_CHANGE_SD**2, precision @ estimate


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

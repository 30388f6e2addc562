"""What the data say of a wheel's scale that walks or changes, with the states integrated out.

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
from trackfg.solver.elimination import eliminate
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
        root = eliminate([*self.rows, chain.with_sigma(sigma).linearize(self.states)], len(self.states))
        keyframe, scale = chain.slots[0].index[edges], offset_in_keyframe(Kind.ODO) + Odo.SCALE
        change, column = np.zeros((len(self.states), KEYFRAME_DIM, len(edges))), np.arange(len(edges))
        change[keyframe, scale, column], change[keyframe + 1, scale, column] = -1.0, 1.0
        keyframes, shared = root.forward_substituted(change)
        parts = keyframes.reshape(len(keyframes) * KEYFRAME_DIM, len(edges)), root.shared_inverse.T @ shared
        precision = np.linalg.inv(sum(part.T @ part for part in parts))
        estimate = np.diff(self.states.odo.scale + root.solution().keyframes[:, scale])[keyframe]
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

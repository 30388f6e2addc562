"""Leave-one-out residuals hold each measurement against what all the others predict for it.

A solution follows a measurement the more, the less the others determine it, so its residual r understates its error.
With the posterior covariance ``S = J P J'`` of the predicted measurement and the information ``W`` that the measurement
entered with (of its sigmas and its robust weight), the others alone would have predicted it with

    e = (I - S W)^-1 r,   C = (I - S W)^-1 S,

error and covariance, without another solve (the scalar case ``r / (1 - h)`` is in Cook & Weisberg, "Residuals and
influence in regression", 1982, ch. 2). If the sigmas are right, e has the covariance ``C + sigma^2``.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trackfg.factors.family import Family
from trackfg.factors.linear import slot_columns
from trackfg.factors.states import States
from trackfg.numerics.arrays import Array
from trackfg.solver.covariance import Covariance

_MOST_FOLLOWED = 1.0 - 1e-9
"""Share of a measurement that a solution follows, at most: beyond it rounding decides what the others say."""


class LeftOut(NamedTuple):
    """Each of m measurements of d values left out: ``error`` (m, d) of its prediction by the others, in its unit, and
    the ``covariance`` (m, d, d) of that prediction.
    """

    error: Array
    covariance: Array

    def in_sigmas(self, sigma: Array) -> Array:
        """Return the errors over their sigmas, with those of the measurements, (m, d), as in the family."""
        variance = np.diagonal(self.covariance, axis1=1, axis2=2)
        return np.asarray(self.error / np.sqrt(variance + sigma**2))


def left_out(family: Family, states: States, covariance: Covariance, *, used: bool = True) -> LeftOut:
    """Return the leave-one-out errors of a family, each of whose factors touches one keyframe and shared variables.

    ``states`` and ``covariance`` are those of the solution; with ``used`` false the family was no part of it.
    """
    residual, S = predicted(family, states, covariance)
    if not used:
        return LeftOut(residual, S)
    # In the measurement's own sigmas the share that the solution follows is symmetric.
    root = np.sqrt(family.weights(states))[:, None] / family.sigma
    followed, axes = np.linalg.eigh(root[:, :, None] * S * root[:, None, :])
    followed = np.minimum(followed, _MOST_FOLLOWED)
    left_inverse = (axes / (1.0 - followed)[:, None, :]) @ np.swapaxes(axes, 1, 2)
    error = np.einsum("mij,mj->mi", left_inverse, residual * root) / root
    spread = (axes * (followed / (1.0 - followed))[:, None, :]) @ np.swapaxes(axes, 1, 2)
    return LeftOut(error, spread / (root[:, :, None] * root[:, None, :]))


def prior_left_out(residual: Array, variance: Array, sigma: Array, least_free: float) -> tuple[Array, Array]:
    """Return error e and variance C of scalars without their priors, each of one scalar and ``sigma``. All (k,).

    ``residual`` and ``variance`` are those of the estimate. ``least_free``: 1 - h is no less, where rounding decides.
    """
    free = np.maximum(1.0 - variance / sigma**2, least_free)
    return residual / free, variance / free


def predicted(family: Family, states: States, covariance: Covariance) -> tuple[Array, Array]:
    """Return residuals (m, d) and the posterior covariance of the predicted measurements, (m, d, d)."""
    residual, jacobians = family.evaluated(family.values(states))
    keyframe = next(slot.index for slot in family.slots if not slot.kind.shared)
    columns = np.concatenate([slot_columns(slot) for slot in family.slots])
    J = np.concatenate(jacobians, axis=2)
    P = covariance.rows(keyframe, columns)[:, :, columns]
    return residual, J @ P @ np.swapaxes(J, 1, 2)

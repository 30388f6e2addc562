"""GTSAM's own optimisers take our families as ``gtsam.CustomFactor`` and our losses as noise models.

GTSAM's robust noise models act on the norm of a factor's whitened residual, as ours do, so Huber, Cauchy and the lone
switch are the same function there. A :class:`~trackfg.factors.loss.SwitchChain` is not: its cost couples all factors
of the chain, and a noise model sees one. Its factors get the weights that the chain has at given states, in their
sigmas. At a minimum of the chain's cost the weighted sum of squares has the same gradient, so it is a minimum of both;
from elsewhere the weights have to be renewed, as iteratively reweighted least squares does.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from trackfg.factors.family import Family
from trackfg.factors.loss import Cauchy, Huber, Loss
from trackfg.factors.states import ELIMINATION_ORDER, SHARED, Kind, Nav, Odo, States, Value, vectors
from trackfg.numerics.arrays import Array

if TYPE_CHECKING:
    import gtsam


def robust_model(loss: Loss) -> gtsam.noiseModel.mEstimator.Base:
    """Return GTSAM's loss with the weights and costs of ``loss``, which must act on each factor by itself."""
    import gtsam

    losses = gtsam.noiseModel.mEstimator
    if isinstance(loss, Huber):
        return losses.Huber.Create(loss.width)
    if isinstance(loss, Cauchy):
        return losses.Cauchy.Create(loss.width)
    return losses.Custom(lambda e: float(loss.weight(np.array(e))), lambda e: float(loss.cost(np.array(e))))


def with_frozen_chain(family: Family, states: States) -> Family:
    """Return the family with a chained loss replaced by the weights that it has at ``states``; others as they are."""
    if not family.is_chained:
        return family
    sigma = family.sigma / np.sqrt(family.weights(states))[:, None]
    return replace(family, loss=None, sigma=sigma)


def custom_factors(family: Family) -> list[gtsam.CustomFactor]:
    """Return one ``gtsam.CustomFactor`` per factor. Raises ``ValueError`` for a chained loss, to be frozen first."""
    if family.is_chained:
        raise ValueError(f"{family.name}: freeze its chained loss first, by with_frozen_chain")
    return [_custom_factor(family.take(slice(i, i + 1))) for i in range(len(family))]


def _custom_factor(factor: Family) -> gtsam.CustomFactor:
    """Return the GTSAM factor of a family of one."""
    import gtsam

    model: gtsam.noiseModel.Base = gtsam.noiseModel.Diagonal.Sigmas(factor.sigma[0])
    if factor.loss is not None:
        model = gtsam.noiseModel.Robust.Create(robust_model(factor.loss), model)
    keys = [slot.keys[0] for slot in factor.slots]
    return gtsam.CustomFactor(model, keys, partial(_error, factor))


def _error(factor: Family, this: gtsam.CustomFactor, values: gtsam.Values, H: list[Array] | None) -> Array:
    """Return the residual of a family of one, as GTSAM asks for it; it takes the Jacobians in ``H``."""
    touched = (value_at(slot.kind, values, key) for slot, key in zip(factor.slots, this.keys(), strict=True))
    residual, jacobians = factor.evaluated(tuple(touched))
    if not all(np.isfinite(array).all() for array in (residual, *jacobians)):
        raise ValueError(f"{factor.name}: residual or Jacobian is not finite")
    if H is not None:
        for j, jacobian in enumerate(jacobians):
            H[j] = np.asfortranarray(jacobian[0])
    return np.asarray(residual[0])


def value_at(kind: Kind, values: gtsam.Values, key: int) -> Value:
    """Return one variable as a value with leading dimension 1."""
    if kind is Kind.NAV:
        state = values.atNavState(key)
        return Nav(state.attitude().matrix()[None], state.position()[None], state.velocity()[None])
    if kind is Kind.BIAS:
        return np.asarray(values.atConstantBias(key).vector())[None]
    vector = np.asarray(values.atVector(key))[None]
    return Odo(vector) if kind is Kind.ODO else vector


def states_at(values: gtsam.Values, keyframes: int, sensors: int) -> States:
    """Return the states of so many keyframes and further sensors, and the shared ones, from GTSAM's values."""

    def of(kind: Kind, count: int) -> list[Value]:
        return [value_at(kind, values, key) for key in kind.keys(np.arange(count)).tolist()]

    def vectors_of(kind: Kind, count: int) -> Array:
        return np.concatenate([np.zeros((0, kind.dim)), *(vectors(value) for value in of(kind, count))])

    poses = [value for value in of(Kind.NAV, keyframes) if isinstance(value, Nav)]
    nav = Nav(*(np.concatenate([getattr(pose, part) for pose in poses]) for part in ("R", "p", "v")))
    bias, odo = (vectors_of(kind, keyframes) for kind in (Kind.BIAS, Kind.ODO))
    counts = {**dict.fromkeys(SHARED, 1), Kind.SENSOR: sensors}
    return States(nav, bias, Odo(odo), *(vectors_of(kind, count) for kind, count in counts.items()))


def chain_ordering(keyframes: int, sensors: int = 0) -> gtsam.Ordering:
    """Return the order of elimination along the chain: keyframe by keyframe, shared variables last.

    The last of these are the variables of the further ``sensors``.
    """
    import gtsam

    ordering = gtsam.Ordering()
    index = np.arange(keyframes)
    for key in np.stack([kind.keys(index) for kind in ELIMINATION_ORDER], axis=1).ravel().tolist():
        ordering.push_back(key)
    for kind in SHARED:
        ordering.push_back(int(kind.keys(np.array([0]))[0]))
    for key in Kind.SENSOR.keys(np.arange(sensors)).tolist():
        ordering.push_back(key)
    return ordering

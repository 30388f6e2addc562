"""Places are recognised late: the vehicle passed them at keyframes that have been marginalised since.

Along the chain of their conditionals (:mod:`trackfg.streaming.window.marginalised`) the vehicle's position then is a
linear function of the window's first keyframe and of the shared variables, z, and of what came in
between:

    D(then) = D^ + G' (z - z^) + e,    e ~ N(0, E),

E of all places together, since the way from a later one to the window is also part of the way from an earlier one. So
"it was at d, to sigma" is ``G' (z - z^) = d - D^`` with the covariance ``E + sigma^2``: a factor on z that says all of
it that the window can still use, once. (Measurements "out of sequence": Bar-Shalom, Li and Kirubarajan, "Estimation
with applications to tracking and navigation", 2001, in the smoother's form.)

The robust loss is the batch's. Its weights are those of the solution of these measurements with what the graph knows of
D(then), ``N(D^, E + G' cov(z) G)``, by reweighting from full weights on, as the batch begins too.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from trackfg.factors.family import Family
from trackfg.factors.loss import Loss
from trackfg.factors.marginal_prior import delayed_position
from trackfg.factors.states import KEYFRAME_DIM, SHARED_DIM, Kind, offset_in_keyframe
from trackfg.numerics.arrays import Array
from trackfg.solver.covariance import Functions, covariance_given_next
from trackfg.solver.square_root import SquareRoot
from trackfg.streaming.window.marginalised import MarginalisedHistory
from trackfg.streaming.window.window import Window

_ROUNDS = 20
"""Rounds of reweighting; weights of a redescending loss converge linearly."""
_LEAST_WEIGHT = 1e-6
"""A weight of 0 would divide by it: below this a place counts for nothing anyway."""


@dataclass(frozen=True)
class PassedPlaces:
    """Places (m,) passed at times ``t``, s, ascending: their distance in the sense of running, its sigma, and by how
    much the distance then exceeds the straight line between the keyframes, m.
    """

    t: Array
    distance: Array
    sigma: Array
    beyond: Array

    def take(self, which: np.ndarray) -> PassedPlaces:
        """Return some of the places."""
        return PassedPlaces(self.t[which], self.distance[which], self.sigma[which], self.beyond[which])


@dataclass(frozen=True)
class DelayedPositions:
    """A factor on the first keyframe that stays (``family``); of the places (m,) the residuals before it, m, the robust
    weights, and the sigma of the distance after it, m.
    """

    places: PassedPlaces
    residual: Array
    weight: Array
    sd: Array
    family: Family


def delayed_position_factor(
    places: PassedPlaces,
    history: MarginalisedHistory,
    window: Window,
    root: SquareRoot,
    leaving: int,
    marginal: Array,
    loss: Loss | None,
) -> DelayedPositions | None:
    """Return the factor of places on the keyframe ``leaving`` of the window, the first that will stay.

    None where none of them was passed between that one and the oldest of the ``history``. ``root`` is the window's,
    ``marginal`` (KEYFRAME_DIM + SHARED_DIM square) the covariance of that keyframe and the shared variables.
    """
    t, states, whole = history.joined_with(window, root)
    n = len(history.parts) + leaving
    places = places.take(np.flatnonzero((places.t >= t[0]) & (places.t < t[n])))
    if not len(places.t):
        return None
    k = np.searchsorted(t, places.t, side="right") - 1
    f = (places.t - t[k]) / (t[k + 1] - t[k])
    D, at = states.odo.distance, offset_in_keyframe(Kind.ODO)
    by_first, by_second = np.zeros((2, len(k), KEYFRAME_DIM))
    by_first[:, at], by_second[:, at] = 1.0 - f, f
    functions = Functions(k - k[0], by_first, by_second, np.zeros((len(k), SHARED_DIM)))
    since = slice(int(k[0]), n)
    marginalised = replace(whole, R=whole.R[since], S=whole.S[since], d=whole.d[since], ahead=whole.ahead[since])
    between, G = covariance_given_next(marginalised, functions)
    prior = between + G.T @ marginal @ G
    residual = (1.0 - f) * D[k] + f * D[k + 1] + places.beyond - places.distance
    weight = _weights(residual, prior, places.sigma, loss)
    noise = np.diag(places.sigma**2 / weight)
    remainder = noise @ np.linalg.solve(prior + noise, prior)
    whitening = np.linalg.cholesky(between + noise)
    rows = np.linalg.solve(whitening, np.column_stack([G.T, -residual]))
    family = delayed_position(rows, states.take(slice(n, n + 1)))
    return DelayedPositions(places, residual, weight, np.sqrt(np.diag(remainder)), family)


def _weights(residual: Array, prior: Array, sigma: Array, loss: Loss | None) -> Array:
    """Return robust weights (m,) of residuals (m,) against an estimate of the covariance ``prior`` (m, m)."""
    weight = np.ones(len(residual))
    if loss is None:
        return weight
    for _ in range(_ROUNDS):
        noise = np.diag(sigma**2 / weight)
        remainder = noise @ np.linalg.solve(prior + noise, residual)
        weight = np.maximum(loss.weight(np.abs(remainder) / sigma), _LEAST_WEIGHT)
    return weight

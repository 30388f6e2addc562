"""Interacting multiple models: several filters, one per mode, that exchange what they know at every step.

Blom and Bar-Shalom, "The interacting multiple model algorithm for systems with Markovian switching coefficients", IEEE
Trans. Automatic Control 33 (1988); equation numbers are those of Miyata and Tsunashima, corrected. With modes i, j of
M, ``p_ij`` the probability of mode j after mode i, ``r_i`` that of mode i:

    c_j = sum_i p_ij r_i                                                     (21)
    r_i|j = p_ij r_i / c_j                                                   (20)
    x0_j = sum_i r_i|j x_i                                                   (18)
    P0_j = sum_i r_i|j (P_i + (x_i - x0_j)(x_i - x0_j)')                     (19)
    (x_j, P_j, L_j) = the step of mode j's filter from (x0_j, P0_j)          (12-16, 23)
    r_j = L_j c_j / sum_i L_i c_i                                            (24)
    x = sum_j r_j x_j,  P = sum_j r_j (P_j + (x_j - x)(x_j - x)')            (25)

``L_j`` is the density of the measurement as mode j *predicted* it, ``|2 pi S|^-1/2 exp(-e' S^-1 e / 2)``, handled as a
logarithm: far from its mode it underflows. The probabilities that weight the combination (25) may be the means of the
last few r_j; the recursion itself runs on r_j, since averages fed back into the mixing let the filters diverge.

All modes are one array with the mode as leading dimension.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from trackfg.numerics.arrays import Array

_LEAST = 1e-300
"""A mode that nothing leads to any more keeps this probability, so that its logarithm is finite."""


class ModeSteps(NamedTuple):
    """One step of every mode's filter: ``state`` (M, n), ``covariance`` (M, n, n), ``log_likelihood`` (M,)."""

    state: Array
    covariance: Array
    log_likelihood: Array


Step = Callable[[int, Array, Array], ModeSteps]
"""``step(k, state (M, n), covariance (M, n, n))``: predict from step k - 1 to k and update with what was measured."""


@dataclass(frozen=True)
class Modes:
    """The filter's history, row 0 the start: combined ``state`` (T, n), ``covariance`` (T, n, n), and the
    ``probability`` (T, M) of each mode, averaged over the window.
    """

    state: Array
    covariance: Array
    probability: Array


def interacting_multiple_models(
    step: Step,
    state: Array,
    covariance: Array,
    probability: Array,
    transition: Array,
    steps: int,
    window: int = 1,
) -> Modes:
    """Run ``step`` for k = 1 .. ``steps``.

    ``state`` (M, n), ``covariance`` (M, n, n) and ``probability`` (M,) are those at k = 0, ``transition`` (M, M) holds
    p_ij, ``window`` is how many of the last probabilities are averaged. Rows of ``transition`` that do not sum to 1
    are used as they are: (20) and (24) normalise. Raises ``ValueError`` for shapes that do not fit and for negative
    probabilities.
    """
    modes, n = state.shape
    if covariance.shape != (modes, n, n) or probability.shape != (modes,) or transition.shape != (modes, modes):
        shapes = f"{state.shape}, {covariance.shape}, {probability.shape}, {transition.shape}"
        raise ValueError(f"shapes {shapes}: expected (M, n), (M, n, n), (M,), (M, M)")
    if (transition < 0).any() or (probability < 0).any() or window < 1:
        raise ValueError("expected probabilities of 0 or more and a window of 1 or more")
    recent = np.tile(probability, (steps + 1, 1))
    states, covariances = np.empty((steps + 1, n)), np.empty((steps + 1, n, n))
    averaged = np.empty((steps + 1, modes))
    averaged[0] = probability
    states[0], covariances[0] = moments(probability, state, covariance)
    for k in range(1, steps + 1):
        predicted = np.maximum(probability @ transition, _LEAST)
        share = transition * probability[:, None] / predicted
        mixed = share.T @ state
        off = state[:, None] - mixed
        apart = off.transpose(1, 2, 0) * share.T[:, None]
        spread = apart @ off.swapaxes(0, 1) + (share.T @ covariance.reshape(modes, n * n)).reshape(modes, n, n)
        state, covariance, log_likelihood = step(k, mixed, spread)
        log_weight = log_likelihood + np.log(predicted)
        weight = np.exp(log_weight - log_weight.max())
        probability = weight / weight.sum()
        recent[k] = probability
        averaged[k] = recent[max(1, k + 1 - window) : k + 1].mean(axis=0)
        states[k], covariances[k] = moments(averaged[k], state, covariance)
    return Modes(states, covariances, averaged)


def moments(probability: Array, state: Array, covariance: Array) -> tuple[Array, Array]:
    """Return mean (n,) and covariance (n, n) of the mixture, eq. 25."""
    mean = probability @ state
    off = state - mean
    within = (probability @ covariance.reshape(len(covariance), -1)).reshape(covariance.shape[1:])
    return mean, within + (off.T * probability) @ off


def measured(state: Array, covariance: Array, error: Array, H: Array, R: Array) -> ModeSteps:
    """Update (13, 14, 16, 23) every mode with the innovation ``error`` (M, p) of its predicted measurement.

    Shapes: ``state`` (M, n), ``covariance`` (M, n, n), ``H`` (M, p, n), ``R`` (p, p) or (M, p, p). The covariance is
    updated in Joseph's form.
    """
    PHt = covariance @ H.swapaxes(1, 2)
    S = H @ PHt + R
    solved = np.linalg.solve(S, np.concatenate([PHt.swapaxes(1, 2), error[..., None]], axis=2))
    K, whitened = solved[..., :-1].swapaxes(1, 2), solved[..., -1]
    rest = np.eye(state.shape[1]) - K @ H
    _, log_determinant = np.linalg.slogdet(2.0 * np.pi * S)
    return ModeSteps(
        state=state + (K @ error[..., None])[..., 0],
        covariance=rest @ covariance @ rest.swapaxes(1, 2) + K @ R @ K.swapaxes(1, 2),
        log_likelihood=-0.5 * (log_determinant + np.sum(error * whitened, axis=1)),
    )

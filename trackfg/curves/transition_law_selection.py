"""Selection of the law of each transition, and the covariance that a doubtful choice adds.

Every law is tried for every transition, the others as they are. Law ``l`` of transition ``i`` has the weight ``w_il ~
pi_l exp(-chi2_il / (2 scale))``. A line is built to few laws, so the shares ``pi`` are estimated over all its
transitions together, which lets clear transitions decide for unclear ones: variational Bayes, ``pi_l =
exp(digamma(n_l))`` with ``n_l`` the sum of the weights and the count below as prior, which leaves laws that few follow
next to no share. Where the weights stay divided, the spread of the laws' solutions adds to the covariance: the points
of a half-sine lie 16 % of its length further out than those of the clothoid that looks alike.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import digamma

from trackfg.curves.chain_edits import with_law
from trackfg.curves.fit import Fit, fitted
from trackfg.curves.transition_laws import LAWS
from trackfg.numerics.arrays import Array

_PRIOR_COUNTS = np.array([2.0, 1.0, 0.2, 0.2, 0.2])
"""Prior counts of transitions, in the order of LAWS: clothoids and half-sines are common, the others rare. Chosen; see
Assumptions in docs/engine.md."""

_ROUNDS = 100
"""Greatest number of rounds of variational Bayes."""
_SETTLED = 1e-4
"""Change of a count below which these have converged."""
_UNLIKELY = 1e-3
"""Weight below which a law adds no spread."""


@dataclass(frozen=True)
class LawTrial:
    """A group's fit, and the fits with each other law of each transition that has a length.

    ``transitions``: their indices. ``chi2`` (t, laws): chi-square over scale. ``parameters`` (t, laws, p).
    """

    fit: Fit
    transitions: tuple[int, ...]
    chi2: Array
    parameters: Array


def law_trial(fit: Fit) -> LawTrial:
    """Try every law for every transition of a group."""
    chain = fit.chain
    transitions = tuple(i for i in range(len(chain.laws)) if chain.begin[i] != chain.end[i])
    chi2 = np.full((len(transitions), len(LAWS)), np.inf)
    parameters = np.zeros((len(transitions), len(LAWS), len(fit.unscaled)))
    for row, i in enumerate(transitions):
        for column, law in enumerate(LAWS):
            other = fit if law == chain.laws[i] else fitted(with_law(chain, law, i), fit.stretch)
            if np.all(np.diff(other.chain.points) >= 0.0):
                chi2[row, column] = other.chi2 / fit.scale
                parameters[row, column] = other.chain.parameters[: len(fit.unscaled)]
    return LawTrial(fit, transitions, chi2, parameters)


def law_weights(trials: Sequence[LawTrial]) -> list[Array]:
    """Return the probabilities of the laws, per group (t, laws)."""
    counts = _PRIOR_COUNTS
    weights: list[Array] = []
    for _ in range(_ROUNDS):
        shares = np.exp(digamma(counts))
        weights = [_weights(trial.chi2, shares) for trial in trials]
        updated = _PRIOR_COUNTS + sum((w.sum(axis=0) for w in weights), np.zeros(len(LAWS)))
        if np.abs(updated - counts).max() < _SETTLED:
            break
        counts = updated
    return weights


def with_likeliest_laws(trial: LawTrial, weights: Array) -> LawTrial:
    """Return the trial of the chain with each transition's likeliest law, unchanged if it has those."""
    chain = trial.fit.chain
    for i, w in zip(trial.transitions, weights, strict=True):
        chain = with_law(chain, LAWS[int(np.argmax(w))], i)
    if chain.laws == trial.fit.chain.laws:
        return trial
    fit = fitted(chain, trial.fit.stretch)
    return law_trial(fit) if np.all(np.diff(fit.chain.points) >= 0.0) else trial


def law_spread(trial: LawTrial, weights: Array) -> Array:
    """Return what the laws' doubt adds to the covariance of the parameters, (p, p)."""
    best = trial.fit.chain.parameters[: len(trial.fit.unscaled)]
    away = np.where(weights[..., None] > _UNLIKELY, trial.parameters - best, 0.0)
    return np.asarray(np.einsum("tl,tli,tlj->ij", weights, away, away))


def _weights(chi2: Array, shares: Array) -> Array:
    if not chi2.size:
        return np.zeros(chi2.shape)
    log = np.log(shares) - 0.5 * (chi2 - chi2.min(axis=1, keepdims=True))
    w = np.exp(log - log.max(axis=1, keepdims=True))
    return np.asarray(w / w.sum(axis=1, keepdims=True))

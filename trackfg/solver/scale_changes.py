"""A wheel's scale changes, and neither the number nor the places of the changes are known.

The scale may change at the edges of cells of some seconds, by r (c,). Two kinds of change are common: one that stays,
as with another wheelset, and creep that begins at one edge and ceases at a later one, +b and then -b. Either is one
effect b, with one of several prior sigmas, anywhere. The posterior of r is that of a sum of such single effects (Wang,
Sarkar, Carbonetto and Stephens, "A simple new approach to variable selection in regression", J. R. Statist. Soc. B 82,
2020): each is updated given the means of the others. With the information L of the data on b, its linear term u less
what the others explain, and a prior variance V, its place has the Bayes factor against no effect

    log BF = (u^2 V / (1 + V L) - log(1 + V L)) / 2,

and b there the mean ``V u / (1 + V L)`` and the variance ``V / (1 + V L)``. Each further effect is half as probable as
the one before. Where the data do not determine the place, several share the probability, and each has the second
moment of r that belongs to its share: the variance by which a scale that walks is to walk there. Where the data leave
the effects by more than their sigmas, all information is divided by s^2, the mean square of what is unexplained.

Creep comes and goes with adhesion and load, too, by a little everywhere. So beside the effects the scale may walk, with
a sigma of q sqrt(way). Integrated out, a walk with the covariance D leaves of the data's information I and linear term
l on the effects

    I - I S K^-1 S I  and  l - I S K^-1 S l,  K = 1 + S I S,  S = sqrt(D),

and their likelihood without any effect grows by ``(l' S K^-1 S l - log det K) / 2``. The variance is the mean over the
walks, each with the probability that this and the evidence lower bound of its effects give it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trackfg.numerics.arrays import Array

WALKS = (1e-5, 3e-5, 1e-4, 3e-4)
"""1/sqrt(m): from 0.03 % to 1 % in a kilometre, as creep that lasts. The likelihood has one maximum."""
_SDS = (1e-3, 3e-3, 1e-2, 2e-2)
"""Prior sigmas of an effect, from the first change that is worth a finding to the top of a creep curve."""
_MOST_EFFECTS = 12
"""Six creeps or so in a run leave as many effects again without probability."""
_MOST_ROUNDS = 50
"""Rounds of updates at most: those of data that determine the places settle within ten."""
_SETTLED = 1e-6
"""The updates end when no mean changes by more: a thousandth of the least sigma."""
_LOG_PRIOR = float(np.log(0.5))
"""Of an effect, and of a walk, against none."""


def log_odds_of_change(information: Array, linear: Array) -> float:
    """Return the log odds of the most probable effect against none, of a scale that does not walk beside it.

    ``information`` (c, c) and ``linear`` term (c,) are those of the data on the changes at the edges.
    """
    return _effects(information, linear).log_odds if len(linear) else -np.inf


def variance_of_changes(information: Array, linear: Array, way: Array) -> Array:
    """Return the second moment of the changes at the edges (c,), effects and walk together.

    ``information`` (c, c) and ``linear`` term (c,) are those of the data; ``way`` (c,): the distance along which a
    scale that walks does so at each edge, m.
    """
    if not len(linear):
        return linear
    constant = _effects(information, linear)
    information, linear = information / constant.level, linear / constant.level
    log_weights, variances = [constant.log_evidence], [constant.variance]
    for walk in WALKS:
        of_walk = walk**2 * way
        log_likelihood, *beside = _with_walk(information, linear, np.sqrt(of_walk))
        effects = _effects(*beside)
        log_weights.append(log_likelihood + effects.log_evidence + _LOG_PRIOR - np.log(len(WALKS)))
        variances.append(of_walk + effects.variance)
    weights = np.exp(np.array(log_weights) - max(log_weights))
    return np.asarray(weights @ np.array(variances) / weights.sum())


def _with_walk(information: Array, linear: Array, sd: Array) -> tuple[float, Array, Array]:
    """Return the gain in log likelihood by independent changes of this ``sd`` (c,) at the edges, and the information
    and linear term that are left of the data when these are integrated out.
    """
    K = np.eye(len(sd)) + sd[:, None] * information * sd
    gain, log_determinant = sd[:, None] * np.linalg.inv(K) * sd, np.linalg.slogdet(K)[1]
    left = information - information @ gain @ information
    return 0.5 * float(linear @ gain @ linear - log_determinant), left, linear - information @ (gain @ linear)


class _Effects(NamedTuple):
    """The posterior of a sum of single effects.

    ``log_odds`` of the most probable one; ``log_evidence``: the lower bound of the log likelihood, less that without
    any effect; ``level``: s^2; ``variance`` (c,): the second moment of r.
    """

    log_odds: float
    log_evidence: float
    level: float
    variance: Array


def _effects(information: Array, linear: Array) -> _Effects:
    """Return the posterior of a sum of single effects, each updated given the means of the others."""
    count, single = len(linear), _SingleEffect.of(information, linear)
    means, moments = np.zeros((2, _MOST_EFFECTS, count))
    log_odds = np.zeros(_MOST_EFFECTS)
    estimate = np.linalg.lstsq(information, linear)[0]
    level = 1.0
    for _ in range(_MOST_ROUNDS):
        previous, unexplained = means.copy(), estimate - means.sum(axis=0)
        level = max(1.0, float(unexplained @ information @ unexplained) / count)
        for number in range(_MOST_EFFECTS):
            others = means.sum(axis=0) - means[number]
            log_odds[number], means[number], moments[number] = single.posterior(others, number, level)
        if np.max(np.abs(means - previous)) < _SETTLED:
            break
    mean = means.sum(axis=0)
    # Of each effect it is log(1 + odds), in which its product with each other one is taken off: twice in all.
    products = mean @ information @ mean - np.einsum("ei,ij,ej->", means, information, means)
    log_evidence = float(np.sum(np.logaddexp(0.0, log_odds)) + 0.5 * products / level)
    second_moment = mean**2 + np.sum(moments - means**2, axis=0)
    return _Effects(float(np.max(log_odds)), log_evidence, level, second_moment)


class _SingleEffect(NamedTuple):
    """One effect at any of the c edges, or creep between any two of the c (c - 1) / 2 pairs: k in all.

    ``begin`` and ``end`` are the edges of each pair; ``precision`` (k,) is L of each, ``log_prior`` (k,) of each with
    one of the sigmas.
    """

    information: Array
    linear: Array
    begin: np.ndarray
    end: np.ndarray
    precision: Array
    log_prior: Array

    @classmethod
    def of(cls, information: Array, linear: Array) -> _SingleEffect:
        count = len(linear)
        begin, end = np.triu_indices(count, 1)
        at_edge = np.diagonal(information)
        of_pair = at_edge[begin] + at_edge[end] - 2.0 * information[begin, end]
        of_each_kind = np.repeat([1.0 / count, 1.0 / max(len(begin), 1)], [count, len(begin)])
        log_prior = _LOG_PRIOR + np.log(of_each_kind / len(_SDS))
        return cls(information, linear, begin, end, np.maximum(np.concatenate([at_edge, of_pair]), 0.0), log_prior)

    def posterior(self, others: Array, number: int, level: float) -> tuple[float, Array, Array]:
        """Return the log odds of the effect of this ``number``, and the first and second moments of its r (c,).

        ``others`` (c,): the mean of the other effects' sum; ``level``: s^2.
        """
        unexplained = (self.linear - self.information @ others) / level
        unexplained = np.concatenate([unexplained, unexplained[self.begin] - unexplained[self.end]])
        variance = np.square(_SDS)[:, None]
        ratio = variance * self.precision / level
        posterior_variance = variance / (1.0 + ratio)
        log_weight = self.log_prior + 0.5 * (unexplained**2 * posterior_variance - np.log1p(ratio))
        most = float(np.max(log_weight))
        weight = np.exp(log_weight - most)
        total = float(np.sum(weight))
        log_odds = most + float(np.log(total)) - number * float(np.log(2.0))
        probability = weight / total * np.exp(-np.logaddexp(0.0, -log_odds))
        mean = posterior_variance * unexplained
        first_moment = np.sum(probability * mean, axis=0)
        second_moment = np.sum(probability * (mean**2 + posterior_variance), axis=0)
        return log_odds, self._at_edges(first_moment, -1.0), self._at_edges(second_moment, 1.0)

    def _at_edges(self, of_effects: Array, at_end: float) -> Array:
        """Return the sum at each edge (c,) of effects (k,); ``at_end``: the factor of creep where it ceases."""
        count = len(self.linear)
        of_pairs = of_effects[count:]
        creep = np.bincount(self.begin, of_pairs, count) + at_end * np.bincount(self.end, of_pairs, count)
        return np.asarray(of_effects[:count] + creep)

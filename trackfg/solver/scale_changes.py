"""Where a wheel's scale changes, of which neither the number nor the places are known.

The scale may change at the edges of cells of some seconds, by r (c,). Two kinds of change are common: one that stays,
as with another wheelset, and creep that begins at one edge and ceases at a later one, +b and then -b. Either is one
effect b, with one of several prior sigmas, anywhere. The posterior of r is that of a sum of such single effects (Wang,
Sarkar, Carbonetto and Stephens, "A simple new approach to variable selection in regression", J. R. Statist. Soc. B 82,
2020): each is updated given the means of the others. With the information L of the data on b, its linear term u less
what the others explain, and a prior variance V, its place has the Bayes factor against no effect

    log BF = (u^2 V / (1 + V L) - log(1 + V L)) / 2,

and b there the mean ``V u / (1 + V L)`` and the variance ``V / (1 + V L)``. Each further effect is half as probable as
the one before. Where the data do not determine the place, several share the probability, and each has the second
moment of r that belongs to its share: the variance by which a scale that walks is to walk there.

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
_SETTLED = 1e-6
"""The updates end when no mean changes by more: a thousandth of the least sigma."""
_LOG_PRIOR = float(np.log(0.5))
"""Of an effect, and of a walk, against none."""


class ScaleChanges(NamedTuple):
    """``log_odds``: of the most probable effect against none. ``variance`` (c,): the second moment of r."""

    log_odds: float
    variance: Array


def scale_changes(information: Array, linear: Array, way: Array) -> ScaleChanges:
    """Return the changes at edges on which the data have this ``information`` (c, c) and ``linear`` term (c,).

    ``way`` (c,): the distance along which a scale that walks does so at each edge, m.
    """
    if not len(linear):
        return ScaleChanges(-np.inf, linear)
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
    return ScaleChanges(constant.log_odds, weights @ np.array(variances) / weights.sum())


def _with_walk(information: Array, linear: Array, sd: Array) -> tuple[float, Array, Array]:
    """Return the gain in log likelihood by independent changes of this ``sd`` (c,) at the edges, and the information
    and linear term that are left of the data when these are integrated out.
    """
    K = np.eye(len(sd)) + sd[:, None] * information * sd
    gain, log_determinant = sd[:, None] * np.linalg.inv(K) * sd, np.linalg.slogdet(K)[1]
    left = information - information @ gain @ information
    return 0.5 * float(linear @ gain @ linear - log_determinant), left, linear - information @ (gain @ linear)


class _Effects(NamedTuple):
    """``log_evidence``: the lower bound of the log likelihood, less that without any effect. ``level``: s^2."""

    log_odds: float
    log_evidence: float
    level: float
    variance: Array


def _effects(information: Array, linear: Array) -> _Effects:
    """Return the posterior of a sum of single effects."""
    count = len(linear)
    begin, end = np.triu_indices(count, 1)
    single = np.diagonal(information)
    precision = np.maximum(np.concatenate([single, single[begin] + single[end] - 2.0 * information[begin, end]]), 0.0)
    of_each_kind = np.repeat([1.0 / count, 1.0 / max(len(begin), 1)], [count, len(begin)])
    log_prior = _LOG_PRIOR + np.log(of_each_kind / len(_SDS))
    variance = np.square(_SDS)[:, None]

    def updated(others: Array, number: int, level: float) -> tuple[float, Array, Array]:
        """Return the log odds of an effect, and the first and second moments of its r; ``level``: s^2."""
        left = (linear - information @ others) / level
        left = np.concatenate([left, left[begin] - left[end]])
        seen = variance * precision / level
        shrunk = variance / (1.0 + seen)
        log_weight = log_prior + 0.5 * (left**2 * shrunk - np.log1p(seen))
        most = float(np.max(log_weight))
        weight = np.exp(log_weight - most)
        total = float(np.sum(weight))
        log_odds = most + float(np.log(total)) - number * float(np.log(2.0))
        probability = weight / total * np.exp(-np.logaddexp(0.0, -log_odds))
        mean = shrunk * left
        first, second = np.sum(probability * mean, axis=0), np.sum(probability * (mean**2 + shrunk), axis=0)
        return log_odds, _at_edges(first, -1.0), _at_edges(second, 1.0)

    def _at_edges(of_effects: Array, at_end: float) -> Array:
        creeps = of_effects[count:]
        at_ends = np.bincount(begin, creeps, count) + at_end * np.bincount(end, creeps, count)
        return np.asarray(of_effects[:count] + at_ends)

    means, moments = np.zeros((2, _MOST_EFFECTS, count))
    log_odds = np.zeros(_MOST_EFFECTS)
    estimate = np.linalg.lstsq(information, linear)[0]
    level = 1.0
    for _ in range(_MOST_ROUNDS):
        last, off = means.copy(), estimate - means.sum(axis=0)
        level = max(1.0, float(off @ information @ off) / count)
        for number in range(_MOST_EFFECTS):
            others = means.sum(axis=0) - means[number]
            log_odds[number], means[number], moments[number] = updated(others, number, level)
        if np.max(np.abs(means - last)) < _SETTLED:
            break
    together = means.sum(axis=0)
    # Of each effect it is log(1 + odds), in which its product with each other one is taken off: twice in all.
    products = together @ information @ together - np.einsum("ei,ij,ej->", means, information, means)
    log_evidence = float(np.sum(np.logaddexp(0.0, log_odds)) + 0.5 * products / level)
    second = together**2 + np.sum(moments - means**2, axis=0)
    return _Effects(float(np.max(log_odds)), log_evidence, level, second)

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
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trackfg.numerics.arrays import Array

_SDS = (1e-3, 3e-3, 1e-2, 2e-2)
"""Prior sigmas of an effect, from the first change that is worth a finding to the top of a creep curve."""
_MOST_EFFECTS = 12
"""Six creeps or so in a run leave as many effects again without probability."""
_MOST_ROUNDS = 50
_SETTLED = 1e-6
"""The updates end when no mean changes by more: a thousandth of the least sigma."""


class ScaleChanges(NamedTuple):
    """``log_odds``: of the most probable effect against none. ``variance`` (c,): the second moment of r."""

    log_odds: float
    variance: Array


def scale_changes(information: Array, linear: Array) -> ScaleChanges:
    """Return the changes at edges on which the data have this ``information`` (c, c) and ``linear`` term (c,)."""
    count = len(linear)
    if not count:
        return ScaleChanges(-np.inf, linear)
    begin, end = np.triu_indices(count, 1)
    single = np.diagonal(information)
    precision = np.maximum(np.concatenate([single, single[begin] + single[end] - 2.0 * information[begin, end]]), 0.0)
    of_each_kind = np.repeat([1.0 / count, 1.0 / max(len(begin), 1)], [count, len(begin)])
    log_prior = np.log(0.5 * of_each_kind / len(_SDS))
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
    for _ in range(_MOST_ROUNDS):
        last, off = means.copy(), estimate - means.sum(axis=0)
        level = max(1.0, float(off @ information @ off) / count)
        for number in range(_MOST_EFFECTS):
            others = means.sum(axis=0) - means[number]
            log_odds[number], means[number], moments[number] = updated(others, number, level)
        if np.max(np.abs(means - last)) < _SETTLED:
            break
    return ScaleChanges(float(np.max(log_odds)), means.sum(axis=0) ** 2 + np.sum(moments - means**2, axis=0))

"""The structure of a group of curves: which levels and transitions it has, by splitting and merging.

Each step is judged by the fit it leads to, and taken if it lowers ``chi^2 / scale + 4 per place + 20 per curve`` and a
little for straights within and for the rarer laws; ``scale`` is that of the richer chain. This is more than the
information criteria's log n, as the noise is only known approximately. The steps are:

* the place where a further step of the curvature would explain most of the residuals (a score test, for every cell at
  once) is tried as a new level;
* a curve that the fit does not need, or wider than the widest, becomes straight; two levels of one sign become one,
  or one of them part of a transition;
* between curves of opposite sign the curvature passes through a straight, tried with and without length;
* points that the fit has put in the wrong order are merged: the transition, or the constant stretch, has no length;
* a transition or stretch of less than two sigmas is tried without length;
* a disturbed cell (:mod:`trackfg.curves.increments`), at 15 each, competes with a step of the curvature, and with a
  curve shorter than 60 m.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np

from trackfg.curves.chain_edits import (
    bridged,
    collapsed,
    level_length,
    merged,
    opened,
    selected,
    straightened,
    with_law,
    with_level,
)
from trackfg.curves.fit import Fit, Stretch, whitened_residuals
from trackfg.curves.increments import DISTURBED_FROM, PER_DISTURBANCE
from trackfg.curves.model import CurveChain, step_turns
from trackfg.curves.refit import refitted
from trackfg.curves.transition_laws import LAWS, TransitionLaw
from trackfg.numerics.arrays import Array

_PER_PLACE, _PER_LEVEL = 4.0, 20.0
"""Price, in chi-square, of a place and of a curve. Chosen on simulated lines; see Assumptions in docs/engine.md."""
_PER_LAW: dict[TransitionLaw, float] = {"clothoid": 0.0, "half-sine": 1.4, "sine": 4.6, "bloss": 4.6, "helmert": 4.6}
"""Price of a law: twice the logarithm of the ratio of prior counts (:mod:`trackfg.curves.transition_law_selection`),
1.4 and 4.6."""
_SPLITS_FROM = 30.0
"""Gain in chi-square from which a further level is tried: the price of a curve and its places, about."""
_TRIED = 3
"""Most places that are tried for a further level at a time."""
_APART_CELLS = 3
"""Least distance of these, cells."""
_SHORT_SIGMAS = 2.0
"""A length of fewer sigmas is tried without."""
_LEAST_GAIN = 1e-3
"""Least gain of a step: less is rounding."""
_DOUBTFUL = 10.0
"""A curve whose curvature is fewer sigmas is tried without."""

_USUAL_SCALE = 3.0
"""Scale above which the residuals are more than noise. Chosen on simulated lines; see Assumptions in docs/engine.md."""

_SHORT_CURVE_M = 60.0
"""Curves this short, m, with their transitions, are tried as disturbances."""


def structured(chain: CurveChain, stretch: Stretch) -> Fit | None:
    """Fit the chain with the levels, transitions and points that the profile shows.

    The fit's stretch has the disturbances that it shows besides; None where it shows no curve.
    """
    best: Fit | None = None
    fewer = collapsed(chain)
    starts = [chain] if fewer is chain else [chain, fewer]
    laws = sorted(LAWS, key=lambda law: -chain.laws.count(law))
    for tried, law in enumerate(laws):
        for start in starts:
            fit = refitted(with_law(start, law), stretch)
            fit = None if fit is None else simplified(fit)
            if best is None or (fit is not None and _costs_less(fit, best)):
                best = fit
        # Several curves can hide a wrong law behind a wrong straight: they are always tried by two laws.
        if best is None:
            continue
        if (tried or len(best.chain.curved) == 1) and not _misfits(best):
            break
    if best is None:
        return None
    if _misfits(best):
        best = simplified(_relawed(best))
    for _ in range(2 + len(chain.straight)):
        best = _undisturbed(best)
        split = (with_level(best.chain, t) for t in _doubtful(best))
        candidate = _first_lower(best, split)
        if candidate is best:
            break
        best = simplified(candidate)
    best = _without_short_curves(best)
    return None if len(best.chain.curved) == 1 and _straight_costs_less(best, stretch) else best


def simplified(best: Fit) -> Fit:
    """Return the fit without levels that it does not need, nor lengths that do not differ from nothing."""
    for _ in range(4):
        candidate = _merged_where_short(_pruned(best))
        if candidate is best:
            break
        best = candidate
    return best


def _merged_where_short(best: Fit) -> Fit:
    for _ in range(len(best.chain.places)):
        shorter = _shortest_merged(best)
        candidate = best if shorter is None else _lower(best, shorter)
        if candidate is best:
            return best
        best = candidate
    return best


def _price(fit: Fit) -> float:
    laws = sum(_PER_LAW[law] for law in fit.chain.laws)
    within = sum(fit.chain.straight[1:-1])
    disturbances = PER_DISTURBANCE * fit.stretch.disturbances
    return _PER_PLACE * (len(fit.chain.places) + within) + _PER_LEVEL * len(fit.chain.curved) + laws + disturbances


def _costs_less(fit: Fit, than: Fit) -> bool:
    richer = max(fit, than, key=_price)
    return fit.chi2 / richer.scale + _price(fit) < than.chi2 / richer.scale + _price(than) - _LEAST_GAIN


def _pruned(best: Fit) -> Fit:
    """Return the fit without the levels and transitions that it does not need, and with the lengths that it does."""
    for _ in range(2 * len(best.chain.straight)):
        candidate = _first_lower(best, itertools.chain(opened(best.chain), _reduced(best)))
        if candidate is best:
            return best
        best = candidate
    return best


def _relawed(best: Fit) -> Fit:
    """Return the fit with each transition by the law that fits best."""
    for i in range(len(best.chain.laws)):
        for law in LAWS:
            if i < len(best.chain.laws) and law != best.chain.laws[i]:
                best = _lower(best, with_law(best.chain, law, i))
    return best


def _reduced(fit: Fit) -> Iterator[CurveChain]:
    """Yield simpler chains.

    They lack a doubtful curve; a level, or a transition, between two levels of one sign; or a straight between two
    such.
    """
    chain = fit.chain
    curved = chain.curved
    p = len(chain.places)
    ratio = np.abs(chain.curvature[curved]) / np.sqrt(np.diag(fit.covariance)[p : p + len(curved)])
    for k in np.argsort(ratio):
        if ratio[k] < _DOUBTFUL and len(curved) > 1:
            yield straightened(chain, int(curved[k]))
    last = len(chain.laws)
    for i in range(last):
        if chain.straight[i] or chain.straight[i + 1] or chain.curvature[i] * chain.curvature[i + 1] < 0.0:
            continue
        # Levels i and i + 1 as one, of the longer one's curvature; then either of them as part of a transition.
        lengths = [level_length(chain, i), level_length(chain, i + 1)]
        shorter = i if lengths[0] < lengths[1] else i + 1
        levels = [level for level in range(last + 1) if level != shorter]
        yield selected(chain, list(chain.straight), levels, [t for t in range(last) if t != i])
        for level in (i, i + 1):
            if 0 < level < last:
                yield bridged(chain, level)
    for level in range(1, last):
        if chain.straight[level] and chain.curvature[level - 1] * chain.curvature[level + 1] > 0.0:
            yield bridged(chain, level)


def _lower(best: Fit, other: CurveChain) -> Fit:
    """Return the other chain's fit if it costs less, else the one there is."""
    fit = refitted(other, best.stretch)
    return best if fit is None or not _costs_less(fit, best) else fit


def _first_lower(best: Fit, others: Iterable[CurveChain]) -> Fit:
    """Return the first of the other chains' fits that costs less, else the one there is."""
    for other in others:
        fit = _lower(best, other)
        if fit is not best:
            return fit
    return best


def _undisturbed(fit: Fit) -> Fit:
    """Return the fit with the disturbances that explain more of the residuals than a step of curvature does."""
    for _ in range(len(fit.stretch.edges) // 10):
        if fit.stretch.turn is None:
            break
        gain, turn = fit.stretch.turn.most_disturbed(*whitened_residuals(fit.chain, fit.stretch.without_tilt()))
        if _to_scale(gain, fit) < DISTURBED_FROM or gain < _step_gains(fit)[1].max(initial=0.0):
            break
        candidate = refitted(fit.chain, replace(fit.stretch, turn=turn))
        if candidate is None:
            break
        fit = candidate
    return fit


def _without_short_curves(best: Fit) -> Fit:
    """Return the fit without curves that are rather disturbances."""
    for level in reversed(best.chain.curved):
        chain = best.chain
        last = len(chain.laws)
        if not 0 < level < last or len(chain.curved) == 1:
            continue
        if chain.places[chain.end[level]] - chain.places[chain.begin[level - 1]] > _SHORT_CURVE_M:
            continue
        between = chain.curvature[level - 1] * chain.curvature[level + 1] > 0.0
        other = bridged(chain, int(level)) if between else straightened(chain, int(level))
        fit = refitted(other, best.stretch)
        fit = None if fit is None else _undisturbed(fit)
        if fit is not None and _costs_less(fit, best):
            best = fit
    return best


def _straight_costs_less(fit: Fit, stretch: Stretch) -> bool:
    """Return whether a straight, with disturbances in place of a short curve, costs less."""
    turn = stretch.turn
    if turn is None:
        return False
    points = fit.chain.points
    if all((fit.chain.straight[0], fit.chain.straight[-1])) and points[-1] - points[0] < _SHORT_CURVE_M:
        turn = turn.undisturbed(turn.increments.measured, np.zeros((len(turn.increments.measured), 0)))
    chi2 = float(np.sum((turn.white @ turn.increments.measured) ** 2))
    return chi2 / fit.scale + PER_DISTURBANCE * turn.increments.disturbances < fit.chi2 / fit.scale + _price(fit)


def _misfits(fit: Fit) -> bool:
    """Return whether the residuals are more than noise."""
    return bool(_doubtful(fit)) or fit.scale > _USUAL_SCALE


def _doubtful(fit: Fit) -> list[float]:
    """Return places where a step of the curvature would explain most of the residuals, best first.

    There is none where all explain too little.
    """
    at, gains = _step_gains(fit)
    apart = _APART_CELLS * (fit.stretch.edges[1] - fit.stretch.edges[0])
    places: list[float] = []
    for k in np.argsort(-gains):
        if _to_scale(float(gains[k]), fit) < _SPLITS_FROM or len(places) == _TRIED:
            break
        if all(abs(at[k] - other) >= apart for other in places):
            places.append(float(at[k]))
    return places


def _to_scale(gain: float, fit: Fit) -> float:
    """Return a gain in chi-square over the scale that it would leave."""
    return gain / replace(fit, chi2=max(fit.chi2 - gain, 0.0)).scale


def _step_gains(fit: Fit) -> tuple[Array, Array]:
    """Return places within the curves, and by how much a step of curvature would lower chi-square. Each (k,)."""
    chain, edges = fit.chain, fit.stretch.edges
    points = chain.points
    low = points[0] if chain.straight[0] else edges[2]
    high = points[-1] if chain.straight[-1] else edges[-3]
    at = edges[(edges > low) & (edges < high)]
    if not at.size or fit.stretch.turn is None:
        return at, np.zeros(len(at))
    r, j = whitened_residuals(chain, fit.stretch.without_tilt())
    g = fit.stretch.turn.white @ step_turns(at, edges)
    q = np.linalg.qr(j)[0]
    g -= q @ (q.T @ g)
    return at, (g.T @ r) ** 2 / np.maximum(np.einsum("ij,ij->j", g, g), 1e-300)


def _shortest_merged(fit: Fit) -> CurveChain | None:
    """Return the chain without its shortest length, in its sigmas; None if all are clearly there."""
    points, nodes = fit.chain.points, fit.chain.nodes
    covariance = fit.covariance
    best, pair = _SHORT_SIGMAS, None
    for j, (a, b) in enumerate(itertools.pairwise(nodes)):
        if a == b:
            continue
        variance = covariance[a, a] + covariance[b, b] - 2.0 * covariance[a, b]
        ratio = float((points[j + 1] - points[j]) / np.sqrt(max(variance, 1e-12)))
        if ratio < best:
            best, pair = ratio, (int(a), int(b))
    return None if pair is None else merged(fit.chain, *pair)

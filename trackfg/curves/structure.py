"""Which levels and transitions a group of curves has: split and merge, each step judged by the fit it leads to.

A step is taken if it lowers ``chi^2 / scale + 4 per place + 20 per curve`` and a little for straights within and for
the rarer laws; ``scale`` is that of the richer chain. This is more than the information criteria's log n, as the noise
is only known approximately. Steps:

* the place where a further step of the curvature would explain most of the residuals (a score test, for every cell at
  once) is tried as a new level;
* a curve that the fit does not need, or wider than the widest, becomes straight; two levels of one sign become one,
  or one of them part of a transition;
* between curves of opposite sign the curvature passes through a straight, tried with and without length;
* points that the fit has put in the wrong order are merged: the transition, or the constant stretch, has no length;
* a transition or stretch of less than two sigmas is tried without length.
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
    swapped,
    with_crossing,
    with_law,
    with_level,
)
from trackfg.curves.fit import Fit, Stretch, fitted, regressors
from trackfg.curves.model import CurveChain, step_turns
from trackfg.curves.transition_laws import LAWS, TransitionLaw

_PER_PLACE, _PER_LEVEL = 4.0, 20.0
_PER_LAW: dict[TransitionLaw, float] = {"clothoid": 0.0, "half-sine": 1.4, "sine": 4.6, "bloss": 4.6, "helmert": 4.6}
_SPLITS_FROM = 30.0
_TRIED = 3
_APART_CELLS = 3
_SHORT_SIGMAS = 2.0
_TURNED_M = 1.0
_LEAST_GAIN = 1e-3
_DOUBTFUL = 10.0
"""A curve whose curvature is fewer sigmas is tried without."""


def structured(chain: CurveChain, stretch: Stretch, widest_radius_m: float) -> Fit | None:
    """The chain with the levels, transitions and points that the profile shows; None where it shows no curve."""
    best: Fit | None = None
    fewer = collapsed(chain)
    starts = [chain] if fewer is chain else [chain, fewer]
    laws = sorted(LAWS, key=lambda law: -chain.laws.count(law))
    for tried, law in enumerate(laws):
        for start in starts:
            fit = _settled(with_law(start, law), stretch, widest_radius_m)
            fit = None if fit is None else simplified(fit, stretch, widest_radius_m)
            if best is None or (fit is not None and _costs_less(fit, best)):
                best = fit
        # Several curves can hide a wrong law behind a wrong straight: they are always tried by two laws.
        if best is None:
            continue
        if (tried or len(best.chain.curved) == 1) and not _doubtful(best, stretch):
            break
    if best is None:
        return None
    if _doubtful(best, stretch):
        best = simplified(_relawed(best, stretch, widest_radius_m), stretch, widest_radius_m)
    for _ in range(2 + len(chain.straight)):
        split = (with_level(best.chain, t) for t in _doubtful(best, stretch))
        after = _first_lower(best, split, stretch, widest_radius_m)
        if after is best:
            break
        best = simplified(after, stretch, widest_radius_m)
    if len(best.chain.curved) == 1:
        needed = (stretch.chi2_of_straight() - best.chi2) / best.scale
        if needed < _price(best):
            return None
    return best


def simplified(best: Fit, stretch: Stretch, widest_radius_m: float) -> Fit:
    """Without levels that it does not need, nor lengths that do not differ from nothing."""
    for _ in range(4):
        after = _merged_where_short(_pruned(best, stretch, widest_radius_m), stretch, widest_radius_m)
        if after is best:
            break
        best = after
    return best


def _merged_where_short(best: Fit, stretch: Stretch, widest_radius_m: float) -> Fit:
    for _ in range(len(best.chain.places)):
        shorter = _shortest_merged(best)
        after = best if shorter is None else _lower(best, shorter, stretch, widest_radius_m)
        if after is best:
            return best
        best = after
    return best


def _price(fit: Fit) -> float:
    laws = sum(_PER_LAW[law] for law in fit.chain.laws)
    within = sum(fit.chain.straight[1:-1])
    return _PER_PLACE * (len(fit.chain.places) + within) + _PER_LEVEL * len(fit.chain.curved) + laws


def _costs_less(fit: Fit, than: Fit) -> bool:
    richer = max(fit, than, key=_price)
    return fit.chi2 / richer.scale + _price(fit) < than.chi2 / richer.scale + _price(than) - _LEAST_GAIN


def _pruned(best: Fit, stretch: Stretch, widest_radius_m: float) -> Fit:
    """Without the levels and transitions that it does not need, and with the lengths that it does."""
    for _ in range(2 * len(best.chain.straight)):
        after = _first_lower(best, opened(best.chain), stretch, widest_radius_m)
        if after is best:
            after = _first_lower(best, _reduced(best), stretch, widest_radius_m)
        if after is best:
            return best
        best = after
    return best


def _relawed(best: Fit, stretch: Stretch, widest_radius_m: float) -> Fit:
    """Each transition by the law that fits best."""
    for i in range(len(best.chain.laws)):
        for law in LAWS:
            if i < len(best.chain.laws) and law != best.chain.laws[i]:
                best = _lower(best, with_law(best.chain, law, i), stretch, widest_radius_m)
    return best


def _reduced(fit: Fit) -> Iterator[CurveChain]:
    """Without a doubtful curve; without a level, or a transition, between two levels of one sign; without a straight
    between two such.
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
        gone = i if lengths[0] < lengths[1] else i + 1
        levels = [level for level in range(last + 1) if level != gone]
        yield selected(chain, list(chain.straight), levels, [t for t in range(last) if t != i])
        for level in (i, i + 1):
            if 0 < level < last:
                yield bridged(chain, level)
    for level in range(1, last):
        if chain.straight[level] and chain.curvature[level - 1] * chain.curvature[level + 1] > 0.0:
            yield bridged(chain, level)


def _lower(best: Fit, other: CurveChain, stretch: Stretch, widest_radius_m: float) -> Fit:
    """The other chain's fit if it costs less, else the one there is."""
    fit = _settled(other, stretch, widest_radius_m)
    return best if fit is None or not _costs_less(fit, best) else fit


def _first_lower(best: Fit, others: Iterable[CurveChain], stretch: Stretch, widest_radius_m: float) -> Fit:
    """The first of the other chains' fits that costs less, else the one there is."""
    for other in others:
        fit = _lower(best, other, stretch, widest_radius_m)
        if fit is not best:
            return fit
    return best


def _settled(chain: CurveChain, stretch: Stretch, widest_radius_m: float) -> Fit | None:
    """Fitted, its points in order, its curves not too wide; None without a curve, or where its points leave the
    stretch.
    """
    turned: set[int] = set()
    for _ in range(4 * len(chain.straight) + 8):
        fit = fitted(chain, stretch)
        points, nodes = fit.chain.points, fit.chain.nodes
        if points.min() < stretch.edges[0] or points.max() > stretch.edges[-1]:
            # Some curve of the chain is none, and its points went astray: the one that turns least.
            if len(chain.curved) == 1:
                return None
            turn = [abs(chain.curvature[level]) * level_length(chain, int(level)) for level in chain.curved]
            chain = straightened(chain, int(chain.curved[np.argmin(turn)]))
            continue
        back = np.where(nodes[1:] != nodes[:-1], points[:-1] - points[1:], -np.inf)
        if back.size and back.max() >= 0.0:
            j = int(np.argmax(back))
            a, b = int(nodes[j]), int(nodes[j + 1])
            # A transition the wrong way round is as good as the right way round: no reason to take its length away.
            if j % 2 == 0 and back.max() > _TURNED_M and j not in turned:
                turned.add(j)
                chain = swapped(fit.chain, a, b)
            else:
                chain = merged(fit.chain, a, b)
            continue
        curved = fit.chain.curved
        flattest = int(curved[np.argmin(np.abs(fit.chain.curvature[curved]))])
        if abs(fit.chain.curvature[flattest]) * widest_radius_m < 1.0:
            chain = straightened(fit.chain, flattest)
            if not chain.curved.size:
                return None
            continue
        crossing = with_crossing(fit.chain)
        if crossing is None:
            return fit
        chain = crossing
    return fit


def _doubtful(fit: Fit, stretch: Stretch) -> list[float]:
    """Places where a step of the curvature would explain most of what is left, best first; none where too little."""
    chain = fit.chain
    r, j = regressors(chain, stretch.without_tilt())
    points = chain.points
    low = points[0] if chain.straight[0] else stretch.edges[2]
    high = points[-1] if chain.straight[-1] else stretch.edges[-3]
    at = stretch.edges[(stretch.edges > low) & (stretch.edges < high)]
    if not at.size:
        return []
    g = stretch.turn_white(step_turns(at, stretch.edges))
    q = np.linalg.qr(j)[0]
    g -= q @ (q.T @ g)
    gain = (g.T @ r) ** 2 / np.maximum(np.einsum("ij,ij->j", g, g), 1e-300)
    found: list[float] = []
    for k in np.argsort(-gain):
        after = replace(fit, chi2=max(fit.chi2 - float(gain[k]), 0.0))
        if gain[k] / after.scale < _SPLITS_FROM or len(found) == _TRIED:
            break
        apart = _APART_CELLS * (stretch.edges[1] - stretch.edges[0])
        if all(abs(at[k] - other) >= apart for other in found):
            found.append(float(at[k]))
    return found


def _shortest_merged(fit: Fit) -> CurveChain | None:
    """With the length that is least, in its sigmas, taken out; None where all are clearly there."""
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

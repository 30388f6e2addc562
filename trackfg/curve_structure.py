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

from trackfg.curve_fit import Fit, Stretch, fitted, regressors
from trackfg.curve_model import CurveChain, step_turns
from trackfg.transition_laws import LAWS, SPREAD, TransitionLaw

_PER_PLACE, _PER_LEVEL = 4.0, 20.0
_PER_LAW: dict[TransitionLaw, float] = {"clothoid": 0.0, "half-sine": 1.4, "sine": 4.6, "bloss": 4.6, "helmert": 4.6}
_SPLITS_FROM = 30.0
_TRIED = 3
_APART_CELLS = 3
_SHORT_SIGMAS = 2.0
_OPENED_M = 7.0
_TURNED_M = 1.0
_LEAST_GAIN = 1e-3
_DOUBTFUL = 10.0
"""A curve whose curvature is fewer sigmas is tried without."""


def structured(chain: CurveChain, stretch: Stretch, widest_radius_m: float) -> Fit | None:
    """The chain with the levels, transitions and points that the profile shows; None where it shows no curve."""
    best: Fit | None = None
    collapsed = _collapsed(chain)
    starts = [chain] if collapsed is chain else [chain, collapsed]
    for law in LAWS:
        for start in starts:
            fit = _settled(with_law(start, law), stretch, widest_radius_m)
            fit = None if fit is None else simplified(fit, stretch, widest_radius_m)
            if best is None or (fit is not None and _costs_less(fit, best)):
                best = fit
        # Several curves can hide a wrong law behind a wrong straight: they are always tried by two laws.
        if best is None:
            continue
        if (law != "clothoid" or len(best.chain.curved) == 1) and not _doubtful(best, stretch):
            break
    if best is None:
        return None
    if _doubtful(best, stretch):
        best = simplified(_relawed(best, stretch, widest_radius_m), stretch, widest_radius_m)
    for _ in range(2 + len(chain.straight)):
        split = (_with_level(best.chain, t) for t in _doubtful(best, stretch))
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
        merged = _shortest_merged(best)
        after = best if merged is None else _lower(best, merged, stretch, widest_radius_m)
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
        after = _first_lower(best, _opened(best.chain), stretch, widest_radius_m)
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


def _opened(chain: CurveChain) -> Iterator[CurveChain]:
    """With some length where a transition, or a straight between two curves, has none."""
    nodes = chain.nodes
    for j, (a, b) in enumerate(itertools.pairwise(nodes)):
        within = j % 2 == 1 and chain.straight[(j + 1) // 2]
        if a == b and (j % 2 == 0 or within):
            points = chain.points
            before = points[j] - points[j - 1] if j else np.inf
            after = points[j + 2] - points[j + 1] if j + 2 < len(nodes) else np.inf
            half = max(min(_OPENED_M, 0.3 * before, 0.3 * after), 0.1)
            places = np.append(chain.places, chain.places[a] + half)
            places[a] -= half
            # Whatever comes at that place after the opening moves with its further side.
            later = [len(places) - 1 if i > j and node == a else int(node) for i, node in enumerate(nodes)]
            yield replace(chain, places=places, begin=tuple(later[::2]), end=tuple(later[1::2]))


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
            yield _straightened(chain, int(curved[k]))
    last = len(chain.laws)
    for i in range(last):
        if chain.straight[i] or chain.straight[i + 1] or chain.curvature[i] * chain.curvature[i + 1] < 0.0:
            continue
        # Levels i and i + 1 as one, of the longer one's curvature; then either of them as part of a transition.
        lengths = [_length(chain, i), _length(chain, i + 1)]
        gone = i if lengths[0] < lengths[1] else i + 1
        levels = [level for level in range(last + 1) if level != gone]
        yield _selected(chain, list(chain.straight), levels, [t for t in range(last) if t != i])
        for level in (i, i + 1):
            if 0 < level < last:
                yield _bridged(chain, level)
    for level in range(1, last):
        if chain.straight[level] and chain.curvature[level - 1] * chain.curvature[level + 1] > 0.0:
            yield _bridged(chain, level)


def _collapsed(chain: CurveChain) -> CurveChain:
    """With the longest level only of those of one sign that follow each other."""
    level = 0
    while level < len(chain.laws):
        pair = (level, level + 1)
        if chain.curvature[level] * chain.curvature[level + 1] > 0.0:
            gone = min((i for i in pair if 0 < i < len(chain.laws)), key=lambda i: _length(chain, i), default=None)
            if gone is not None:
                chain = _bridged(chain, gone)
                level = 0
                continue
        level += 1
    return chain


def _length(chain: CurveChain, level: int) -> float:
    """Of the constant stretch; endless at the ends."""
    if level in (0, len(chain.laws)):
        return np.inf
    return float(chain.places[chain.begin[level]] - chain.places[chain.end[level - 1]])


def _bridged(chain: CurveChain, level: int) -> CurveChain:
    """The transitions on both sides of a level as one, by the law of the longer one."""
    before, after = level - 1, level
    ends = list(chain.end)
    ends[before] = chain.end[after]
    laws = list(chain.laws)
    spans = [chain.places[chain.end[t]] - chain.places[chain.begin[t]] for t in (before, after)]
    laws[before] = chain.laws[before] if spans[0] >= spans[1] else chain.laws[after]
    levels = [i for i in range(len(chain.straight)) if i != level]
    kept = [t for t in range(len(laws)) if t != after]
    return _selected(replace(chain, end=tuple(ends), laws=tuple(laws)), list(chain.straight), levels, kept)


def with_law(chain: CurveChain, law: TransitionLaw, only: int | None = None) -> CurveChain:
    """All transitions, or ``only`` one, by this law, their lengths such that they look the same from afar."""
    laws = list(chain.laws)
    places = chain.places.copy()
    for i, old in enumerate(chain.laws):
        if only not in (None, i) or chain.begin[i] == chain.end[i]:
            continue
        laws[i] = law
        ends = chain.places[[chain.begin[i], chain.end[i]]]
        places[[chain.begin[i], chain.end[i]]] = ends.mean() + SPREAD[old] / SPREAD[law] * (ends - ends.mean())
    return replace(chain, laws=tuple(laws), places=places)


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
            turn = [abs(chain.curvature[level]) * _length(chain, int(level)) for level in chain.curved]
            chain = _straightened(chain, int(chain.curved[np.argmin(turn)]))
            continue
        back = np.where(nodes[1:] != nodes[:-1], points[:-1] - points[1:], -np.inf)
        if back.size and back.max() >= 0.0:
            j = int(np.argmax(back))
            a, b = int(nodes[j]), int(nodes[j + 1])
            # A transition the wrong way round is as good as the right way round: no reason to take its length away.
            if j % 2 == 0 and back.max() > _TURNED_M and j not in turned:
                turned.add(j)
                chain = _swapped(fit.chain, a, b)
            else:
                chain = _merged(fit.chain, a, b)
            continue
        curved = fit.chain.curved
        flattest = int(curved[np.argmin(np.abs(fit.chain.curvature[curved]))])
        if abs(fit.chain.curvature[flattest]) * widest_radius_m < 1.0:
            chain = _straightened(fit.chain, flattest)
            if not chain.curved.size:
                return None
            continue
        crossing = _crossing(fit.chain)
        if crossing is None:
            return fit
        chain = crossing
    return fit


def _swapped(chain: CurveChain, a: int, b: int) -> CurveChain:
    """The values of two places exchanged."""
    places = chain.places.copy()
    places[[a, b]] = places[[b, a]]
    return replace(chain, places=places)


def _merged(chain: CurveChain, a: int, b: int) -> CurveChain:
    """Places a and b made one."""
    keep, drop = min(a, b), max(a, b)
    places = chain.places.copy()
    places[keep] = 0.5 * (places[a] + places[b])
    number = [keep if i == drop else i - (i > drop) for i in range(len(places))]
    return replace(
        chain,
        places=np.delete(places, drop),
        begin=tuple(number[i] for i in chain.begin),
        end=tuple(number[i] for i in chain.end),
    )


def _straightened(chain: CurveChain, level: int) -> CurveChain:
    """The level made straight, and joined with straights beside it."""
    straight = list(chain.straight)
    straight[level] = True
    levels = [0]
    kept: list[int] = []
    for i in range(len(chain.laws)):
        if straight[i] and straight[i + 1]:
            continue
        kept.append(i)
        levels.append(i + 1)
    return _selected(chain, straight, levels, kept)


def _selected(chain: CurveChain, straight: list[bool], levels: list[int], kept: list[int]) -> CurveChain:
    used = sorted({chain.begin[i] for i in kept} | {chain.end[i] for i in kept})
    number = {place: k for k, place in enumerate(used)}
    flat = np.array([straight[i] for i in levels])
    return CurveChain(
        straight=tuple(bool(value) for value in flat),
        begin=tuple(number[chain.begin[i]] for i in kept),
        end=tuple(number[chain.end[i]] for i in kept),
        laws=tuple(chain.laws[i] for i in kept),
        places=chain.places[used],
        curvature=np.where(flat, 0.0, chain.curvature[levels]),
        cant=np.where(flat, 0.0, chain.cant[levels]),
    )


def _inserted(chain: CurveChain, transition: int, nodes: tuple[float, float], curvature: float | None) -> CurveChain:
    """A level (straight for None) between two nodes within a transition, which becomes two. Equal nodes are one."""
    i, p = transition, len(chain.places)
    first, second = nodes
    places = np.append(chain.places, first if first == second else [first, second])
    level = i + 1
    new = 0.0 if curvature is None else curvature
    return CurveChain(
        straight=(*chain.straight[:level], curvature is None, *chain.straight[level:]),
        begin=(*chain.begin[:level], len(places) - 1, *chain.begin[level:]),
        end=(*chain.end[:i], p, *chain.end[i:]),
        laws=(*chain.laws[:level], *chain.laws[i:]),
        places=places,
        curvature=np.insert(chain.curvature, level, new),
        cant=np.insert(chain.cant, level, 0.0 if curvature is None else chain.cant[i : i + 2].mean()),
    )


def _crossing(chain: CurveChain) -> CurveChain | None:
    """With a straight without length where the curvature changes sign from a curve to the next."""
    for i in range(len(chain.laws)):
        before, after = chain.curvature[i], chain.curvature[i + 1]
        if before * after < 0.0:
            b, e = chain.places[chain.begin[i]], chain.places[chain.end[i]]
            zero = float(b + (e - b) * before / (before - after))
            return _inserted(chain, i, (zero, zero), None)
    return None


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


def _with_level(chain: CurveChain, t: float) -> CurveChain:
    points = chain.points
    j = int(np.searchsorted(points, t, side="right")) - 1
    ends = (points[j] if j >= 0 else t - 60.0), (points[j + 1] if j + 1 < len(points) else t + 60.0)
    room = min(t - ends[0], ends[1] - t)
    half = max(min(10.0, 0.4 * room), 0.1)
    if j >= 0 and j % 2 == 0:
        here = float(chain.curvature_at(np.array([t]))[0])
        return _inserted(chain, j // 2, (t - half, t + half), here)
    level = (j + 1) // 2
    p = len(chain.places)
    return CurveChain(
        straight=(*chain.straight[: level + 1], chain.straight[level], *chain.straight[level + 1 :]),
        begin=(*chain.begin[:level], p, *chain.begin[level:]),
        end=(*chain.end[:level], p + 1, *chain.end[level:]),
        laws=(*chain.laws[:level], "clothoid", *chain.laws[level:]),
        places=np.append(chain.places, [t - half, t + half]),
        curvature=np.insert(chain.curvature, level + 1, chain.curvature[level]),
        cant=np.insert(chain.cant, level + 1, chain.cant[level]),
    )


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
    return None if pair is None else _merged(fit.chain, *pair)

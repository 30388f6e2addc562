"""Edits of a chain of curves: the moves of the search for its structure (:mod:`trackfg.curves.structure`).

All are pure functions; the numbers they set are starting values for the fit that follows.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from trackfg.curves.model import CurveChain
from trackfg.curves.transition_laws import SPREAD, TransitionLaw

_OPENED_M = 7.0
"""Half the length with which a transition or straight is opened, m: a starting value."""


def with_law(chain: CurveChain, law: TransitionLaw, only: int | None = None) -> CurveChain:
    """Return the chain with all transitions, or ``only`` one, by this law, of lengths that look the same from afar."""
    laws = list(chain.laws)
    places = chain.places.copy()
    for i, previous_law in enumerate(chain.laws):
        if only not in (None, i) or chain.begin[i] == chain.end[i]:
            continue
        laws[i] = law
        ends = chain.places[[chain.begin[i], chain.end[i]]]
        places[[chain.begin[i], chain.end[i]]] = ends.mean() + SPREAD[previous_law] / SPREAD[law] * (ends - ends.mean())
    return replace(chain, laws=tuple(laws), places=places)


def opened(chain: CurveChain) -> Iterator[CurveChain]:
    """Yield chains with some length where a transition, or a straight between two curves, has none."""
    nodes = chain.nodes
    for j, (a, b) in enumerate(itertools.pairwise(nodes)):
        within = j % 2 == 1 and chain.straight[(j + 1) // 2]
        if a == b and (j % 2 == 0 or within):
            points = chain.points
            room_before = points[j] - points[j - 1] if j else np.inf
            room_after = points[j + 2] - points[j + 1] if j + 2 < len(nodes) else np.inf
            half = max(min(_OPENED_M, 0.3 * room_before, 0.3 * room_after), 0.1)
            places = np.append(chain.places, chain.places[a] + half)
            places[a] -= half
            # Whatever comes at that place after the opening moves with its further side.
            later = [len(places) - 1 if i > j and node == a else int(node) for i, node in enumerate(nodes)]
            yield replace(chain, places=places, begin=tuple(later[::2]), end=tuple(later[1::2]))


def collapsed(chain: CurveChain) -> CurveChain:
    """Return the chain in which of levels of one sign in succession only the longest is left."""
    level = 0
    while level < len(chain.laws):
        pair = (level, level + 1)
        if chain.curvature[level] * chain.curvature[level + 1] > 0.0:
            short = min(
                (i for i in pair if 0 < i < len(chain.laws)), key=lambda i: level_length(chain, i), default=None
            )
            if short is not None:
                chain = bridged(chain, short)
                level = 0
                continue
        level += 1
    return chain


def level_length(chain: CurveChain, level: int) -> float:
    """Return the length of the constant stretch of a level, m; it is infinite at the ends."""
    if level in (0, len(chain.laws)):
        return np.inf
    return float(chain.places[chain.begin[level]] - chain.places[chain.end[level - 1]])


def bridged(chain: CurveChain, level: int) -> CurveChain:
    """Return the chain with the transitions on both sides of a level as one, by the law of the longer one."""
    first, second = level - 1, level
    ends = list(chain.end)
    ends[first] = chain.end[second]
    laws = list(chain.laws)
    spans = [chain.places[chain.end[t]] - chain.places[chain.begin[t]] for t in (first, second)]
    laws[first] = chain.laws[first] if spans[0] >= spans[1] else chain.laws[second]
    levels = [i for i in range(len(chain.straight)) if i != level]
    kept = [t for t in range(len(laws)) if t != second]
    return selected(replace(chain, end=tuple(ends), laws=tuple(laws)), list(chain.straight), levels, kept)


def swapped(chain: CurveChain, a: int, b: int) -> CurveChain:
    """Return the chain with the values of two places exchanged."""
    places = chain.places.copy()
    places[[a, b]] = places[[b, a]]
    return replace(chain, places=places)


def merged(chain: CurveChain, a: int, b: int) -> CurveChain:
    """Return the chain with places a and b made one."""
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


def straightened(chain: CurveChain, level: int) -> CurveChain:
    """Return the chain with a level made straight, and joined with straights beside it."""
    straight = list(chain.straight)
    straight[level] = True
    levels = [0]
    kept: list[int] = []
    for i in range(len(chain.laws)):
        if straight[i] and straight[i + 1]:
            continue
        kept.append(i)
        levels.append(i + 1)
    return selected(chain, straight, levels, kept)


def selected(chain: CurveChain, straight: list[bool], levels: list[int], kept: list[int]) -> CurveChain:
    """Return the chain of some levels and transitions only."""
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
    """Return the chain with a level (straight for None) between two nodes within a transition, which becomes two.

    Equal nodes are one place.
    """
    i, p = transition, len(chain.places)
    first, second = nodes
    places = np.append(chain.places, first if first == second else [first, second])
    level = i + 1
    level_curvature = 0.0 if curvature is None else curvature
    return CurveChain(
        straight=(*chain.straight[:level], curvature is None, *chain.straight[level:]),
        begin=(*chain.begin[:level], len(places) - 1, *chain.begin[level:]),
        end=(*chain.end[:i], p, *chain.end[i:]),
        laws=(*chain.laws[:level], *chain.laws[i:]),
        places=places,
        curvature=np.insert(chain.curvature, level, level_curvature),
        cant=np.insert(chain.cant, level, 0.0 if curvature is None else chain.cant[i : i + 2].mean()),
    )


def with_crossing(chain: CurveChain) -> CurveChain | None:
    """Return the chain with a straight without length where curvature changes sign between two curves.

    It is inserted at the first such transition; None if there is none.
    """
    for i in range(len(chain.laws)):
        curvature_before, curvature_after = chain.curvature[i], chain.curvature[i + 1]
        if curvature_before * curvature_after < 0.0:
            b, e = chain.places[chain.begin[i]], chain.places[chain.end[i]]
            zero = float(b + (e - b) * curvature_before / (curvature_before - curvature_after))
            return _inserted(chain, i, (zero, zero), None)
    return None


def with_level(chain: CurveChain, t: float) -> CurveChain:
    """Return the chain with a further level about place ``t``, m."""
    points = chain.points
    j = int(np.searchsorted(points, t, side="right")) - 1
    ends = (points[j] if j >= 0 else t - 60.0), (points[j + 1] if j + 1 < len(points) else t + 60.0)
    room = min(t - ends[0], ends[1] - t)
    half = max(min(10.0, 0.4 * room), 0.1)
    if j >= 0 and j % 2 == 0:
        level_curvature = float(chain.curvature_at(np.array([t]))[0])
        return _inserted(chain, j // 2, (t - half, t + half), level_curvature)
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

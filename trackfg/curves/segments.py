"""Segmentation of a profile: a first chain of curves for each group of them.

Averaged over five cells (50 m), curvature above a threshold is part of a curve: half the widest one's, or four sigmas
of the irregularities, whichever is more. Curves closer together than :data:`GROUP_GAP_M` form a group that is fitted as
one; more than three are parted where the straights between are longest.

Over a group and some straight beside it, the curvature of the cells is cut into constant and linear pieces such that
``sum of squares / variance + 15 per constant + 22 per linear piece`` is least (dynamic programming, exact: Jackson et
al., "An algorithm for optimal partitioning of data on an interval", IEEE Signal Processing Letters 12, 2005). Constant
pieces are the levels of the chain, linear ones its transitions.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trackfg.curves.cells import Cells
from trackfg.curves.chain_edits import level_length, selected
from trackfg.curves.model import WIDEST_RADIUS_M, CurveChain
from trackfg.curves.transition_laws import TransitionLaw
from trackfg.numerics.arrays import Array
from trackfg.numerics.spans import true_runs

GROUP_GAP_M = 60.0
"""Curves closer together than this, m, are fitted as one group."""
_AVERAGED = 5
"""Cells over which curvature is averaged to find curves."""
_SIGMAS = 4.0
"""Sigmas of the averaged irregularities above which there is a curve."""
_FIRST_LAW: TransitionLaw = "clothoid"
"""Law of all transitions of a first chain."""
_BESIDE = 8
"""Cells of straight beside a group that are cut with it."""

_MOST_CURVES, _CUT_M = 3, 15.0
"""Most curves of a group, and the shortest straight, m, at which one with more is parted."""

_PER_CONSTANT, _PER_LINEAR = 15.0, 22.0
"""Price, in chi-square, of a constant and of a linear piece. Chosen on simulated lines; see Assumptions in
docs/engine.md."""
_LEAST_SD = 2e-5
"""Least sigma of curvature, 1/m: that of good track. A better track shows no more pieces, as the laws of transitions
are none of them."""


def first_chains(cells: Cells) -> list[CurveChain]:
    """Return a chain per group of curves, in order of chainage, with clothoids only and without cant."""
    weight = np.convolve(np.ones(len(cells)), np.ones(_AVERAGED), mode="same")
    mean = np.convolve(cells.curvature, np.ones(_AVERAGED), mode="same") / weight
    sd = max(cells.turn_sd / cells.base_m, _LEAST_SD)
    least = max(0.5 / WIDEST_RADIUS_M, _SIGMAS * sd / _AVERAGED)
    groups: list[list[int]] = []
    for first, stop in true_runs(np.abs(mean) > least):
        if groups and (first - groups[-1][1]) * cells.base_m < GROUP_GAP_M:
            groups[-1][1] = int(stop)
        else:
            groups.append([int(first), int(stop)])
    chains = []
    for k, (first, stop) in enumerate(groups):
        previous_stop = groups[k - 1][1] if k else 0
        next_first = groups[k + 1][0] if k + 1 < len(groups) else len(mean)
        low = max(first - _BESIDE, previous_stop if k == 0 else (previous_stop + first) // 2)
        high = min(stop + _BESIDE, next_first if k + 1 == len(groups) else (stop + next_first + 1) // 2)
        pieces = _pieces(cells.curvature[low:high], sd)
        within = low > 0, high < len(mean)
        chain = _chain(pieces, cells.centres[low] - 0.5 * cells.base_m, cells.base_m, least, within)
        if chain is not None:
            chains += _parts(chain)
    return chains


def _parts(chain: CurveChain) -> list[CurveChain]:
    """Return parts with few curves of a chain with many: a search takes the third power of their number."""
    levels = range(1, len(chain.laws))
    lengths = {i: level_length(chain, i) for i in levels if chain.straight[i]}
    longest = max(lengths, key=lambda i: lengths[i], default=None)
    if len(chain.curved) <= _MOST_CURVES or longest is None or lengths[longest] < _CUT_M:
        return [chain]
    every, last = list(chain.straight), len(chain.laws)
    first_part = selected(chain, every, list(range(longest + 1)), list(range(longest)))
    last_part = selected(chain, every, list(range(longest, last + 1)), list(range(longest, last)))
    return [*_parts(first_part), *_parts(last_part)]


@dataclass(frozen=True)
class _Piece:
    """Cells first to stop; curvature at its ends, 1/m, which are equal for a constant piece."""

    first: int
    stop: int
    start: float
    end: float
    constant: bool


def _pieces(y: Array, sd: float) -> list[_Piece]:
    """Return the best cut of y (n,) into constant and linear pieces."""
    n = len(y)
    x = np.arange(n, dtype=np.float64)
    sums = {name: np.concatenate([[0.0], np.cumsum(v)]) for name, v in (("y", y), ("yy", y * y), ("xy", x * y))}
    best = np.zeros(n + 1)
    origin: list[int] = [0] * (n + 1)
    flat: list[bool] = [True] * (n + 1)

    def cost(i: np.ndarray, j: int) -> tuple[Array, Array]:
        count = j - i
        total = sums["y"][j] - sums["y"][i]
        constant = sums["yy"][j] - sums["yy"][i] - total**2 / count
        middle = 0.5 * (i + j - 1)
        tilt = sums["xy"][j] - sums["xy"][i] - middle * total
        linear = constant - tilt**2 / np.maximum(count * (count**2 - 1.0) / 12.0, 1.0)
        return np.maximum(constant, 0.0) / sd**2 + _PER_CONSTANT, np.maximum(linear, 0.0) / sd**2 + _PER_LINEAR

    for j in range(1, n + 1):
        constant, linear = cost(np.arange(j), j)
        total = best[:j] + np.minimum(constant, linear)
        k = int(np.argmin(total))
        best[j], origin[j], flat[j] = total[k], k, bool(constant[k] <= linear[k])
    pieces: list[_Piece] = []
    j = n
    while j > 0:
        i = origin[j]
        mean = float(y[i:j].mean())
        rise = 0.0 if flat[j] else float(np.polyfit(x[i:j], y[i:j], 1)[0]) * (j - i)
        pieces.append(_Piece(i, j, mean - 0.5 * rise, mean + 0.5 * rise, flat[j]))
        j = i
    return pieces[::-1]


def _chain(
    pieces: list[_Piece], start_m: float, base_m: float, least: float, within: tuple[bool, bool]
) -> CurveChain | None:
    """Return levels from constant pieces, and transitions from the linear ones and jumps between; None without a curve.

    ``within`` says whether the first and the last piece are within the profile, and so straight.
    """
    levels: list[float] = []
    ends: list[list[float]] = []
    if not pieces[0].constant:
        levels.append(pieces[0].start)
    for piece, following in zip(pieces, [*pieces[1:], None], strict=True):
        first, stop = start_m + base_m * piece.first, start_m + base_m * piece.stop
        if piece.constant:
            if len(levels) > len(ends):
                ends.append([first - 0.25 * base_m, first + 0.25 * base_m])
            levels.append(piece.end)
            continue
        if len(levels) > len(ends):
            ends.append([first, stop])
        else:
            ends[-1][1] = stop
        if following is None:
            levels.append(piece.end)
        elif not following.constant and (following.end - following.start) * (piece.end - piece.start) < 0.0:
            levels.append(piece.end)
            ends[-1][1] = stop - 0.1 * base_m
    if len(levels) == len(ends):
        levels.append(pieces[-1].end)
    straight = [abs(level) < least for level in levels]
    straight[0] |= within[0]
    straight[-1] |= within[1]
    kept = [i for i in range(len(ends)) if not (straight[i] and straight[i + 1])]
    if not kept:
        return None
    chosen = [kept[0], *(i + 1 for i in kept)]
    curvature = np.array([0.0 if straight[i] else levels[i] for i in chosen])
    places = np.array([place for i in kept for place in ends[i]])
    return CurveChain(
        straight=tuple(straight[i] for i in chosen),
        begin=tuple(range(0, 2 * len(kept), 2)),
        end=tuple(range(1, 2 * len(kept), 2)),
        laws=tuple(_FIRST_LAW for _ in kept),
        places=np.maximum.accumulate(places),
        curvature=curvature,
        cant=np.zeros(len(chosen)),
    )

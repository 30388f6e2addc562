"""The largest set of fixes that agree with each other and with the wheel is sought before there is a solution.

A balise with the chainage of another one is wrong by hundreds of metres. Where the iteration starts from such a fix, or
several pull one way, no robust loss finds back. So fixes are hypotheses first: each is right, or says nothing. Right
ones follow each other as the wheel rolled. From fix i to the next right one j the chainage grows by ``ds`` where the
wheel rolled ``dd``; with the scale k of the wheel

    r = ds - k dd,   p(r) = (1 - P) N(0, v) + P N(0, v + w^2),
    v = l^2 (s_i^2 + s_j^2) + wheel variance + (SHARE |dd|)^2,   w = WIDE_SHARE |dd| + distance of slips and silence.

The second part is a wheel that erred unnoticed. A wrong fix may be anywhere on the line, with the density 1 / R. The
likelihood of all is a product along the run, so the most likely choice of right fixes comes by dynamic programming
(Viterbi), for each scale k and each level l of the declared sigmas on a grid: exact, and linear in the number of fixes.

Several readings at one place, while the vehicle stands or creeps there, are one hypothesis.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trackfg.numerics.arrays import Array

WRONG = 0.1
"""Probability that a fix is wrong, before anything is known of it: up to one in five shall be found, and good
recordings have fewer than one in a hundred; the result changes with the logarithm only."""

ERRED = 0.05
"""Probability that a wheel errs between two fixes by more than its sigma says, unnoticed."""

_SHARE = 0.005
"""Sigma of a rolling wheel's scale within a run, from creep under force and in curves: of the distance. Half a step of
the grid of scales is in it, too."""

WIDE_SHARE = 0.05
"""Sigma of the distance that an unnoticed slip or slide takes, of the distance: more than that shows against the
accelerometer (:mod:`trackfg.graph.wheel_slip`)."""

_LOG_SCALES = np.linspace(-0.35, 0.35, 141)
"""Logarithms of the wheel's scale: a wheel that is off by up to 40 %. The prior makes those far from 1 unlikely."""

_SCALE_TAIL = 3.0
"""Degrees of freedom of Student's distribution of the scale: a wrong diameter is not as rare as a normal one says."""

_LEVELS = np.array([1.0, 3.0, 10.0, 30.0])
"""By what the declared sigmas of all fixes may be too small."""

_LEVEL_COST = 1.0
"""Negative logarithm of the prior of each step on that grid: declared sigmas are right more often than not."""

SHORTEST_LINE_M = 1000.0
"""A wrong fix may be anywhere on the line, which is at least as long, m."""

_MOST_IN_A_ROW = 30
"""So many wrong fixes may follow each other."""

SAME_PLACE_M = 1.0
"""Readings of one chainage within such a distance are of one balise: its antenna field is shorter, m (ERTMS subset 036
has contact lengths of up to 1.3 m)."""


@dataclass(frozen=True)
class Passages:
    """The fixes of a run, in order of time, and how the wheel rolled from one to the next; all of shape (n,).

    ``place`` (m, in the sense of running) with its declared ``sd``; ``rolled`` (m): what the wheel has rolled by then,
    signed. ``variance`` (m^2), ``length`` (m) and ``unknown`` (m) grow from the start of the run: the variance of that
    distance, the way, and the part of it in which the wheel slips or is silent.
    """

    place: Array
    sd: Array
    rolled: Array
    variance: Array
    length: Array
    unknown: Array

    def __len__(self) -> int:
        return len(self.place)

    @property
    def line_m(self) -> float:
        """Length of the line, as far as the run shows it, m."""
        return float(max(np.ptp(self.place), np.ptp(self.rolled), SHORTEST_LINE_M))

    def take(self, index: np.ndarray) -> Passages:
        """Return some of them."""
        return Passages(*(getattr(self, name)[index] for name in self.__dataclass_fields__))


@dataclass(frozen=True)
class Consensus:
    """The fixes that are ``right`` (n,), and by how many votes.

    ``votes``: how many places these have read, and how many the largest set of agreeing ones among the others has.
    """

    right: np.ndarray
    votes: tuple[int, int]

    @property
    def is_undecided(self) -> bool:
        """Return whether the other set is about as large, so that either may be the right one."""
        right, rival = self.votes
        return rival > 0 and (rival >= right or (rival > 1 and rival == right - 1))


def consensus(passages: Passages, scale_sd: float) -> Consensus:
    """Return which fixes are right. ``scale_sd``: the relative sigma of the wheel's scale as declared."""
    n = len(passages)
    if n < 2:
        return Consensus(np.ones(n, dtype=bool), (n, 0))
    group = _places(passages)
    first = np.flatnonzero(np.diff(group, prepend=-1))
    heads = passages.take(first)
    right = _most_likely(heads, scale_sd)
    rival = 0 if right.all() else int(_most_likely(heads.take(~right), scale_sd).sum())
    return Consensus(right[group], (int(right.sum()), rival))


def wrong_is_likelier(error: Array | float, variance: Array | float, line_m: float) -> np.ndarray:
    """Return of which fixes it is likelier that they are wrong than that all else has erred unnoticed.

    ``error``: how far they are from where all else has them, m; ``variance``: of that, had it erred, m^2. A wrong one
    may be anywhere on the line.
    """
    erred = np.log(ERRED * (1.0 - WRONG)) - 0.5 * (np.square(error) / variance + np.log(2.0 * np.pi * variance))
    return np.asarray(erred <= np.log(WRONG / line_m))


def _places(passages: Passages) -> np.ndarray:
    """Return the number of the place that each fix reads, counted from 0. Shape (n,)."""
    again = np.abs(np.diff(passages.place)) <= passages.sd[:-1]
    again &= np.diff(passages.length) <= np.maximum(SAME_PLACE_M, 3.0 * passages.sd[:-1])
    return np.concatenate([[0], np.cumsum(~again)])


def _variances(passages: Passages, i: np.ndarray, j: np.ndarray, levels: Array) -> tuple[Array, Array]:
    """Return v and v + w^2 of the distance from fixes i to j, m^2, shape (levels, pairs)."""
    rolled = np.abs(passages.length[j] - passages.length[i])
    both = passages.sd[i] ** 2 + passages.sd[j] ** 2
    wheel = passages.variance[j] - passages.variance[i] + (_SHARE * rolled) ** 2
    narrow = levels[:, None] ** 2 * both + wheel
    return narrow, narrow + (WIDE_SHARE * rolled + passages.unknown[j] - passages.unknown[i]) ** 2


def _step_cost(passages: Passages, i: np.ndarray, j: int) -> Array:
    """Return ``-log p`` of going from right fixes i to the right fix j, shape (levels, i, scales)."""
    narrow, wide = (variance[:, :, None] for variance in _variances(passages, i, np.full(len(i), j), _LEVELS))
    rolled = passages.rolled[j] - passages.rolled[i]
    residual = passages.place[j] - passages.place[i] - np.exp(_LOG_SCALES)[:, None] * rolled
    squares = residual.T[None] ** 2

    def log_density(variance: Array) -> Array:
        return np.asarray(-0.5 * (squares / variance + np.log(2.0 * np.pi * variance)))

    density: Array = np.logaddexp(np.log1p(-ERRED) + log_density(narrow), np.log(ERRED) + log_density(wide))
    return -density


def _most_likely(passages: Passages, scale_sd: float) -> np.ndarray:
    """Return the most likely choice of right fixes, (n,) of bool."""
    n, levels, scales = len(passages), len(_LEVELS), len(_LOG_SCALES)
    line = np.log(passages.line_m)
    wrong, right = line - np.log(WRONG), -np.log1p(-WRONG)
    cost = np.empty((n, levels, scales))
    predecessor = np.full((n, levels, scales), -1)
    for j in range(n):
        cost[j] = line + right + j * wrong
        i = np.arange(max(0, j - _MOST_IN_A_ROW), j)
        if not i.size:
            continue
        steps = np.swapaxes(cost[i], 0, 1) + _step_cost(passages, i, j) + ((j - i - 1) * wrong)[None, :, None] + right
        best = np.argmin(steps, axis=1)
        least = np.take_along_axis(steps, best[:, None], axis=1)[:, 0]
        better = least < cost[j]
        cost[j], predecessor[j] = np.where(better, least, cost[j]), np.where(better, i[0] + best, -1)
    total = cost + ((n - 1 - np.arange(n)) * wrong)[:, None, None] + _prior_cost(scale_sd)
    j, level, scale = (int(index) for index in np.unravel_index(np.argmin(total), total.shape))
    chosen = np.zeros(n, dtype=bool)
    while j >= 0:
        chosen[j] = True
        j = int(predecessor[j, level, scale])
    return chosen


def _prior_cost(scale_sd: float) -> Array:
    """Return the cost of levels and scales before anything is measured, shape (levels, scales)."""
    scale = 0.5 * (_SCALE_TAIL + 1.0) * np.log1p((_LOG_SCALES / np.hypot(scale_sd, _SHARE)) ** 2 / _SCALE_TAIL)
    return np.asarray(_LEVEL_COST * np.arange(len(_LEVELS))[:, None] + scale)

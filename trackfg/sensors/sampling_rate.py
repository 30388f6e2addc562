"""A sensor's rate may change within a record: stretches of the record, each with a sampling interval of its own.

A logger changes its settings, a receiver loses its faster output, or two records are joined. What is usual of a whole
record is then that of its larger part, and samples of the slower one look as if others were missing beside each. The
rate of a stretch is another one where its steps are regular, alike for :data:`_LEAST_S` at least, and longer or shorter
than those before by half. Single rows that are missing, holes and stamps that scatter change no rate.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from trackfg.numerics.arrays import Array
from trackfg.numerics.robust import median
from trackfg.numerics.spans import median_interval

FIRST_SAMPLES = 10
"""Samples of a stream whose median interval is the first that is taken: of nine steps four may be longer."""
BLOCK = 16
"""Steps that are looked at together: a tenth of all may be missing rows, which quartiles do not see."""
_REGULAR = 1.2
"""Upper over lower quartile of a block's steps, at most; and the largest ratio of the levels of blocks that are alike:
stamps that scatter by a tenth of the interval."""
_OTHER = 1.5
"""Ratio of two rates at least: between one usual step and two, as a missing row makes."""
_LEAST_S = 2.0
"""A rate lasts so long at least, s: loggers lose every second row for a moment when they are busy."""


def first_interval(t: Array) -> float | None:
    """Return the sampling interval of the first samples at ``t`` (n,), s; None while they are fewer than
    :data:`FIRST_SAMPLES`.
    """
    return median_interval(t[:FIRST_SAMPLES]) if len(t) >= FIRST_SAMPLES else None


def rate_stretches(steps: Array) -> list[tuple[int, int]]:
    """Return first index and index after the last of stretches of ``steps`` (n,), s, of one rate each, in order.

    Nearly always that is one.
    """
    count = len(steps) // BLOCK
    # The level of a block is no further off than a step is.
    if count >= 2 and is_other_rate(float(steps.max()), float(steps.min())):
        level, regular = regular_levels(steps[: count * BLOCK].reshape(count, BLOCK))
        of_regular = level[regular]
        if of_regular.size and of_regular.max() >= _OTHER * of_regular.min():
            bounds = [0, *_changes(steps, level, np.flatnonzero(regular)), len(steps)]
            return list(pairwise(bounds))
    return [(0, len(steps))]


def local_intervals(steps: Array, usual_s: float) -> Array:
    """Return the sampling interval of each of the steps (n,), s; ``usual_s`` of all where the rate does not change."""
    stretches = rate_stretches(steps)
    if len(stretches) == 1:
        return np.full(len(steps), usual_s)
    return np.concatenate([np.full(end - first, median(steps[first:end])) for first, end in stretches])


def regular_levels(blocks: Array) -> tuple[Array, np.ndarray]:
    """Return the median of the steps of each block (b, :data:`BLOCK`), s, and whether they are alike."""
    ordered = np.sort(blocks, axis=1)
    half, quarter = BLOCK // 2, BLOCK // 4
    level = 0.5 * (ordered[:, half - 1] + ordered[:, half])
    return level, (ordered[:, -quarter - 1] <= _REGULAR * ordered[:, quarter]) & (level > 0.0)


def is_other_rate(level: float, usual: float) -> bool:
    """Return whether a step of one ``level`` is of another rate than a ``usual`` one, s."""
    return bool(level >= _OTHER * usual or usual >= _OTHER * level)


def _changes(steps: Array, level: Array, regular: np.ndarray) -> list[int]:
    """Return the first step of each rate but the first one, from the levels of blocks and which of these are regular
    (r,).
    """
    ends = np.cumsum(steps)[BLOCK - 1 :: BLOCK]
    usual, begin, changes = float(level[regular[0]]), None, list[int]()
    for block in regular.tolist():
        if not is_other_rate(level[block], usual):
            begin = None
            continue
        if begin is None or max(level[block] / level[begin], level[begin] / level[block]) > _REGULAR:
            begin = block
        if block > begin and ends[block] - ends[begin] + BLOCK * level[begin] >= _LEAST_S:
            new = float(level[begin])
            first = max((begin - 1) * BLOCK, changes[-1] + 1 if changes else 1)
            changes.append(first + _best_split(steps[first : (begin + 1) * BLOCK], usual, new))
            usual, begin = new, None
    return changes


def _best_split(steps: Array, earlier: float, later: float) -> int:
    """Return the index from which on most steps (n,) are of the ``later`` rate, and before of the ``earlier`` one."""
    is_later = (steps > np.sqrt(earlier * later)) == (later > earlier)
    wrong_before = np.append(0, np.cumsum(is_later))
    wrong_after = np.count_nonzero(~is_later) - np.append(0, np.cumsum(~is_later))
    return int(np.argmin(wrong_before + wrong_after))


@dataclass
class RateFollower:
    """Follows the rate of samples as they come.

    ``usual_s``: the interval of those so far; ``steps``: of the block under way; ``other_s``, ``lasted_s``: the level
    of blocks of another rate, and how long these have lasted; 0 without any.
    """

    usual_s: float
    steps: Array = field(default_factory=lambda: np.empty(0))
    other_s: float = 0.0
    lasted_s: float = 0.0

    def pieces(self, steps: Array) -> Iterator[tuple[int, float]]:
        """Take the next steps (n,), s: yield how many belong together, and the interval that is usual of them."""
        joined = np.concatenate([self.steps, steps])
        count = len(joined) // BLOCK
        shortest, longest = joined.min(initial=np.inf), joined.max(initial=0.0)
        if not self.other_s and longest < _OTHER * self.usual_s < _OTHER**2 * shortest:  # as nearly always
            self.steps = joined[count * BLOCK :]
            yield len(steps), self.usual_s
            return
        level, regular = regular_levels(joined[: count * BLOCK].reshape(count, BLOCK))
        partial, self.steps = len(self.steps), joined[count * BLOCK :]
        changed = regular & ((level >= _OTHER * self.usual_s) | (self.usual_s >= _OTHER * level))
        if not changed.any():
            self.other_s = 0.0 if regular.any() else self.other_s
            yield len(steps), self.usual_s
            return
        for block in range(count):
            yield BLOCK - partial, self.usual_s
            partial = 0
            if regular[block]:
                self._follow(float(level[block]), float(joined[block * BLOCK : (block + 1) * BLOCK].sum()))
        yield len(self.steps), self.usual_s

    def _follow(self, level: float, duration: float) -> None:
        if not is_other_rate(level, self.usual_s):
            self.other_s = 0.0
        elif not self.other_s or max(level / self.other_s, self.other_s / level) > _REGULAR:
            self.other_s, self.lasted_s = level, duration
        else:
            self.lasted_s += duration
            if self.lasted_s >= _LEAST_S:
                self.usual_s, self.other_s = self.other_s, 0.0

"""A stuck value is one that a channel shows again and again: it is stuck, or cut off at the end of its range.

A plateau begins where a sample equals the one before. With the probability p that two samples are equal by chance, that
its value comes j times more within n rows has at most the probability

    C(n, j) p^j,

and where that falls below ``exp(_IMPOSSIBLE)``, it was not chance. In between a channel that is cut off shows other
values, all on one side. A channel that has shown values on both sides, or has not come back for some rows, is neither
stuck nor cut off there. Where values repeat often by chance, only a value that comes without others in between is
found: a level would else be waited for at every turn.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import lgamma, log

_IMPOSSIBLE = log(1e-9)
"""One false alarm in some 50 days of one channel at 200 Hz, if every sample were tested by itself."""
LIKELIEST = 0.5
"""A channel that repeats its values more often by chance is not judged."""
_RAREST = 1e-6
"""The smallest probability of a repetition: it is not known better."""
_RARELY = 0.1
"""A level is waited for before it is found if so many repetitions by chance, or fewer, are expected meanwhile."""
_MOST_HELD = 60
"""Rows that wait at most until a plateau is clear: those of the most frequent chance that is judged, and some."""


@dataclass
class StuckValue:
    """The plateau of one channel; without a ``level`` there is none. Rows are counted from the first one on.

    ``first`` is the row of the first repetition, ``newest`` that of the last; ``again`` counts repetitions. ``above``
    and ``below``: whether other values came since. ``is_fault``: whether it was no chance.
    """

    level: float | None = None
    first: int = 0
    newest: int = 0
    again: int = 0
    above: bool = False
    below: bool = False
    is_fault: bool = False

    @property
    def held_from(self) -> float:
        """The row from which on it is not known yet whether rows are measurements."""
        if self.level is None:
            return float("inf")
        return self.newest + 1 if self.is_fault else self.first

    def take(
        self, values: Sequence[float], begin: int, before: float, chance: float, patience: int
    ) -> list[tuple[int, int]]:
        """Take the next samples, from row ``begin`` on, after one with the value ``before``.

        Returns spans of rows (first, end) that are no measurements; they may begin before these samples. ``chance``:
        probability of a repetition. ``patience``: rows after which a level is no longer waited for.
        """
        wrong: list[tuple[int, int]] = []
        if chance > LIKELIEST:
            self.level = None
            return wrong
        for row, value in enumerate(values, begin):
            if value == self.level:
                self._again(row, chance, wrong)
            else:
                if self.level is not None:
                    self._other(value, row, patience if self.is_fault or chance * patience <= _RARELY else 0)
                if value == before and not (self.level is not None and self.is_fault):
                    self._begin(value, row)
            before = value
        return wrong

    def _begin(self, value: float, row: int) -> None:
        self.level, self.first, self.newest, self.again = value, row, row, 1
        self.above = self.below = self.is_fault = False

    def _again(self, row: int, chance: float, wrong: list[tuple[int, int]]) -> None:
        since, self.newest = self.newest + 1, row
        self.again += 1
        if self.is_fault:
            wrong.append((since, row + 1))
        elif self._is_no_chance(chance):
            self.is_fault = True
            wrong.append((self.first, row + 1))

    def _other(self, value: float, row: int, patience: int) -> None:
        assert self.level is not None
        self.above |= value > self.level
        self.below |= value < self.level
        waited = row - self.newest > patience or (not self.is_fault and row - self.first >= _MOST_HELD)
        if waited or (self.above and self.below):
            self.level = None

    def _is_no_chance(self, chance: float) -> bool:
        n, j = self.newest - self.first + 1, self.again
        ways = lgamma(n + 1) - lgamma(j + 1) - lgamma(n - j + 1)
        return ways + j * log(max(chance, _RAREST)) < _IMPOSSIBLE

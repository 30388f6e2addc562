"""The history of marginalised keyframes gives their smoothed states long after they left the window.

A marginalised keyframe keeps its conditional on the next one and on the shared variables, ``R x_k + S (x_k+1, s) = d``.
Back-substitution along these carries what the window learns to older keyframes, without any of their factors
(Bierman, "Factorization methods for discrete sequential estimation", 1977).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import reduce
from itertools import pairwise

import numpy as np

from trackfg.factors.family import Family
from trackfg.factors.marginal_prior import change_of_linearisation_point
from trackfg.factors.states import KEYFRAME_DIM, States
from trackfg.numerics.arrays import Array
from trackfg.numerics.spans import true_runs
from trackfg.output.events import REPORTED_TYPES
from trackfg.solver.elimination import Conditionals
from trackfg.solver.square_root import SquareRoot
from trackfg.streaming.window.window import MarginalisedKeyframes, Window

_AT_REST_M = 0.01
"""A vehicle that moves less from one keyframe to the next is at rest, m."""


@dataclass
class MarginalisedHistory:
    """Consecutive keyframes that left the window, one by one in ``parts``, and the ``families`` that events are made
    from; keyframe 0 is the oldest part.
    """

    parts: list[MarginalisedKeyframes] = field(default_factory=list)
    families: tuple[Family, ...] = ()

    @property
    def t(self) -> Array:
        """Times of the keyframes, s, shape (h,)."""
        return np.concatenate([np.zeros(0), *(part.t for part in self.parts)])

    def append(self, keyframes: MarginalisedKeyframes) -> None:
        """Append the next keyframes that left."""
        self.families = self.with_later_families(keyframes.families)
        for k in range(len(keyframes.t)):
            conditional = Conditionals(*(part[k : k + 1].copy() for part in keyframes.conditionals))
            point = keyframes.linearisation_point.take(slice(k, k + 2))
            self.parts.append(MarginalisedKeyframes(keyframes.t[k : k + 1], conditional, point))

    def forget(self, before: float, *, at_most: int | None = None) -> None:
        """Drop keyframes whose next one is not later than ``before``, s; and the oldest beyond ``at_most``."""
        count = 0 if at_most is None else max(len(self.parts) - at_most, 0)
        while len(self.parts) > count + 1 and self.parts[count + 1].t[0] <= before:
            count += 1
        self.parts = self.parts[count:]
        self.families = tuple(family.take(family.first_keyframe >= count).shifted(-count) for family in self.families)

    def shift(self, by_m: float) -> None:
        """Shift the keyframes ``by_m`` along the track, with what they know of each other."""
        if by_m:
            self.parts = [
                part._replace(linearisation_point=part.linearisation_point.moved_along(by_m)) for part in self.parts
            ]

    def collapse_rests(self, before: float) -> Array:
        """Merge the keyframes of each rest up to ``before`` (s) into one at its begin: a vehicle may stand for hours.

        Returns the rests, s, shape (r, 2).
        """
        distances = [part.linearisation_point.odo.distance.tolist() for part in self.parts]
        t, moved = self.t, np.array([later - earlier for earlier, later in distances])
        at_rest = (np.abs(moved[:-1]) < _AT_REST_M) & (t[1:] < before)
        rests = [(i, j) for i, j in true_runs(at_rest) if j - i > 1]
        for i, j in reversed(rests):
            self.parts[i:j] = [reduce(_merge, self.parts[i:j])]
            earlier = (family.take(family.first_keyframe <= i) for family in self.families)
            later = (family.take(family.first_keyframe >= j).shifted(i + 1 - j) for family in self.families)
            self.families = tuple(a.joined(b) for a, b in zip(earlier, later, strict=True))
        return np.array([(t[i], t[j]) for i, j in rests]).reshape(-1, 2)

    def with_later_families(self, later: Iterable[Family]) -> tuple[Family, ...]:
        """Return the families of these keyframes joined with those of the keyframes that follow."""
        by_type = {family.type: family for family in self.families}
        for family in later:
            if family.type in REPORTED_TYPES:
                shifted = family.shifted(len(self.parts))
                by_type[family.type] = by_type[family.type].joined(shifted) if family.type in by_type else shifted
        return tuple(by_type.values())

    def joined_with(self, window: Window, root: SquareRoot) -> tuple[Array, States, SquareRoot]:
        """Return times, states and square root of the information of these keyframes and of the window's, in a row."""
        states = [window.states]
        for begin, end in reversed(_left_together(self.parts)):
            states.append(_joined(self.parts[begin:end]).back_substitute(states[-1]))
        oldest, *later = reversed(states)
        R, S, d = (
            np.concatenate([*(part.conditionals[i] for part in self.parts), newest])
            for i, newest in enumerate((root.R, root.S, root.d))
        )
        ahead = np.zeros(len(R), dtype=np.int64)
        return (
            np.concatenate([self.t, window.t]),
            oldest.joined(*later),
            SquareRoot(R, S, d, root.R_shared, root.d_shared, ahead),
        )


def _merge(first: MarginalisedKeyframes, second: MarginalisedKeyframes) -> MarginalisedKeyframes:
    """Return the first keyframe's conditional on the one after the second, which is eliminated.

    The rows ``R x + S (x', s) = d`` of both are stacked with x' and s at the linearisation point of the second.
    """
    (R, S, d), (R_next, S_next, d_next) = ([part[0] for part in keyframe.conditionals] for keyframe in (first, second))
    point, next_point = first.linearisation_point, second.linearisation_point
    J, c = change_of_linearisation_point(point.take(slice(1, 2)), next_point.take(slice(0, 1)))
    d = d - S @ np.concatenate([c.keyframes[0], c.shared])
    S = S @ J
    n = KEYFRAME_DIM
    rows = np.zeros((2 * n, 2 * n + S.shape[1] + 1))  # x', x, x'', s, right-hand side
    rows[:n, :n], rows[:n, n : 2 * n], rows[:n, 3 * n : -1], rows[:n, -1] = S[:, :n], R, S[:, n:], d
    rows[n:, :n], rows[n:, 2 * n : -1], rows[n:, -1] = R_next, S_next, d_next
    remainder = np.asarray(np.linalg.qr(rows, mode="r"))[n:, n:]
    remainder *= np.sign(np.diagonal(remainder))[:, None]
    merged = Conditionals(remainder[None, :, :n], remainder[None, :, n:-1], remainder[None, :, -1])
    return MarginalisedKeyframes(first.t, merged, point.take(slice(0, 1)).joined(next_point.take(slice(1, 2))))


def _left_together(parts: list[MarginalisedKeyframes]) -> list[tuple[int, int]]:
    """Return the first keyframe and the one after the last of each pass that marginalised some of them.

    In one pass the next keyframe of the first was linearised at the linearisation point of the second.
    """
    if not parts:
        return []
    points = [part.linearisation_point for part in parts]
    p, imu = (np.array(values) for values in ([point.nav.p for point in points], [point.imu for point in points]))
    apart = (p[:-1, 1] != p[1:, 0]).any(axis=1) | (imu[:-1] != imu[1:]).any(axis=(1, 2))
    edges = [0, *(np.flatnonzero(apart) + 1).tolist(), len(parts)]
    return list(pairwise(edges))


def _joined(parts: list[MarginalisedKeyframes]) -> MarginalisedKeyframes:
    """Return keyframes that were marginalised in one pass, without their factors."""
    conditionals = zip(*(part.conditionals for part in parts), strict=True)
    oldest, *later = (part.linearisation_point.take(slice(0, 1)) for part in parts)
    return MarginalisedKeyframes(
        np.concatenate([part.t for part in parts]),
        Conditionals(*(np.concatenate(same) for same in conditionals)),
        oldest.joined(*later, parts[-1].linearisation_point.take(slice(1, 2))),
    )

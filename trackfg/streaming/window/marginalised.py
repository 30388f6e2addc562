"""Keyframes that left the window and are still needed, estimated from all that came since.

A keyframe that leaves has a conditional on the next one and on the shared variables, ``R x_k + S (x_k+1, s) = d``. What
the window learns about these goes back along the conditionals to the keyframes before, without any of the factors:
:meth:`~trackfg.streaming.window.window.Gone.before`. (Bierman, "Factorization methods for discrete sequential
estimation", 1977.)
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import reduce

import numpy as np

from trackfg.factors.family import Family
from trackfg.factors.marginal_prior import change_of_linearisation_point
from trackfg.factors.states import KEYFRAME_DIM, States
from trackfg.numerics.arrays import Array
from trackfg.numerics.spans import true_runs
from trackfg.output.events import TOLD
from trackfg.solver.elimination import Conditionals
from trackfg.solver.square_root import SquareRoot
from trackfg.streaming.window.window import Gone, Window

_STOOD_M = 0.01
"""A vehicle that moves less from one keyframe to the next stands."""


@dataclass
class History:
    """Some keyframes in a row, each with what :class:`~trackfg.streaming.window.window.Gone` holds of it, and together
    those of their ``families`` that events are told by; keyframe 0 is the first of them.
    """

    parts: list[Gone] = field(default_factory=list)
    families: tuple[Family, ...] = ()

    @property
    def t(self) -> Array:
        """Their times, s, shape (h,)."""
        return np.concatenate([np.zeros(0), *(part.t for part in self.parts)])

    def append(self, gone: Gone) -> None:
        """The next ones that left, one by one."""
        self.families = self.with_families(gone.families)
        for k in range(len(gone.t)):
            one = Conditionals(*(part[k : k + 1].copy() for part in gone.conditionals))
            self.parts.append(Gone(gone.t[k : k + 1], one, gone.origin.take(slice(k, k + 2))))

    def forget(self, before: float, *, at_most: int | None = None) -> None:
        """Those whose next keyframe is not later than ``before``, s; and the oldest that are more than ``at_most``."""
        count = 0 if at_most is None else max(len(self.parts) - at_most, 0)
        while len(self.parts) > count + 1 and self.parts[count + 1].t[0] <= before:
            count += 1
        self.parts = self.parts[count:]
        self.families = tuple(family.take(family.first_keyframe >= count).shifted(-count) for family in self.families)

    def stood(self, before: float) -> Array:
        """Merge the keyframes of each rest that ended ``before`` then (s), or goes on, into one at its begin: a vehicle
        may stand for hours. The rests, s, shape (r, 2).
        """
        t, moved = self.t, np.array([np.diff(part.origin.odo.distance)[0] for part in self.parts])
        still = (np.abs(moved[:-1]) < _STOOD_M) & (t[1:] < before)
        rests = [(i, j) for i, j in true_runs(still) if j - i > 1]
        for i, j in reversed(rests):
            self.parts[i:j] = [reduce(_merged, self.parts[i:j])]
            earlier = (family.take(family.first_keyframe <= i) for family in self.families)
            later = (family.take(family.first_keyframe >= j).shifted(i + 1 - j) for family in self.families)
            self.families = tuple(a.joined(b) for a, b in zip(earlier, later, strict=True))
        return np.array([(t[i], t[j]) for i, j in rests]).reshape(-1, 2)

    def with_families(self, later: Iterable[Family]) -> tuple[Family, ...]:
        """Those of these keyframes, and the same ones of keyframes that follow, in a row."""
        known = {family.type: family for family in self.families}
        for family in later:
            if family.type in TOLD:
                own = family.shifted(len(self.parts))
                known[family.type] = known[family.type].joined(own) if family.type in known else own
        return tuple(known.values())

    def with_window(self, window: Window, root: SquareRoot) -> tuple[Array, States, SquareRoot]:
        """Times, states and square root of the information of these keyframes and of the window's, in a row."""
        states, end = [window.states], len(self.parts)
        while end:
            begin = end - 1
            while begin and _goes_on(self.parts[begin - 1], self.parts[begin]):
                begin -= 1
            states.append(_together(self.parts[begin:end]).before(states[-1]))
            end = begin
        oldest, *later = reversed(states)
        R, S, d = (
            np.concatenate([*(part.conditionals[i] for part in self.parts), own])
            for i, own in enumerate((root.R, root.S, root.d))
        )
        ahead = np.zeros(len(R), dtype=np.int64)
        return (
            np.concatenate([self.t, window.t]),
            oldest.joined(*later),
            SquareRoot(R, S, d, root.R_shared, root.d_shared, ahead),
        )


def _merged(first: Gone, second: Gone) -> Gone:
    """One keyframe's conditional on the one after the next: that between is eliminated.

    The rows ``R x + S (x', s) = d`` of both, with x' and s of the first from where those of the second are linearised.
    """
    (R, S, d), (R_next, S_next, d_next) = ([part[0] for part in one.conditionals] for one in (first, second))
    J, c = change_of_linearisation_point(first.origin.take(slice(1, 2)), second.origin.take(slice(0, 1)))
    d = d - S @ np.concatenate([c.keyframes[0], c.shared])
    S = S @ J
    n = KEYFRAME_DIM
    rows = np.zeros((2 * n, 2 * n + S.shape[1] + 1))  # x', x, x'', s, right-hand side
    rows[:n, :n], rows[:n, n : 2 * n], rows[:n, 3 * n : -1], rows[:n, -1] = S[:, :n], R, S[:, n:], d
    rows[n:, :n], rows[n:, 2 * n : -1], rows[n:, -1] = R_next, S_next, d_next
    left = np.asarray(np.linalg.qr(rows, mode="r"))[n:, n:]
    left *= np.sign(np.diagonal(left))[:, None]
    merged = Conditionals(left[None, :, :n], left[None, :, n:-1], left[None, :, -1])
    return Gone(first.t, merged, first.origin.take(slice(0, 1)).joined(second.origin.take(slice(1, 2))), ())


def _goes_on(first: Gone, second: Gone) -> bool:
    """Whether the second was linearised where the first took it to be: both left the window together."""
    here, there = first.origin.take(slice(1, 2)), second.origin
    return np.array_equal(here.nav.p, there.nav.p[:1]) and np.array_equal(here.imu, there.imu)


def _together(parts: list[Gone]) -> Gone:
    """Keyframes that left together, without their factors."""
    conditionals = Conditionals(
        *(np.concatenate(own) for own in zip(*(part.conditionals for part in parts), strict=True))
    )
    oldest, *others = (part.origin.take(slice(0, 1)) for part in parts)
    return Gone(
        np.concatenate([part.t for part in parts]),
        conditionals,
        oldest.joined(*others, parts[-1].origin.take(slice(1, 2))),
    )

"""Keyframes that left the window and are still needed, estimated from all that came since.

A keyframe that leaves has a conditional on the next one and on the shared variables, ``R x_k + S (x_k+1, s) = d``. What
the window learns about these goes back along the conditionals to the keyframes before: the smoother of Rauch, Tung and
Striebel, without any of the factors. (Bierman, "Factorization methods for discrete sequential estimation", 1977.)
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from trackfg.elimination import Conditionals
from trackfg.factors.past import moved_from, step_from
from trackfg.factors.states import States, Step
from trackfg.frames import Array
from trackfg.square_root import SquareRoot
from trackfg.streaming.window import Gone, Window


@dataclass
class History:
    """Some keyframes in a row, each with what :class:`~trackfg.streaming.window.Gone` holds of it."""

    parts: list[Gone] = field(default_factory=list)

    @property
    def t(self) -> Array:
        """Their times, s, shape (h,)."""
        return np.concatenate([np.zeros(0), *(part.t for part in self.parts)])

    def append(self, gone: Gone) -> None:
        """The next ones that left, one by one."""
        for k in range(len(gone.t)):
            one = Conditionals(*(part[k : k + 1].copy() for part in gone.conditionals))
            self.parts.append(Gone(gone.t[k : k + 1], one, gone.origin.take(slice(k, k + 2))))

    def forget(self, before: float, *, at_most: int | None = None) -> None:
        """Those whose next keyframe is not later than ``before``, s; and the oldest that are more than ``at_most``."""
        while len(self.parts) > 1 and self.parts[1].t[0] <= before:
            del self.parts[0]
        if at_most is not None:
            del self.parts[:-at_most]

    def with_window(self, window: Window, root: SquareRoot) -> tuple[Array, States, SquareRoot]:
        """Times, states and square root of the information of these keyframes and of the window's, in a row."""
        states = [window.states]
        for part in reversed(self.parts):
            states.append(_estimated(part, states[-1]))
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


def _estimated(part: Gone, later: States) -> States:
    """One keyframe from the states of those after it."""
    origin = part.origin
    step = step_from(origin.take(slice(1, 2)), later.take(slice(0, 1)))
    y = np.concatenate([step.keyframes[0], step.shared])
    x = np.linalg.solve(part.conditionals.R[0], part.conditionals.d[0] - part.conditionals.S[0] @ y)
    return moved_from(origin.take(slice(0, 1)), Step(x[None], step.shared))

"""The square root of an information matrix of a chain of keyframes comes with the solution.

Elimination (:mod:`trackfg.solver.elimination`) leaves for keyframe k with tangent x_k and the variables s that the run
shares

    R_k x_k + S_k y_k = d_k + e,   e ~ N(0, I),   y_k = (x_{k+1}, s, nav_{k+2}, ..., nav_{k+w}),

where the reach w is 1 unless a factor ties keyframes further apart (two passes of lasers over one place).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np
from scipy.linalg.lapack import dtrtri

from trackfg.factors.states import KEYFRAME_DIM, SHARED_DIM, Kind, Step, offset_in_keyframe
from trackfg.numerics.arrays import Array
from trackfg.numerics.key_figures import Outlined

SIZE = KEYFRAME_DIM + SHARED_DIM
"""Of (x_k, s) without further sensors."""

NAV_DIM = Kind.NAV.dim
NAV = slice(offset_in_keyframe(Kind.NAV), offset_in_keyframe(Kind.NAV) + NAV_DIM)
"""Where the navigation state is in x_k."""


@dataclass(frozen=True, repr=False)
class SquareRoot(Outlined):
    """The square root consists of the conditionals of all keyframes, and of s.

    With K = KEYFRAME_DIM: ``R`` (n, K, K), ``S`` (n, K, SIZE + NAV_DIM (w - 1)), ``d`` (n, K). Columns
    of S: x_{k+1}, s, then the navigation states of k + 2 and so on. ``ahead`` (n,): how many of these a recursion has
    to carry at k, because this keyframe or an earlier one has them as parents: 0 along a chain.
    """

    R: Array
    S: Array
    d: Array
    R_shared: Array
    d_shared: Array
    ahead: np.ndarray

    @cached_property
    def size(self) -> int:
        """The number of variables in (x_k, s)."""
        return KEYFRAME_DIM + len(self.R_shared)

    def last(self, keyframes: int) -> SquareRoot:
        """Return the square root of the last keyframes alone, all others eliminated; along a chain."""
        return replace(
            self, R=self.R[-keyframes:], S=self.S[-keyframes:], d=self.d[-keyframes:], ahead=self.ahead[-keyframes:]
        )

    @cached_property
    def inverse(self) -> Array:
        """R^-1, in the shape of R."""
        inverse = np.empty_like(self.R)
        for own, R in zip(inverse, self.R, strict=True):
            own[:] = dtrtri(R)[0]
        return inverse

    @cached_property
    def shared_inverse(self) -> Array:
        """R^-1 of the shared variables."""
        return np.asarray(dtrtri(self.R_shared)[0])

    @cached_property
    def regression(self) -> Array:
        """``A_k = -R_k^-1 S_k``: the mean of x_k is ``A_k y_k + R_k^-1 d_k``. Shape of S."""
        product = self.inverse @ self.S
        return np.negative(product, out=product)

    def parents(self, k: int) -> int:
        """Return the size of y_k as far as it is carried; of y_{-1}, behind the first keyframe, that of (x_0, s)."""
        return self.size + NAV_DIM * (self._reach[k] if k >= 0 else 0)

    def kept(self, k: int) -> np.ndarray | slice:
        """Return which entries of y_k are in y_{k-1} behind x_k: s, and the navigation states from k + 1 on."""
        count = self._reach[k - 1] if k > 0 else 0
        return _kept(self.size, count) if count else slice(KEYFRAME_DIM, self.size)

    @cached_property
    def _reach(self) -> list[int]:
        return [int(count) for count in self.ahead]

    def solution(self) -> Step:
        """Return the least-squares solution, backwards from the last keyframe."""
        n = len(self.R)
        shared = self.shared_inverse @ self.d_shared
        x = np.empty((n, KEYFRAME_DIM))
        y = np.zeros(self.parents(n - 1))
        y[KEYFRAME_DIM : self.size] = shared
        for k in range(n - 1, -1, -1):
            x[k] = self.inverse[k] @ (self.d[k] - self.S[k, :, : y.size] @ y)
            y = np.concatenate([x[k], y[self.kept(k)]])
        return Step(x, shared)

    @property
    def length(self) -> float:
        """The length of the solution in posterior sigmas, ``|R x|``; half its square is what it takes off the cost."""
        return float(np.sqrt(np.sum(self.d**2) + np.sum(self.d_shared**2)))


@lru_cache
def _kept(size: int, count: int) -> np.ndarray:
    later = size + np.arange(NAV_DIM * (count - 1))
    return np.concatenate([np.arange(KEYFRAME_DIM, size), np.arange(NAV.start, NAV.stop), later])

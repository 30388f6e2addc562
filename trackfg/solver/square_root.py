"""The square root of an information matrix of a chain of keyframes comes with the solution.

Elimination (:mod:`trackfg.solver.elimination`) leaves for keyframe k with tangent x_k and the variables s that the run
shares

    R_k x_k + S_k y_k = d_k + e,   e ~ N(0, I),   y_k = (x_{k+1}, s, nav_{k+2}, ..., nav_{k+w}),

where the reach w is 1 unless a factor ties keyframes further apart (two passes of lasers over one place). It differs
from keyframe to keyframe, so what belongs to navigation states beyond x_{k+1} is kept apart, row after row.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache

import numpy as np
from scipy.linalg.lapack import dtrtri

from trackfg.factors.states import KEYFRAME_DIM, SHARED_DIM, Kind, Step, offset_in_keyframe
from trackfg.numerics.arrays import Array
from trackfg.numerics.kernels import compiled_kernels, kernel_argument
from trackfg.numerics.key_figures import Outlined

SIZE = KEYFRAME_DIM + SHARED_DIM
"""Of (x_k, s) without further sensors."""

NAV_DIM = Kind.NAV.dim
NAV = slice(offset_in_keyframe(Kind.NAV), offset_in_keyframe(Kind.NAV) + NAV_DIM)
"""Where the navigation state is in x_k."""


@dataclass(frozen=True, repr=False)
class SquareRoot(Outlined):
    """The square root consists of the conditionals of all keyframes, and of s.

    With K = KEYFRAME_DIM: ``R`` (n, K, K), ``d`` (n, K), and of S_k the columns of (x_{k+1}, s) in ``S`` (n, K, SIZE),
    those of the navigation states of k + 2 and so on as rows of ``beyond`` (NAV_DIM sum(ahead), K), keyframe after
    keyframe. ``ahead`` (n,): how many of these states a recursion has to carry at k, because this keyframe or an
    earlier one has them as parents: 0 along a chain. ``before`` is the same of the keyframe before the first, where
    these are some keyframes of a longer chain.
    """

    R: Array
    S: Array
    d: Array
    R_shared: Array
    d_shared: Array
    ahead: np.ndarray
    beyond: Array = field(default_factory=lambda: np.zeros((0, KEYFRAME_DIM)))
    before: int = 0

    @property
    def size(self) -> int:
        """The number of variables in (x_k, s)."""
        return int(self.S.shape[2])

    def first(self, keyframes: int) -> SquareRoot:
        """Return the conditionals of the first keyframes on those after them; along a chain."""
        some = slice(0, keyframes)
        return replace(self, R=self.R[some], S=self.S[some], d=self.d[some], ahead=self.ahead[some])

    def last(self, keyframes: int) -> SquareRoot:
        """Return the square root of the last keyframes alone, all others eliminated; along a chain."""
        if keyframes >= len(self.R):
            return self
        return replace(
            self, R=self.R[-keyframes:], S=self.S[-keyframes:], d=self.d[-keyframes:], ahead=self.ahead[-keyframes:]
        )

    def part(self, begin: int, end: int) -> SquareRoot:
        """Return the conditionals of keyframes from ``begin`` to before ``end``, on those after them."""
        some, rows = slice(begin, end), slice(self._begins[begin], self._begins[end])
        return replace(
            self,
            R=self.R[some],
            S=self.S[some],
            d=self.d[some],
            ahead=self.ahead[some],
            beyond=self.beyond[rows],
            before=self._reach[begin - 1] if begin else self.before,
        )

    @cached_property
    def inverse(self) -> Array:
        """R^-1, in the shape of R."""
        inverse = np.empty_like(self.R)
        for block, R in zip(inverse, self.R, strict=True):
            block[:] = dtrtri(R)[0]
        return inverse

    @cached_property
    def shared_inverse(self) -> Array:
        """R^-1 of the shared variables."""
        return np.asarray(dtrtri(self.R_shared)[0])

    @cached_property
    def shared_covariance(self) -> Array:
        """The covariance of the shared variables."""
        return np.asarray(self.shared_inverse @ self.shared_inverse.T)

    def on_parents(self, k: int) -> Array:
        """Return S_k over all of y_k."""
        return np.concatenate([self.S[k], self.beyond[self._rows_beyond(k)].T], axis=1) if self._reach[k] else self.S[k]

    def regression(self, k: int) -> Array:
        """Return ``A_k = -R_k^-1 S_k``: the mean of x_k is ``A_k y_k + R_k^-1 d_k``."""
        product = self.inverse[k] @ self.on_parents(k)
        return np.asarray(np.negative(product, out=product))

    def _rows_beyond(self, k: int) -> slice:
        return slice(self._begins[k], self._begins[k + 1])

    def parents(self, k: int) -> int:
        """Return the size of y_k as far as it is carried; of y_{-1}, before a chain, that of (x_0, s)."""
        return self.size + NAV_DIM * (self._reach[k] if k >= 0 else self.before)

    def kept(self, k: int) -> np.ndarray | slice:
        """Return which entries of y_k are in y_{k-1} behind x_k: s, and the navigation states from k + 1 on."""
        count = self._reach[k - 1] if k > 0 else self.before
        return _kept(self.size, count) if count else slice(KEYFRAME_DIM, self.size)

    @cached_property
    def _reach(self) -> list[int]:
        return [int(count) for count in self.ahead]

    @cached_property
    def _begins(self) -> list[int]:
        return [int(begin) for begin in begins_beyond(self.ahead)]

    def conditionals(self) -> tuple[Array, Array, Array, np.ndarray, tuple[int, int]]:
        """Return those of all keyframes as the kernels take them (kernels/recursions.cpp), without d."""
        R, S, beyond = map(kernel_argument, (self.R, self.S, self.beyond))
        return R, S, beyond, np.asarray(self.ahead, dtype=np.int64), (NAV.start, NAV_DIM)

    def behind(self, shared: Array) -> Array:
        """Return y_{n-1} where the chain ends, (p, m): nothing but ``shared`` (s, m)."""
        whole = np.zeros((self.parents(len(self.R) - 1), shared.shape[1]))
        whole[KEYFRAME_DIM : self.size] = shared
        return whole

    def back_substituted(self, right: Array, behind: Array) -> tuple[Array, Array]:
        """Return x of ``R_k x_k + S_k y_k = right_k``, over ``right`` (n, K, m), and y_{-1} (p, m).

        ``behind`` (p, m) is y_{n-1}.
        """
        x = kernel_argument(right)
        if compiled_kernels():
            from trackfg.numerics import compiled

            window = self._room_for(behind)
            compiled.back_substitute(*self.conditionals(), self.before, window, x)
            return x, window[: self.parents(-1)]
        window = behind.copy()
        for k in range(len(x) - 1, -1, -1):
            x[k] = self.inverse[k] @ (x[k] - self.on_parents(k) @ window)
            if len(window) == self.parents(k - 1) == self.size:
                window[:KEYFRAME_DIM] = x[k]
            else:
                window = np.concatenate([x[k], window[self.kept(k)]])
        return x, window

    def forward_substituted(self, right: Array, carried: Array | None = None) -> tuple[Array, Array]:
        """Return y of the transposed system, over its right-hand sides ``right`` (n, K, m), and what these add to
        those of y_{n-1}: in rows K to ``size`` to those of s.

        ``carried`` (p, m) is what keyframes before the first add to those of y_{-1}, nothing by default.
        """
        y, columns = kernel_argument(right), right.shape[2]
        carried = np.zeros((self.parents(-1), columns)) if carried is None else carried
        if compiled_kernels():
            from trackfg.numerics import compiled

            window = self._room_for(carried)
            compiled.forward_substitute(*self.conditionals(), self.before, window, y)
            return y, window[: self.parents(len(y) - 1)]
        taken = -carried
        for k in range(len(y)):
            y[k] = self.inverse[k].T @ (y[k] - taken[:KEYFRAME_DIM])
            ahead = self.on_parents(k).T @ y[k]
            ahead[self.kept(k)] += taken[KEYFRAME_DIM:]
            taken = ahead
        return y, -taken

    def _room_for(self, parents: Array) -> Array:
        """Return the values of one y_k (p, m) as the first rows of an array for the widest."""
        window = np.empty((self.size + NAV_DIM * max(self.before, *self._reach), parents.shape[1]))
        window[: len(parents)] = parents
        return window

    def solution(self) -> Step:
        """Return the least-squares solution, backwards from the last keyframe."""
        shared = self.shared_inverse @ self.d_shared
        keyframes, _ = self.back_substituted(self.d[:, :, None].copy(), self.behind(shared[:, None]))
        return Step(keyframes[:, :, 0], shared)

    @cached_property
    def length(self) -> float:
        """The length of the solution in posterior sigmas, ``|R x|``; half its square is what it takes off the cost."""
        d = self.d.ravel()
        return math.sqrt(d @ d + self.d_shared @ self.d_shared)


def begins_beyond(ahead: np.ndarray) -> np.ndarray:
    """Return where the rows of each keyframe begin in ``beyond``, and where they end, shape (n + 1,)."""
    return np.concatenate([np.zeros(1, dtype=np.int64), NAV_DIM * np.cumsum(ahead, dtype=np.int64)])


@lru_cache
def _kept(size: int, count: int) -> np.ndarray:
    later = size + np.arange(NAV_DIM * (count - 1))
    return np.concatenate([np.arange(KEYFRAME_DIM, size), np.arange(NAV.start, NAV.stop), later])

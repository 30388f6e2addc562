"""Posterior covariances and posterior samples by backward recursions over the Bayes net.

Elimination along the chain leaves, for keyframe k with tangent x_k and the shared variables s,

    R_k x_k + S_k y_k = d_k + e,   e ~ N(0, I),   y_k = (x_{k+1}, s, nav_{k+2}, ..., nav_{k+w}),

where the reach w is 1 unless a factor ties keyframes further apart (two passes of lasers over one place). With
``A_k = -R_k^-1 S_k`` therefore ``x_k = A_k y_k + R_k^-1 e``: backwards from the last keyframe, covariances of the
moving window (x_k, y_k) follow, or, with drawn e, samples of all states together. (Bierman, "Factorization methods for
discrete sequential estimation", 1977, ch. X; here with GTSAM's QR factors. ``gtsam.Marginals`` has no QR.)
"""

from __future__ import annotations

from dataclasses import dataclass

import gtsam
import numpy as np

from trackfg.factors.states import ELIMINATION_ORDER, KEYFRAME_DIM, SHARED, SHARED_DIM, Kind, offset_in_keyframe
from trackfg.frames import Array

_SIZE = KEYFRAME_DIM + SHARED_DIM
_NAV = slice(offset_in_keyframe(Kind.NAV), offset_in_keyframe(Kind.NAV) + Kind.NAV.dim)


@dataclass(frozen=True)
class Covariance:
    """``marginal`` (n, d, d): covariance of z_k = (x_k, s); ``gain`` (n - 1, d, d): regression of z_k on z_{k+1}.

    d is 19 + 26, elimination order.
    """

    marginal: Array
    gain: Array

    def of(self, kind: Kind) -> Array:
        """Marginal covariance of one kind: (n, dim, dim), or (1, dim, dim) for a shared one."""
        start = offset_in_keyframe(kind)
        rows = self.marginal[:1] if kind.shared else self.marginal
        return rows[:, start : start + kind.dim, start : start + kind.dim]

    def between(self, i: int, j: int) -> Array:
        """Cross-covariance of keyframes ``i <= j``, shape (d, d).

        Exact for a chain; with a longer reach exact for neighbours, and carried from neighbour to neighbour beyond.
        """
        out: Array = self.marginal[j]
        for k in range(j - 1, i - 1, -1):
            out = self.gain[k] @ out
        return out


@dataclass(frozen=True)
class SquareRoot:
    """The Bayes net as arrays: ``inverse`` (n, 19, 19) R^-1, ``regression`` (n, 19, d + 9 (w - 1)) A, and R^-1 of s.

    ``ahead`` (n,): how many navigation states after x_{k+1} the recursion has to carry at k, because an earlier
    keyframe has them as parents: 0 along a chain.
    """

    inverse: Array
    regression: Array
    shared_inverse: Array
    ahead: np.ndarray

    def parents(self, k: int) -> int:
        """The size of y_k as far as it is carried."""
        return _SIZE + Kind.NAV.dim * int(self.ahead[k])

    def kept(self, k: int) -> np.ndarray:
        """Which entries of y_k are in y_{k-1} behind x_k: s, and the navigation states from k + 1 on."""
        count = int(self.ahead[k - 1]) if k > 0 else 0
        nav = np.arange(_NAV.start, _NAV.stop)[: Kind.NAV.dim * min(count, 1)]
        later = _SIZE + np.arange(Kind.NAV.dim * max(count - 1, 0))
        return np.concatenate([np.arange(KEYFRAME_DIM, _SIZE), nav, later])


def square_root(bayes_net: gtsam.GaussianBayesNet, keyframes: int) -> SquareRoot:
    """Collect the conditionals of a Bayes net eliminated keyframe by keyframe, shared variables last."""
    columns: dict[int, tuple[int, int, int]] = {}
    index = np.arange(keyframes)
    for kind in ELIMINATION_ORDER:
        for k, key in enumerate(kind.keys(index).tolist()):
            columns[key] = (k, offset_in_keyframe(kind), kind.dim)
    for kind in SHARED:
        columns[int(kind.keys(np.array([0]))[0])] = (-1, offset_in_keyframe(kind), kind.dim)

    conditionals = [bayes_net.at(i) for i in range(bayes_net.size())]
    families = [[columns[key] for key in list(conditional.keys())] for conditional in conditionals]
    last = np.arange(1, keyframes + 1)
    for own, *parents in families:
        if own[0] >= 0:
            last[own[0]] = max([last[own[0]], *(parent[0] for parent in parents)])
    ahead = np.maximum.accumulate(last) - np.arange(keyframes) - 1
    R = np.zeros((keyframes, KEYFRAME_DIM, KEYFRAME_DIM))
    S = np.zeros((keyframes, KEYFRAME_DIM, _SIZE + Kind.NAV.dim * int(ahead.max())))
    shared_R = np.zeros((SHARED_DIM, SHARED_DIM))
    for conditional, ((k, row, dim), *parents) in zip(conditionals, families, strict=True):
        rows = slice(row, row + dim)
        if k < 0:
            rows = slice(row - KEYFRAME_DIM, row - KEYFRAME_DIM + dim)
        (shared_R if k < 0 else R[k])[rows, rows] = conditional.R()
        blocks, at = conditional.S(), 0
        for other, column, width in parents:
            block = blocks[:, at : at + width]
            at += width
            if k < 0:
                shared_R[rows, column - KEYFRAME_DIM : column - KEYFRAME_DIM + width] = block
            elif other == k:
                R[k, rows, column : column + width] = block
            else:
                if other > k + 1:
                    column = column - _NAV.start + _SIZE + Kind.NAV.dim * (other - k - 2)
                S[k, rows, column : column + width] = block
    inverse = np.asarray(np.linalg.inv(R), dtype=np.float64)
    return SquareRoot(inverse, -inverse @ S, np.asarray(np.linalg.inv(shared_R), dtype=np.float64), ahead)


def posterior_covariance(root: SquareRoot) -> Covariance:
    """Run the recursion. Cost is linear in the number of keyframes."""
    n = len(root.inverse)
    spread = root.inverse @ np.swapaxes(root.inverse, 1, 2)
    marginal, cross = np.zeros((n, _SIZE, _SIZE)), np.zeros((n, _SIZE, _SIZE))
    window = np.zeros((root.parents(n - 1), root.parents(n - 1)))
    window[KEYFRAME_DIM:_SIZE, KEYFRAME_DIM:_SIZE] = root.shared_inverse @ root.shared_inverse.T
    for k in range(n - 1, -1, -1):
        A, kept = root.regression[k, :, : len(window)], root.kept(k)
        ahead = A @ window
        cross[k, :KEYFRAME_DIM] = ahead[:, :_SIZE]
        cross[k, KEYFRAME_DIM:] = window[KEYFRAME_DIM:_SIZE, :_SIZE]
        own = ahead @ A.T + spread[k]
        window = np.block([[own, ahead[:, kept]], [ahead[:, kept].T, window[np.ix_(kept, kept)]]])
        window = 0.5 * (window + window.T)
        marginal[k] = window[:_SIZE, :_SIZE]
    return Covariance(marginal, _gain(root, marginal, cross))


def posterior_samples(root: SquareRoot, count: int, rng: np.random.Generator) -> Array:
    """Tangent vectors (x_k, s) of all keyframes together, drawn from their joint posterior. Shape (n, d, count)."""
    n = len(root.inverse)
    samples = np.empty((n, _SIZE, count))
    noise = root.inverse @ rng.standard_normal((n, KEYFRAME_DIM, count))
    window = np.zeros((root.parents(n - 1), count))
    window[KEYFRAME_DIM:_SIZE] = root.shared_inverse @ rng.standard_normal((SHARED_DIM, count))
    for k in range(n - 1, -1, -1):
        own = root.regression[k, :, : len(window)] @ window + noise[k]
        window = np.concatenate([own, window[root.kept(k)]])
        samples[k] = window[:_SIZE]
    return samples


def _gain(root: SquareRoot, marginal: Array, cross: Array) -> Array:
    if not root.ahead.any():
        gain = np.zeros((len(marginal) - 1, _SIZE, _SIZE))
        gain[:, :KEYFRAME_DIM] = root.regression[:-1]
        gain[:, KEYFRAME_DIM:, KEYFRAME_DIM:] = np.eye(SHARED_DIM)
        return gain
    sd = np.sqrt(np.diagonal(marginal[1:], axis1=1, axis2=2))
    correlation = marginal[1:] / (sd[:, :, None] * sd[:, None, :])
    scaled = np.linalg.solve(correlation, np.swapaxes(cross[:-1] / sd[:, None, :], 1, 2))
    return np.asarray(np.swapaxes(scaled, 1, 2) / sd[:, None, :])

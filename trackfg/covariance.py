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
    """The Bayes net as arrays: ``inverse`` (n, 19, 19) R^-1, ``regression`` (n, 19, d + 9 (w - 1)) A, and R^-1 of s."""

    inverse: Array
    regression: Array
    shared_inverse: Array

    @property
    def reach(self) -> int:
        """How many keyframes on the furthest parent of a keyframe is."""
        return 1 + (self.regression.shape[2] - _SIZE) // Kind.NAV.dim

    @property
    def kept(self) -> np.ndarray:
        """Which of y_k are in y_{k-1} behind x_k: s and the navigation states of k + 1 to k + w - 1."""
        nav = np.arange(_NAV.start, _NAV.stop)
        later = [_SIZE + Kind.NAV.dim * m + np.arange(Kind.NAV.dim) for m in range(self.reach - 2)]
        shared = np.arange(KEYFRAME_DIM, _SIZE)
        return np.concatenate([shared, nav, *later]) if self.reach > 1 else shared


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
    reach = max(max(parent[0] - own[0] for parent in (own, *parents)) for own, *parents in families if own[0] >= 0)
    R = np.zeros((keyframes, KEYFRAME_DIM, KEYFRAME_DIM))
    S = np.zeros((keyframes, KEYFRAME_DIM, _SIZE + Kind.NAV.dim * (max(reach, 1) - 1)))
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
    inverse = np.linalg.inv(R)
    return SquareRoot(inverse, -inverse @ S, np.linalg.inv(shared_R))


def posterior_covariance(root: SquareRoot) -> Covariance:
    """Run the recursion. Cost is linear in the number of keyframes."""
    n, _, d = root.regression.shape
    spread = root.inverse @ np.swapaxes(root.inverse, 1, 2)
    marginal, cross = np.zeros((n, _SIZE, _SIZE)), np.zeros((n, _SIZE, _SIZE))
    window = np.zeros((d, d))
    window[KEYFRAME_DIM:_SIZE, KEYFRAME_DIM:_SIZE] = root.shared_inverse @ root.shared_inverse.T
    kept, size = root.kept, KEYFRAME_DIM + len(root.kept)
    for k in range(n - 1, -1, -1):
        ahead = root.regression[k] @ window
        new = np.zeros((d, d))
        new[:KEYFRAME_DIM, :KEYFRAME_DIM] = ahead @ root.regression[k].T + spread[k]
        new[:KEYFRAME_DIM, KEYFRAME_DIM:size] = ahead[:, kept]
        new[KEYFRAME_DIM:size, :KEYFRAME_DIM] = ahead[:, kept].T
        new[KEYFRAME_DIM:size, KEYFRAME_DIM:size] = window[np.ix_(kept, kept)]
        cross[k, :KEYFRAME_DIM] = ahead[:, :_SIZE]
        cross[k, KEYFRAME_DIM:] = window[KEYFRAME_DIM:_SIZE, :_SIZE]
        window = 0.5 * (new + new.T)
        marginal[k] = window[:_SIZE, :_SIZE]
    return Covariance(marginal, _gain(root, marginal, cross))


def posterior_samples(root: SquareRoot, count: int, rng: np.random.Generator) -> Array:
    """Tangent vectors (x_k, s) of all keyframes together, drawn from their joint posterior. Shape (n, d, count)."""
    n, _, d = root.regression.shape
    samples = np.empty((n, _SIZE, count))
    noise = root.inverse @ rng.standard_normal((n, KEYFRAME_DIM, count))
    window = np.zeros((d, count))
    window[KEYFRAME_DIM:_SIZE] = root.shared_inverse @ rng.standard_normal((SHARED_DIM, count))
    kept, size = root.kept, KEYFRAME_DIM + len(root.kept)
    for k in range(n - 1, -1, -1):
        new = np.zeros((d, count))
        new[:KEYFRAME_DIM] = root.regression[k] @ window + noise[k]
        new[KEYFRAME_DIM:size] = window[kept]
        window = new
        samples[k] = window[:_SIZE]
    return samples


def _gain(root: SquareRoot, marginal: Array, cross: Array) -> Array:
    if root.reach == 1:
        gain = np.zeros((len(marginal) - 1, _SIZE, _SIZE))
        gain[:, :KEYFRAME_DIM] = root.regression[:-1]
        gain[:, KEYFRAME_DIM:, KEYFRAME_DIM:] = np.eye(SHARED_DIM)
        return gain
    sd = np.sqrt(np.diagonal(marginal[1:], axis1=1, axis2=2))
    correlation = marginal[1:] / (sd[:, :, None] * sd[:, None, :])
    scaled = np.linalg.solve(correlation, np.swapaxes(cross[:-1] / sd[:, None, :], 1, 2))
    return np.asarray(np.swapaxes(scaled, 1, 2) / sd[:, None, :])

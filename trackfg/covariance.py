"""Posterior covariances by one backward recursion over the Bayes net.

Elimination along the chain leaves, for keyframe k with tangent x_k and the shared variables s,

    R_k x_k + S_k x_{k+1} + T_k s = d_k + e,   e ~ N(0, I),

so with ``z_k = (x_k, s)``: ``z_k = A_k z_{k+1} + q_k``, ``Cov(q_k) = Q_k``, and ``P_k = A_k P_{k+1} A_k' + Q_k``, from
the last keyframe backwards. The cross-covariance of keyframes i < j is ``A_i ... A_{j-1} P_j``. (Bierman,
"Factorization methods for discrete sequential estimation", 1977, ch. X; here with GTSAM's QR factors.
``gtsam.Marginals`` has no QR.)
"""

from __future__ import annotations

from dataclasses import dataclass

import gtsam
import numpy as np

from trackfg.factors.states import ELIMINATION_ORDER, KEYFRAME_DIM, SHARED, SHARED_DIM, Kind, offset_in_keyframe
from trackfg.frames import Array

_SIZE = KEYFRAME_DIM + SHARED_DIM


@dataclass(frozen=True)
class Covariance:
    """``marginal`` (n, d, d): covariance of (x_k, s); ``gain`` (n - 1, d, d): A_k. d is 19 + 5, elimination order."""

    marginal: Array
    gain: Array

    def of(self, kind: Kind) -> Array:
        """Marginal covariance of one kind: (n, dim, dim), or (1, dim, dim) for a shared one."""
        start = offset_in_keyframe(kind)
        rows = self.marginal[:1] if kind.shared else self.marginal
        return rows[:, start : start + kind.dim, start : start + kind.dim]

    def between(self, i: int, j: int) -> Array:
        """Cross-covariance of keyframes ``i <= j``, shape (d, d)."""
        out: Array = self.marginal[j]
        for k in range(j - 1, i - 1, -1):
            out = self.gain[k] @ out
        return out


def posterior_covariance(bayes_net: gtsam.GaussianBayesNet, keyframes: int) -> Covariance:
    """Run the recursion. Cost is linear in the number of keyframes."""
    R, S = _square_root(bayes_net, keyframes)
    shared_R = R[-1, KEYFRAME_DIM:, KEYFRAME_DIM:]
    inverse = np.linalg.inv(R[:, :KEYFRAME_DIM, :KEYFRAME_DIM])
    gain = np.zeros((keyframes, _SIZE, _SIZE))
    gain[:, :KEYFRAME_DIM] = -inverse @ S
    gain[:, KEYFRAME_DIM:, KEYFRAME_DIM:] = np.eye(SHARED_DIM)
    spread = inverse @ np.swapaxes(inverse, 1, 2)

    marginal = np.zeros((keyframes, _SIZE, _SIZE))
    current = np.zeros((_SIZE, _SIZE))
    shared_inverse = np.linalg.inv(shared_R)
    current[KEYFRAME_DIM:, KEYFRAME_DIM:] = shared_inverse @ shared_inverse.T
    for k in range(keyframes - 1, -1, -1):
        current = gain[k] @ current @ gain[k].T
        current[:KEYFRAME_DIM, :KEYFRAME_DIM] += spread[k]
        current = 0.5 * (current + current.T)
        marginal[k] = current
    return Covariance(marginal, gain[:-1])


def _square_root(bayes_net: gtsam.GaussianBayesNet, keyframes: int) -> tuple[Array, Array]:
    """The Bayes net as dense blocks: R (n, d, d), whose last entry also holds the shared block, and S (n, 19, d)."""
    R = np.zeros((keyframes, _SIZE, _SIZE))
    S = np.zeros((keyframes, KEYFRAME_DIM, _SIZE))
    columns: dict[int, tuple[int, int, int]] = {}
    index = np.arange(keyframes)
    for kind in ELIMINATION_ORDER:
        for k, key in enumerate(kind.keys(index).tolist()):
            columns[key] = (k, offset_in_keyframe(kind), kind.dim)
    for kind in SHARED:
        columns[int(kind.keys(np.array([0]))[0])] = (-1, offset_in_keyframe(kind), kind.dim)

    for i in range(bayes_net.size()):
        conditional = bayes_net.at(i)
        own, *parents = conditional.keys()
        k, row, dim = columns[own]
        R[k, row : row + dim, row : row + dim] = conditional.R()
        blocks, at = conditional.S(), 0
        for parent in parents:
            other, column, width = columns[parent]
            target = R[k] if other == k else S[k]
            target[row : row + dim, column : column + width] = blocks[:, at : at + width]
            at += width
    return R, S

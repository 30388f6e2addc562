"""Recursions over the conditionals of a chain give posterior covariances and samples.

With the square root of :mod:`trackfg.solver.square_root` the error of keyframe k is ``x_k = A_k y_k + R_k^-1 e``:
backwards from the last keyframe, covariances of the moving window (x_k, y_k) follow, or, with drawn e, samples of all
states together. Forwards, with all conditionals stacked as ``R x = e``, the covariance of linear functions ``C x`` is
``Y' Y`` with ``R' Y = C'``. (Bierman, "Factorization methods for discrete sequential estimation", 1977, ch. X.)
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from trackfg.factors.states import KEYFRAME_DIM, Kind, offset_in_keyframe
from trackfg.numerics.arrays import Array
from trackfg.numerics.chained_covariance import Block, ChainedCovariance
from trackfg.numerics.key_figures import Outlined
from trackfg.solver.square_root import SquareRoot

_PLACES_IN_A_BLOCK = 8
"""Places whose functions are carried together: two each are as many rows as a fifth of those of y, beside them."""

_AT_A_TIME = 256
"""Keyframes whose regressions are computed together: what is needed on the way stays small."""


@dataclass(frozen=True, repr=False)
class Covariance(Outlined):
    """The covariance of a chain consists of marginals and of regressions of each keyframe on the next one.

    ``marginal`` (n, d, d): covariance of z_k = (x_k, s); ``gain`` (n - 1, KEYFRAME_DIM, d): regression of x_k on
    z_{k+1}, which has the same s.

    d is KEYFRAME_DIM + SHARED_DIM, in elimination order, and the dimension of each further sensor.
    """

    marginal: Array
    gain: Array

    def of(self, kind: Kind) -> Array:
        """Return the marginal covariance of one kind: (n, dim, dim), or (1, dim, dim) for a shared one.

        Further sensors have one of all together.
        """
        start = offset_in_keyframe(kind)
        if kind is Kind.SENSOR:
            return self.marginal[:1, start:, start:]
        rows = self.marginal[:1] if kind.shared else self.marginal
        return rows[:, start : start + kind.dim, start : start + kind.dim]

    def leading(self, size: int) -> Array:
        """Return those of the first variables of z_k alone, shape (n, size, size)."""
        return self.marginal[:, :size, :size]

    def with_added_distance_variance(self, variance: Array | float) -> Covariance:
        """Return the covariance with so much more variance (n,), m^2, of the distances along the track."""
        if not np.any(variance):
            return self
        at, marginal = offset_in_keyframe(Kind.ODO), self.marginal.copy()
        marginal[:, at, at] += variance
        return replace(self, marginal=marginal)

    def between(self, i: int, j: int) -> Array:
        """Return the cross-covariance of keyframes ``i <= j``, shape (d, d).

        Exact for a chain; with a longer reach exact for neighbours, and carried from neighbour to neighbour beyond.
        """
        out: Array = self.marginal[j]
        for k in range(j - 1, i - 1, -1):
            out = np.concatenate([self.gain[k] @ out, out[KEYFRAME_DIM:]])
        return out


class _Window(NamedTuple):
    """Covariances at keyframe k are those of y_k (p, p), and of x_k with y_k (K, p)."""

    k: int
    ahead: Array
    cross: Array


def _windows(root: SquareRoot, marginal: Array) -> Iterator[_Window]:
    """Go backwards from the last keyframe, and fill in ``marginal``. Cost is linear in the number of keyframes."""
    n, dim, size = len(root.inverse), KEYFRAME_DIM, root.size
    spread = root.inverse @ np.swapaxes(root.inverse, 1, 2)
    ahead = np.zeros((root.parents(n - 1), root.parents(n - 1)))
    ahead[dim:size, dim:size] = root.shared_inverse @ root.shared_inverse.T
    for k in range(n - 1, -1, -1):
        width, kept = root.parents(k - 1), root.kept(k)
        whole = marginal[k] if width == size else np.empty((width, width))
        A = root.regression[k, :, : len(ahead)]
        cross = A @ ahead
        own, both = cross @ A.T + spread[k], cross[:, kept]
        whole[:dim, :dim] = 0.5 * (own + own.T)
        whole[:dim, dim:], whole[dim:, :dim], whole[dim:, dim:] = both, both.T, ahead[kept][:, kept]
        if width > size:
            marginal[k] = whole[:size, :size]
        yield _Window(k, ahead, cross)
        ahead = whole


def posterior_covariance(root: SquareRoot) -> Covariance:
    """Return the posterior covariances of a solution. Cost is linear in the number of keyframes.

    Parameters
    ----------
    root
        The ``root`` of a :class:`Solution`: the square root of the information at the minimum.

    Returns
    -------
    Covariance
        Covariances of the states of keyframes and of neighbours, in the units of the states (SI).

    Examples
    --------
    >>> import trackfg
    >>> from trackfg.graph import build_problem
    >>> from trackfg.solver import posterior_covariance, solve
    >>> settings = trackfg.SmoothConfig()
    >>> solution = solve(build_problem(trackfg.read_recording("run1"), settings), settings.solver)
    >>> covariance = posterior_covariance(solution.root)
    """
    n, dim, size = len(root.inverse), KEYFRAME_DIM, root.size
    marginal, cross = np.empty((n, size, size)), np.empty((n, dim, size)) if root.ahead.any() else None
    for window in _windows(root, marginal):
        if cross is not None:
            cross[window.k] = window.cross[:, :size]
    return Covariance(marginal, root.regression[:-1] if cross is None else _gain(marginal, cross))


def posterior_samples(root: SquareRoot, count: int, rng: np.random.Generator) -> tuple[Array, Array]:
    """Return tangents of all variables together, drawn from their joint posterior.

    Those of the keyframes (n, KEYFRAME_DIM, count), and of the shared variables (s, count).
    """
    n, size = len(root.inverse), root.size
    samples = rng.standard_normal((n, KEYFRAME_DIM, count))
    window = np.zeros((root.parents(n - 1), count))
    shared = window[KEYFRAME_DIM:size] = root.shared_inverse @ rng.standard_normal((size - KEYFRAME_DIM, count))
    for k in range(n - 1, -1, -1):
        samples[k] = root.regression[k, :, : len(window)] @ window + root.inverse[k] @ samples[k]
        window = np.concatenate([samples[k], window[root.kept(k)]])
    return samples, shared


@dataclass(frozen=True, repr=False)
class Functions(Outlined):
    """These are m linear functions of the tangents of keyframes k and k + 1 and of the shared variables.

    ``keyframe`` (m,) ascending; ``by_first``, ``by_second`` (m, KEYFRAME_DIM), ``by_shared`` (m, SHARED_DIM).
    """

    keyframe: np.ndarray
    by_first: Array
    by_second: Array
    by_shared: Array


def joint_covariance(root: SquareRoot, functions: Functions, covariance: Covariance) -> ChainedCovariance:
    """Return the covariance of functions with each other, however far apart they are.

    ``covariance`` is that of the root. With the functions of one keyframe ``f = F_x x_k + F_y y_k`` and
    ``x_k = A_k y_k + e_k``, ``f = D y_k + F_x e_k`` with ``D = F_x A_k + F_y``. Functions of earlier keyframes are
    ``B y_{k-1}`` and what is independent of it, B multiplied by the gains of y_{k-1} on y_k from place to place: within
    a block of some places, at whose start stands y for all before. So the cost is linear in the number of keyframes.
    """
    places, starts = np.unique(functions.keyframe, return_index=True)
    ends = np.append(starts[1:], len(functions.keyframe))
    ahead = _ahead(root, covariance, places)
    blocks, last = [], int(places[0]) - 1 if places.size else 0
    for begin in range(0, len(places), _PLACES_IN_A_BLOCK):
        some = slice(begin, begin + _PLACES_IN_A_BLOCK)
        own = np.arange(starts[begin], ends[some][-1])
        width = root.parents(last)
        carried = np.eye(width)
        cross = np.zeros((width + len(own), len(own)))
        for k, start, stop in zip(places[some].tolist(), starts[some], ends[some], strict=True):
            D, noise = _given_parents(root, functions, k, slice(start, stop))
            for between in range(last + 1, k):
                carried = _carried(root, carried, between)
            before = carried[:, :KEYFRAME_DIM] @ root.inverse[k]
            carried = np.concatenate([_carried(root, carried, k), D])
            part = cross[: len(carried), start - own[0] : stop - own[0]]
            part[:] = carried @ (ahead[k] @ D.T) + np.concatenate([before, noise]) @ noise.T
            last = k
        between_own = np.triu(cross[width:])
        symmetric = between_own + np.triu(between_own, 1).T
        blocks.append(Block(own, symmetric, carried[width:], carried[:width], cross[:width]))
    return ChainedCovariance(tuple(blocks))


def _given_parents(root: SquareRoot, functions: Functions, k: int, own: slice) -> tuple[Array, Array]:
    """Return D and ``F_x R_k^-1`` of functions of keyframe k, which are ``D y_k + F_x R_k^-1 e``."""
    F_x = functions.by_first[own]
    D = F_x @ root.regression[k, :, : root.parents(k)]
    D[:, :KEYFRAME_DIM] += functions.by_second[own]
    D[:, KEYFRAME_DIM : KEYFRAME_DIM + functions.by_shared.shape[1]] += functions.by_shared[own]
    return D, F_x @ root.inverse[k]


def _ahead(root: SquareRoot, covariance: Covariance, keyframes: np.ndarray) -> Mapping[int, Array]:
    """Return the covariances of y_k of some keyframes but the last: along a chain those of z_{k+1}."""
    if not root.ahead.any():
        return {k: covariance.marginal[k + 1] for k in keyframes.tolist()}
    wanted, marginal = set(keyframes.tolist()), np.empty_like(covariance.marginal)
    return {window.k: window.ahead for window in _windows(root, marginal) if window.k in wanted}


def _carried(root: SquareRoot, B: Array, k: int) -> Array:
    """Express functions ``B y_{k-1}`` (m, p) by y_k: ``y_{k-1} = (A_k y_k + e_k, what it keeps of y_k)``."""
    width = root.parents(k)
    out = B[:, :KEYFRAME_DIM] @ root.regression[k, :, :width]
    out[:, root.kept(k)] += B[:, KEYFRAME_DIM:]
    return np.asarray(out)


def covariance_given_next(root: SquareRoot, functions: Functions) -> tuple[Array, Array]:
    """Return the covariance of e, (m, m), and G, (d, m), of functions written as ``G' z + e``.

    z is (x_n, s): the keyframe after the root's last one, which the functions may touch, and the shared variables.
    """
    n, m, dim, size = len(root.inverse), len(functions.keyframe), KEYFRAME_DIM, root.size
    total = np.zeros((m, m))
    carried = np.zeros((size, m))
    own = np.searchsorted(functions.keyframe, np.arange(n + 1))
    for k in range(n):
        right = carried[:dim].copy()
        first, second = slice(own[k], own[k + 1]), slice(own[max(k - 1, 0)], own[k])
        right[:, first] += functions.by_first[first].T
        right[:, second] += functions.by_second[second].T
        active = slice(0, own[k + 1])
        y = root.inverse[k].T @ right[:, active]
        ahead = np.zeros((root.parents(k), m))
        ahead[root.kept(k)] = carried[dim:]
        ahead[:, active] -= root.S[k, :, : len(ahead)].T @ y
        carried = ahead
        total[active, active] += y.T @ y
    last = slice(own[max(n - 1, 0)], own[n])
    carried[:dim, last] += functions.by_second[last].T
    carried[dim : dim + functions.by_shared.shape[1]] += functions.by_shared.T  # what is behind is not touched
    return total, carried[:size]


def _gain(marginal: Array, cross: Array) -> Array:
    """Return the regressions of keyframes on the next ones, written over their ``cross`` covariances (n, K, d)."""
    for begin in range(0, len(cross) - 1, _AT_A_TIME):
        some = cross[begin : min(begin + _AT_A_TIME, len(cross) - 1)]
        ahead = marginal[begin + 1 : begin + 1 + len(some)]
        sd = np.sqrt(np.diagonal(ahead, axis1=1, axis2=2))
        correlation = ahead / (sd[:, :, None] * sd[:, None, :])
        scaled = np.linalg.solve(correlation, np.swapaxes(some / sd[:, None, :], 1, 2))
        some[:] = np.swapaxes(scaled, 1, 2) / sd[:, None, :]
    return cross[:-1]


def times_covariance(root: SquareRoot, keyframes: Array, shared: Array) -> tuple[Array, Array]:
    """Return ``P c`` of m columns c: ``keyframes`` (n, KEYFRAME_DIM, m) and ``shared`` (s, m), likewise the result.

    P is the covariance of all variables: ``R'`` is solved forwards, R backwards, along the chain.
    """
    n, size = len(root.inverse), root.size
    whitened = np.empty_like(keyframes)
    carried = np.zeros((size, keyframes.shape[2]))
    for k in range(n):
        whitened[k] = root.inverse[k].T @ (keyframes[k] + carried[:KEYFRAME_DIM])
        ahead = np.zeros((root.parents(k), keyframes.shape[2]))
        ahead[root.kept(k)] = carried[KEYFRAME_DIM:]
        carried = ahead - root.S[k, :, : len(ahead)].T @ whitened[k]
    of_shared = root.shared_inverse @ (root.shared_inverse.T @ (shared + carried[KEYFRAME_DIM:size]))
    window = np.zeros((root.parents(n - 1), keyframes.shape[2]))
    window[KEYFRAME_DIM:size] = of_shared
    out = whitened
    for k in range(n - 1, -1, -1):
        out[k] = root.regression[k, :, : len(window)] @ window + root.inverse[k] @ whitened[k]
        window = np.concatenate([out[k], window[root.kept(k)]])
    return out, of_shared

"""Recursions over the conditionals of a chain give posterior covariances and samples.

With the square root of :mod:`trackfg.solver.square_root` the error of keyframe k is ``x_k = A_k y_k + R_k^-1 e``:
backwards from the last keyframe, covariances of the moving window (x_k, y_k) follow, or, with drawn e, samples of all
states together. Forwards, with all conditionals stacked as ``R x = e``, the covariance of linear functions ``C x`` is
``Y' Y`` with ``R' Y = C'``. (Bierman, "Factorization methods for discrete sequential estimation", 1977, ch. X.)
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple, Protocol

import numpy as np

from trackfg.factors.states import KEYFRAME_DIM, Kind, offset_in_keyframe
from trackfg.numerics.arrays import Array
from trackfg.numerics.chained_covariance import Block, ChainedCovariance
from trackfg.numerics.kernels import compiled_kernels
from trackfg.numerics.key_figures import Outlined
from trackfg.solver.square_root import SquareRoot

_PLACES_IN_A_BLOCK = 8
"""Places whose functions are carried together: two each are as many rows as a fifth of those of y, beside them."""

_NO_WINDOWS = np.zeros(0, dtype=np.int64), np.zeros(0)
"""Keyframes whose windows are wanted, and room for these: none."""


@dataclass(frozen=True, repr=False)
class Covariance(Outlined):
    """The covariance of a chain consists of those of each keyframe, and of each with the next one.

    Of z_k = (x_k, s), whose s is the same for all: ``of_keyframes`` (n, KEYFRAME_DIM, d), covariances of x_k with z_k;
    ``of_shared`` (d - KEYFRAME_DIM square), that of s; ``cross`` (n - 1, KEYFRAME_DIM, KEYFRAME_DIM), those of x_k with
    x_{k+1}.

    d is KEYFRAME_DIM + SHARED_DIM, in elimination order, and the dimension of each further sensor.

    Examples
    --------
    >>> import trackfg
    >>> from trackfg import graph, solver
    >>> from trackfg.factors.states import Kind
    >>> settings = trackfg.SmoothConfig()
    >>> problem = graph.build_problem(trackfg.read_recording("run1"), settings)
    >>> covariance = solver.posterior_covariance(solver.solve(problem, settings.solver).root)
    >>> covariance.of(Kind.NAV).shape  # of attitude, position and velocity at each keyframe
    (38, 9, 9)
    """

    of_keyframes: Array
    of_shared: Array
    cross: Array

    @property
    def marginal(self) -> Array:
        """The covariances of all z_k, (n, d, d): thrice as large as what they are kept as."""
        return self.at(slice(None))

    def at(self, keyframes: int | slice | np.ndarray) -> Array:
        """Return the covariances of z_k of some keyframes, (m, d, d), or of one, (d, d)."""
        blocks, dim = self.of_keyframes[keyframes], KEYFRAME_DIM
        whole = np.empty((*blocks.shape[:-2], blocks.shape[-1], blocks.shape[-1]))
        whole[..., :dim, :], whole[..., dim:, :dim] = blocks, blocks[..., dim:].swapaxes(-1, -2)
        whole[..., dim:, dim:] = self.of_shared
        return whole

    def of(self, kind: Kind) -> Array:
        """Return the marginal covariance of one kind: (n, dim, dim), or (1, dim, dim) for a shared one.

        Further sensors have one of all together.
        """
        start = offset_in_keyframe(kind)
        if not kind.shared:
            return self.of_keyframes[:, start : start + kind.dim, start : start + kind.dim]
        start -= KEYFRAME_DIM
        columns = slice(start, None if kind is Kind.SENSOR else start + kind.dim)
        return self.of_shared[None, columns, columns]

    def rows(self, keyframes: np.ndarray, rows: np.ndarray) -> Array:
        """Return rows (r,) of the covariances of z_k of some keyframes, (m, r, d)."""
        in_keyframe, dim = rows < KEYFRAME_DIM, KEYFRAME_DIM
        out = np.empty((len(keyframes), len(rows), self.of_keyframes.shape[2]))
        out[:, in_keyframe] = self.of_keyframes[keyframes[:, None], rows[in_keyframe]]
        if not in_keyframe.all():
            out[:, ~in_keyframe, :dim] = self.of_keyframes[keyframes[:, None], :, rows[~in_keyframe]]
            out[:, ~in_keyframe, dim:] = self.of_shared[rows[~in_keyframe] - dim]
        return out

    def propagated(self, J: Array) -> Array:
        """Return the covariances of ``J z_k`` with the first of the z_k, as many as the columns of J (n, r, c)."""
        size, dim = J.shape[2], KEYFRAME_DIM
        blocks = self.of_keyframes[:, :, :size]
        out = J[:, :, :dim] @ blocks
        if size > dim:
            out[:, :, :dim] += J[:, :, dim:] @ blocks[:, :, dim:].swapaxes(1, 2)
            out[:, :, dim:] += J[:, :, dim:] @ self.of_shared[: size - dim, : size - dim]
        return np.asarray(out)

    def with_added_distance_variance(self, variance: Array | float) -> Covariance:
        """Return the covariance with so much more variance (n,), m^2, of the distances along the track.

        It is that of an error which all of them have in common.
        """
        if not (variance if isinstance(variance, float) else np.any(variance)):
            return self
        at, sd = offset_in_keyframe(Kind.ODO), np.broadcast_to(np.sqrt(variance), len(self.of_keyframes))
        of_keyframes, cross = self.of_keyframes.copy(), self.cross.copy()
        of_keyframes[:, at, at] += sd**2
        cross[:, at, at] += sd[:-1] * sd[1:]
        return replace(self, of_keyframes=of_keyframes, cross=cross)

    def between(self, i: int, j: int) -> Array:
        """Return the cross-covariance of keyframes ``i <= j``, shape (d, d).

        Exact for a chain; with a longer reach exact for neighbours, and carried from neighbour to neighbour beyond.
        """
        out = self.at(j)
        if i < j:
            out = np.concatenate([self._with_next(slice(j - 1, j))[0], out[KEYFRAME_DIM:]])
        for gain in reversed(self._gains(i, j - 1)):
            out = np.concatenate([gain @ out, out[KEYFRAME_DIM:]])
        return out

    def _with_next(self, keyframes: slice) -> Array:
        """Return the covariances of x_k with z_{k+1}, (m, KEYFRAME_DIM, d)."""
        return np.concatenate([self.cross[keyframes], self.of_keyframes[keyframes, :, KEYFRAME_DIM:]], axis=2)

    def _gains(self, begin: int, end: int) -> Array:
        """Return the regressions of x_k on z_{k+1} for keyframes from ``begin`` until before ``end``, (m, K, d)."""
        cross, ahead = self._with_next(slice(begin, end)), self.at(slice(begin + 1, end + 1))
        sd = np.sqrt(np.diagonal(ahead, axis1=1, axis2=2))
        correlation = ahead / (sd[:, :, None] * sd[:, None, :])
        scaled = np.linalg.solve(correlation, np.swapaxes(cross / sd[:, None, :], 1, 2))
        return np.asarray(np.swapaxes(scaled, 1, 2) / sd[:, None, :])


class _Window(NamedTuple):
    """Covariances at keyframe k are those of y_k (p, p), of x_k with y_k (K, p), and of x_k with z_k."""

    k: int
    ahead: Array
    cross: Array
    marginal: Array


def _windows(root: SquareRoot, behind: Array) -> Iterator[_Window]:
    """Go backwards from the last keyframe; ``behind`` is the covariance of (x_n, s). Cost is linear in the number of
    keyframes.
    """
    n, dim, size = len(root.inverse), KEYFRAME_DIM, root.size
    spread = root.inverse @ np.swapaxes(root.inverse, 1, 2)
    ahead = np.zeros((root.parents(n - 1), root.parents(n - 1)))
    ahead[:size, :size] = behind
    for k in range(n - 1, -1, -1):
        width, kept = root.parents(k - 1), root.kept(k)
        whole = np.empty((width, width))
        A = root.regression(k)
        cross = A @ ahead
        marginal, both = cross @ A.T + spread[k], cross[:, kept]
        whole[:dim, :dim] = 0.5 * (marginal + marginal.T)
        whole[:dim, dim:], whole[dim:, :dim], whole[dim:, dim:] = both, both.T, ahead[kept][:, kept]
        yield _Window(k, ahead, cross, whole[:dim, :size])
        ahead = whole


def _of_shared_alone(of_shared: Array) -> Array:
    """Return the covariance of (x_n, s) where the chain ends, and there is no x_n."""
    whole = np.zeros((KEYFRAME_DIM + len(of_shared),) * 2)
    whole[KEYFRAME_DIM:, KEYFRAME_DIM:] = of_shared
    return whole


def _by_numpy(root: SquareRoot, behind: Array, marginal: Array, cross: Array) -> None:
    """Do as the kernel (kernels/recursions.cpp)."""
    for window in _windows(root, behind):
        marginal[window.k] = window.marginal
        cross[window.k] = window.cross[:, :KEYFRAME_DIM]


def posterior_covariance(root: SquareRoot, later: Covariance | None = None) -> Covariance:
    """Return the posterior covariances of a solution. Cost is linear in the number of keyframes.

    Parameters
    ----------
    root
        The ``root`` of a :class:`Solution`: the square root of the information at the minimum.
    later
        The covariance of the keyframes after these, if the root is of the first of a longer chain.

    Returns
    -------
    Covariance
        Covariances of the states of keyframes and of neighbours, later ones included, in the units of the states (SI).

    Raises
    ------
    TypeError
        For anything but a root, such as the solution that has it.

    Examples
    --------
    >>> import trackfg
    >>> from trackfg.graph import build_problem
    >>> from trackfg.solver import posterior_covariance, solve
    >>> settings = trackfg.SmoothConfig()
    >>> solution = solve(build_problem(trackfg.read_recording("run1"), settings), settings.solver)
    >>> covariance = posterior_covariance(solution.root)
    """
    if not isinstance(root, SquareRoot):
        raise TypeError(f"expected the square root of a solution, solution.root, not {type(root).__name__}")
    n, size = len(root.R), root.size
    marginal, cross = np.empty((n, KEYFRAME_DIM, size)), np.empty((n, KEYFRAME_DIM, KEYFRAME_DIM))
    behind = _of_shared_alone(root.shared_covariance) if later is None else later.at(0)
    if compiled_kernels():
        from trackfg.numerics import compiled

        compiled.covariances(*root.conditionals(), behind, marginal, cross, *_NO_WINDOWS)
    else:
        _by_numpy(root, behind, marginal, cross)
    if later is None:
        return Covariance(marginal, root.shared_covariance, cross[:-1])
    of_keyframes = np.concatenate([marginal, later.of_keyframes])
    return Covariance(of_keyframes, later.of_shared, np.concatenate([cross, later.cross]))


class Normals(Protocol):
    """A source of standard normal numbers, as generators of numpy are."""

    def standard_normal(self, size: tuple[int, ...]) -> Array:
        """Return the next numbers."""


def posterior_samples(root: SquareRoot, count: int, rng: Normals) -> tuple[Array, Array]:
    """Return tangents of all variables together, drawn from their joint posterior.

    Those of the keyframes (n, KEYFRAME_DIM, count), and of the shared variables (s, count).
    """
    samples = rng.standard_normal((len(root.R), KEYFRAME_DIM, count))
    shared = root.shared_inverse @ rng.standard_normal((root.size - KEYFRAME_DIM, count))
    return root.back_substituted(samples, root.behind(shared))[0], shared


@dataclass(frozen=True, repr=False)
class Functions(Outlined):
    """These are m linear functions of the tangents of keyframes k and k + 1 and of the shared variables.

    ``keyframe`` (m,), ascending unless stated otherwise; ``by_first``, ``by_second`` (m, KEYFRAME_DIM), ``by_shared``
    (m, SHARED_DIM).
    """

    keyframe: np.ndarray
    by_first: Array
    by_second: Array
    by_shared: Array

    def add_to(self, columns: Array, begin: int) -> None:
        """Add the functions' vectors to ``columns`` (n, KEYFRAME_DIM, m), those of keyframes from ``begin`` on."""
        end = begin + len(columns)
        for keyframe, part in ((self.keyframe, self.by_first), (self.keyframe + 1, self.by_second)):
            members = np.flatnonzero((keyframe >= begin) & (keyframe < end))
            columns[keyframe[members] - begin, :, members] += part[members]


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
        rows = np.arange(starts[begin], ends[some][-1])
        width = root.parents(last)
        carried = np.eye(width)
        cross = np.zeros((width + len(rows), len(rows)))
        for k, start, stop in zip(places[some].tolist(), starts[some], ends[some], strict=True):
            D, noise = _given_parents(root, functions, k, slice(start, stop))
            for between in range(last + 1, k):
                carried = _carried(root, carried, between)
            transferred = carried[:, :KEYFRAME_DIM] @ root.inverse[k]
            carried = np.concatenate([_carried(root, carried, k), D])
            part = cross[: len(carried), start - rows[0] : stop - rows[0]]
            part[:] = carried @ (ahead[k] @ D.T) + np.concatenate([transferred, noise]) @ noise.T
            last = k
        between_own = np.triu(cross[width:])
        symmetric = between_own + np.triu(between_own, 1).T
        blocks.append(Block(rows, symmetric, carried[width:], carried[:width], cross[:width]))
    return ChainedCovariance(tuple(blocks))


def _given_parents(root: SquareRoot, functions: Functions, k: int, rows: slice) -> tuple[Array, Array]:
    """Return D and ``F_x R_k^-1`` of functions of keyframe k, which are ``D y_k + F_x R_k^-1 e``."""
    F_x = functions.by_first[rows]
    D = F_x @ root.regression(k)
    D[:, :KEYFRAME_DIM] += functions.by_second[rows]
    D[:, KEYFRAME_DIM : KEYFRAME_DIM + functions.by_shared.shape[1]] += functions.by_shared[rows]
    return D, F_x @ root.inverse[k]


def _ahead(root: SquareRoot, covariance: Covariance, keyframes: np.ndarray) -> Mapping[int, Array]:
    """Return the covariances of y_k of some keyframes but the last: along a chain those of z_{k+1}."""
    if not root.ahead.any():
        return {k: covariance.at(k + 1) for k in keyframes.tolist()}
    if not compiled_kernels():
        wanted = set(keyframes.tolist())
        behind = _of_shared_alone(root.shared_covariance)
        return {window.k: window.ahead for window in _windows(root, behind) if window.k in wanted}
    from trackfg.numerics import compiled

    sizes = np.array([root.parents(k) for k in keyframes.tolist()])
    begins = np.concatenate([np.zeros(1, dtype=np.int64), np.cumsum(sizes**2)])
    windows, none = np.empty(int(begins[-1])), np.empty((0, KEYFRAME_DIM, root.size))
    without = none, none[:, :, :KEYFRAME_DIM]
    behind = _of_shared_alone(covariance.of_shared)
    compiled.covariances(*root.conditionals(), behind, *without, keyframes, windows)
    return {
        k: windows[begin : begin + size**2].reshape(size, size)
        for k, begin, size in zip(keyframes.tolist(), begins[:-1].tolist(), sizes.tolist(), strict=True)
    }


def _carried(root: SquareRoot, B: Array, k: int) -> Array:
    """Express functions ``B y_{k-1}`` (m, p) by y_k: ``y_{k-1} = (A_k y_k + e_k, what it keeps of y_k)``."""
    out = B[:, :KEYFRAME_DIM] @ root.regression(k)
    out[:, root.kept(k)] += B[:, KEYFRAME_DIM:]
    return np.asarray(out)


def covariance_given_next(root: SquareRoot, functions: Functions) -> tuple[Array, Array]:
    """Return the covariance of e, (m, m), and G, (d, m), of functions written as ``G' z + e``.

    z is (x_n, s): the keyframe after the root's last one, which the functions may touch, and the shared variables.
    """
    n, m, dim, size = len(root.inverse), len(functions.keyframe), KEYFRAME_DIM, root.size
    total = np.zeros((m, m))
    carried = np.zeros((size, m))
    starts = np.searchsorted(functions.keyframe, np.arange(n + 1))
    for k in range(n):
        right = carried[:dim].copy()
        first, second = slice(starts[k], starts[k + 1]), slice(starts[max(k - 1, 0)], starts[k])
        right[:, first] += functions.by_first[first].T
        right[:, second] += functions.by_second[second].T
        active = slice(0, starts[k + 1])
        y = root.inverse[k].T @ right[:, active]
        ahead = np.zeros((root.parents(k), m))
        ahead[root.kept(k)] = carried[dim:]
        ahead[:, active] -= root.on_parents(k).T @ y
        carried = ahead
        total[active, active] += y.T @ y
    last = slice(starts[max(n - 1, 0)], starts[n])
    carried[:dim, last] += functions.by_second[last].T
    carried[dim : dim + functions.by_shared.shape[1]] += functions.by_shared.T  # what is behind is not touched
    return total, carried[:size]


def times_covariance(root: SquareRoot, keyframes: Array, shared: Array) -> tuple[Array, Array]:
    """Return ``P c`` of m columns c: ``keyframes`` (n, KEYFRAME_DIM, m) and ``shared`` (s, m), likewise the result.

    That of the keyframes is written over them. P is the covariance of all variables: ``R'`` is solved forwards, R
    backwards, along the chain.
    """
    whitened, carried = root.forward_substituted(keyframes)
    of_shared = root.shared_inverse @ (root.shared_inverse.T @ (shared + carried[KEYFRAME_DIM : root.size]))
    return root.back_substituted(whitened, root.behind(of_shared))[0], of_shared

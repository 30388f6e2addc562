"""Fit of a chain of curves to a stretch of profile: nonlinear least squares with whitened residuals.

Residuals are the increments of heading and of cross-level (:mod:`trackfg.curves.model`), whitened by their noise
(:mod:`trackfg.curves.increment_noise`). The covariance is ``(J^T J)^-1``, times the residuals' mean square:
irregularities are not the same all along a line.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from trackfg.curves.increment_noise import Whitener
from trackfg.curves.model import CurveChain, tilts, turns
from trackfg.frames import Array

_PRIOR_CELLS = 30.0
"""The noise of the whole line counts as much as so many cells of the stretch itself."""

_SCALES = (1.0, 1e-5, 0.1)
_DAMPED, _DAMPED_AGAIN = 1e-9, 1e-4
_EVALUATIONS, _PATIENCE = 60, 8
_SETTLED, _LITTLE = 1e-5, 1e-2
"""Of chi^2."""


@dataclass(frozen=True)
class Stretch:
    """Cells of a profile: ``edges`` (n + 2,) m, ``turn`` (n,) rad with its whitener; ``tilt`` (n - 1,) mm likewise.
    Either is None where it is not known or not to be used. ``curvature_known`` (n,), 1/m^2, and ``cross_level_known``
    (n,), mm^2, are the variances that the profile states for itself.
    """

    edges: Array
    turn: Array | None
    turn_white: Whitener
    curvature_known: Array
    tilt: Array | None = None
    tilt_white: Whitener | None = None
    cross_level_known: Array | None = None

    @property
    def tilt_edges(self) -> Array:
        """Of the increments of cross-level. Shape (n + 1,)."""
        return np.asarray(self.edges[:-1] + 0.5 * (self.edges[1] - self.edges[0]))

    def without_tilt(self) -> Stretch:
        """The curvature alone."""
        return replace(self, tilt=None, tilt_white=None)

    def chi2_of_straight(self) -> float:
        """The sum of squares of the whitened turns without any curve."""
        return 0.0 if self.turn is None else float(np.sum(self.turn_white(self.turn) ** 2))


@dataclass(frozen=True)
class Fit:
    """The best chain, the sum of squares of its whitened residuals (count ``cells``), and the covariance of its
    parameters (without those of the cant where the stretch has no cross-level), for residuals of mean square 1.
    """

    chain: CurveChain
    chi2: float
    cells: int
    unscaled: Array

    @property
    def scale(self) -> float:
        """How much larger the noise's variance is here than on the whole line."""
        freedom = self.cells - len(self.unscaled)
        return (_PRIOR_CELLS + self.chi2) / (_PRIOR_CELLS + freedom)

    @property
    def covariance(self) -> Array:
        """Of :attr:`CurveChain.parameters`."""
        return self.scale * self.unscaled


def fitted(chain: CurveChain, stretch: Stretch) -> Fit:
    """The chain's places and levels that fit the stretch best, from the given ones on (Levenberg-Marquardt)."""
    scales = _scales(chain, stretch)
    x = chain.parameters[: len(scales)]
    r, j = _residuals(chain, stretch)
    j *= scales
    chi2, damping, idle = float(r @ r), _DAMPED, 0
    for _ in range(_EVALUATIONS):
        normal, gradient = j.T @ j, j.T @ r
        size = np.maximum(np.diag(normal), 1e-12 * float(normal.max(initial=1e-300)))
        step = np.linalg.solve(normal + np.diag(damping * size), -gradient)
        promised = -float(step @ (2.0 * gradient + normal @ step))
        after = chain.with_parameters(x + scales * step)
        r_after, j_after = _residuals(after, stretch)
        gained = chi2 - float(r_after @ r_after)
        if gained >= 0.0:
            chain, x, r, j, chi2 = after, x + scales * step, r_after, j_after * scales, chi2 - gained
            damping = max(damping / 8.0, _DAMPED)
        else:
            damping = max(damping * 8.0, _DAMPED_AGAIN)
        # Where points pass each other, chi^2 has edges on which steps promise what they do not keep.
        idle = idle + 1 if gained < _LITTLE else 0
        if max(promised, gained) < _SETTLED or idle == _PATIENCE:
            break
    # What the data do not tell gets a large variance, not an infinite one.
    _, s, v = np.linalg.svd(j, full_matrices=False)
    w = v / np.maximum(s, max(1e-8 * s[0], 1e-8))[:, None] * scales
    return Fit(chain, chi2, len(r), w.T @ w)


def canted(chain: CurveChain, stretch: Stretch) -> CurveChain:
    """With the cants that fit the cross-level best, the ramps where the transitions are."""
    if stretch.tilt is None or stretch.tilt_white is None:
        return chain
    slopes = stretch.tilt_white(tilts(chain, stretch.tilt_edges)[1][:, len(chain.places) :])
    cant = chain.cant.copy()
    cant[chain.curved] = np.linalg.lstsq(slopes, stretch.tilt_white(stretch.tilt), rcond=1e-10)[0]
    return replace(chain, cant=cant)


def regressors(chain: CurveChain, stretch: Stretch) -> tuple[Array, Array]:
    """Whitened residuals (n,) and their derivatives (n, parameters) at the chain as it is."""
    return _residuals(chain, stretch)


def _scales(chain: CurveChain, stretch: Stretch) -> Array:
    c = len(chain.curved)
    counts = (len(chain.places), c, 0 if stretch.tilt is None else c)
    return np.repeat(_SCALES, counts)


def _residuals(chain: CurveChain, stretch: Stretch) -> tuple[Array, Array]:
    p, c = len(chain.places), len(chain.curved)
    counts = (0 if seen is None else len(seen) for seen in (stretch.turn, stretch.tilt))
    ends = np.cumsum([0, *counts])
    r = np.empty(ends[-1])
    slopes = np.zeros((ends[-1], p + c * (1 if stretch.tilt is None else 2)))
    if stretch.turn is not None:
        turn, by_turn = turns(chain, stretch.edges)
        r[: ends[1]] = stretch.turn_white(turn - stretch.turn)
        slopes[: ends[1], : p + c] = stretch.turn_white(by_turn)
    if stretch.tilt is not None and stretch.tilt_white is not None:
        tilt, by_tilt = tilts(chain, stretch.tilt_edges)
        white = stretch.tilt_white(by_tilt)
        r[ends[1] :] = stretch.tilt_white(tilt - stretch.tilt)
        slopes[ends[1] :, :p] = white[:, :p]
        slopes[ends[1] :, p + c :] = white[:, p:]
    return r, slopes

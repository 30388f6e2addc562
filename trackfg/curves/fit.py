"""Fit of a chain of curves to a stretch of profile: nonlinear least squares with whitened residuals.

Residuals are the increments of heading and of cross-level (:mod:`trackfg.curves.model`), whitened by their noise
(:mod:`trackfg.curves.increments`). The covariance is ``(J^T J)^-1``, times the residuals' mean square:
irregularities are not the same all along a line.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from trackfg.curves.increments import DISTURBED_FROM, PER_DISTURBANCE, Observed
from trackfg.curves.model import CurveChain, tilts, turns
from trackfg.numerics.arrays import Array

_PRIOR_CELLS = 30.0
"""The noise of the whole line counts as much as so many cells of the stretch itself."""

_SCALES = (1.0, 1e-5, 0.1)
_SUSPECT, _FREE_RAMPS = 20.0, 6.0
"""Of chi^2: so much more than is usual casts doubt on ramps at the transitions; so much per place makes them free."""

_DAMPED, _DAMPED_AGAIN = 1e-9, 1e-4
_EVALUATIONS, _PATIENCE = 20, 4
_SETTLED, _LITTLE = 1e-5, 1e-2
"""Of chi^2."""


@dataclass(frozen=True)
class Stretch:
    """Cells of a profile: ``edges`` (n + 2,) m, ``turn`` (n), rad, and ``tilt`` (n - 1), mm, either None where it is
    not known or not to be used. ``curvature_known`` (n,), 1/m^2, and ``cross_level_known`` (n,), mm^2, are the
    variances that the profile states for itself.
    """

    edges: Array
    turn: Observed | None
    tilt: Observed | None
    curvature_known: Array
    cross_level_known: Array

    @property
    def tilt_edges(self) -> Array:
        """Of the increments of cross-level. Shape (n + 1,)."""
        return np.asarray(self.edges[:-1] + 0.5 * (self.edges[1] - self.edges[0]))

    @property
    def disturbances(self) -> int:
        """How many were allowed."""
        return sum(seen.increments.disturbances for seen in (self.turn, self.tilt) if seen is not None)

    def without_tilt(self) -> Stretch:
        """The curvature alone."""
        return replace(self, tilt=None)


@dataclass(frozen=True)
class Fit:
    """The best chain on a stretch, the sum of squares of its whitened residuals (``freedom`` of them say something),
    and the covariance of its parameters (without those of the cant where the stretch has no cross-level), for residuals
    of mean square 1.
    """

    chain: CurveChain
    stretch: Stretch
    chi2: float
    freedom: int
    unscaled: Array

    @property
    def scale(self) -> float:
        """How much larger the noise's variance is here than on the whole line."""
        return (_PRIOR_CELLS + self.chi2) / (_PRIOR_CELLS + self.freedom - len(self.unscaled))

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
    freedom = sum(seen.increments.freedom for seen in (stretch.turn, stretch.tilt) if seen is not None)
    return Fit(chain, stretch, chi2, freedom, w.T @ w)


def canted(chain: CurveChain, stretch: Stretch) -> tuple[CurveChain, Stretch]:
    """With the cants that fit the cross-level best, the ramps where the transitions are; and with the disturbances of
    cross-level that are left so, or where the ramps may be anywhere, whichever explains more.
    """
    if stretch.tilt is None:
        return chain, stretch
    tied, tied_cost = _cant_disturbances(chain, stretch.tilt, stretch, free=False)
    if tied_cost > stretch.tilt.increments.freedom + _SUSPECT:
        free, free_cost = _cant_disturbances(chain, stretch.tilt, stretch, free=True)
        if free_cost + _FREE_RAMPS * len(chain.places) < tied_cost:
            tied = free
    return _with_cants(chain, tied, stretch.tilt_edges), replace(stretch, tilt=tied)


def _cant_disturbances(chain: CurveChain, tilt: Observed, stretch: Stretch, *, free: bool) -> tuple[Observed, float]:
    """With the disturbances that cants leave, their ramps ``free`` or where the transitions are, and ``chi^2`` and
    their price.
    """
    while True:
        here = _with_cants(chain, tilt, stretch.tilt_edges)
        if free:
            fit = fitted(here, replace(stretch, turn=None, tilt=tilt))
            r, slopes = _residuals(fit.chain, fit.stretch)
        else:
            model, by_all = tilts(here, stretch.tilt_edges)
            r, slopes = tilt.white(tilt.increments.measured - model), tilt.white(by_all[:, len(chain.places) :])
        gain, after = tilt.most_disturbed(r, slopes)
        if gain < DISTURBED_FROM or after.increments.disturbances > len(r) // 10:
            return tilt, float(r @ r) + PER_DISTURBANCE * tilt.increments.disturbances
        tilt = after


def _with_cants(chain: CurveChain, tilt: Observed, tilt_edges: Array) -> CurveChain:
    slopes = tilt.white(tilts(chain, tilt_edges)[1][:, len(chain.places) :])
    cant = chain.cant.copy()
    cant[chain.curved] = np.linalg.lstsq(slopes, tilt.white(tilt.increments.measured), rcond=1e-10)[0]
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
    counts = (0 if seen is None else len(seen.increments.measured) for seen in (stretch.turn, stretch.tilt))
    ends = np.cumsum([0, *counts])
    r = np.empty(ends[-1])
    slopes = np.zeros((ends[-1], p + c * (1 if stretch.tilt is None else 2)))
    if stretch.turn is not None:
        turn, by_turn = turns(chain, stretch.edges)
        r[: ends[1]] = stretch.turn.white(turn - stretch.turn.increments.measured)
        slopes[: ends[1], : p + c] = stretch.turn.white(by_turn)
    if stretch.tilt is not None:
        tilt, by_tilt = tilts(chain, stretch.tilt_edges)
        white = stretch.tilt.white(by_tilt)
        r[ends[1] :] = stretch.tilt.white(tilt - stretch.tilt.increments.measured)
        slopes[ends[1] :, :p] = white[:, :p]
        slopes[ends[1] :, p + c :] = white[:, p:]
    return r, slopes

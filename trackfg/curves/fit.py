"""The fit of a chain of curves to a stretch of profile is nonlinear least squares with whitened residuals.

Residuals are the increments of heading and of cross-level (:mod:`trackfg.curves.model`), whitened by their noise
(:mod:`trackfg.curves.increments`). The covariance is ``(J^T J)^-1``, times the residuals' mean square, because
irregularities are not the same all along a line.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from trackfg.curves.increments import DISTURBED_FROM, PER_DISTURBANCE, Observed
from trackfg.curves.model import CurveChain, tilts, turns
from trackfg.numerics.arrays import Array

_PRIOR_CELLS = 30.0
"""The noise of the whole line counts as much as so many cells of the stretch itself. Chosen on simulated lines; see
Assumptions in docs/engine.md."""

_SCALES = (1.0, 1e-5, 0.1)
"""Scales of the parameters: m of places, 1/m of curvatures, mm of cants, about their sigmas on good track."""
_SUSPECT, _FREE_RAMPS = 20.0, 6.0
"""Thresholds of chi-square: the excess over its expectation above which cant ramps may lie elsewhere than the
transitions, and the penalty per place that is then free. Chosen on simulated lines; see Assumptions in
docs/engine.md."""

_DAMPED, _DAMPED_AGAIN = 1e-9, 1e-4
"""Least damping of Levenberg and Marquardt, and the least after a step that has failed."""
_EVALUATIONS, _PATIENCE = 20, 4
"""Greatest number of steps, and of steps in a row that gain little."""
_SETTLED, _LITTLE = 1e-5, 1e-2
"""Gain in chi-square below which the fit has converged, and below which a step has gained little."""


@dataclass(frozen=True)
class Stretch:
    """Cells of a profile: ``edges`` (n + 2,) m, increments ``turn`` (n), rad, and ``tilt`` (n - 1), mm.

    Either is None where it is not known or not to be used. ``curvature_known`` (n,), 1/m^2, and ``cross_level_known``
    (n,), mm^2, are the variances that the profile states for itself.
    """

    edges: Array
    turn: Observed | None
    tilt: Observed | None
    curvature_known: Array
    cross_level_known: Array

    @property
    def tilt_edges(self) -> Array:
        """The edges of the increments of cross-level, m (n + 1,)."""
        return np.asarray(self.edges[:-1] + 0.5 * (self.edges[1] - self.edges[0]))

    @property
    def disturbances(self) -> int:
        """The number of disturbances that were allowed."""
        return sum(observed.increments.disturbances for observed in (self.turn, self.tilt) if observed is not None)

    def without_tilt(self) -> Stretch:
        """Return the stretch with its curvature only."""
        return replace(self, tilt=None)


@dataclass(frozen=True)
class Fit:
    """The best chain on a stretch.

    ``chi2``: the sum of squares of its whitened residuals, of which ``freedom`` carry information. ``unscaled``: the
    covariance of its parameters (without the cant where the stretch has no cross-level) for residuals of mean square 1.
    """

    chain: CurveChain
    stretch: Stretch
    chi2: float
    freedom: int
    unscaled: Array

    @property
    def scale(self) -> float:
        """The noise's variance on this stretch over that of the whole line."""
        return (_PRIOR_CELLS + self.chi2) / (_PRIOR_CELLS + self.freedom - len(self.unscaled))

    @property
    def covariance(self) -> Array:
        """The covariance of :attr:`CurveChain.parameters`."""
        return self.scale * self.unscaled


def fitted(chain: CurveChain, stretch: Stretch) -> Fit:
    """Fit places and levels of a chain to a stretch, from the given ones on (Levenberg-Marquardt)."""
    c = len(chain.curved)
    scales = np.repeat(_SCALES, (len(chain.places), c, 0 if stretch.tilt is None else c))
    x = chain.parameters[: len(scales)]
    r, j = whitened_residuals(chain, stretch)
    j *= scales
    chi2, damping, idle = float(r @ r), _DAMPED, 0
    for _ in range(_EVALUATIONS):
        normal, gradient = j.T @ j, j.T @ r
        size = np.maximum(np.diag(normal), 1e-12 * float(normal.max(initial=1e-300)))
        step = np.linalg.solve(normal + np.diag(damping * size), -gradient)
        promised = -float(step @ (2.0 * gradient + normal @ step))
        candidate = chain.with_parameters(x + scales * step)
        candidate_r, candidate_j = whitened_residuals(candidate, stretch)
        gained = chi2 - float(candidate_r @ candidate_r)
        if gained >= 0.0:
            chain, x, r, j, chi2 = candidate, x + scales * step, candidate_r, candidate_j * scales, chi2 - gained
            damping = max(damping / 8.0, _DAMPED)
        else:
            damping = max(damping * 8.0, _DAMPED_AGAIN)
        # Where points pass each other, chi^2 has edges on which steps promise what they do not keep.
        idle = idle + 1 if gained < _LITTLE else 0
        if max(promised, gained) < _SETTLED or idle == _PATIENCE:
            break
    # What the data do not determine gets a large variance, not an infinite one.
    _, s, v = np.linalg.svd(j, full_matrices=False)
    w = v / np.maximum(s, max(1e-8 * s[0], 1e-8))[:, None] * scales
    freedom = sum(observed.increments.freedom for observed in (stretch.turn, stretch.tilt) if observed is not None)
    return Fit(chain, stretch, chi2, freedom, w.T @ w)


def canted(chain: CurveChain, stretch: Stretch) -> tuple[CurveChain, Stretch]:
    """Return the chain with the cants that fit the cross-level best, and the stretch with its disturbances.

    The cant's ramps are where the transitions are. The disturbances of cross-level are those that are left so, or where
    the ramps may be anywhere, whichever explains more.
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
    """Return cross-level with the disturbances that cants leave, and ``chi^2`` plus their price.

    The ramps are ``free``, or where the transitions are.
    """
    while True:
        with_cants = _with_cants(chain, tilt, stretch.tilt_edges)
        if free:
            fit = fitted(with_cants, replace(stretch, turn=None, tilt=tilt))
            r, slopes = whitened_residuals(fit.chain, fit.stretch)
        else:
            model, by_all = tilts(with_cants, stretch.tilt_edges)
            r, slopes = tilt.white @ (tilt.increments.measured - model), tilt.white @ by_all[:, len(chain.places) :]
        gain, candidate = tilt.most_disturbed(r, slopes)
        if gain < DISTURBED_FROM or candidate.increments.disturbances > len(r) // 10:
            return tilt, float(r @ r) + PER_DISTURBANCE * tilt.increments.disturbances
        tilt = candidate


def _with_cants(chain: CurveChain, tilt: Observed, tilt_edges: Array) -> CurveChain:
    slopes = tilt.white @ tilts(chain, tilt_edges)[1][:, len(chain.places) :]
    cant = chain.cant.copy()
    cant[chain.curved] = np.linalg.lstsq(slopes, tilt.white @ tilt.increments.measured, rcond=1e-10)[0]
    return replace(chain, cant=cant)


def whitened_residuals(chain: CurveChain, stretch: Stretch) -> tuple[Array, Array]:
    """Return whitened residuals (n,) and their derivatives (n, parameters) at the chain as it is."""
    p, c = len(chain.places), len(chain.curved)
    counts = (0 if observed is None else len(observed.increments.measured) for observed in (stretch.turn, stretch.tilt))
    ends = np.cumsum([0, *counts])
    r = np.empty(ends[-1])
    slopes = np.zeros((ends[-1], p + c * (1 if stretch.tilt is None else 2)))
    if stretch.turn is not None:
        turn, by_turn = turns(chain, stretch.edges)
        r[: ends[1]] = stretch.turn.white @ (turn - stretch.turn.increments.measured)
        slopes[: ends[1], : p + c] = stretch.turn.white @ by_turn
    if stretch.tilt is not None:
        tilt, by_tilt = tilts(chain, stretch.tilt_edges)
        white = stretch.tilt.white @ by_tilt
        r[ends[1] :] = stretch.tilt.white @ (tilt - stretch.tilt.increments.measured)
        slopes[ends[1] :, :p] = white[:, :p]
        slopes[ends[1] :, p + c :] = white[:, p:]
    return r, slopes

"""Coloured noise of heading and cross-level, as increments from cell to cell.

Averages over cells of some 10 m of a quantity that track irregularities disturb (the heading, the cross-level) have
noise that is all but white at short waves and fades towards long ones, where track is kept to its design; what
measured it adds a slow walk. The increments are thus

    d_k = w_k + v_k+1 - v_k + s_k+1 - s_k,

``w`` the walk's independent steps, of variance ``known + walk``; ``s`` whatever else is declared to disturb a cell's
own mean (a defect, a hole); and ``v`` the irregularities, with the spectrum, ``u`` in rad per cell,

    S(u) = level |1 + theta exp(-i u)|^2 / (1 + (tan(cutoff / 2) / tan(u / 2))^8),

a moving average of order one behind a digital Butterworth high-pass of order four. Heading of the German spectra is
``S ~ W^2 / ((W^2 + Wr^2)(W^2 + Wc^2))``: white between ``Wr`` and ``Wc``, which is beyond a 10 m cell. How steeply
irregularities fade below ``cutoff`` decides how exactly long waves, and so curves, are known. Where they end at a
longest wavelength, an order of two makes sigmas 1.3 times too wide; from order five on they are too narrow, as curves
take their share of the long waves with them. Where the fade is gentler than order four, ``cutoff`` comes out lower and
sigmas stay within 15 %.

Whitening is by the Cholesky factor of the full covariance of a stretch, which any variances along it leave well
conditioned. The four numbers are those of greatest likelihood of the stretches' mean periodogram, which is held against
its exact expectation for stretches of that length and taper (Sykulski et al., "The debiased Whittle likelihood",
Biometrika 106, 2019): the irregularities' spectrum spans six decades, and a short stretch's leaks.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy import fft
from scipy.linalg.lapack import dtrtri
from scipy.optimize import minimize

from trackfg.numerics.arrays import Array
from trackfg.numerics.spans import true_runs

_ORDER = 4
"""Order of the Butterworth high-pass; the module docstring compares orders."""
_LEAST_GRID = 1024
"""Frequencies of a spectrum: enough for the memory of the slowest fading."""

_LONGEST_PIECE, _SHORTEST_PIECE = 200, 12
"""Cells of a piece of which a periodogram is taken."""
_PERIODOGRAM = 512
"""Frequencies of a periodogram: twice the longest piece and more."""

_LEAST_CUTOFF, _GREATEST_CUTOFF = 0.01 * np.pi, 0.9 * np.pi
"""Bounds of the cutoff, rad per cell: wavelengths of 2 km and 22 m with cells of 10 m."""


@dataclass(frozen=True)
class IncrementNoise:
    """The parameters of the noise of increments.

    ``level`` and ``walk``: variances, of the irregularities' white core and of the walk's step per cell; ``cutoff``,
    rad per cell, between 0 and pi; -1 < ``theta`` < 1.
    """

    level: float
    walk: float
    cutoff: float
    theta: float

    def whitener(self, known: Array, disturbed: Array) -> Array:
        """Return the lower triangle (n, n) that makes independent numbers of variance 1 of a stretch of increments.

        ``known`` (n,): variances of the walk besides its own. ``disturbed`` (n + 1,): variances of disturbances of
        cells' means.
        """
        factor = np.linalg.cholesky(self.covariance(known, disturbed))
        return np.asarray(dtrtri(factor, lower=1)[0])

    def covariance(self, known: Array, disturbed: Array) -> Array:
        """Return the covariance (n, n) of such a stretch."""
        n = len(known)
        lags = np.abs(np.arange(n)[:, None] - np.arange(n))
        out: Array = self.autocovariance(n)[lags]
        diagonal = np.arange(n)
        out[diagonal, diagonal] += known
        if np.any(disturbed):
            out[diagonal, diagonal] += disturbed[1:] + disturbed[:-1]
            out[diagonal[1:], diagonal[:-1]] -= disturbed[1:-1]
            out[diagonal[:-1], diagonal[1:]] -= disturbed[1:-1]
        return out

    def autocovariance(self, count: int) -> Array:
        """Return that of the increments for lags 0 to count - 1, without the known variances. Shape (count,)."""
        return np.asarray(fft.irfft(self._spectrum(max(_LEAST_GRID, 1 << count.bit_length())))[:count])

    def _spectrum(self, grid: int) -> Array:
        """Return the spectrum at grid + 1 frequencies from 0 to pi; its mean is the variance."""
        cosine, tangent = _frequencies(grid)
        gain = 1.0 / (1.0 + (np.tan(0.5 * self.cutoff) / tangent) ** (2 * _ORDER))
        moving = 1.0 + 2.0 * self.theta * cosine + self.theta**2
        return np.asarray(self.level * moving * gain * 2.0 * (1.0 - cosine) + self.walk)


@cache
def _frequencies(grid: int) -> tuple[Array, Array]:
    """Return cos(u) and tan(u / 2), kept finite."""
    u = np.linspace(0.0, np.pi, grid + 1)
    return np.cos(u), np.tan(0.5 * np.clip(u, 1e-6, np.pi - 1e-6))


def fitted_noise(stretches: Sequence[tuple[Array, Array]], floor: float) -> IncrementNoise:
    """Estimate the noise of stretches of increments by maximum likelihood.

    Each stretch has residuals (n,), NaN where nothing was measured, and known variances (n,). The square root of
    ``level`` is at least ``floor``.
    """
    pieces = [piece for residuals, variance in stretches for piece in _pieces(residuals, variance)]
    measured, window, noise_known = np.zeros(_PERIODOGRAM + 1), np.zeros(_PERIODOGRAM), 0.0
    for residuals, variance in pieces:
        taper = np.sin(np.pi * (np.arange(len(residuals)) + 0.5) / len(residuals)) ** 2
        measured += np.abs(fft.rfft(taper * residuals, 2 * _PERIODOGRAM)) ** 2
        window += fft.irfft(np.abs(fft.rfft(taper, 2 * _PERIODOGRAM)) ** 2)[:_PERIODOGRAM]
        noise_known += float(taper**2 @ variance)
    cells = sum(int(np.isfinite(residuals).sum()) for residuals, _ in stretches) if pieces else 0
    start = max(0.5 * float(np.mean(measured)) / max(float(window[0]), 1e-300), floor**2)

    def noise(x: Array) -> IncrementNoise:
        level = max(start * float(np.exp(np.clip(x[0], -12.0, 12.0))), floor**2)
        walk = level * float(np.exp(np.clip(x[1], -15.0, 1.0)))
        cutoff = float(np.clip(np.pi / (1.0 + np.exp(-x[2])), _LEAST_CUTOFF, _GREATEST_CUTOFF))
        return IncrementNoise(level, walk, cutoff, float(0.9 * np.tanh(x[3])))

    def cost(x: Array) -> float:
        one_sided = noise(x).autocovariance(_PERIODOGRAM) * window
        expected = 2.0 * fft.rfft(one_sided, 2 * _PERIODOGRAM).real - one_sided[0] + noise_known
        whittle = float(np.mean(np.log(expected) + measured / expected)) if pieces else 0.0
        # Weakly towards what is usual, for short stretches.
        usual = 0.05 * (x[1] + 9.0) ** 2 + (x[2] + 1.8) ** 2 + (x[3] / 0.7) ** 2
        return cells * whittle + float(usual)

    first = [0.0, -9.0, -1.8, 0.0]
    simplex = np.array(first) + np.vstack([np.zeros(4), np.diag([0.3, -2.0, 0.3, 0.3])])
    best = minimize(
        cost, first, method="Nelder-Mead", options={"xatol": 0.02, "fatol": 0.02, "initial_simplex": simplex}
    )
    return noise(best.x)


def _pieces(residuals: Array, variance: Array) -> list[tuple[Array, Array]]:
    """Return what was measured in one piece, cut into overlapping halves where it is long."""
    pieces = []
    for first, stop in true_runs(np.isfinite(residuals)):
        length = min(int(stop - first), _LONGEST_PIECE)
        if length < _SHORTEST_PIECE:
            continue
        count = 1 if stop - first == length else 1 + int(np.ceil(2.0 * (stop - first - length) / length))
        starts = np.linspace(first, stop - length, count).astype(int)
        pieces += [(residuals[start : start + length], variance[start : start + length]) for start in starts]
    return pieces

"""Coloured noise of heading and cross-level, as increments from cell to cell.

Averages over cells of some 10 m of a quantity that track irregularities disturb (the heading, the cross-level) have
noise that is all but white at short waves and fades towards long ones, where track is kept to its design; what
measured it adds a slow walk. The increments are thus

    d = w + (1 - B) v,    v = (1 - B)^2 (1 + theta B) / (1 - phi B)^2 e,

``B`` the shift by one cell, ``w`` the walk's independent steps, of variance ``known + walk`` per cell, and ``e`` white
with variance ``level``. Heading of the German spectra is such noise: ``S ~ W^2 / ((W^2 + Wr^2)(W^2 + Wc^2))`` is white
between ``Wr`` and ``Wc``, which is beyond a 10 m cell; ``phi`` near one takes nothing away, a smaller one fades waves
longer than some ``2 pi cell / (1 - phi)``.

``z = (1 - phi B)^2 d`` is a moving average of order four, its covariance has five bands: whitening and the exact
likelihood, by a banded Cholesky factor, take linear time. The four numbers are those of greatest likelihood. Increments
that were not measured are told by a large known variance.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cholesky_banded
from scipy.linalg.lapack import dtbtrs
from scipy.optimize import minimize
from scipy.signal import lfilter

from trackfg.frames import Array

_ORDER = 2
_BANDS = 5
_MEMORY = 400
"""Cells after which even the slowest fading has forgotten."""


@dataclass(frozen=True)
class IncrementNoise:
    """``level`` and ``walk``: variances of e and of the walk's step per cell; 0 <= ``phi`` < 1, -1 < ``theta`` < 1."""

    level: float
    walk: float
    phi: float
    theta: float

    def whitener(self, known: Array) -> Whitener:
        """For a stretch of increments whose walk has the known variances (n,) besides its own."""
        n = len(known)
        a, c = self._polynomials()
        q = known + self.walk
        bands = np.zeros((_BANDS, n))
        for lag in range(_BANDS):
            bands[lag] = self.level * (c[lag:] @ c[: _BANDS - lag])
        # Before the first increment the noise went on as ever; of z, only what is left of it without what came before.
        first = self.level * self._first_covariance(a, c)
        for k in range(min(_ORDER, n)):
            reach = min(_BANDS, n - k)
            bands[:reach, k] = first[k, k : k + reach]
        for lag in range(min(_ORDER + 1, n)):
            for i in range(_ORDER + 1 - lag):
                # z_k has a_i w_(k-i), z_(k+lag) has a_(i+lag) of the same.
                bands[lag, i : n - lag] += a[i] * a[i + lag] * q[: n - lag - i]
        return Whitener(cholesky_banded(bands, lower=True, check_finite=False), a)

    def _polynomials(self) -> tuple[Array, Array]:
        """Of the autoregression and of the moving average, constant term first."""
        fading = np.array([1.0, -self.phi])
        return np.convolve(fading, fading), np.convolve([1.0, -3.0, 3.0, -1.0], [1.0, self.theta])

    def _first_covariance(self, a: Array, c: Array) -> Array:
        """Of the noise's share in the first values of z, per ``level``. Shape (order + bands, order + bands)."""
        impulse = lfilter(c, a, np.eye(1, _MEMORY)[0])
        count = _ORDER + _BANDS
        increments = np.zeros((count, _MEMORY + count))
        for row in range(count):
            increments[row, count - row : count - row + _MEMORY] = impulse
        z = lfilter(a, [1.0], increments, axis=0)
        return np.asarray(z @ z.T)


@dataclass(frozen=True)
class Whitener:
    """Turns noise into independent numbers of variance 1. ``factor`` is banded, lower, (5, n)."""

    factor: Array
    autoregression: Array

    def __call__(self, increments: Array) -> Array:
        """Shape (n,) or (n, k) to the same."""
        z = increments.copy()
        for i in range(1, _ORDER + 1):
            z[i:] += self.autoregression[i] * increments[:-i]
        return np.asarray(dtbtrs(self.factor, z, uplo="L")[0])

    @property
    def log_determinant(self) -> float:
        """Of the covariance."""
        return 2.0 * float(np.sum(np.log(self.factor[0])))


def fitted_noise(stretches: Sequence[tuple[Array, Array]], floor: float) -> IncrementNoise:
    """The noise of greatest likelihood of stretches of increments: each its residuals (n,) and known variances (n,).

    The square root of ``level`` is at least ``floor``.
    """
    together = np.concatenate([residuals[residuals != 0.0] for residuals, _ in stretches])
    spread = float(np.median(np.abs(together))) / 0.6745 if together.size else 0.0
    start = max(0.5 * spread**2, floor**2)

    def noise(x: Array) -> IncrementNoise:
        x = np.clip(x, -12.0, 12.0)
        level = max(start * float(np.exp(x[0])), floor**2)
        walk = level * float(np.exp(min(x[1], 1.0)))
        return IncrementNoise(level, walk, float(0.95 / (1.0 + np.exp(-x[2]))), float(0.9 * np.tanh(x[3])))

    def cost(x: Array) -> float:
        model = noise(x)
        total = 0.0
        for residuals, known in stretches:
            white = model.whitener(known)
            total += float(np.sum(white(residuals) ** 2)) + white.log_determinant
        # Weakly towards what is usual, for short stretches.
        return total + 0.05 * float((x[1] + 9.0) ** 2) + float((x[2] - 1.5) ** 2) + float((x[3] / 0.7) ** 2)

    best = minimize(cost, [0.0, -9.0, 1.5, 0.0], method="Nelder-Mead", options={"xatol": 0.02, "fatol": 0.05})
    return noise(best.x)

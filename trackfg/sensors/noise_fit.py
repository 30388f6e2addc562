"""White noise, bias instability and random walk of a sensor at rest, by maximum likelihood.

The slopes of an Allan deviation use few of its points, which are correlated; the likelihood uses all samples. Averages
over blocks of T s have as differences a process whose power at the angle theta = pi j / n is the sum of

    white noise          N^2 (2 - 2 cos theta) / T
    random walk          K^2 T (2 + cos theta) / 3
    bias instability     B^2 2 / pi^3 sin^4(theta / 2) (zeta(3, u) + zeta(3, 1 - u)),  u = theta / 2 pi

for two-sided densities N^2, K^2 / (2 pi f)^2 and B^2 / (2 pi f) of the sensor's error (IEEE Std 952, annex C). The
discrete sine transform makes the first two independent exactly, since their covariance is a symmetric tridiagonal
Toeplitz matrix, and the third nearly so. Variances are then a sum of known shapes times unknown, positive factors:
those of greatest likelihood follow from weighted least squares with weights of the variances themselves (Fisher
scoring; Searle, Casella and McCulloch, *Variance Components* (1992), 6.6 and 8.2).

Beside its noise a sensor may follow its temperature: a factor per kelvin is estimated together with the noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy.fft import dst
from scipy.optimize import nnls
from scipy.special import zeta

from trackfg.numerics.arrays import Array
from trackfg.sensors.allan import NoiseKind

BLOCK_S = 0.5
"""Length of a block, s: what is slower than 1 Hz moves an estimate of the motion; above, an engine shakes the car."""

KINDS: tuple[NoiseKind, ...] = ("white", "flicker", "walk")

_WORTH = 2.0
"""Gain of the log-likelihood per axis that a further kind of noise must bring. Twice that is, for each axis, zero or
chi-square distributed with one degree of freedom (Self and Liang 1987): of sensors of three axes without it 0.4 % gain
so much.
"""

_SLOW = 30
"""So many of the slowest modes give the first guess of what is not white."""

_ITERATIONS = 100
_SETTLED = 1e-6
"""Relative change of all variances at which scoring ends."""

FLICKER_FLOOR = float(np.sqrt(2.0 * np.log(2.0) / np.pi))
"""Allan deviation of a bias instability B = 1, at any averaging time (IEEE Std 952, annex C)."""


@dataclass(frozen=True)
class NoiseFit:
    """Coefficients N, B, K of :data:`KINDS` (3,) and their sigmas (3,), in SI units; 0 where a kind does not show.

    ``per_kelvin`` and its sigma are NaN without a temperature.
    """

    coefficients: Array
    sds: Array
    per_kelvin: float = np.nan
    per_kelvin_sd: float = np.nan

    def allan(self, tau: Array) -> Array:
        """Return the Allan variance of each kind at averaging times (k,), s. Shape (3, k)."""
        N, B, K = self.coefficients
        return np.array([N**2 / tau, np.full_like(tau, (FLICKER_FLOOR * B) ** 2), K**2 * tau / 3.0])


def fit_noise(sensor: Array, dt: float, temperature: Array | None = None) -> list[NoiseFit]:
    """Return the noise of each axis of a sensor at rest: samples (n, 3) every ``dt`` s, ``temperature`` (n,) in degC.

    Which kinds of noise there are is decided for all axes together. Raises ``ValueError`` below 16 blocks.
    """
    size = max(round(BLOCK_S / dt), 1)
    z = _transformed(sensor, size)
    if len(z) < 15:
        raise ValueError("too few samples")
    heat = None if temperature is None else _transformed(temperature[:, None], size)[:, 0]
    if heat is not None and not np.any(heat):
        heat = None
    shapes = _shapes(len(z), size * dt)
    subsets = [("white", *rest) for count in range(3) for rest in combinations(KINDS[1:], count)]
    tried = [_Fitted.of(z, shapes, [KINDS.index(kind) for kind in subset], heat) for subset in subsets]
    best = max(tried, key=lambda fitted: fitted.likelihood - _WORTH * fitted.variances.size)
    return best.fits()


@dataclass(frozen=True)
class _Fitted:
    """Variances a (axes, c) of some columns of the shapes, their covariance, the log-likelihood, and the slopes over
    temperature (axes,), NaN without one.
    """

    columns: list[int]
    variances: Array
    covariance: Array
    likelihood: float
    slopes: Array
    slope_sds: Array

    @classmethod
    def of(cls, z: Array, shapes: Array, columns: list[int], heat: Array | None) -> _Fitted:
        chosen, axes = shapes[:, columns], z.shape[1]
        variances, covariance = np.zeros((axes, len(columns))), np.zeros((axes, len(columns), len(columns)))
        slopes, sds, likelihood = np.full(axes, np.nan), np.full(axes, np.nan), 0.0
        for axis in range(axes):
            a, slope, information = _scored(z[:, axis], chosen, heat)
            V = chosen @ a
            rest = z[:, axis] - (0.0 if heat is None else slope * heat)
            likelihood -= 0.5 * _cost(V, rest)
            weighted = chosen / V[:, None]
            variances[axis], covariance[axis] = a, np.linalg.pinv(0.5 * weighted.T @ weighted, hermitian=True)
            if heat is not None:
                slopes[axis], sds[axis] = slope, 1.0 / np.sqrt(information)
        return cls(columns, variances, covariance, likelihood, slopes, sds)

    def fits(self) -> list[NoiseFit]:
        fits = []
        for axis, a in enumerate(self.variances):
            coefficients, sds = np.zeros(len(KINDS)), np.zeros(len(KINDS))
            roots = np.sqrt(a)
            sd = np.sqrt(np.diag(self.covariance[axis]))
            coefficients[self.columns] = roots
            # Of a root, by the derivative; where the variance is hardly above zero, the root of its sigma is less.
            sds[self.columns] = np.minimum(sd / np.maximum(2.0 * roots, 1e-300), np.sqrt(sd))
            fits.append(NoiseFit(coefficients, sds, float(self.slopes[axis]), float(self.slope_sds[axis])))
        return fits


def _scored(z: Array, shapes: Array, heat: Array | None) -> tuple[Array, float, float]:
    """Return the variances (c,) of greatest likelihood, the slope over temperature and its information."""
    a = np.array([np.mean(z**2 / shapes[:, 0])] + [np.median(z[:_SLOW] ** 2 / shape[:_SLOW]) for shape in shapes.T[1:]])
    slope, information = 0.0, 0.0
    for _ in range(_ITERATIONS):
        V = shapes @ a
        if heat is not None:
            information = float(np.sum(heat**2 / V))
            slope = float(np.sum(heat * z / V)) / information
        rest = z if heat is None else z - slope * heat
        scale = shapes / V[:, None]
        norms = np.linalg.norm(scale, axis=0)
        wanted = nnls(scale / norms, rest**2 / V)[0] / norms
        wanted[0] = max(wanted[0], 1e-3 * a[0])  # all of a power may not vanish
        cost, step = _cost(V, rest), 1.0
        while step > _SETTLED and _cost(shapes @ (a + step * (wanted - a)), rest) > cost + _SETTLED:
            step *= 0.5
        a = a + step * (wanted - a)
        if np.max(np.abs(shapes @ a - V) / V) < _SETTLED:
            break
    return a, slope, information


def _cost(V: Array, z: Array) -> float:
    """Return twice the negative log-likelihood of normal values ``z`` with variances ``V``, less a constant."""
    return float(np.sum(np.log(V) + z**2 / V))


def _transformed(y: Array, size: int) -> Array:
    """Return the sine transform of the differences of block means, (blocks - 1, axes)."""
    blocks = len(y) // size
    means = y[: blocks * size].reshape(blocks, size, -1).mean(axis=1)
    return np.asarray(dst(np.diff(means, axis=0), type=1, axis=0, norm="ortho"))


def _shapes(modes: int, T: float) -> Array:
    """Return the power of each of :data:`KINDS` with coefficient 1, by mode. Shape (modes, 3)."""
    theta = np.pi * np.arange(1, modes + 1) / (modes + 1.0)
    u = theta / (2.0 * np.pi)
    white = (2.0 - 2.0 * np.cos(theta)) / T
    walk = T * (2.0 + np.cos(theta)) / 3.0
    flicker = 2.0 / np.pi**3 * np.sin(theta / 2.0) ** 4 * (zeta(3.0, u) + zeta(3.0, 1.0 - u))
    return np.stack([white, flicker, walk], axis=1)


def pooled(fits: Sequence[NoiseFit]) -> NoiseFit:
    """Return the root mean square over axes, with its sigma."""
    values = np.array([fit.coefficients for fit in fits])
    sds = np.array([fit.sds for fit in fits])
    level = np.sqrt(np.mean(values**2, axis=0))
    sd = np.sqrt(np.sum((values * sds) ** 2, axis=0)) / (len(fits) * np.maximum(level, 1e-300))
    return NoiseFit(level, sd)

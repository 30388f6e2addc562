"""The overlapping Allan deviation of a sensor's samples, with its equivalent degrees of freedom.

With x the integral of the samples y and tau = m dt,

    sigma^2(tau) = mean((x_{i+2m} - 2 x_{i+m} + x_i)^2) / (2 tau^2)

over all i (IEEE Std 1139-2008, annex A; W. Riley, *Handbook of Frequency Stability Analysis*, NIST SP 1065 (2008),
5.2.4). A rate takes the place of that standard's fractional frequency: white noise of rate is its white FM, bias
instability its flicker FM, a random walk of the bias its random walk FM.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

import numpy as np

from trackfg.numerics.arrays import Array

NoiseKind = Literal["white", "flicker", "walk"]

_PER_DECADE = 10
"""Averaging times per decade: neighbours are strongly correlated (a finer grid shows nothing more)."""


def averaging_factors(samples: int) -> np.ndarray:
    """Return averaging factors m from 1 to half the number of samples, evenly over the decades. Shape (k,)."""
    longest = max(samples // 2, 1)
    count = int(_PER_DECADE * np.log10(longest)) + 2
    return np.unique(np.round(np.geomspace(1.0, longest, count)).astype(np.int64))


def overlapping_allan(y: Array, dt: float, factors: np.ndarray) -> Array:
    """Return the Allan deviation of samples ``y`` (n,) every ``dt`` s for averaging ``factors`` (k,). Shape (k,)."""
    x = np.append(0.0, np.cumsum(y - y.mean())) * dt
    deviation = np.empty(len(factors))
    for k, m in enumerate(factors):
        second = x[2 * m :] - 2.0 * x[m:-m] + x[: -2 * m]
        deviation[k] = np.sqrt(np.dot(second, second) / len(second) / 2.0) / (m * dt)
    return deviation


def degrees_of_freedom(samples: int, factors: np.ndarray, kinds: np.ndarray) -> Array:
    """Return the equivalent degrees of freedom of the Allan variance, by the noise that dominates it. Shape (k,).

    ``kinds`` (k,) are of :data:`NoiseKind`. NIST SP 1065, table 5 (after Howe, Allan and Barnes 1981), with N = n + 1
    integrals.
    """
    N, m = samples + 1.0, factors.astype(np.float64)
    by_kind: dict[NoiseKind, Callable[[], Array]] = {
        "white": lambda: (1.5 * (N - 1.0) / m - 2.0 * (N - 2.0) / N) * 4.0 * m**2 / (4.0 * m**2 + 5.0),
        "flicker": lambda: np.where(
            m == 1.0, 2.0 * (N - 2.0) ** 2 / (2.3 * N - 4.9), 1.25 * N**2 / (m * (N + 3.0 * m))
        ),
        "walk": lambda: (N - 2.0) / m * ((N - 1.0) ** 2 - 3.0 * m * (N - 1.0) + 4.0 * m**2) / (N - 3.0) ** 2,
    }
    freedom = np.select([kinds == kind for kind in by_kind], [formula() for formula in by_kind.values()])
    return np.asarray(np.maximum(freedom, 1.0))

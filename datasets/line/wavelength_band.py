"""The wavelength band D1 (3-25 m), in which level and alignment are stated, as a gain.

A Butterworth band-pass of order 4 run forwards and backwards has no phase, and with ``W = 2 pi / wavelength``,
``W1 = 2 pi / 25 m`` and ``W2 = 2 pi / 3 m`` the gain

    g(W) = 1 / (1 + ((W^2 - W1 W2) / (W (W2 - W1)))^8).

It is one half at both edges and falls like ``W^8`` towards long waves.
"""

from __future__ import annotations

import numpy as np

from trackfg.numerics.arrays import Array

SHORTEST_M = 3.0
LONGEST_M = 25.0
"""Edges of the band D1, m (EN 13848-1)."""


def d1_gain(wavenumber: Array) -> Array:
    """Return the gain at wavenumbers in rad/m, 0 at 0. Shape (...) to (...)."""
    low, high = 2 * np.pi / LONGEST_M, 2 * np.pi / SHORTEST_M
    w = np.abs(np.asarray(wavenumber, dtype=np.float64))
    # Written with (w (W2 - W1))^8 in the numerator: no division by zero.
    numerator = (w * (high - low)) ** 8
    return np.asarray(numerator / (numerator + (w * w - low * high) ** 8))

"""Convolution with a long kernel, by FFT, and lengths at which an FFT is fast.

The FFT is numpy's: SciPy's is the same (pocketfft), as fast, and takes 0.03 s to import.
"""

from __future__ import annotations

import numpy as np

from trackfg.numerics.arrays import Array


def convolve_inside(y: Array, kernel: Array) -> Array:
    """Return ``sum_k kernel[k] y[..., i + m - 1 - k]`` where the kernel of ``m`` taps fits.

    Shape (..., n) to (..., n - m + 1).

    Rounding is that of the largest value of a row, about 1e-15 of it, at every place.
    """
    taps = len(kernel)
    length = fast_length(y.shape[-1])  # what wraps round falls on the taps - 1 places that are cut
    spectrum = np.fft.rfft(y, length)
    spectrum *= np.fft.rfft(kernel, length)
    return np.asarray(np.fft.irfft(spectrum, length)[..., taps - 1 : y.shape[-1]])


def fast_length(least: int) -> int:
    """Return the smallest length from ``least`` on, at least 1, whose only prime factors are 2, 3 and 5."""
    shortest = 1 << (least - 1).bit_length()
    fives = 1
    while fives < shortest:
        odd = fives
        while odd < shortest:
            shortest = min(shortest, odd << (-(-least // odd) - 1).bit_length())
            odd *= 3
        fives *= 5
    return shortest

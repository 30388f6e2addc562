"""Convolution with a long kernel, by FFT, and lengths at which an FFT is fast.

A long row is convolved block after block (overlap-save: Oppenheim and Schafer, *Discrete-Time Signal Processing*, 3rd
ed. (2010), ch. 8.7.3), so that the cost is linear in its length and a block stays in the cache. The FFT is numpy's:
SciPy's is the same (pocketfft), as fast, and takes 0.03 s to import.
"""

from __future__ import annotations

import numpy as np

from trackfg.numerics.arrays import Array

_KERNELS_IN_A_BLOCK = 8
"""Length of a block over that of the kernel: an eighth of each block is transformed twice."""
_LEAST_BLOCK = 2**14
"""Values of a block, at least: 128 KiB, which a cache of the second level holds."""


def convolve_inside(y: Array, kernel: Array) -> Array:
    """Return ``sum_k kernel[k] y[..., i + m - 1 - k]`` where the kernel of ``m`` taps fits.

    Shape (..., n) to (..., n - m + 1).

    Rounding is that of the largest value around, about 1e-15 of it, at every place.
    """
    overlap, size = len(kernel) - 1, y.shape[-1]
    length = fast_length(min(size, max(_KERNELS_IN_A_BLOCK * len(kernel), _LEAST_BLOCK)))
    of_kernel = np.fft.rfft(kernel, length)
    out = np.empty((*y.shape[:-1], size - overlap))
    for begin in range(0, size - overlap, length - overlap):
        spectrum = np.fft.rfft(y[..., begin : begin + length], length)
        spectrum *= of_kernel
        inside = out[..., begin : begin + length - overlap]
        # What wraps round falls on the overlap, which is left out.
        inside[...] = np.fft.irfft(spectrum, length)[..., overlap : overlap + inside.shape[-1]]
    return out


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

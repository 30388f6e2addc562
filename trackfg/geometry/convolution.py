"""Convolution with a long kernel, by FFT, the kernel of a response, and lengths at which an FFT is fast.

The FFT is numpy's: SciPy's is the same (pocketfft), as fast, and takes 0.03 s to import.
"""

from __future__ import annotations

import numpy as np

from trackfg.numerics.arrays import Array
from trackfg.numerics.spans import true_runs

_TAIL = 1e-3
"""Share of the absolute sum of a response's kernel beyond where it is cut."""
_PERIOD = 64
"""A kernel is computed as if periodic, this many times the longest wavelength long."""


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


def convolve_runs(y: Array, kernel: Array) -> Array:
    """Return values (n,) through a centred kernel of odd length; NaN where it reaches into a hole or beyond an end."""
    half = len(kernel) // 2
    out = np.full(len(y), np.nan)
    for first, stop in true_runs(np.isfinite(y)):
        if stop - first > 2 * half:
            out[first + half : stop - half] = convolve_inside(y[first:stop], kernel)
    return out


def kernel_frequencies(longest_m: float, step_m: float) -> Array:
    """Return the frequencies, 1/m from 0 on, at which a kernel for waves up to ``longest_m`` has its response."""
    count = 2 ** int(np.ceil(np.log2(_PERIOD * longest_m / step_m)))
    return np.asarray(np.fft.rfftfreq(count, step_m), dtype=np.float64)


def kernel_of_response(response: Array) -> Array:
    """Return the kernel of a real response, at the steps to either side of a place: symmetrical, cut, not writeable.

    ``response`` stands at :func:`kernel_frequencies`.
    """
    right = np.fft.irfft(response)[: len(response) - 1]
    tail = np.cumsum(np.abs(right[::-1]))[::-1]
    reach = int(np.argmax(tail < _TAIL * tail[0]))
    kernel: Array = np.concatenate([right[reach:0:-1], right[: reach + 1]])
    kernel.flags.writeable = False
    return kernel

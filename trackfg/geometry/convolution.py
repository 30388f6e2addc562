"""Convolution of profiles with a long kernel, by FFT, and the kernel of a response."""

from __future__ import annotations

import numpy as np

from trackfg.numerics.arrays import Array
from trackfg.numerics.spans import true_runs

_TAIL = 1e-3
"""Share of the absolute sum of a response's kernel beyond where it is cut."""


def convolve_inside(y: Array, kernel: Array) -> Array:
    """Return ``sum_k kernel[k] y[..., i + m - 1 - k]`` where the kernel of ``m`` taps fits.

    Shape (..., n) to (..., n - m + 1).

    Rounding is that of the largest value of a row, about 1e-15 of it, at every place.
    """
    from scipy.fft import irfft, next_fast_len, rfft  # late: most of the package works without

    taps = len(kernel)
    length = next_fast_len(y.shape[-1], real=True)  # what wraps round falls on the taps - 1 places that are cut
    spectrum = rfft(y, length, axis=-1)
    spectrum *= rfft(kernel, length)
    full: Array = irfft(spectrum, length, axis=-1, overwrite_x=True)
    return full[..., taps - 1 : y.shape[-1]]


def convolve_runs(y: Array, kernel: Array) -> Array:
    """Return values (n,) through a kernel of an odd number of taps, centred; NaN where it reaches beyond an end or into
    a hole.
    """
    half = len(kernel) // 2
    out = np.full(len(y), np.nan)
    for first, stop in true_runs(np.isfinite(y)):
        if stop - first > 2 * half:
            out[first + half : stop - half] = convolve_inside(y[first:stop], kernel)
    return out


def kernel_of_response(response: Array) -> Array:
    """Return the kernel of a real response, at the steps to either side of a place: symmetrical, cut, not writeable.

    ``response`` stands at the frequencies of ``numpy.fft.rfftfreq``, of a period much longer than the kernel.
    """
    right = np.fft.irfft(response)[: len(response) - 1]
    tail = np.cumsum(np.abs(right[::-1]))[::-1]
    reach = int(np.argmax(tail < _TAIL * tail[0]))
    kernel: Array = np.concatenate([right[reach:0:-1], right[: reach + 1]])
    kernel.flags.writeable = False
    return kernel

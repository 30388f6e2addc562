"""Convolution of what has holes with a long kernel, and the kernel of a response."""

from __future__ import annotations

import numpy as np

from trackfg.numerics.arrays import Array
from trackfg.numerics.convolution import convolve_inside
from trackfg.numerics.spans import true_runs

_TAIL = 1e-3
"""Share of the absolute sum of a response's kernel beyond where it is cut."""
_PERIOD = 64
"""A kernel is computed as if periodic, this many times the longest wavelength long."""


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

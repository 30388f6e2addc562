"""Convolution of profiles with a long kernel, by FFT."""

from __future__ import annotations

from trackfg.numerics.arrays import Array


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

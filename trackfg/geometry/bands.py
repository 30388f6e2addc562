"""The wavelength bands of longitudinal level and alignment: D0 1-5 m, D1 3-25 m, D2 25-70 m, D3 70-150 m.

A band is a 4th-order Butterworth band-pass run both ways, so with zero phase and the gain

    G(W) = 1 / (1 + ((W^2 - W1 W2) / (W (W2 - W1)))^8),    W1 = 2 pi / longest, W2 = 2 pi / shortest,

1 in the middle and 1/2 at both edges. (The analogue form: no bilinear transform bends the wavelengths near the step.)

Profiles grow without bound: the lateral position in a curve like x^2, the height with the gradient. Therefore the band
is taken from the second difference, which does not, with a kernel ``K`` whose response is that of the band over that of
the second difference:

    y_band = K * d2y,    d2y_i = (y_{i-1} - 2 y_i + y_{i+1}) / h^2,    K(W) = -G(W) h^2 / (2 - 2 cos(W h)).

``G`` falls like W^8 to long wavelengths, so ``K`` is smooth and its tail falls exponentially. It is cut where the
response as realised (:func:`realised_band_response`) is within 1e-4 of ``G`` at every wavelength.

Beyond an end, or a hole, the second difference is continued by its mean over the last ``longest`` of the profile, so
that a circle continues as a circle. Values within :func:`end_margin_m` of an end or a hole are NaN. They could be wrong
by more than 2 % of the amplitude of a sine whose wavelength is ``shortest`` to four times ``longest``.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from trackfg.errors import BadInputError
from trackfg.geometry.convolution import kernel_frequencies
from trackfg.geometry.grid import wave_number
from trackfg.numerics.arrays import Array
from trackfg.numerics.convolution import convolve_inside
from trackfg.numerics.spans import true_runs

_TAIL = 2e-5
"""The kernel is cut where the rest of it would add less than this to the response at the longest wavelength."""
_END_ERROR = 0.02
"""What the missing part of the kernel may do to a sine of any wavelength at an end, as a share of its amplitude. Chosen
here."""


_FADED = 10.0
"""So many times beyond its ends a band has faded, to 1e-8 of its amplitude."""


@dataclass(frozen=True)
class Band:
    """Wavelengths from ``shortest_m`` to ``longest_m``. Raises ``BadInputError`` unless ``0 < shortest < longest``."""

    shortest_m: float
    longest_m: float

    def __post_init__(self) -> None:
        if not 0.0 < self.shortest_m < self.longest_m < np.inf:
            raise BadInputError(
                f"band from {self.shortest_m!r} m to {self.longest_m!r} m; expected 0 < shortest < longest"
            )


D0 = Band(1.0, 5.0)
D1 = Band(3.0, 25.0)
D2 = Band(25.0, 70.0)
D3 = Band(70.0, 150.0)
"""The wavelength ranges D0 to D3 of track geometry; D1 to D3 are those of EN 13848-1."""
BANDS = {"D0": D0, "D1": D1, "D2": D2, "D3": D3}


def band_pass(y: ArrayLike, step_m: float, band: Band) -> Array:
    """Return the part of a profile (..., n) in a band, in its unit; NaN within :func:`end_margin_m` of an end or hole.

    A hole in one row is a hole in all. Raises ``BadInputError`` where the step is too long for the band.
    """
    kernel = _kernel(band, step_m)
    margin = _end_margin(band, step_m)
    y = np.asarray(y, dtype=np.float64)
    out = np.full(y.shape, np.nan)
    whole = np.isfinite(y).all(axis=tuple(range(y.ndim - 1)))
    for first, stop in true_runs(whole):
        if stop - first > 2 * margin:
            inner = _band_of_run(y[..., first:stop], step_m, band, kernel)
            out[..., first + margin : stop - margin] = inner[..., margin:-margin]
    return out


def band_response(wavelength_m: ArrayLike, band: Band) -> Array:
    """Return the gain ``G`` of a band, real; 0 for an infinite wavelength."""
    W = wave_number(wavelength_m)
    low, high = 2.0 * np.pi / band.longest_m, 2.0 * np.pi / band.shortest_m
    safe = np.where(W == 0.0, 1.0, W)
    detuning = (safe * safe - low * high) / (safe * (high - low))
    return np.asarray(np.where(W == 0.0, 0.0, 1.0 / (1.0 + detuning**8)))


@lru_cache(maxsize=32)
def band_variance(band: Band, order: int) -> float:
    """Return the integral of ``(G / W^order)^2`` over the wave numbers ``W``, rad/m.

    It is the variance in a band of a profile whose derivative of that order is white, over the density of that.
    """
    lengths = np.geomspace(band.longest_m * _FADED, band.shortest_m / _FADED, 4001)
    W = wave_number(lengths)
    return float(np.trapezoid((band_response(lengths, band) / W**order) ** 2, W))


def realised_band_response(wavelength_m: ArrayLike, step_m: float, band: Band) -> Array:
    """Return the response of :func:`band_pass` away from the ends, real: the kernel's times the second difference's."""
    W = wave_number(wavelength_m)
    kernel = _kernel(band, step_m)
    half = len(kernel) // 2
    weights = np.concatenate([[1.0], np.full(half, 2.0)]) * kernel[half:]
    cosines = np.cos(W[..., None] * step_m * np.arange(half + 1))
    return np.asarray(-(cosines @ weights) * (2.0 - 2.0 * np.cos(W * step_m)) / step_m**2)


def end_margin_m(step_m: float, band: Band) -> float:
    """Return how far from an end :func:`band_pass` gives its first value, m."""
    return _end_margin(band, step_m) * step_m


def _band_of_run(y: Array, step_m: float, band: Band, kernel: Array) -> Array:
    """Return the band of a profile without holes, continued at both ends."""
    second = y[..., 2:] - y[..., 1:-1]
    second -= y[..., 1:-1] - y[..., :-2]  # difference of differences: the large values cancel first
    second /= step_m**2
    reach = len(kernel) // 2
    mean_over = _mean_over(band, step_m)
    n = y.shape[-1]
    padded = np.empty((*y.shape[:-1], n + 2 * reach))
    padded[..., : reach + 1] = second[..., :mean_over].mean(axis=-1, keepdims=True)
    padded[..., reach + 1 : reach + n - 1] = second
    padded[..., reach + n - 1 :] = second[..., -mean_over:].mean(axis=-1, keepdims=True)
    return convolve_inside(padded, kernel)


def _mean_over(band: Band, step_m: float) -> int:
    return max(1, round(band.longest_m / step_m))


@lru_cache(maxsize=32)
def _kernel(band: Band, step_m: float) -> Array:
    """Return ``K`` at the steps from ``-reach`` to ``reach``; its last eighth tapered, its sum zero."""
    if not 0.0 < step_m < band.shortest_m / 2.0:
        raise BadInputError(f"step_m is {step_m!r}; expected less than half of the band's {band.shortest_m:g} m")
    frequency = kernel_frequencies(band.longest_m, step_m)
    response = np.zeros(len(frequency))
    second_difference = -(2.0 - 2.0 * np.cos(2.0 * np.pi * frequency[1:] * step_m)) / step_m**2
    response[1:] = band_response(1.0 / frequency[1:], band) / second_difference
    right = np.fft.irfft(response)[: len(response) - 1]
    tail = 2.0 * np.cumsum(np.abs(right[::-1]))[::-1] * (2.0 * np.pi / band.longest_m) ** 2
    reach = int(np.argmax(tail < _TAIL))
    right = right[: reach + 1]
    taper = reach // 8
    right[reach + 1 - taper :] *= 0.5 + 0.5 * np.cos(np.pi * np.arange(1, taper + 1) / (taper + 1))
    kernel: Array = np.concatenate([right[:0:-1], right])
    window = np.hanning(len(kernel))
    kernel -= window * (kernel.sum() / window.sum())  # a circle has no part in a band: its response is 0 to rounding
    kernel.flags.writeable = False
    return kernel


@lru_cache(maxsize=32)
def _end_margin(band: Band, step_m: float) -> int:
    """Return steps from an end to where the part of the kernel beyond it does less than ``_END_ERROR`` of any sine.

    At ``m`` steps from the end, a sine (second difference 1) is wrong by ``sum_{j > m} K_j (exp(i w (j - m)) - c)``,
    with ``c`` the mean that it is continued by.
    """
    kernel = _kernel(band, step_m)
    right = kernel[len(kernel) // 2 :]
    j = np.arange(len(right))
    constant = np.cumsum(right[::-1])[::-1]
    worst = np.zeros(len(right))
    for wavelength in np.geomspace(band.shortest_m, 4.0 * band.longest_m, 60):
        w = 2.0 * np.pi / wavelength * step_m
        wave = np.cumsum((right * np.exp(1j * w * j))[::-1])[::-1] * np.exp(-1j * w * j)
        mean = np.exp(-1j * w * np.arange(_mean_over(band, step_m))).mean()
        gain = (2.0 - 2.0 * np.cos(w)) / step_m**2
        worst = np.maximum(worst, np.abs(wave - constant * mean) * gain)
    return int(np.flatnonzero(worst > _END_ERROR).max()) + 1

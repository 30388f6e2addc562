"""Irregularities of a track: level, alignment, cross-level and gauge as random functions of the arc length.

Each is a stationary Gaussian process with a one-sided power spectral density ``S(W)`` in m^2/(rad/m), independent of
the others. Its shape is that of the German spectra for low and high disturbance, which are those of ORE B176:

    level, alignment:    S = A Wc^2 / ((W^2 + Wr^2)(W^2 + Wc^2)),
    cross-level, gauge:  S = A Wc^2 W^2 / ((W^2 + Wr^2)(W^2 + Wc^2)(W^2 + Ws^2)),

    Wr = 0.0206, Wc = 0.8246, Ws = 0.438 rad/m, and for cross-level A = 4 A_level (B176 states its angle on 1.5 m).

A model that asks for a standard deviation in the band D1 scales ``S`` so that the *expected* one is that:
``integral of S g^2 dW`` with the gain ``g`` of the band, not the sample of one realisation.

The spectra hold for wavelengths of several metres and more. Nothing shorter than 1.5 m is generated: what there is in
real track belongs to rail surface, welds and sleepers, not to track geometry. Above 2 m everything is there up to three
quarters of the longest wavelength; in between, the amplitude fades as cos^2 of the logarithm of the wavelength.

Synthesis is a convolution of white noise with the even kernel whose transform is ``sqrt(S)``. So a longer track begins
as a shorter one of the same seed (to rounding, and but for the fading at its end). The samples, 0.25 m apart, are knots
of a quintic spline: four times continuously differentiable, and exact polynomials to everyone who asks.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, lru_cache
from math import ceil, e, factorial
from typing import Literal

import numpy as np
from scipy import fft
from scipy.interpolate import PPoly, make_interp_spline
from scipy.special import lambertw

from trackfg.datasets.line.defects import Defect
from trackfg.datasets.line.polynomials import mirrored
from trackfg.datasets.line.wavelength_band import d1_gain
from trackfg.numerics.arrays import Array

KNOT_M = 0.25
"""Distance of the spline's knots, m: six to the shortest wave."""
SHORTEST_M = 1.5
"""Shortest wave that is generated, m; the module's docstring says why."""
FADE_M = 25.0
"""Over so much at each end of the track the irregularities grow from nothing, so that a run starts on smooth track."""

_FADE_RATIO = 4.0 / 3.0
"""Ratio of wavelengths over which the amplitude fades at both ends: 1.5 to 2 m. Chosen here."""
_KERNEL_WAVES = 6
"""Half length of the kernel, in longest wavelengths. Chosen here."""
_OMEGA_R, _OMEGA_C, _OMEGA_S = 0.0206, 0.8246, 0.438
"""Corners of the spectra, rad/m (ORE B176)."""
_AMPLITUDES = {
    "low": (4.032e-7, 2.119e-7, 4 * 4.032e-7, 5.32e-8),
    "high": (1.08e-6, 6.125e-7, 4 * 1.08e-6, 1.032e-7),
}
"""A of level, alignment, cross-level and gauge, m^2 rad/m."""


@dataclass(frozen=True)
class IrregularityModel:
    """The shape of the spectra to draw, and the standard deviation of each quantity in the band D1, m.

    ``None`` leaves a quantity at the shape's own height, in which cross-level refers to a base of 1.5 m. Nothing longer
    than ``longest_m`` is there.
    """

    shape: Literal["low", "high"] = "low"
    level_d1_sd_m: float | None = None
    alignment_d1_sd_m: float | None = None
    cross_level_d1_sd_m: float | None = None
    gauge_d1_sd_m: float | None = None
    longest_m: float = 200.0


@dataclass(frozen=True)
class Irregularities:
    """Level (up), alignment (to the left), cross-level (left over right rail) and gauge deviation, m, on [0, length].

    ``functions`` has these four columns. The left rail's level is level + cross_level / 2 and its alignment
    alignment + gauge / 2; the right one's, the differences.
    """

    functions: PPoly
    length_m: float

    @classmethod
    def none(cls, length_m: float) -> Irregularities:
        """Return a perfect track."""
        return cls(PPoly(np.zeros((1, 1, 4)), np.array([0.0, length_m])), length_m)

    @classmethod
    def through(cls, values: Array, length_m: float) -> Irregularities:
        """Return the quintic spline through ``values`` (n, 4), 0.25 m apart from ``s = 0``, the last at the end or
        beyond.
        """
        s = KNOT_M * np.arange(len(values), dtype=np.float64)
        spline = make_interp_spline(s, values, k=5)
        taylor = np.stack([spline(s[:-1], nu) / factorial(nu) for nu in range(5, -1, -1)])
        return cls(PPoly(taylor, s), length_m)

    def at(self, s: Array, nu: int = 0) -> Array:
        """Return the four at ``s``, or their derivatives of order ``nu``, m/m^nu. Shape (...) to (..., 4).

        Beyond the ends they stay what they are there; drawn ones are nothing there.
        """
        return np.asarray(self.functions(np.clip(s, self.functions.x[0], self.functions.x[-1]), nu))

    def reversed(self) -> Irregularities:
        """Return the same track to who comes from its other end: ``s`` becomes ``length - s`` and left becomes
        right.
        """
        c, x = self.functions.c, self.functions.x
        columns = [mirrored(PPoly(sign * c[..., i], x), self.length_m) for i, sign in enumerate((1, -1, -1, 1))]
        turned = np.stack([column.c for column in columns], axis=-1)
        return Irregularities(PPoly(turned, columns[0].x), self.length_m)


def draw_irregularities(
    model: IrregularityModel, length_m: float, rng: np.random.Generator, defects: Sequence[Defect] = ()
) -> Irregularities:
    """Return irregularities of a track of this length, with the defects added. The same ``rng`` state gives the same
    ones.

    Raises ``ValueError`` where a defect reaches beyond an end.
    """
    for defect in defects:
        first, last = defect.extent_m
        if first < 0.0 or last > length_m:
            raise ValueError(f"{defect} reaches beyond the track, which is from 0 to {length_m} m")
    s = KNOT_M * np.arange(int(np.ceil(length_m / KNOT_M)) + 1, dtype=np.float64)
    kernels = _kernels(model)
    noise = np.stack([stream.standard_normal(len(s) + len(kernels) - 1) for stream in rng.spawn(4)], axis=-1)
    values = _convolved(noise, kernels) * _fade(s, length_m)[:, None]
    for defect in defects:
        first, last = np.searchsorted(s, defect.extent_m)
        values[first:last] += defect.deviations(s[first:last])
    return Irregularities.through(values, length_m)


def spectra(model: IrregularityModel, wavenumber: Array) -> Array:
    """Return one-sided power spectral densities of what the model draws, m^2/(rad/m), at wavenumbers in rad/m.

    Columns level, alignment, cross-level, gauge. Shape (...) to (..., 4).
    """
    return _shape(model, wavenumber) * _scales(model)


def _shape(model: IrregularityModel, wavenumber: Array) -> Array:
    """Return the unscaled spectra with their ends faded out. Shape (...) to (..., 4)."""
    w = np.abs(np.asarray(wavenumber, dtype=np.float64))[..., None]
    w2 = w * w
    smooth = _OMEGA_C**2 / ((w2 + _OMEGA_R**2) * (w2 + _OMEGA_C**2))
    turning = np.concatenate([np.ones((*w.shape[:-1], 2)), np.repeat(w2 / (w2 + _OMEGA_S**2), 2, axis=-1)], axis=-1)
    return np.asarray(np.array(_AMPLITUDES[model.shape]) * smooth * turning * _passed(model, w) ** 2)


def _passed(model: IrregularityModel, w: Array) -> Array:
    """Return the amplitude that the ends leave: 1 inside, cos^2 of the logarithm over the fade, 0 outside."""
    fade = np.log(_FADE_RATIO)
    with np.errstate(divide="ignore"):
        inside = np.minimum(np.log(w * model.longest_m / (2 * np.pi)), np.log(2 * np.pi / (w * SHORTEST_M)))
    return np.asarray(np.sin(0.5 * np.pi * np.clip(inside / fade, 0.0, 1.0)) ** 2)


@cache
def _scales(model: IrregularityModel) -> Array:
    """Return what multiplies each spectrum, from the variances in D1 of the unscaled ones: the trapezium rule over the
    logarithm of the wavenumber. Shape (4,).
    """
    w = np.geomspace(2 * np.pi / model.longest_m, 2 * np.pi / SHORTEST_M, 4001)
    density = _shape(model, w) * (d1_gain(w) ** 2 * w)[:, None]
    natural = np.sqrt(np.trapezoid(density, np.log(w), axis=0))
    asked = (model.level_d1_sd_m, model.alignment_d1_sd_m, model.cross_level_d1_sd_m, model.gauge_d1_sd_m)
    return np.array([1.0 if sd is None else (sd / unscaled) ** 2 for sd, unscaled in zip(asked, natural, strict=True)])


@lru_cache(maxsize=4)  # those of long waves are large
def _kernels(model: IrregularityModel) -> Array:
    """Return what turns white noise of variance 1 into the four, by convolution. Shape (odd, 4).

    Noise convolved with a kernel of transform ``H`` has the density ``S = H^2 KNOT / pi``.
    """
    half = int(np.ceil(_KERNEL_WAVES * model.longest_m / KNOT_M))
    size = fft.next_fast_len(8 * half, real=True)
    w = 2 * np.pi * fft.rfftfreq(size, KNOT_M)
    kernel = fft.irfft(np.sqrt(spectra(model, w) * np.pi / KNOT_M), size, axis=0)
    return np.concatenate([kernel[-half:], kernel[: half + 1]])


def _convolved(noise: Array, kernels: Array) -> Array:
    """Return the convolution of each column (n, 4) with its kernel (k, 4), where that lies within it. (n - k + 1, 4).

    By overlap-add of transforms of N values, ``N = (k - 1) ln(2 e N)``, which take the fewest operations. What
    ``scipy.signal`` has for this takes longer to import than a short run takes to simulate.
    """
    n, overlap = len(noise), len(kernels) - 1
    size = fft.next_fast_len(ceil(-overlap * lambertw(-1.0 / (2.0 * e * overlap), -1).real))
    step = size - overlap
    if size >= n or len(kernels) >= n / 2:
        size, step = fft.next_fast_len(n + overlap, real=True), n
    blocks = ceil(n / step)
    padded = np.pad(noise, ((0, blocks * step - n), (0, 0))).reshape(blocks, step, -1)
    parts = fft.irfft(fft.rfft(padded, size, axis=1) * fft.rfft(kernels, size, axis=0), size, axis=1)
    parts[1:, :overlap] += parts[:-1, step : step + overlap]
    return np.asarray(parts[:, :step].reshape(blocks * step, -1)[overlap:n])


def _fade(s: Array, length_m: float) -> Array:
    x = np.clip(np.minimum(s, length_m - s) / min(FADE_M, 0.5 * length_m), 0.0, 1.0)
    return np.asarray(x**4 * (35.0 - 84.0 * x + 70.0 * x**2 - 20.0 * x**3))

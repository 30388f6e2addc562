"""Level and alignment in the bands D2 and D3 from versines: the band of the profile that the versine was taken of.

A versine over the chord ``L`` has the response ``1 - cos(W L / 2)``, which is above zero at every wavelength beyond
``L / 2``. So the part of a profile in a band of longer waves is the versine through the kernel

    K(W) = G(W) / (1 - cos(W L / 2)),

``G`` the band's response (:func:`trackfg.geometry.bands.band_response`). Below the wavelength where ``G`` has fallen to
1e-5 the kernel is zero.

**Sigmas.** The white noise of a gyro makes errors of the curvature that are as dense at every wavelength, and the
profile is the curvature through ``1 / W^2``. So the errors of a band and of the versine have the ratio of variances

    integral of (G / W^2)^2 dW / integral of ((1 - cos(W L / 2)) / W^2)^2 dW,    the latter pi L^3 / 48.

Whatever else is wrong with a versine has less of it in long waves, so that the sigma of a band is too large then.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from trackfg.errors import BadInputError
from trackfg.geometry.bands import BANDS, Band, band_response, band_variance
from trackfg.geometry.convolution import convolve_runs, kernel_frequencies, kernel_of_response
from trackfg.numerics.arrays import Array
from trackfg.numerics.chainage.chainage_grid import cells_of

_LEAST_RESPONSE = 1e-5
"""Response of a band below which its waves are left out: a hundredth of a micrometre in a millimetre."""


def band_of_versine(versine: ArrayLike, step_m: float, chord_m: float, band: Band) -> Array:
    """Return the part of a profile in a band, in the unit of its versine (n,); NaN near an end or a hole.

    Raises ``BadInputError`` for a band with waves that the versine does not have: shorter than the chord.
    """
    if band.shortest_m < 2.0 * chord_m:
        raise BadInputError(
            f"band from {band.shortest_m:g} m: a versine over {chord_m:g} m shows waves from {2.0 * chord_m:g} m on"
        )
    return convolve_runs(np.asarray(versine, dtype=np.float64), _kernel(step_m, chord_m, band))


def with_long_bands(geometry: pd.DataFrame, step_m: float, chord_m: float) -> pd.DataFrame:
    """Return a geometry with level and alignment of the centre line in the bands D2 and D3, from its versines.

    Its further columns are ``level_d2_mm`` and so on, without those of a band that begins below twice the chord, and
    ``level_d2_mm_sd`` where the versine has a sigma. Rows are whole multiples of the step; some may be missing.
    """
    cells = cells_of(geometry, step_m)
    bands: dict[str, Array] = {}
    for quantity in ("level", "alignment"):
        versine, column = np.full(int(cells[-1] - cells[0]) + 1, np.nan), f"versine_{quantity}_mm"
        versine[cells - cells[0]] = geometry[column].to_numpy()
        for key in ("D2", "D3"):
            if BANDS[key].shortest_m < 2.0 * chord_m:
                continue
            name, values = f"{quantity}_{key.lower()}_mm", band_of_versine(versine, step_m, chord_m, BANDS[key])
            bands[name] = values[cells - cells[0]]
            if f"{column}_sd" in geometry:
                sd = geometry[f"{column}_sd"].to_numpy() * _sigma_ratio(chord_m, BANDS[key])
                bands[f"{name}_sd"] = np.where(np.isnan(bands[name]), np.nan, sd)
    return geometry.assign(**bands)


def _sigma_ratio(chord_m: float, band: Band) -> float:
    """Return the sigma of a band over that of the versine, both of white errors of the curvature."""
    return float(np.sqrt(band_variance(band, 2) / (np.pi * chord_m**3 / 48.0)))


@lru_cache(maxsize=16)
def _kernel(step_m: float, chord_m: float, band: Band) -> Array:
    """Return the kernel ``K`` at the steps to either side of a place."""
    frequency = kernel_frequencies(band.longest_m, step_m)
    gain = np.zeros(len(frequency))
    gain[1:] = band_response(1.0 / frequency[1:], band)
    response = 1.0 - np.cos(np.pi * frequency * chord_m)
    used = gain > _LEAST_RESPONSE
    spectrum = np.zeros(len(frequency))
    spectrum[used] = gain[used] / response[used]
    return kernel_of_response(spectrum)

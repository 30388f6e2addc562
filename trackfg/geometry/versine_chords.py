"""Versines over further chords, from the band and the versine of a profile that a table has.

A band has no long waves and a versine over the chord ``L`` none of ``L / 2``, but together they have every wave from
the shortest of the band on. With their responses ``G`` (:func:`trackfg.geometry.bands.band_response`) and
``H = 1 - cos(W L / 2)``, the versine over the chord ``c`` is estimated by least squares,

    v_c = K_G * band + K_H * versine,    (K_G, K_H) = A H_c (G, H) / (G^2 + H^2 + (1 - A)^2),    H_c = 1 - cos(W c / 2),

where ``A = 1 / (1 + (W / W2)^8)`` leaves out the waves that neither contains, shorter than the band's shortest
``2 pi / W2``; ``(1 - A)^2`` keeps the kernels short, since there ``G`` and the zeros of ``H`` meet. Errors of long
waves grow by ``(c / L)^2``, the ratio of the two versines of a circle.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import lru_cache

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from trackfg.errors import BadInputError
from trackfg.geometry.bands import Band, band_response
from trackfg.geometry.convolution import convolve_runs, kernel_frequencies, kernel_of_response
from trackfg.numerics.arrays import Array

_MOST_RATIO = 4.0
"""Of a chord to that of the table's versines: beyond it the errors of long waves grow more than 16 times. Chosen here:
the longest chord of 49 CFR 213, 124 ft, is 3.8 times 10 m."""


def versine_over(
    band_part: ArrayLike, versine: ArrayLike, step_m: float, band: Band, chords_m: tuple[float, float]
) -> Array:
    """Return the versines of a profile over another symmetrical chord (n,); NaN within some metres of an end or a hole.

    ``band_part`` and ``versine``, both (n,), are the part of the profile in ``band`` and its versine over the first of
    ``chords_m``; the second is the chord asked for. Raises ``BadInputError`` where these two together lack any wave
    from the shortest of the band on, or the chord is more than four times that of the versine.
    """
    from_m, chord_m = chords_m
    if reason := _undetermined(band, from_m, chord_m):
        raise BadInputError(reason)
    of_band, of_versine = _kernels(step_m, band, from_m, chord_m)
    parts = (np.asarray(band_part, dtype=np.float64), of_band), (np.asarray(versine, dtype=np.float64), of_versine)
    return sum((convolve_runs(values, kernel) for values, kernel in parts), start=np.zeros(1))


def further_chord_column(parameter: str, side: str, chord_m: float) -> str:
    """Return the name of a column of versines over a further chord, such as ``versine_level_left_18.8976m_mm``."""
    return f"versine_{parameter}{side}_{chord_m:.6g}m_mm"


def with_further_chords(
    geometry: pd.DataFrame, step_m: float, band: Band, from_m: float, chords_m: Iterable[float]
) -> pd.DataFrame:
    """Return a geometry with versines of level and alignment over further chords, as far as its columns determine them.

    ``band`` and ``from_m`` are the band and the chord of its columns. It has a row at every step.
    """
    further: dict[str, Array] = {}
    for chord in (each for each in chords_m if not _undetermined(band, from_m, each)):
        for parameter in ("level", "alignment"):
            for side in ("", "_left", "_right"):
                names = f"{parameter}{side}_mm", f"versine_{parameter}{side}_mm"
                if all(name in geometry for name in names):
                    of_band, versine = (geometry[name].to_numpy(dtype=np.float64) for name in names)
                    values = versine_over(of_band, versine, step_m, band, (from_m, chord))
                    further[further_chord_column(parameter, side, chord)] = values
    return geometry.assign(**further)


def _undetermined(band: Band, from_m: float, chord_m: float) -> str:
    """Return why a band and versines over ``from_m`` do not determine those over ``chord_m``; empty where they do."""
    if not band.shortest_m <= from_m / 2.0 <= band.longest_m:
        waves = f"has no waves of {from_m / 2.0:g} m, which a versine over {from_m:g} m lacks"
        return f"band from {band.shortest_m:g} to {band.longest_m:g} m {waves}"
    if chord_m > _MOST_RATIO * from_m:
        return f"chord of {chord_m:g} m: versines over {from_m:g} m determine chords to {_MOST_RATIO * from_m:g} m"
    return ""


@lru_cache(maxsize=16)
def _kernels(step_m: float, band: Band, from_m: float, chord_m: float) -> tuple[Array, Array]:
    """Return ``K_G`` and ``K_H`` at the steps to either side of a place."""
    frequency = kernel_frequencies(max(band.longest_m, from_m, chord_m), step_m)[1:]
    low = 1.0 / (1.0 + (frequency * band.shortest_m) ** 8)
    gain = band_response(1.0 / frequency, band)
    of_versine = 1.0 - np.cos(np.pi * frequency * from_m)
    wanted = low * (1.0 - np.cos(np.pi * frequency * chord_m))
    share = wanted / (gain**2 + of_versine**2 + (1.0 - low) ** 2)
    return (
        kernel_of_response(np.append(0.0, share * gain)),
        kernel_of_response(np.append((chord_m / from_m) ** 2, share * of_versine)),
    )

"""Level and alignment of each rail in the bands of EN 13848-1, from the centre line, the cross-level and the gauge.

The centre line is the mean of both rails. So the left rail is half the cross-level higher, where that refers to the
distance of the rails, and half the gauge to the left of it, the right one as much lower and to the right; bands are
linear, so that this holds of each band:

    left = centre + band(cross_level or gauge) / 2,    right = centre - band(cross_level or gauge) / 2.

Without displacement sensors the gauge is not measured, and alignment is that of the centre line alone.

**Sigmas.** The errors of pitch and yaw, which bend the centre line, and of roll are independent, so variances add up.
The white noise of a gyro makes a roll whose derivative is white. A twist over the base ``b`` has the variance ``pi b``
of it, by ``|2 sin(W b / 2)|``, a band the integral of ``(G / W)^2 dW``: the cross-level in a band has the sigma of the
twist times the root of their ratio. That of the gauge, of lasers, is at most the gauge's own.
"""

from __future__ import annotations

import numpy as np
import pandas as pd

from trackfg.geometry.bands import BANDS, Band, band_pass, band_variance
from trackfg.numerics.arrays import Array
from trackfg.numerics.chainage.chainage_grid import cells_of

_APART = {"level": "cross_level_mm", "alignment": "gauge_mm"}
"""How far the left rail is from the right one, upwards and sideways."""


def with_rail_bands(
    geometry: pd.DataFrame, step_m: float, twist_base_m: float, *, tops_over_base: float = 1.0
) -> pd.DataFrame:
    """Return a geometry with the rails' level and alignment in the bands D1 to D3 (``level_left_d2_mm``).

    It has those bands of the centre line that the geometry has, D1 as ``level_mm``, D2 and D3 as
    :func:`~trackfg.geometry.versine_bands.with_long_bands` gives them; no D1 of a rail that was measured by itself
    (``level_left_mm``). They have sigmas (``level_left_d2_mm_sd``) where the centre line, gauge and twist have. Rows
    are whole multiples of the step; some may be missing. ``tops_over_base``: how far the rails are apart over the base
    of the cross-level.
    """
    cells = cells_of(geometry, step_m)
    bands: dict[str, Array] = {}
    for quantity, apart in _APART.items():
        if apart not in geometry:
            continue
        profile = np.full(int(cells[-1] - cells[0]) + 1, np.nan)
        profile[cells - cells[0]] = geometry[apart].to_numpy()
        for key in ("D1", "D2", "D3"):
            centre = f"{quantity}_mm" if key == "D1" else f"{quantity}_{key.lower()}_mm"
            if centre not in geometry or (key == "D1" and f"{quantity}_left_mm" in geometry):
                continue
            share = 0.5 * (tops_over_base if quantity == "level" else 1.0)
            half = share * band_pass(profile, step_m, BANDS[key])[cells - cells[0]]
            sd = _sigma(geometry, centre, apart, BANDS[key], twist_base_m, share)
            for side, sign in (("left", 1.0), ("right", -1.0)):
                name = f"{quantity}_{side}_{key.lower()}_mm"
                bands[name] = geometry[centre].to_numpy() + sign * half
                if sd is not None:
                    bands[f"{name}_sd"] = np.where(np.isnan(bands[name]), np.nan, sd)
    return geometry.assign(**bands)


def _sigma(
    geometry: pd.DataFrame, centre: str, apart: str, band: Band, twist_base_m: float, share: float
) -> Array | None:
    """Return the sigma of a rail in a band, from those of the ``centre`` line and of how far rails are ``apart``."""
    of_apart, ratio = f"{apart}_sd", 1.0
    if apart == "cross_level_mm":
        of_apart, ratio = "twist_mm_sd", float(np.sqrt(band_variance(band, 1) / (np.pi * twist_base_m)))
    if f"{centre}_sd" not in geometry or of_apart not in geometry:
        return None
    return np.asarray(np.hypot(geometry[f"{centre}_sd"].to_numpy(), share * ratio * geometry[of_apart].to_numpy()))

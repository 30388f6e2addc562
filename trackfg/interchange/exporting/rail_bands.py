"""Level and alignment of each rail in the bands of EN 13848-1, from the centre line, the cross-level and the gauge.

The centre line is the mean of both rails. So the left rail is half the cross-level higher, and half the gauge to the
left of it, the right one as much lower and to the right; bands are linear, so that this holds of each band:

    left = centre + band(cross_level or gauge) / 2,    right = centre - band(cross_level or gauge) / 2.

Without displacement sensors the gauge is not measured, and alignment is that of the centre line alone.
"""

from __future__ import annotations

import numpy as np
import pandas as pd

from trackfg.geometry.bands import BANDS, band_pass
from trackfg.numerics.arrays import Array
from trackfg.numerics.chainage_grid import cells_of

_APART = {"level": "cross_level_mm", "alignment": "gauge_mm"}
"""How far the left rail is from the right one, upwards and sideways."""


def with_rail_bands(geometry: pd.DataFrame, step_m: float) -> pd.DataFrame:
    """Return a geometry with the rails' level and alignment in the bands D1 to D3 (``level_left_d2_mm``).

    It has those bands of the centre line that the geometry has, D1 as ``level_mm``, D2 and D3 as
    :func:`~trackfg.geometry.versine_bands.with_long_bands` gives them; no D1 of a rail that was measured by itself
    (``level_left_mm``). Rows are whole multiples of the step; some may be missing.
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
            half = 0.5 * band_pass(profile, step_m, BANDS[key])[cells - cells[0]]
            for side, sign in (("left", 1.0), ("right", -1.0)):
                bands[f"{quantity}_{side}_{key.lower()}_mm"] = geometry[centre].to_numpy() + sign * half
    return geometry.assign(**bands)

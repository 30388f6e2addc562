"""Score a geometry table against the true one.

The geometry at a place and the chainage of that place are two estimates, each with its own sigma. So the error of a
quantity is taken where the vehicle was: a row at estimated chainage ``x`` was measured at ``x - e(x)``, ``e`` the error
of the trajectory's chainage, and is compared with the truth there. At a fixed ``x`` instead, 1 m of chainage error in a
transition of 10 mm per 10 m would count as 1 mm of cross-level, which no sigma of the cross-level holds.

The truth between its rows is a quintic spline: its curvature has waves of 3 m, of which a straight line over 0.25 m
misses 1e-6 1/m. (At a kink, the end of a straight cant ramp, the spline is off by up to 0.1 mm for a row or two.) Truth
and estimate hold all quantities facing increasing chainage.
"""

from __future__ import annotations

import numpy as np
import pandas as pd

from trackfg.evaluation.scores import PLACE, quantities
from trackfg.numerics.arrays import Array
from trackfg.numerics.chainage.passes import passes
from trackfg.numerics.splines import spline_at


def geometry_errors(
    geometry: pd.DataFrame, trajectory: pd.DataFrame, truth: pd.DataFrame, truth_geometry: pd.DataFrame
) -> pd.DataFrame:
    """Return errors of a geometry table at the places where its rows were measured.

    ``trajectory`` and ``truth`` have ``t_s, chainage_m``; a ``geometry`` with ``t_s``, as of a stream, holds by itself
    when the vehicle was where. Columns, one row per row of ``geometry``: ``chainage_m``
    (estimated), ``speed_mps``, and for every quantity that the truth has too its error, under its own name, and its
    sigma, ``_sd``; NaN where the estimate or the truth has no value. Where the run passed a place more than once, the
    pass is the longest, as in the geometry table.
    """
    chainage = geometry["chainage_m"].to_numpy(dtype=np.float64)
    if "t_s" in geometry:
        place = np.interp(geometry["t_s"], truth["t_s"], truth["chainage_m"])
    else:
        place = chainage - _chainage_errors(trajectory, truth, chainage)
    true_chainage = truth_geometry["chainage_m"].to_numpy(dtype=np.float64)
    columns = {name: geometry[name].to_numpy(dtype=np.float64) for name in PLACE}
    for name in quantities(geometry):
        if name in truth_geometry:
            true = spline_at(true_chainage, truth_geometry[name].to_numpy(dtype=np.float64), place)
            columns[name] = geometry[name].to_numpy(dtype=np.float64) - true
            columns[f"{name}_sd"] = geometry[f"{name}_sd"].to_numpy(dtype=np.float64)
    return pd.DataFrame(columns)


def _chainage_errors(trajectory: pd.DataFrame, truth: pd.DataFrame, places: Array) -> Array:
    """Return error of the trajectory's chainage when it was at estimated chainages ``places``; NaN where it never
    was.
    """
    t, estimated = trajectory["t_s"].to_numpy(), trajectory["chainage_m"].to_numpy()
    true = np.interp(t, truth["t_s"].to_numpy(), truth["chainage_m"].to_numpy())
    stretches = [slice(stretch.first, stretch.last + 1) for stretch in passes(true, least_m=0.0)]
    out = np.full(places.shape, np.nan)
    for stretch in sorted(stretches, key=lambda stretch: float(np.ptp(true[stretch])), reverse=True):
        x, error = estimated[stretch], (estimated - true)[stretch]
        if true[stretch][-1] < true[stretch][0]:
            x, error = x[::-1], error[::-1]
        x = np.maximum.accumulate(x)  # at rest an estimate may creep back by less than its sigma
        found = np.isnan(out) & (places >= x[0]) & (places <= x[-1])
        out[found] = np.interp(places[found], x, error)
    return out

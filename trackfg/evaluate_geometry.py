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
from scipy import stats
from scipy.interpolate import make_interp_spline

from trackfg.frames import Array
from trackfg.spans import true_runs
from trackfg.units import KMH

_PLACE = ("chainage_m", "speed_mps")
_DEGREE = 5
COVERED = float(stats.norm.ppf(0.975))
"""Half the width of the interval that holds 95 %, in sigmas."""


def quantities(geometry: pd.DataFrame) -> list[str]:
    """The columns of a geometry table that have a sigma, but for the chainage."""
    return [name for name in map(str, geometry) if f"{name}_sd" in geometry and name not in _PLACE]


def geometry_errors(
    geometry: pd.DataFrame, trajectory: pd.DataFrame, truth: pd.DataFrame, truth_geometry: pd.DataFrame
) -> pd.DataFrame:
    """Errors of a geometry table at the places where its rows were measured.

    ``trajectory`` and ``truth`` have ``t_s, chainage_m``. Columns, one row per row of ``geometry``: ``chainage_m``
    (estimated), ``speed_mps``, and for every quantity that the truth has too its error, under its own name, and its
    sigma, ``_sd``; NaN where the estimate or the truth has no value. Where the run passed a place more than once, the
    pass is the longest, as in the geometry table.
    """
    chainage = geometry["chainage_m"].to_numpy(dtype=np.float64)
    place = chainage - _chainage_errors(trajectory, truth, chainage)
    true_chainage = truth_geometry["chainage_m"].to_numpy(dtype=np.float64)
    columns = {name: geometry[name].to_numpy(dtype=np.float64) for name in _PLACE}
    for name in quantities(geometry):
        if name in truth_geometry:
            true = spline_at(true_chainage, truth_geometry[name].to_numpy(dtype=np.float64), place)
            columns[name] = geometry[name].to_numpy(dtype=np.float64) - true
            columns[f"{name}_sd"] = geometry[f"{name}_sd"].to_numpy(dtype=np.float64)
    return pd.DataFrame(columns)


def spline_at(x: Array, y: Array, places: Array) -> Array:
    """``y`` over ascending, evenly spaced ``x``, both (n,), by a quintic spline through the finite values.

    Shape of ``places``; NaN outside of the finite values, in gaps between them, and everywhere if they are fewer than
    six.
    """
    out = np.full(places.shape, np.nan)
    known = np.isfinite(y)
    x, y = x[known], y[known]
    if len(x) <= _DEGREE:
        return out
    gap = np.diff(x) > 1.5 * np.diff(x).min()
    with np.errstate(invalid="ignore"):
        inside = (places >= x[0]) & (places <= x[-1])
    inside[inside] = ~gap[np.clip(np.searchsorted(x, places[inside], side="right") - 1, 0, len(gap) - 1)]
    out[inside] = make_interp_spline(x, y, k=_DEGREE)(places[inside])
    return out


def _chainage_errors(trajectory: pd.DataFrame, truth: pd.DataFrame, places: Array) -> Array:
    """Error of the trajectory's chainage when it was at estimated chainages ``places``; NaN where it never was."""
    t, estimated = trajectory["t_s"].to_numpy(), trajectory["chainage_m"].to_numpy()
    true = np.interp(t, truth["t_s"].to_numpy(), truth["chainage_m"].to_numpy())
    stretches = [slice(first, stop + 1) for first, stop in _passes(true)]
    out = np.full(places.shape, np.nan)
    for stretch in sorted(stretches, key=lambda stretch: float(np.ptp(true[stretch])), reverse=True):
        x, error = estimated[stretch], (estimated - true)[stretch]
        if true[stretch][-1] < true[stretch][0]:
            x, error = x[::-1], error[::-1]
        x = np.maximum.accumulate(x)  # at rest an estimate may creep back by less than its sigma
        found = np.isnan(out) & (places >= x[0]) & (places <= x[-1])
        out[found] = np.interp(places[found], x, error)
    return out


def _passes(chainage: Array) -> list[tuple[int, int]]:
    """First and last row of each stretch between two changes of direction; a rest belongs to the pass before it."""
    sense = np.sign(np.diff(chainage))
    moving = np.flatnonzero(sense)
    if moving.size == 0:
        return []
    last_moving = np.clip(np.searchsorted(moving, np.arange(len(sense)), side="right") - 1, 0, None)
    sense = sense[moving[last_moving]]
    return [span for way in (1.0, -1.0) for span in true_runs(sense == way)]


def score_run(errors: pd.DataFrame, band_kmh: float = 10.0) -> pd.DataFrame:
    """One run's scores from :func:`geometry_errors`: a row per quantity for all of it, and one per speed band.

    Columns: ``quantity``; ``from_kmh`` (NaN in the row for all); ``places``, the number of rows that have an error;
    ``rms``, of the error; ``sd``, of the error about its mean over the whole run (the constant offset removed, in every
    band the same one); ``max``, of its magnitude; ``mean_sd``, the sigmas' mean; ``ratio``, the rms of error / sigma;
    ``coverage``, the share of errors within 1.96 sigma. An absent quantity has one row, with no places.
    """
    speed = np.floor(errors["speed_mps"].to_numpy() / (band_kmh * KMH))
    rows = []
    for name in quantities(errors):
        error, sd = errors[name].to_numpy(), errors[f"{name}_sd"].to_numpy()
        known = np.isfinite(error) & np.isfinite(sd)
        error, sd, band = error[known], sd[known], speed[known]
        offset = float(error.mean()) if error.size else np.nan
        rows.append({"quantity": name, "from_kmh": np.nan, **_statistics(error, sd, offset)})
        rows += [
            {"quantity": name, "from_kmh": band_kmh * b, **_statistics(error[band == b], sd[band == b], offset)}
            for b in np.unique(band)
        ]
    return pd.DataFrame(rows)


def _statistics(error: Array, sd: Array, offset: float) -> dict[str, float]:
    if error.size == 0:
        return {"places": 0, **dict.fromkeys(("rms", "sd", "max", "mean_sd", "ratio", "coverage"), np.nan)}
    return {
        "places": error.size,
        "rms": _rms(error),
        "sd": _rms(error - offset),
        "max": float(np.abs(error).max()),
        "mean_sd": float(sd.mean()),
        "ratio": _rms(error / sd),
        "coverage": float(np.mean(np.abs(error) <= COVERED * sd)),
    }


def score_runs(runs: pd.DataFrame) -> pd.DataFrame:
    """The scores of many runs (rows of :func:`score_run` under each other), one row per quantity.

    ``runs``, how many have the quantity; ``rms, sd, mean_sd, coverage``: the mean over runs of each run's; ``max`` over
    all; ``ratio``: over all, every run with one weight; ``rms_margin, sd_margin, coverage_margin``: half the width of
    the 95 % interval of the mean (Student's t over runs, which are independent; places of one run are not), NaN for one
    run.
    """
    rows = []
    for name, scores in runs[runs["from_kmh"].isna()].groupby("quantity", sort=False):
        known = scores[scores["places"] > 0]
        row = {"quantity": name, "runs": len(known)}
        for statistic in ("rms", "sd", "mean_sd", "coverage"):
            row[statistic] = known[statistic].mean()
            if statistic != "mean_sd":
                row[f"{statistic}_margin"] = _margin(known[statistic].to_numpy())
        rows.append({**row, "max": known["max"].max(), "ratio": _mean_square_root(known["ratio"])})
    return pd.DataFrame(rows)


def score_bands(runs: pd.DataFrame) -> pd.DataFrame:
    """The scores of many runs by speed band, every place with one weight: a row per quantity and band.

    Columns ``quantity, from_kmh, places, rms, sd, max, mean_sd, ratio, coverage`` as in :func:`score_run`.
    """
    rows = []
    banded = runs[runs["from_kmh"].notna()]
    for (name, band), scores in banded.groupby(["quantity", "from_kmh"], sort=False):
        weight = scores["places"].to_numpy()
        rows.append(
            {
                "quantity": name,
                "from_kmh": band,
                "places": int(weight.sum()),
                **{s: _mean_square_root(scores[s], weight) for s in ("rms", "sd", "ratio")},
                **{s: float(np.average(scores[s], weights=weight)) for s in ("mean_sd", "coverage")},
                "max": scores["max"].max(),
            }
        )
    columns = ["quantity", "from_kmh", "places", "rms", "sd", "max", "mean_sd", "ratio", "coverage"]
    return pd.DataFrame(rows, columns=columns).sort_values(["quantity", "from_kmh"], ignore_index=True)


def _margin(values: Array) -> float:
    if len(values) < 2:
        return np.nan
    return float(stats.t.ppf(0.975, len(values) - 1) * values.std(ddof=1) / np.sqrt(len(values)))


def _mean_square_root(values: pd.Series[float], weights: Array | None = None) -> float:
    return float(np.sqrt(np.average(np.square(values), weights=weights))) if len(values) else np.nan


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))

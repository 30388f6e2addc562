"""Score errors: the one code by which every estimator is judged, whatever it estimates.

What goes in is a table of errors, one row per place or instant: for each quantity its error, under the quantity's own
name, and the sigma that was given for it, ``_sd`` (NaN where none was); ``speed_mps`` where scores by speed are wanted.
"""

from __future__ import annotations

import numpy as np
import pandas as pd
from scipy.special import ndtri, stdtrit

from trackfg.numerics.arrays import Array
from trackfg.numerics.units import KMH

COVERED = float(ndtri(0.975))
"""Half the width of the interval that holds 95 %, in sigmas."""

PLACE = ("chainage_m", "speed_mps")
_OF_ERROR = ("rms", "sd", "mean_abs", "max")
_OF_SIGMA = ("mean_sd", "ratio", "coverage")
STATISTICS = (*_OF_ERROR, *_OF_SIGMA)


def quantities(table: pd.DataFrame) -> list[str]:
    """Return the columns that have a sigma, but for the place."""
    return [name for name in map(str, table) if f"{name}_sd" in table and name not in PLACE]


def score_run(errors: pd.DataFrame, band_kmh: float | None = 10.0) -> pd.DataFrame:
    """Return one run's scores: a row per quantity for all of it, and one per speed band (None: no bands).

    Columns: ``quantity``; ``from_kmh`` (NaN in the row for all); ``places``, the number of rows that have an error;
    ``rms``, of the error; ``sd``, of the error about its mean over the whole run (the constant offset removed, in every
    band the same one); ``mean_abs`` and ``max``, of its magnitude; and where sigmas were given ``mean_sd``, their mean;
    ``ratio``, the rms of error / sigma; ``coverage``, the share of errors within 1.96 sigma. An absent quantity has one
    row, with no places.
    """
    rows = []
    for name in quantities(errors):
        error, sd = errors[name].to_numpy(), errors[f"{name}_sd"].to_numpy()
        known = np.isfinite(error)
        error, sd = error[known], sd[known]
        offset = float(error.mean()) if error.size else np.nan
        rows.append({"quantity": name, "from_kmh": np.nan, **_statistics(error, sd, offset)})
        if band_kmh is None:
            continue
        band = np.floor(errors["speed_mps"].to_numpy()[known] / (band_kmh * KMH))
        rows += [
            {"quantity": name, "from_kmh": band_kmh * b, **_statistics(error[band == b], sd[band == b], offset)}
            for b in np.unique(band[np.isfinite(band)])
        ]
    return pd.DataFrame(rows)


def _statistics(error: Array, sd: Array, offset: float) -> dict[str, float]:
    if error.size == 0:
        return {"places": 0, **dict.fromkeys(STATISTICS, np.nan)}
    row = {
        "places": error.size,
        "rms": rms(error),
        "sd": rms(error - offset),
        "mean_abs": float(np.abs(error).mean()),
        "max": float(np.abs(error).max()),
        **dict.fromkeys(_OF_SIGMA, np.nan),
    }
    claimed = np.isfinite(sd)
    if claimed.any():
        error, sd = error[claimed], sd[claimed]
        row["mean_sd"] = float(sd.mean())
        row["ratio"] = rms(error / sd)
        row["coverage"] = float(np.mean(np.abs(error) <= COVERED * sd))
    return row


def score_runs(runs: pd.DataFrame) -> pd.DataFrame:
    """Return the scores of many runs (rows of :func:`score_run` under each other), one row per quantity.

    ``runs``, how many have the quantity; ``rms, sd, mean_abs, mean_sd, coverage``: the mean over runs of each run's;
    ``max`` over all; ``ratio``: over all, every run with one weight; ``rms_margin`` and so on (but for ``mean_sd``):
    half the width of the 95 % interval of the mean (Student's t over runs, which are independent; places of one run are
    not), NaN for one run.
    """
    rows = []
    for name, scores in runs[runs["from_kmh"].isna()].groupby("quantity", sort=False):
        located = scores[scores["places"] > 0]
        row = {"quantity": name, "runs": len(located)}
        for statistic in ("rms", "sd", "mean_abs", "mean_sd", "coverage"):
            row[statistic] = located[statistic].mean()
            if statistic != "mean_sd":
                row[f"{statistic}_margin"] = margin(located[statistic].to_numpy())
        rows.append({**row, "max": located["max"].max(), "ratio": _mean_square_root(located["ratio"])})
    return pd.DataFrame(rows)


def score_bands(runs: pd.DataFrame) -> pd.DataFrame:
    """Return the scores of many runs by speed band, every place with one weight: a row per quantity and band.

    The columns of :func:`score_run`.
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
                **{s: float(np.average(scores[s], weights=weight)) for s in ("mean_abs", "mean_sd", "coverage")},
                "max": scores["max"].max(),
            }
        )
    columns = ["quantity", "from_kmh", "places", *STATISTICS]
    return pd.DataFrame(rows, columns=columns).sort_values(["quantity", "from_kmh"], ignore_index=True)


def margin(values: Array) -> float:
    """Return half the width of the 95 % interval of the mean (Student's t); NaN for one value."""
    if len(values) < 2:
        return np.nan
    return float(stdtrit(len(values) - 1, 0.975) * values.std(ddof=1) / np.sqrt(len(values)))


def _mean_square_root(values: pd.Series[float], weights: Array | None = None) -> float:
    return float(np.sqrt(np.average(np.square(values), weights=weights))) if len(values) else np.nan


def rms(values: Array | pd.Series) -> float:
    """Return the root of the mean square; NaN of no values, and where one is."""
    return float(np.sqrt(np.mean(np.square(np.asarray(values))))) if len(values) else np.nan

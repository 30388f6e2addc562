"""Estimators are judged by how they predict a part of the measurements that is withheld, where no truth is known.

Every kind of measurement is divided into :data:`FOLDS` parts, which are withheld in turn: every third fix, GNSS
positions of every third span of 30 s, tachometer rows of every third span of 20 s. What is withheld is the same for all
estimators and in all repetitions. The error of a prediction has the measurement's own in it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Literal, get_args

import numpy as np
import pandas as pd

from trackfg.baselines.result import GNSS_CLOCK, BaselineResult
from trackfg.evaluation.trajectory_errors import values_at
from trackfg.numerics.rotations import matrix_from_rpy
from trackfg.numerics.spans import true_runs
from trackfg.recording.model import Recording

Withheld = Literal["fixes", "positions", "tach"]
"""The kinds of measurements that are withheld."""

FOLDS = 3
"""Into how many parts a kind is divided: each estimator runs once per part."""

_TABLE: dict[Withheld, str] = {"fixes": "fixes", "positions": "gnss", "tach": "tach"}
"""The recording's table of each kind."""

_SPAN_S: dict[Withheld, float] = {"positions": 30.0, "tach": 20.0}
"""Length of the spans that are withheld, s: shorter ones would be bridged by interpolation."""

_LEAST_FIXES = 2 * FOLDS
"""Fewer fixes are not divided: what is left would not hold the run."""

_LEAST_WAY_M = 10.0
"""Minimum distance that a tachometer counts over a span that is scored, m."""

_STEP_S = 1.0
"""Step at which the distance within a span is scored, s."""


@dataclass(frozen=True)
class Division:
    """One part of a recording's measurements of a kind: the recording without it, and ``rows`` that are withheld."""

    what: Withheld
    kept: Recording
    rows: np.ndarray
    """Which rows of the measurements' table are withheld, (m,) of bool."""


def divisible(recording: Recording) -> list[Withheld]:
    """Return the kinds of measurements that a recording has enough of to withhold a part."""
    return [what for what in get_args(Withheld) if _parts(recording, what) is not None]


def division(recording: Recording, what: Withheld, part: int) -> Division:
    """Return the recording without one part of its measurements of a kind."""
    parts, name = _parts(recording, what), _TABLE[what]
    assert parts is not None
    rows = parts == part
    kept = recording.tables[name][~rows].reset_index(drop=True)
    return Division(what, replace(recording, **{name: kept}), rows)


def predicted(divided: Division, recording: Recording, estimate: BaselineResult, *, anchored: bool) -> pd.DataFrame:
    """Return the errors of an estimate's predictions of what was withheld, with their sigmas, as scores need them.

    ``anchored``: its chainage is the line's; else it is shifted to fit the fixes that it had. Positions are predicted
    at their stamps on the clock that the estimate found the receiver to have.
    """
    scorers: dict[Withheld, Callable[..., pd.DataFrame]] = {
        "fixes": _fix_errors,
        "positions": _position_errors,
        "tach": _way_errors,
    }
    if divided.what == "positions" and recording.gnss is not None:
        offset_s = float(estimate.parameters.get(GNSS_CLOCK, 0.0))
        recording = replace(recording, gnss=recording.gnss.assign(t_s=recording.gnss["t_s"] + offset_s))
    return scorers[divided.what](divided, recording, estimate.trajectory, anchored=anchored)


def _parts(recording: Recording, what: Withheld) -> np.ndarray | None:
    """Return the part that each row belongs to, -1 for none, (n,); None where there is too little to divide."""
    table = recording.tables.get(_TABLE[what])
    if table is None or len(table) < _LEAST_FIXES:
        return None
    if what == "fixes":
        return np.arange(len(table)) % FOLDS
    t = table["t_s"].to_numpy()
    span = ((t - t[0]) // _SPAN_S[what]).astype(np.int64)
    # The first and the last span always stay: estimators begin and end there.
    part = np.where((span > 0) & (span < span[-1]), (span - 1) % FOLDS, -1)
    return part if span[-1] > FOLDS else None


def _fix_errors(divided: Division, recording: Recording, trajectory: pd.DataFrame, *, anchored: bool) -> pd.DataFrame:
    assert recording.fixes is not None
    at = recording.fixes["t_s"].to_numpy()
    error = values_at(trajectory, "chainage_m", at) - recording.fixes["chainage_m"].to_numpy()
    if not anchored:
        error = error - np.nanmean(error[~divided.rows])
    sd = np.hypot(values_at(trajectory, "chainage_m_sd", at), recording.fixes["chainage_sd_m"].to_numpy())
    return pd.DataFrame({"withheld_fix_m": error, "withheld_fix_m_sd": sd})[divided.rows]


def _position_errors(
    divided: Division, recording: Recording, trajectory: pd.DataFrame, *, anchored: bool
) -> pd.DataFrame:
    """Return errors to the east and to the north under each other; of estimators that know where east is."""
    assert recording.gnss is not None
    assert recording.description.gnss is not None
    fixes = recording.gnss[divided.rows] if anchored else recording.gnss[:0]
    at = partial(values_at, trajectory, t=fixes["t_s"].to_numpy())
    R = matrix_from_rpy(*(at(f"{name}_rad") for name in ("roll", "pitch", "yaw")))
    arm = np.nan_to_num(R) @ np.array(recording.description.gnss.lever_arm_m)
    parts = [
        pd.DataFrame(
            {
                "withheld_position_m": at(f"{axis}_m") + arm[:, i] - fixes[f"{axis}_m"].to_numpy(),
                "withheld_position_m_sd": np.hypot(at(f"{axis}_m_sd"), fixes[f"{axis}_sd_m"].to_numpy()),
            }
        )
        for i, axis in enumerate(("east", "north"))
    ]
    return pd.concat(parts, ignore_index=True)


def _way_errors(divided: Division, recording: Recording, trajectory: pd.DataFrame, *, anchored: bool) -> pd.DataFrame:
    """Return the errors of the distance since the beginning of each span, scaled to the tachometer's over all of it.

    Scale and sense of the wheel, which differ between estimators, therefore do not count.
    """
    assert recording.tach is not None
    t, counted = recording.tach["t_s"].to_numpy(), recording.tach["distance_m"].to_numpy()
    errors = [np.zeros(0)]
    for first, last in true_runs(divided.rows):
        at = np.arange(t[first - 1], t[last], _STEP_S)
        way = np.interp([*at, t[last]], t, counted) - counted[first - 1]
        if abs(way[-1]) >= _LEAST_WAY_M:
            estimated = values_at(trajectory, "chainage_m", np.append(at, t[last]))
            estimated = estimated - estimated[0]
            errors.append((estimated - way * (estimated[-1] / way[-1]))[1:-1])
    error = np.concatenate(errors)
    return pd.DataFrame({"withheld_way_m": error, "withheld_way_m_sd": np.full(error.size, np.nan)})

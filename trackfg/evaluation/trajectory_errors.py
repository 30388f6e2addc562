"""Score a trajectory against the true one: attitude, speed, place along the track, distance, horizontal position.

A chainage that starts anywhere (an odometer knows no kilometre posts) can still measure distances, so that two things
are scored: where the vehicle was estimated to be, and how long each kilometre.
"""

from __future__ import annotations

import numpy as np
import pandas as pd

from trackfg.numerics.arrays import Array
from trackfg.numerics.units import KMH

DISTANCE_M = 1000.0
"""The length of track over which distances are scored."""

_IN_UNITS = {
    "along_track_m": ("chainage_m", 1.0),
    "roll_mrad": ("roll_rad", 1e3),
    "pitch_mrad": ("pitch_rad", 1e3),
    "speed_kmh": ("speed_mps", 1.0 / KMH),
    "east_m": ("east_m", 1.0),
    "north_m": ("north_m", 1.0),
}
"""Name and unit of the error of each column."""


def trajectory_errors(trajectory: pd.DataFrame, truth: pd.DataFrame) -> pd.DataFrame:
    """Return the error of every quantity at each instant that the truth holds, and its sigma ``_sd``: ``t_s``,
    ``speed_mps``, ``along_track_m``, ``roll_mrad, pitch_mrad, speed_kmh, east_m, north_m``.

    ``trajectory`` has :data:`trackfg.results.columns.TRAJECTORY_COLUMNS`, NaN where nothing is estimated; ``truth`` any
    of them, interpolated linearly.
    """
    clock = truth["t_s"].to_numpy()
    trajectory = trajectory[trajectory["t_s"].between(clock[0], clock[-1])]
    t = trajectory["t_s"].to_numpy()
    columns: dict[str, Array] = {"t_s": t, "speed_mps": trajectory["speed_mps"].to_numpy()}
    for name, (column, factor) in _IN_UNITS.items():
        if column in truth:
            true = np.interp(t, clock, truth[column].to_numpy())
            columns[name] = factor * (trajectory[column].to_numpy() - true)
            columns[f"{name}_sd"] = factor * trajectory[f"{column}_sd"].to_numpy()
    return pd.DataFrame(columns)


def values_at(trajectory: pd.DataFrame, column: str, t: Array) -> Array:
    """Return a column of a trajectory at times (m,), s, linear between rows; NaN outside. Yaw is unwrapped."""
    values = trajectory[column].to_numpy(dtype=np.float64)
    if column == "yaw_rad":
        values = np.unwrap(values)
    return np.asarray(np.interp(t, trajectory["t_s"], values, left=np.nan, right=np.nan))


def from_the_true_start(trajectory: pd.DataFrame, truth: pd.DataFrame) -> pd.DataFrame:
    """Return the trajectory with its chainage shifted to be right at its first row: for estimators that only count."""
    first = trajectory.iloc[0]
    shift = np.interp(first["t_s"], truth["t_s"], truth["chainage_m"]) - first["chainage_m"]
    return trajectory.assign(chainage_m=trajectory["chainage_m"] + shift)


def distance_errors(trajectory: pd.DataFrame, truth: pd.DataFrame) -> pd.DataFrame:
    """Return the error of the distance over each whole kilometre of true way, to or fro, from the start: ``speed_mps``,
    the mean speed over it, and ``distance_percent`` of the true distance, whose sigma is not known (NaN).
    """
    clock, chainage = truth["t_s"].to_numpy(), truth["chainage_m"].to_numpy()
    way = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(chainage)))])
    posts = np.arange(0.0, way[-1], DISTANCE_M)
    t = np.interp(posts, way, clock)  # at a rest any of its instants: the chainage is the same
    places = np.interp(t, trajectory["t_s"].to_numpy(), trajectory["chainage_m"].to_numpy(), left=np.nan, right=np.nan)
    true = np.diff(np.interp(t, clock, chainage))
    straight = np.abs(np.abs(true) - DISTANCE_M) < 1.0  # not where the vehicle turned back on the way
    percent = 100.0 * (np.diff(places) - true) / true
    speed = DISTANCE_M / np.diff(t)
    return pd.DataFrame(
        {"speed_mps": speed[straight], "distance_percent": percent[straight], "distance_percent_sd": np.nan}
    )

"""Withhold satellite positions, and score a trajectory at the withheld ones.

The horizontal error at a position is the length of (east, north) of trajectory minus position; its 1-sigma is
``sqrt(sd_east^2 + sd_north^2)``, so that the root mean square of error / sigma is 1 when the sigma is honest.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np
import pandas as pd

from trackfg.evaluation.scores import rms
from trackfg.evaluation.trajectory_errors import values_at
from trackfg.numerics.arrays import Array
from trackfg.numerics.rotations import matrix_from_rpy
from trackfg.numerics.spans import Span


def withhold(gnss: pd.DataFrame, spans: Sequence[Span]) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Return the rows outside all spans, and those inside one of them. ``gnss`` has ``t_s``."""
    t = gnss["t_s"].to_numpy()
    inside = np.zeros(len(t), dtype=bool)
    for start, end in spans:
        inside |= (t >= start) & (t < end)
    return gnss[~inside].reset_index(drop=True), gnss[inside].reset_index(drop=True)


def horizontal_errors(
    trajectory: pd.DataFrame, positions: pd.DataFrame, lever_arm_m: Sequence[float] = (0.0, 0.0, 0.0)
) -> pd.DataFrame:
    """Return error and 1-sigma at each position inside the trajectory's time: ``t_s, error_m, sd_m``.

    ``positions`` has ``t_s, east_m, north_m`` of a point at ``lever_arm_m`` (body axes) from the reference point. The
    trajectory is interpolated linearly, its sigma is that of the reference point.
    """
    clock = trajectory["t_s"].to_numpy()
    positions = positions[positions["t_s"].between(clock[0], clock[-1])]
    t = positions["t_s"].to_numpy()
    at_positions = partial(values_at, trajectory, t=t)
    attitude = matrix_from_rpy(*(at_positions(f"{angle}_rad") for angle in ("roll", "pitch", "yaw")))
    arm = attitude @ np.asarray(lever_arm_m, dtype=np.float64)
    east = at_positions("east_m") + arm[:, 0] - positions["east_m"].to_numpy()
    north = at_positions("north_m") + arm[:, 1] - positions["north_m"].to_numpy()
    sd = np.hypot(at_positions("east_m_sd"), at_positions("north_m_sd"))
    return pd.DataFrame({"t_s": t, "error_m": np.hypot(east, north), "sd_m": sd})


def straight_line_errors(kept: pd.DataFrame, withheld: pd.DataFrame) -> Array:
    """Return horizontal error, m, of what needs no sensor at all: straight lines between the positions that were
    kept.
    """

    def error(column: str) -> Array:
        line: Array = np.interp(withheld["t_s"].to_numpy(), kept["t_s"].to_numpy(), kept[column].to_numpy())
        missed: Array = line - withheld[column].to_numpy()
        return missed

    length: Array = np.hypot(error("east_m"), error("north_m"))
    return length


def score_outages(
    trajectory: pd.DataFrame,
    gnss: pd.DataFrame,
    spans: Sequence[Span],
    lever_arm_m: Sequence[float] = (0.0, 0.0, 0.0),
) -> pd.DataFrame:
    """Return one row per span and a last one for all of them together.

    ``gnss`` holds all positions; those in ``spans`` were withheld from the trajectory. Columns: ``start_s, end_s``
    (empty in the last row), ``positions, rms_m, max_m, mean_sd_m, straight_rms_m``.
    """

    def score(outage: Sequence[Span], start: float, end: float) -> dict[str, float]:
        _, withheld = withhold(gnss, outage)
        errors = horizontal_errors(trajectory, withheld, lever_arm_m)
        return {
            "start_s": start,
            "end_s": end,
            "positions": len(errors),
            "rms_m": rms(errors["error_m"].to_numpy()),
            "max_m": float(errors["error_m"].max()),
            "mean_sd_m": float(errors["sd_m"].mean()),
            "straight_rms_m": rms(straight_line_errors(kept, withheld)),
        }

    kept, _ = withhold(gnss, spans)
    return pd.DataFrame([*(score([span], *span) for span in spans), score(spans, np.nan, np.nan)])

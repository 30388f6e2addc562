"""Drives of the Wheel Inertial Dataset without positions: the smoother's path and dead reckoning's, against GNSS."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from robustness.scores import plan_error
from trackfg.baselines import dead_reckoning
from trackfg.datasets.real import wid
from trackfg.evaluation.scores import rms
from trackfg.numerics.arrays import Array
from trackfg.smoothing.smoother import smooth

TRIALS = ("trial02", "trial04", "trial08", "trial09", "trial10")
"""Those with both rear wheels, but trial06, whose positions jump by metres."""
_MOVES_MPS = 0.2
"""Rows at rest show no path."""
_STEP_S = 0.1
_FIRST_S, _LAST_S = -5.0, 40.0
"""The receiver's record begins so long before the inertial sensors', s."""
_FINE_S = 1.5
"""The shift by which speeds agree best is right to this, s."""
_COVERED = 0.9


@dataclass(frozen=True)
class DriveScore:
    """``smoother_m`` and ``floor_m``: rms of the horizontal error, m, after the turn and the shifts in place and time
    that make it least; ``sigma_m``: the smoother's own of its positions, which have no such fit.
    """

    name: str
    distance_m: float
    smoother_m: float
    floor_m: float
    sigma_m: float


def drive_scores(folder: Path) -> Iterator[DriveScore]:
    """Yield the scores of the trials in a folder."""
    for name in TRIALS:
        run = wid.load(folder / name)
        result = smooth(run.recording)
        trajectory = result.trajectory
        floor = dead_reckoning.run(run.recording).trajectory
        yield DriveScore(
            name=name,
            distance_m=float(result.summary.distance_m or np.nan),
            smoother_m=_error(trajectory, run.reference),
            floor_m=_error(floor, run.reference),
            sigma_m=rms(np.hypot(trajectory["east_m_sd"], trajectory["north_m_sd"])),
        )


def as_table(scores: list[DriveScore]) -> str:
    """Return the scores as a table in Markdown."""
    lines = ["| drive | distance, m | smoother, m | its sigma, m | dead reckoning, m |", "|---|---|---|---|---|"]
    lines += [
        f"| {one.name} | {one.distance_m:.0f} | {one.smoother_m:.2f} | {one.sigma_m:.1f} | {one.floor_m:.2f} |"
        for one in scores
    ]
    both = np.array([[one.smoother_m, one.floor_m] for one in scores])
    lines.append("| all, rms | | {:.2f} | | {:.2f} |".format(*np.sqrt(np.mean(both**2, axis=0))))
    return "\n".join(lines)


def _error(trajectory: pd.DataFrame, reference: pd.DataFrame) -> float:
    moving = trajectory[np.abs(trajectory["speed_mps"]) > _MOVES_MPS]
    t, speed = moving["t_s"].to_numpy(), np.abs(moving["speed_mps"].to_numpy())
    place = moving["east_m"].to_numpy() + 1j * moving["north_m"].to_numpy()
    at, places = reference["t_s"].to_numpy(), reference["east_m"].to_numpy() + 1j * reference["north_m"].to_numpy()
    clock = np.arange(at[0] + 0.5, at[-1] - 0.5, _STEP_S)
    speeds = np.abs(_at(clock + 0.5, at, places) - _at(clock - 0.5, at, places))

    def speeds_apart(shift_s: float) -> float:
        return _mean_square(np.interp(t + shift_s, clock, speeds, left=np.nan, right=np.nan) - speed)

    def error(shift_s: float) -> float:
        true = _at(t + shift_s, at, places)
        known = np.isfinite(true)
        if known.mean() < _COVERED:
            return np.inf
        return rms(plan_error(place[known], true[known]))

    rough = min(np.arange(_FIRST_S, _LAST_S, _STEP_S).tolist(), key=speeds_apart)
    return min(error(shift_s) for shift_s in np.arange(rough - _FINE_S, rough + _FINE_S, 0.05).tolist())


def _at(t: Array, at: Array, places: Array) -> Array:
    """Return places of the complex plane at times ``t``, NaN outside of what is known."""
    return np.asarray(np.interp(t, at, places, left=np.nan, right=np.nan))


def _mean_square(values: Array) -> float:
    known = np.isfinite(values)
    return float(np.mean(values[known] ** 2)) if known.mean() >= _COVERED else np.inf

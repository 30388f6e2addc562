"""What happened on the run: rests, holes in the records, wheel slip and slide, positions used and set aside."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pandas as pd

from trackfg.covariance import Covariance
from trackfg.factors.family import Family
from trackfg.factors.states import Kind, States
from trackfg.graph import Problem
from trackfg.results import EVENT_COLUMNS
from trackfg.spans import true_runs

_Row = tuple[str, float, float, float, float, float, float, str]
"""One event, in the order of the columns."""

_OUTLIER_WEIGHT = 0.5
"""A robust weight below this marks a measurement that the solution does not follow."""


def event_table(problem: Problem, states: States, covariance: Covariance, direction: int) -> pd.DataFrame:
    """Events in order of their start, columns :data:`trackfg.results.EVENT_COLUMNS`."""
    sd = np.sqrt(covariance.of(Kind.ODO)[:, 0, 0])

    def row(
        kind: str, start: float, end: float, detail: str = "", removed: float = np.nan, removed_sd: float = np.nan
    ) -> _Row:
        chainage = direction * np.interp(start, problem.t, states.odo[:, 0])
        return kind, start, end, float(chainage), float(np.interp(start, problem.t, sd)), removed, removed_sd, detail

    rows = [row("standstill", start, end) for start, end in problem.rests]
    rows += [row("imu gap", start, end, "bridged with interpolated samples") for start, end in problem.gaps]
    if problem.wheel is not None:
        rows += [row("tach gap", start, end) for start, end in problem.wheel.gaps]
    wheel = problem.family("tach distance")
    if wheel is not None and wheel.loss is not None:
        for start, end, removed, removed_sd in _slips(problem, wheel, states, covariance):
            rows.append(row("slip" if removed > 0 else "slide", start, end, "", removed, removed_sd))
    for name in ("absolute fix", "landmark", "GNSS position"):
        family = problem.family(name)
        if family is not None:
            rows += _positions(problem, family, states, row)
    rows.sort(key=lambda r: r[1])
    return pd.DataFrame(rows, columns=list(EVENT_COLUMNS))


def _slips(
    problem: Problem, wheel: Family, states: States, covariance: Covariance
) -> list[tuple[float, float, float, float]]:
    """Runs of intervals in which the wheel did not roll: start, end, distance removed and its sigma.

    A slip begins and ends between keyframes: an interval beside an outlier belongs to it if its wheel erred the same
    way by more than its sigma.
    """
    outlier = wheel.weights(states) < _OUTLIER_WEIGHT
    residual, sigma = wheel.residual(states)[:, 0], wheel.sigma[:, 0]
    return [
        (problem.t[i], problem.t[j], float(residual[i:j].sum()), _distance_sd(covariance, int(i), int(j)))
        for way in (1.0, -1.0)
        for i, j in true_runs(way * residual > sigma)
        if outlier[i:j].any()
    ]


def _distance_sd(covariance: Covariance, i: int, j: int) -> float:
    """Sigma of the distance between keyframes i and j: what the wheel's excess over it is known to."""
    cross = covariance.between(i, j)[0, 0]
    variance = covariance.marginal[i, 0, 0] + covariance.marginal[j, 0, 0] - 2.0 * cross
    return float(np.sqrt(max(variance, 0.0)))


def _positions(problem: Problem, family: Family, states: States, row: Callable[..., _Row]) -> list[_Row]:
    """Fixes one by one; GNSS as runs of outliers, since a row per epoch would bury the rest."""
    t = problem.t[family.slots[0].index]
    size = np.linalg.norm(family.residual(states), axis=1)
    outlier = family.weights(states) < _OUTLIER_WEIGHT
    if family.name != "GNSS position":
        what = "fix" if family.name == "absolute fix" else "landmark"
        return [
            row(f"{what} set aside" if bad else f"{what} used", at, at, f"residual {r:.2f} m")
            for at, r, bad in zip(t, size, outlier, strict=True)
        ]
    return [
        row("gnss set aside", t[i], t[j - 1], f"{j - i} positions, residual up to {size[i:j].max():.1f} m")
        for i, j in true_runs(outlier)
    ]

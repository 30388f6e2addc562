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
from trackfg.slip_events import slip_events
from trackfg.spans import true_runs

_Row = tuple[str, float, float, float, float, float, float, str]
"""One event, in the order of the columns."""

_OUTLIER_WEIGHT = 0.5
"""A robust weight below this marks a measurement that the solution does not follow."""


def event_table(
    problem: Problem, states: States, covariance: Covariance, trajectory: pd.DataFrame, direction: int
) -> pd.DataFrame:
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
    for event in slip_events(problem, states, covariance, trajectory, direction):
        rows.append(
            row(
                "slip" if event.removed_m > 0 else "slide",
                event.start_s,
                event.end_s,
                "",
                event.removed_m,
                event.removed_m_sd,
            )
        )
    for name in ("absolute fix", "landmark", "GNSS position"):
        family = problem.family(name)
        if family is not None:
            rows += _positions(problem, family, states, row)
    rows.sort(key=lambda r: r[1])
    return pd.DataFrame(rows, columns=list(EVENT_COLUMNS))


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
